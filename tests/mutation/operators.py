"""Mutants that nobody wrote: each operator, constant, statement and decision of a file changed once, by text.

They are of whole folders (AREAS). What survives and changes nothing that anybody could see is listed in equal.json
with the reason."""

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
)]
STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
IF = re.compile(r"\bif \((?!constexpr)")
# A whole number by itself: no part of a name or of a fraction. (Of exponents only the negative ones.)
NUMBER = re.compile(r"(?<![\w.'])\d+(?![\w.'])")
# A call, an assignment, or a count, alone on its line.
STATEMENT = re.compile(r"(?:(?:[\w:.\[\]]|->|\(\))+\(.*\)|(?:[\w.\[\]*]|->)+ [-+*/|]?= .*|\+\+.*|--.*);$")
NO_STATEMENT = re.compile(r"(?:return|throw|else|case|delete)\b")


def of_line(line):
    """The line, changed at one place in each way."""
    code = line.split("//")[0]
    if not code.strip() or code.lstrip().startswith(("#", "template", "using", "static_assert")):
        return
    strings = [match.span() for match in STRING.finditer(code)]

    def places(pattern):
        return (match for match in pattern.finditer(code)
                if not any(begin < match.end() and match.start() < end for begin, end in strings))

    for pattern, instead in CHANGES:
        for match in places(pattern):
            yield code[:match.start()] + instead + code[match.end():]
    for match in places(NUMBER):
        yield code[:match.start()] + str(int(match.group()) + 1) + code[match.end():]
    for match in places(IF):
        yield from decisions(code, match.end())
    indent, text = code[:len(code) - len(code.lstrip())], code.strip()
    if indent and STATEMENT.match(text) and not NO_STATEMENT.match(text) and balanced(text):
        yield indent + ";"


def decisions(code, begin):
    """An if whose condition ends on its line, with the condition negated, and, if the line has all of it, never
    taken."""
    depth = 1
    for at in range(begin, len(code)):
        depth += {"(": 1, ")": -1}.get(code[at], 0)
        if depth:
            continue
        condition, rest = code[begin:at], code[at:]
        # What comes before a ";" in a condition is its declaration.
        declared, semicolon, condition = condition.rpartition(";")
        yield f"{code[:begin]}{declared}{semicolon}!({condition}){rest}"
        if rest.rstrip().endswith(";"):
            yield f"{code[:begin]}{declared}{semicolon}({condition}) && false{rest}"
        return


def balanced(text):
    return text.count("(") == text.count(")") and text.count("{") == text.count("}")


def equal_ones():
    """(file, line, changed line) of each that changes nothing that anybody could see -> the reason."""
    return {tuple(entry[:3]): entry[3]
            for entry in json.loads((HERE / "equal.json").read_text(encoding="utf-8"))}


def every_mutant():
    """(test program, file, number of the line, the line, what stands in its place), in a fixed order."""
    for area, program in AREAS.items():
        for file in sorted((ROOT / area).rglob("*.cc")):
            name = file.relative_to(ROOT).as_posix()
            for number, line in enumerate(file.read_text(encoding="utf-8").split("\n")):
                for changed in of_line(line):
                    yield program, name, number, line, changed


def sample(every=1, first=0):
    """Every Nth of those that are not listed as equal."""
    equal = equal_ones()
    return [mutant for mutant in every_mutant()
            if (mutant[1], mutant[3].strip(), mutant[4].strip()) not in equal][first::every]
