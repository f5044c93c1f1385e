#!/usr/bin/python3
"""Makes the API's OpenAPI document of the parts in this folder.

bundle.py VERSION OUT.json OUT.cc: the document, and the same as a C++ source with its text
(document.h). The parts are OpenAPI objects, which are put together key by key; the operations of
paths/NAME.json have the tag Name. Descriptions of the whole, of tags and of operations are the text of ../README.md,
and of the sections of ../ADDRESSES.md. Three things stand for something else:

  {"$ref": "FILE#POINTER"}  a schema of another file, relative to the part: its content replaces it,
                            and with it whatever that file's schema refers to in its own file
  "x-errors"                in base.json: answers that tell of an error, without their content
  "x-answers"               in base.json: answers that operations have without naming them: "all"
                            have these, and "body" those with a body as well; they stay in the document

A reference that leads nowhere, a key that two parts have and a section of no operation are mistakes; exit status 1.
"""

import json
import pathlib
import re
import sys

HERE = pathlib.Path(__file__).resolve().parent
METHODS = {"get", "put", "post", "delete", "patch"}
CHUNK = 8000  # characters of one string literal
SECTION = re.compile(r"^(##|###) (.+)\n((?:(?!##).*\n)*)", re.MULTILINE)


class Mistake(Exception):
    """A part that can't be used."""


def text_of(path):
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise Mistake(f"{path}: {error}") from None


def load(path):
    try:
        return json.loads(text_of(path))
    except ValueError as error:
        raise Mistake(f"{path}: {error}") from None


def look_up(document, pointer, where):
    """The value at a JSON pointer."""
    value = document
    for word in pointer.split("/")[1:]:
        word = word.replace("~1", "/").replace("~0", "~")
        try:
            value = value[int(word) if isinstance(value, list) else word]
        except (KeyError, ValueError, IndexError):
            raise Mistake(f"{where}: there is no {pointer}") from None
    return value


def inline(value, file, own_refs=False):
    """`value` of `file` with each reference to another file replaced by what it names. `own_refs`:
    references within the file too, as the file is not part of the document."""
    if isinstance(value, list):
        return [inline(entry, file, own_refs) for entry in value]
    if not isinstance(value, dict):
        return value
    target = value.get("$ref")
    if isinstance(target, str) and (own_refs or not target.startswith("#")):
        name, _, pointer = target.partition("#")
        other = (file.parent / name).resolve() if name else file
        found = inline(look_up(load(other), pointer, f"{file.name}: {target}"), other, True)
        rest = {key: inline(entry, file, own_refs) for key, entry in value.items() if key != "$ref"}
        return {**{key: entry for key, entry in found.items()
                   if key not in ("$schema", "$defs", "title")}, **rest}
    return {key: inline(entry, file, own_refs) for key, entry in value.items()}


def merge(into, part, where):
    for key, value in part.items():
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            merge(into[key], value, f"{where}: {key}")
        elif key in into:
            raise Mistake(f"{where}: {key} is in another part too")
        else:
            into[key] = value


def add_errors(document):
    error = {"schema": {"$ref": "#/components/schemas/Error"}}
    for name, answer in document.pop("x-errors").items():
        document["components"]["responses"][name] = {**answer,
                                                     "content": {"application/json": error}}


def resolved(document, value):
    """What a reference names in the document, under what stands beside the reference."""
    while "$ref" in value:
        found = document
        for word in value["$ref"].split("/")[1:]:
            found = found[word]
        value = {**found, **{key: entry for key, entry in value.items() if key != "$ref"}}
    return value


def operations(document):
    """Triples of each operation: method, path, and the operation itself."""
    for path, item in document.get("paths", {}).items():
        for method in METHODS & set(item):
            yield method.upper(), path, item[method]


def add_answers(document):
    answers = document["x-answers"]
    for _, _, operation in operations(document):
        common = {**answers["all"], **(answers["body"] if "requestBody" in operation else {})}
        own = {code: answer for code, answer in operation["responses"].items() if answer}
        operation["responses"] = dict(sorted({**common, **own}.items()))


def add_texts(document):
    """Tags, and the descriptions of the whole and of operations."""
    document["info"]["description"] = text_of(HERE.parent / "README.md").partition("\n")[2].strip()
    document["tags"] = []
    by_name = {f"`{method} {path}`": operation for method, path, operation in operations(document)}
    for level, title, text in SECTION.findall(text_of(HERE.parent / "ADDRESSES.md")):
        if level == "##":
            document["tags"].append({"name": title, "description": text.strip()})
            continue
        operation = by_name.get(title)
        if operation is None or operation["tags"] != [document["tags"][-1]["name"]]:
            raise Mistake(f"ADDRESSES.md: {document['tags'][-1]['name']} has no {title}")
        operation["description"] = text.strip()


def check_refs(value, document):
    """References within the document lead somewhere."""
    if isinstance(value, list):
        for entry in value:
            check_refs(entry, document)
    elif isinstance(value, dict):
        target = value.get("$ref")
        if isinstance(target, str):
            look_up(document, target.removeprefix("#"), target)
        for entry in value.values():
            check_refs(entry, document)


def bundle(version):
    """The document of a program of this version."""
    document = {}
    for file in sorted(HERE.rglob("*.json")):
        part = inline(load(file), file)
        for _, _, operation in operations(part):
            operation["tags"] = [file.stem.capitalize()]
        merge(document, part, file.name)
    document["info"]["version"] = version
    add_errors(document)
    add_answers(document)
    add_texts(document)
    check_refs(document, document)
    return document


def source_of(text):
    """C++ whose OpenApiDocument() returns `text`, which is ASCII."""
    pieces = [text[i:i + CHUNK] for i in range(0, len(text), CHUNK)]
    literals = "\n".join(f'         R"json({piece})json"' for piece in pieces)
    return ('#include "server/api/openapi/document.h"\n\nnamespace myograde::server {\n\n'
            f'std::string_view OpenApiDocument() {{\n  return ""\n{literals};\n}}\n\n'
            "}  // namespace myograde::server\n")


def main():
    version, json_file, source_file = sys.argv[1:]
    text = json.dumps(bundle(version), separators=(",", ":"), sort_keys=True) + "\n"
    pathlib.Path(json_file).write_text(text, encoding="utf-8")
    pathlib.Path(source_file).write_text(source_of(text), encoding="utf-8")


if __name__ == "__main__":
    try:
        main()
    except Mistake as mistake:
        sys.exit(f"bundle.py: {mistake}")
