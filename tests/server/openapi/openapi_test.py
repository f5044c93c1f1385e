"""The OpenAPI document describes exactly the addresses that the daemon has, with the roles that they
need and the codes that README.md lists."""

import json
import re
import sys
import unittest

import jsonschema

from world import BIN, SOURCE, World

sys.path.append(str(SOURCE / "server/api/openapi"))
from bundle import resolved  # noqa: E402

METHODS = ("get", "post", "put", "patch", "delete")
BUILT = BIN.parent / "openapi.json"
STANDARD = jsonschema.Draft202012Validator
# Whose values are schemas by name, and those whose schemas are of a part of an object.
BY_NAME = ("properties", "patternProperties", "dependentSchemas")
OF_PARTS = ("allOf", "if", "then", "else", "not")


def operations(document):
    for path, item in document["paths"].items():
        for method in METHODS:
            if method in item:
                yield method.upper(), path, item, item[method]


def unless_shortened(keyword):
    """The check of a keyword, which what an example shortens by `…` passes."""
    def check(validator, value, instance, schema):
        if not (isinstance(instance, (str, dict)) and "…" in instance):
            yield from STANDARD.VALIDATORS[keyword](validator, value, instance, schema)
    return check


Shortened = jsonschema.validators.extend(
    STANDARD, {keyword: unless_shortened(keyword) for keyword in ("required", "pattern")})


def plain(path):
    """A path as /v1/addresses writes it and the document does, with * for what differs."""
    return re.sub(r"\b(ID|HASH|NAME)\b|\{\w+\}", "*", path)


class Document(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.world = World()
        cls.addClassCleanup(cls.world.close)
        cls.world.start()
        cls.document = cls.world.get("/v1/openapi.json")

    def test_it_has_the_addresses_of_the_daemon_and_no_others(self):
        addresses = self.world.get("/v1/addresses")["addresses"]
        there = {(one["method"], plain(one["path"])): one["role"] for one in addresses}
        for one in addresses:
            self.assertEqual(one["own_team"], one["role"] == "participant", one)
        described = {(method, plain(path)): operation["x-role"]
                     for method, path, _, operation in operations(self.document)}
        self.assertEqual(sorted(described), sorted(there))
        self.assertEqual(described, there)

    def test_each_operation_has_what_its_users_need(self):
        names = set()
        used, tags = set(), {tag["name"] for tag in self.document["tags"]}
        for method, path, item, operation in operations(self.document):
            with self.subTest(f"{method} {path}"):
                self.assertNotIn(operation["operationId"], names)
                names.add(operation["operationId"])
                used |= set(operation["tags"])
                self.assertTrue(operation["summary"])
                parameters = [self.resolved(parameter) for parameter in
                              item.get("parameters", []) + operation.get("parameters", [])]
                in_path = {one["name"] for one in parameters if one["in"] == "path"}
                self.assertEqual(in_path, set(re.findall(r"\{(\w+)\}", path)))
                for parameter in parameters:
                    self.assertTrue(parameter["description"])
                self.assertTrue(any(code.startswith("2") for code in operation["responses"]))
                for code in ("400", "401", "403", "404", "405", "429", "500", "503"):
                    self.assertIn(code, operation["responses"])
                self.assertEqual("requestBody" in operation, method == "POST")
        self.assertEqual(used, tags)

    def test_its_schemas_are_schemas_and_fit_their_examples(self):
        schemas = self.document["components"]["schemas"]
        jsonschema.Draft202012Validator.check_schema({"$defs": schemas})
        bodies = 0
        for method, path, _, operation in operations(self.document):
            content = self.resolved(operation.get("requestBody", {})).get("content", {})
            if "application/json" in content and path != "/v1/import":
                schema = self.resolved(content["application/json"]["schema"])
                with self.subTest(f"{method} {path}"):
                    for example in schema.get("examples", []):
                        STANDARD({**self.document, **schema}).validate(example)
                    self.assertTrue(schema["examples"])
                    bodies += 1
        self.assertGreater(bodies, 20)

    def closed(self, schema, of_part=False):
        """A schema with what it refers to, that takes no keys but those it names, and `…`."""
        if isinstance(schema, list):
            return [self.closed(entry, of_part) for entry in schema]
        if not isinstance(schema, dict):
            return schema
        made = {key: {name: self.closed(entry) for name, entry in value.items()} if key in BY_NAME else
                     self.closed(value, of_part or key in OF_PARTS) for key, value in self.resolved(schema).items()}
        if "properties" in made:
            made["properties"]["…"] = True
        if not of_part and {"properties", "allOf"} & set(made) and "additionalProperties" not in made:
            made["unevaluatedProperties"] = False
        return made

    def test_examples_of_answers_have_the_keys_and_types_of_the_schemas(self):
        checked = 0
        for method, path, _, operation in operations(self.document):
            # An example is of a success; that of /v1/ready is of its other answer.
            answers = [self.resolved(answer) for code, answer in operation["responses"].items()
                       if code.startswith("2") or path == "/v1/ready"]
            schema = {"anyOf": [self.closed(answer["content"]["application/json"]["schema"]) for answer in answers
                                if "application/json" in answer.get("content", {})]}
            for example in re.findall(r"^```json\n(.*?)^```$", operation.get("description", ""), re.M | re.S):
                with self.subTest(f"{method} {path}", example=example):
                    error = jsonschema.exceptions.best_match(Shortened(schema).iter_errors(json.loads(example)))
                    self.assertIsNone(error)
                    checked += 1
        self.assertGreater(checked, 30)

    def test_its_codes_are_those_of_the_readme(self):
        readme = (SOURCE / "server/api/README.md").read_text(encoding="utf-8")
        table = readme.split("## Errors")[1].split("\n## ")[0]
        rows = re.findall(r"^\| [\d, ]+\| (.*?) \|", table, re.MULTILINE)
        listed = {code for row in rows for code in re.findall(r"`(\w+)`", row)}
        self.assertEqual(set(self.document["components"]["schemas"]["ErrorCode"]["enum"]), listed)

    def test_what_is_installed_is_what_is_served(self):
        self.assertEqual(json.loads(BUILT.read_text(encoding="utf-8")), self.document)
        self.assertEqual(self.document["info"]["version"], self.world.get("/v1/health")["version"])

    def resolved(self, value):
        return resolved(self.document, value)


if __name__ == "__main__":
    unittest.main(verbosity=2)
