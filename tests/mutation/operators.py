"""Mutants that nobody wrote: each operator, constant and decision of a file changed once, by text.

They are of whole folders (AREAS), too many for one run, so run.py takes every Nth of them. What survives and
changes nothing that anybody could see is listed in equal.json with the reason."""

import json
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
HERE = pathlib.Path(__file__).resolve().parent
# Folder -> the test program that must notice.
AREAS = {"scoring": "scoring_test", "server/scheduler": "scheduler_test"}
CHANGES = [(re.compile(pattern), instead) for pattern, instead in (
    (r" < ", " <= "), (r" <= ", " < "), (r" > ", " >= "), (r" >= ", " > "),
    (r" == ", " != "), (r" != ", " == "), (r" && ", " || "), (r" \|\| ", " && "),
    (r" \+ ", " - "), (r" - ", " + "), (r" \* ", " / "), (r" / ", " * "),
    (r"\+\+", "--"), (r"\+= ", "-= "), (r"-= ", "+= "),
    (r"\breturn true;", "return false;"), (r"\breturn false;", "return true;"),
    (r"\bcontinue;", "break;"), (r"\bstd::min\b", "std::max"), (r"\bstd::max\b", "std::min"),
    (r"\bif \((?=[a-z!])(?!constexpr)", "if (!("),
)]
STRING = re.compile(r'"(?:[^"\\]|\\.)*"')


def of_line(line):
    """The line, changed at one place in each way."""
    code = line.split("//")[0]
    if not code.strip() or code.lstrip().startswith(("#", "template", "using", "static_assert")):
        return
    strings = [match.span() for match in STRING.finditer(code)]
    for pattern, instead in CHANGES:
        for match in pattern.finditer(code):
            if any(begin < match.end() and match.start() < end for begin, end in strings):
                continue
            changed = code[:match.start()] + instead + code[match.end():]
            if instead == "if (!(":
                changed = negated(code, match)
            if changed:
                yield changed


def negated(code, match):
    """An if whose condition ends on its line, with the condition negated; None otherwise."""
    depth = 1
    for at in range(match.end(), len(code)):
        depth += {"(": 1, ")": -1}.get(code[at], 0)
        if depth == 0:
            condition = code[match.end():at]
            return None if ";" in condition else f"{code[:match.end()]}!({condition}){code[at:]}"
    return None


def all_mutants():
    """(test program, file, number of the line, the line, what stands in its place), in a fixed order."""
    equal = {tuple(entry[:3]) for entry in json.loads((HERE / "equal.json").read_text(encoding="utf-8"))}
    for area, program in AREAS.items():
        for file in sorted((ROOT / area).rglob("*.cc")):
            name = file.relative_to(ROOT).as_posix()
            for number, line in enumerate(file.read_text(encoding="utf-8").split("\n")):
                for changed in of_line(line):
                    if (name, line.strip(), changed.strip()) not in equal:
                        yield program, name, number, line, changed


def sample(every, first=0):
    return list(all_mutants())[first::every]
