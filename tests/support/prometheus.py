"""Reads Prometheus' text format, version 0.0.4, as strictly as its documentation describes it."""

import math
import re

NAME = r"[a-zA-Z_:][a-zA-Z0-9_:]*"
SAMPLE = re.compile(rf"({NAME})(?:\{{(.*)\}})? (\S+)")
LABEL = re.compile(r'([a-zA-Z_][a-zA-Z0-9_]*)="((?:[^"\\\n]|\\[\\"n])*)"(?:,|$)')
SUFFIXES = {"histogram": ("_bucket", "_sum", "_count")}


class FormatError(AssertionError):
    """A line that no scraper would take."""


def _labels(text, line):
    labels, at = {}, 0
    while at < len(text or ""):
        found = LABEL.match(text, at)
        if not found or found.group(1) in labels:
            raise FormatError(f"labels of {line!r}")
        labels[found.group(1)] = re.sub(r"\\(.)", lambda m: {"n": "\n"}.get(m[1], m[1]),
                                        found.group(2))
        at = found.end()
    return labels


def _check_histogram(name, samples):
    series = {}
    for sample, labels, value in samples:
        key = tuple(sorted((k, v) for k, v in labels.items() if k != "le"))
        series.setdefault(key, []).append((sample, labels, value))
    for rows in series.values():
        buckets = [(float(labels["le"]), value) for sample, labels, value in rows
                   if sample.endswith("_bucket")]
        count = [value for sample, _, value in rows if sample == name + "_count"]
        if (buckets != sorted(buckets) or buckets[-1][0] != math.inf
                or count != [buckets[-1][1]]):
            raise FormatError(f"buckets of {name}: {rows}")


def parse(text):
    """{family: {"type", "help", "samples": [(name, labels, value)]}}. FormatError for anything that
    the format does not have."""
    if not text.endswith("\n"):
        raise FormatError("no line feed at the end")
    families, current, seen = {}, None, set()
    for line in text.splitlines():
        if line.startswith("# "):
            _, kind, name, rest = (line.split(" ", 3) + [""])[:4]
            if kind not in ("HELP", "TYPE") or not re.fullmatch(NAME, name):
                raise FormatError(line)
            if kind == "HELP" and name in families:
                raise FormatError(f"{name} appears twice")
            current = families.setdefault(name, {"samples": []})
            current[kind.lower()] = rest
            current["name"] = name
            continue
        found = SAMPLE.fullmatch(line)
        if not found or current is None:
            raise FormatError(line)
        name, labels, value = found.group(1), _labels(found.group(2), line), float(found.group(3))
        allowed = [current["name"] + end for end in SUFFIXES.get(current["type"], ("",))]
        key = (name, tuple(sorted(labels.items())))
        if name not in allowed or key in seen:
            raise FormatError(line)
        seen.add(key)
        current["samples"].append((name, labels, value))
    for name, family in families.items():
        if family["type"] == "histogram":
            _check_histogram(name, family["samples"])
    return families


def value_of(families, name, **labels):
    """The value of the one sample with this name and these labels among its own; None: there is
    none."""
    for family in families.values():
        for sample, own, value in family["samples"]:
            if sample == name and labels.items() <= own.items():
                return value
    return None
