"""The page of the API's addresses, made of its OpenAPI document (server/api/openapi)."""

import json

from markdown.extensions.toc import slugify

from bundle import operations, resolved

ROLES = {"public": "everybody", "participant": "participants, of their own teams", "organiser": "organisers",
         "operator": "operators"}
KINDS = {"boolean": "`true` or `false`", "array": "a list", "object": "an object", "string": ""}
LARGEST = 2**63 - 1
LONG_LINE = 80


def table(head, rows):
    """A table in Markdown with an empty line below it, or nothing without rows."""
    if not rows:
        return []
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |"
            for line in (head, ["---"] * len(head), *rows)] + [""]


class Page:
    def __init__(self, document):
        self.document = document
        self.operations = sorted(((path, method, operation) for method, path, operation in operations(document)),
                                 key=lambda one: one[:2])

    def resolved(self, value):
        return resolved(self.document, value)

    def row(self, name, notes, meaning, schema):
        """A parameter or key: its name with notes; what it means and which values it takes."""
        if "enum" in schema or "const" in schema:
            known = [f"`{value}`" for value in schema.get("enum", [schema.get("const")])]
            values = "" if all(value in meaning for value in known) else ", ".join(known)
        elif "minimum" in schema:
            values = f"{schema['minimum']} to {schema['maximum']:,}" if schema.get("maximum", LARGEST) < LARGEST else \
                f"from {schema['minimum']} on"
        else:
            values = KINDS[schema["type"]]
        default = f"default `{json.dumps(schema['default']).strip(chr(34))}`" if "default" in schema else ""
        words = "; ".join(filter(None, (values, default)))
        return [f"`{name}`" + (f" ({', '.join(notes)})" if notes else ""),
                " ".join(filter(None, (meaning, words and words[0].upper() + words[1:] + ".")))]

    def parameters(self, parameters):
        return table(["parameter", "meaning"], [
            self.row(one["name"], [one["in"]] * (one["in"] == "header") +
                     ["required"] * (one["in"] != "path" and one.get("required", False)), one["description"],
                     self.resolved(one["schema"])) for one in map(self.resolved, parameters)])

    def body(self, body):
        content = self.resolved(body)["content"]
        schema = self.resolved(content.get("application/json", {}).get("schema", {}))
        if "properties" not in schema:
            return ["Body: " + ("`{}`" if schema else ", ".join(f"`{kind}`" for kind in content)) + ".", ""]
        rows = []
        for name, value in schema["properties"].items():
            value = self.resolved(value)
            notes = ["required"] * (name in schema.get("required", ()))
            rows.append(self.row(name, notes, value.get("description", ""), value))
        lines = [*table(["key of the body", "meaning"], rows), schema.get("description", ""), ""]
        for example in schema.get("examples", []):
            text = json.dumps(example, ensure_ascii=False)
            if len(text) > LONG_LINE:
                text = json.dumps(example, ensure_ascii=False, indent=2)
            lines += ["For example:", "", "```json", text, "```", ""]
        return lines

    def answers(self, operation):
        """Those that not every address has."""
        common = {**self.document["x-answers"]["all"], **self.document["x-answers"]["body"]}
        lines = []
        for code, answer in operation["responses"].items():
            if answer != common.get(code):
                answer = self.resolved(answer)
                kinds = [f" (`{kind}`)" for kind in answer.get("content", {}) if kind != "application/json"]
                lines.append(f"- {code}{''.join(kinds)}: {answer['description']}")
        return ["Answers:", "", *lines, ""]

    def text(self, head):
        """The page, which begins with `head`."""
        def name(path, method):
            return f"`{method} {path}`"

        lines = [head.strip(), ""]
        for role, whom in ROLES.items():
            lines += table([f"for {whom}", "what it does"], [
                [f"[{name(path, method)}](#{slugify(name(path, method), '-')})", operation["summary"]]
                for path, method, operation in self.operations if operation["x-role"] == role])
        for tag in self.document["tags"]:
            lines += [f"## {tag['name']}", "", tag["description"], ""]
            for path, method, operation in self.operations:
                if operation["tags"] == [tag["name"]]:
                    lines += [f"### {name(path, method)}", "",
                              f"**{operation['summary']}.** For {ROLES[operation['x-role']]}.", "",
                              *self.parameters([*self.document["paths"][path].get("parameters", []),
                                                *operation.get("parameters", [])]),
                              *(self.body(operation["requestBody"]) if "requestBody" in operation else []),
                              operation.get("description", ""), "", *self.answers(operation)]
        return "\n".join(lines) + "\n"
