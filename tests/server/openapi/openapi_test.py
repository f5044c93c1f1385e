"""The OpenAPI document describes exactly the addresses that the daemon has, with the roles that they
need and the codes that README.md lists."""

import json
import re
import unittest

import jsonschema

from world import BIN, SOURCE, World

METHODS = ("get", "post", "put", "patch", "delete")
BUILT = BIN.parent / "openapi.json"


def operations(document):
    for path, item in document["paths"].items():
        for method in METHODS:
            if method in item:
                yield method.upper(), path, item, item[method]


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
        described = {(method, plain(path)): operation["x-role"]
                     for method, path, _, operation in operations(self.document)}
        self.assertEqual(sorted(described), sorted(there))
        self.assertEqual(described, there)

    def test_each_operation_has_what_its_users_need(self):
        names = set()
        tags = {tag["name"] for tag in self.document["tags"]}
        for method, path, item, operation in operations(self.document):
            with self.subTest(f"{method} {path}"):
                self.assertNotIn(operation["operationId"], names)
                names.add(operation["operationId"])
                self.assertLessEqual(set(operation["tags"]), tags)
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

    def test_its_schemas_are_schemas_and_fit_their_examples(self):
        schemas = self.document["components"]["schemas"]
        jsonschema.Draft202012Validator.check_schema({"$defs": schemas})
        examples = 0
        for name, schema in schemas.items():
            whole = {**self.document, **schema}
            for example in schema.get("examples", []):
                with self.subTest(name):
                    jsonschema.Draft202012Validator(whole).validate(example)
                    examples += 1
        self.assertGreater(examples, 10)

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
        target = value.get("$ref")
        if target is None:
            return value
        found = self.document
        for word in target.split("/")[1:]:
            found = found[word]
        return found


if __name__ == "__main__":
    unittest.main(verbosity=2)
