#!/usr/bin/env python3
"""Holds the track configs, their JSON Schema and their documentation together: every file
fits the schema, the schema has exactly the keys that the files have, configs/README.md has a
row for each key with its default, and its tables of differences between the profiles say what
the files say. Prints one line per mistake; exit status 1 if there is one.
Use: track_docs.py ROOT"""

import copy
import json
import pathlib
import re
import sys

try:
    import jsonschema
except ImportError:
    sys.exit("the Python package jsonschema is missing; install Debian's python3-jsonschema")

TRACKS = ("manipulation", "locomotion")  # with tables of the whole config in configs/README.md
OTHERS = ("elbow", "reorientation", "baoding", "relocation", "chasetag")  # with tables of their own: the rules in sim/<track>/README.md
SECTIONS = ("budgets", "rules", "scoring")
# Values that are leaves of a config although they are objects.
WHOLE = {"seeds", "practice_seeds"}
# The prosthesis' parameter sets have a table of their own; elsewhere only their number stands.
SETS = "rules.leg.parameter_sets"


def merged(base, patch):
    """RFC 7386."""
    if not isinstance(patch, dict):
        return copy.deepcopy(patch)
    result = copy.deepcopy(base) if isinstance(base, dict) else {}
    for key, value in patch.items():
        if value is None:
            result.pop(key, None)
        else:
            result[key] = merged(result.get(key), value)
    return result


def leaves(value, path=""):
    """{"rules.field.rows": 600, ...} without comments."""
    if not isinstance(value, dict) or path in WHOLE:
        return {path: value}
    found = {}
    for key, child in value.items():
        if not key.startswith("//"):
            found.update(leaves(child, f"{path}.{key}" if path else key))
    return found


def effective(config):
    """Profile -> leaves of what is in force in it."""
    base = {k: v for k, v in config.items()
            if k not in ("profiles", "default_profile", "track", "form")}
    profiles = {name: leaves(merged(base, patch)) for name, patch in config["profiles"].items()
                if not name.startswith("//")}
    for found in profiles.values():
        if SETS in found:
            found[SETS] = len(found[SETS])
    return profiles


def number(value):
    return f"{value:g}"


def check_sets(rows, sets):
    """One row for each state of each set: its number and name, the state, knee and ankle as
    stiffness, damping and target, and what leaves it."""
    expected = []
    for index, chosen in enumerate(sets):
        for state in ("e_stance", "l_stance", "e_swing", "l_swing"):
            said = chosen[state]
            joints = [", ".join(number(said[joint][key])
                                for key in ("stiffness", "damping", "target_deg"))
                      for joint in ("knee", "ankle")]
            until = ", ".join(f"`{key}` {number(value)}"
                              for key, value in sorted(said["until"].items()))
            expected.append([f"{index} {chosen['name']}", f"`{state}`", *joints, until])
    got = [row[:5] for row in rows]
    for want in expected:
        if want not in got:
            yield f'"Parameter sets of the prosthesis" has no row {" | ".join(want)}'
    if len(got) != len(expected):
        yield f'"Parameter sets of the prosthesis" has {len(got)} rows, must have {len(expected)}'
    for row in rows:
        if len(row) != 6 or not row[5]:
            yield (f'"Parameter sets of the prosthesis": {row[0]} {row[1]} does not say where it '
                   'is from')


def schema_keys(schema, node, path):
    """Paths of the leaves that a schema's object allows."""
    node = schema["$defs"][node["$ref"].split("/")[-1]] if "$ref" in node else node
    if "properties" not in node:
        return {path}
    return set().union(*(schema_keys(schema, child, f"{path}.{key}")
                         for key, child in node["properties"].items()))


def tables(text):
    """Heading -> its table's rows, each a list of cells."""
    found, heading = {}, ""
    for line in text.splitlines():
        if line.startswith("#"):
            heading = line.lstrip("#").strip()
        elif line.startswith("|") and not re.match(r"\|[-|: ]+\|$", line):
            found.setdefault(heading, []).append([c.strip() for c in line.strip("|").split("|")])
    return {name: rows[1:] for name, rows in found.items()}


def values(cell):
    """The JSON values in a cell's code spans; a span that is not JSON is a string."""
    found = []
    for span in re.findall(r"`([^`]*)`", cell):
        try:
            found.append(json.loads(span))
        except ValueError:
            found.append(span)
    return found


def rows_by_key(rows):
    return {re.sub(r"^`|`$", "", row[0]): row for row in rows}


def check_rows(heading, rows, expected):
    """`expected`: key -> [(column, allowed values of the cell)]. Rows and keys must agree."""
    by_key = rows_by_key(rows)
    if len(by_key) != len(rows):
        yield f'"{heading}" names a key twice'
    for key in sorted(set(expected) - set(by_key)):
        yield f'"{heading}" has no row for `{key}`'
    for key in sorted(set(by_key) - set(expected)):
        yield f'"{heading}" has a row for `{key}`, which should not be there'
    for key in sorted(set(expected) & set(by_key)):
        row = by_key[key]
        if any(not cell for cell in row):
            yield f'"{heading}": the row for `{key}` has an empty cell'
        for column, wanted in expected[key]:
            got = values(row[column])
            if {json.dumps(v) for v in got} != {json.dumps(v) for v in wanted}:
                yield f'"{heading}": `{key}` has {row[column]}, the config has {wanted}'


