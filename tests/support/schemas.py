"""The JSON Schemas of what --json prints and of the files that people write (configs/schema)."""

import json
import pathlib

import jsonschema

FOLDER = pathlib.Path(__file__).resolve().parents[2] / "configs/schema"


def validate(value, name):
    """Raises jsonschema.ValidationError. References between the schemas are relative to their folder."""
    path = FOLDER / f"{name}.json"
    schema = json.loads(path.read_text(encoding="utf-8"))
    resolver = jsonschema.RefResolver(path.as_uri(), schema)
    jsonschema.Draft202012Validator(schema, resolver=resolver).validate(value)
