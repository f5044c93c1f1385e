"""The JSON Schemas of what --json prints and of the files that people write (configs/schema)."""

import json
import os
import pathlib

import jsonschema

FOLDER = pathlib.Path(os.environ.get("MYOGRADE_TEST_SOURCE", pathlib.Path(__file__).parents[2])) / "configs/schema"


def validator(name):
    """References between the schemas are relative to their folder."""
    path = FOLDER / f"{name}.json"
    schema = json.loads(path.read_text(encoding="utf-8"))
    return jsonschema.Draft202012Validator(schema, resolver=jsonschema.RefResolver(path.as_uri(), schema))


def validate(value, name):
    """Raises jsonschema.ValidationError."""
    validator(name).validate(value)