def check_key_tables(found, defaults):
    """`defaults`: track -> leaves of its default profile."""
    for heading, section, tracks in (
            ("Budgets", "budgets", TRACKS), ("Scoring", "scoring", TRACKS),
            ("Rules of manipulation", "rules", TRACKS[:1]),
            ("Rules of locomotion", "rules", TRACKS[1:])):
        expected = {}
        for track in tracks:
            for path, value in defaults[track].items():
                if path.startswith(section + "."):
                    wanted = expected.setdefault(path.split(".", 1)[1], [(-1, [])])[0][1]
                    wanted.append(value)
        if section == "rules":  # keys that only other profiles have
            for path in defaults[tracks[0] + "/all"]:
                if path.startswith("rules."):
                    expected.setdefault(path.split(".", 1)[1], [(-1, [])])
        yield from check_rows(heading, found.get(heading, []), expected)


def check_differences(heading, rows, profiles):
    names = ["paper"] + sorted((n for n in profiles if n != "paper"), reverse=True)
    expected = {}
    for path in set().union(*profiles.values()):
        cells = [profiles[name].get(path) for name in names]
        if any(cell != cells[0] for cell in cells):
            expected[path] = [(column, [] if cell is None else [cell])
                              for column, cell in enumerate(cells, 1)]
    yield from check_rows(heading, rows, expected)


def check_schema_refuses(validator, good):
    """The schema must be able to say no: one break of the config at a time."""
    bad = {"unknown key": {"seed": 1}, "no limit": {"budgets": {"tasks": 0}},
           "unknown limit": {"budgets": {"task": 4}}, "negative": {"budgets": {"step_s": -1}},
           "fraction": {"episodes_per_lease": 1.5}, "word": {"default_profile": "Paper"},
           "profile's key": {"profiles": {"paper": {"track": "locomotion"}}},
           "unknown rule": {"rules": {"gravity": 9.81}}, "no seeds": {"seeds": []},
           "practice of none": {"practice_seeds": {"first": 3, "count": 0}},
           "unknown board": {"scoring": {"boards": {"third": {}}}}}
    for what, patch in bad.items():
        if validator.is_valid(merged(good, patch)):
            yield f"configs/schema/track.json accepts a config with a mistake: {what} {patch}"
        if validator.is_valid({"extends": "x", **patch}):
            yield f"configs/schema/track.json accepts an extension with a mistake: {what} {patch}"


def check_other(root, track, config, found, validator, schema):
    """A track whose profiles stand side by side in one table of rules and one of scoring."""
    yield from check_schema_refuses(validator, config)
    profiles = effective(config)
    names = [config["default_profile"]] + sorted(set(profiles) - {config["default_profile"]})
    rules = tables((root / f"sim/{track}/README.md").read_text()).get("Rules", [])
    for section, heading, rows, first in (("rules", "Rules", rules, 3),
                                          ("scoring", f"The track {track}",
                                           found.get(f"The track {track}", []), 3)):
        expected = {}
        for path in set().union(*profiles.values()):
            key = path.removeprefix(section + ".")
            if key == path or (section == "scoring" and key not in rows_by_key(rows)):
                continue  # what it shares with the other tracks stands there
            expected[key] = [(first + i, [profiles[name][path]] if path in profiles[name] else [])
                             for i, name in enumerate(names)]
        yield from check_rows(heading, rows, expected)
    everything = set().union(*profiles.values())
    for section in ("rules", "scoring"):
        allowed = schema_keys(schema, schema["$defs"][f"{track}_{section}"], section)
        used = {path for path in everything if path.startswith(section + ".")}
        for path in sorted(allowed ^ used):
            yield f"{track}: {path} is in only one of configs/schema/track.json and the config"


def check(root):
    schema = json.loads((root / "configs/schema/track.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    configs = {path.stem: json.loads(path.read_text())
               for path in sorted((root / "configs/tracks").glob("*.json"))}
    for name, config in configs.items():
        for error in validator.iter_errors(config):
            place = ".".join(str(part) for part in error.absolute_path)
            yield f"configs/tracks/{name}.json: {place}: {error.message}"
    found = tables((root / "configs/README.md").read_text())
    defaults = {}
    for track in TRACKS:
        yield from check_schema_refuses(validator, configs[track])
        profiles = effective(configs[track])
        defaults[track] = profiles[configs[track]["default_profile"]]
        everything = set().union(*profiles.values())
        defaults[track + "/all"] = everything
        for section in SECTIONS:
            node = schema["$defs"]["budgets" if section == "budgets" else f"{track}_{section}"]
            allowed = schema_keys(schema, node, section)
            used = {path for path in everything if path.startswith(section + ".")}
            for path in sorted(allowed ^ used):
                yield f"{track}: {path} is in only one of configs/schema/track.json and the config"
        heading = f"Differences on the {track} track"
        yield from check_differences(heading, found.get(heading, []), profiles)
    for track in OTHERS:
        yield from check_other(root, track, configs[track], found, validator, schema)
    yield from check_key_tables(found, defaults)
    paper = merged(configs["locomotion"], configs["locomotion"]["profiles"]["paper"])
    yield from check_sets(found.get("Parameter sets of the prosthesis", []),
                          paper["rules"]["leg"]["parameter_sets"])


def main():
    mistakes = list(check(pathlib.Path(sys.argv[1]).resolve()))
    print("\n".join(mistakes) or "track configs, schema and tables agree")
    return 1 if mistakes else 0


if __name__ == "__main__":
    sys.exit(main())
