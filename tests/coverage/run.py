#!/usr/bin/env python3
"""Measures which lines the unit tests of each area run, and compares with the floors of floors.json.

Use: run.py --build build/asan [--json FILE] [AREA ...]     (./dev coverage)
The build folder is of the preset "asan", with the areas' tests in it. An area's own sources are compiled once more, with
counters and without optimization, into build/asan/coverage, and linked with the tests as they are. Exit status 1 if a
test fails or an area is below its floor."""

import argparse
import collections
import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE.parent))

from support.build_commands import BuildCommands, instead  # noqa: E402

COUNTED = ["-O0", "--coverage", "-fprofile-update=atomic", "-w"]
# What a compiler of the build is told, and GCC isn't: gcov reads the counters of GCC's objects.
NOT_FOR_GCC = ("-fsanitize", "-fno-sanitize", "-Xclang", "-W")
# A line of brackets alone has only what is destroyed there, also after an exception.
BRACKETS = re.compile(r"[{}()\[\];,\s]*")


def by_gcc(words):
    """A compilation of the build as GCC does it: without sanitizers, whose checks are branches and no decisions of the
    code, and without clang's precompiled header."""
    words = ["g++" if pathlib.Path(word).name.startswith("clang++") else word for word in words]
    return [word for word, before in zip(words, ["", *words])
            if before != "-Xclang" and not word.startswith(NOT_FOR_GCC)]


class Area:
    """One area and its folder of objects with counters."""

    def __init__(self, name, tests, commands):
        self.name, self.tests, self.commands = name, tests, commands
        self.folder = commands.folder / "coverage" / name.replace("/", "_")
        self.objects = {}  # by unit
        self.linked = {}  # the units of each test

    def must(self, words, what, seconds=900, **more):
        done = subprocess.run(words, cwd=self.commands.folder, capture_output=True, text=True, timeout=seconds,
                              check=False, **more)
        if done.returncode != 0:
            sys.exit(f"{self.name}: {what} fails:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
        return done.stdout

    def compilations(self):
        """Empties the folder; returns what to call for each file to compile."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        units = {}
        for test in self.tests:
            own = {str(unit): words for unit, words in self.commands.units(test, ROOT / self.name)}
            self.linked[test] = sorted(own)
            units.update(own)
        calls = []
        for number, (unit, words) in enumerate(sorted(units.items())):
            made = self.folder / f"{number}.o"
            self.objects[unit] = made
            words = instead(words, "-o", made)
            for option in {"-MF", "-MT"} & set(words):
                words = instead(words, option, made.with_suffix(".d"))
            calls.append(lambda words=[*by_gcc(words), *COUNTED], unit=unit: self.must(words, f"the compilation of {unit}"))
        return calls

    def run_tests(self):
        for test in self.tests:
            words = instead(self.commands.link(test), "-o", self.folder / test)
            # Before the test's own objects, which may have the same inline functions, and before the archives, whose
            # objects are then not asked for.
            first = next(at for at, word in enumerate(words) if word.endswith(".o"))
            objects = [self.objects[unit] for unit in self.linked[test]]
            counters = self.must(["g++", "-print-file-name=libgcov.a"], "g++").strip()
            self.must([*words[:first], *objects, *words[first:], counters], f"the linking of {test}")
            self.must([self.folder / test, "--gtest_brief=1"], test,
                      env={**os.environ, "RC_PARAMS": "max_success=100"})
            (self.folder / test).unlink()

    def counts(self):
        """Percent of the area's lines and branches that its tests ran."""
        lines, branches = collections.Counter(), collections.Counter()
        for made in self.objects.values():
            text = self.must(["gcov", "--json-format", "--stdout", "--branch-probabilities",
                              made.with_suffix(".gcno")], "gcov")
            for file in json.loads(text)["files"]:
                path = pathlib.Path(file["file"])
                if path.is_relative_to(ROOT / self.name):
                    add(path, file["lines"], lines, branches)
        if not lines:
            sys.exit(f"{self.name}: {', '.join(self.tests)} of {self.commands.folder} have no line of it")
        return {"lines": percent(lines), "branches": percent(branches), "of_lines": len(lines)}


def add(path, entries, lines, branches):
    """Adds up how often gcov saw the lines and the branches of a file taken. A line has an entry for each function that
    it was compiled in. Branches that exceptions take are left out."""
    source = path.read_text(encoding="utf-8").split("\n")
    for entry in entries:
        number = entry["line_number"]
        if BRACKETS.fullmatch(source[number - 1]):
            continue
        lines[path, number] += entry["count"]
        decisions = [branch for branch in entry["branches"] if not branch["throw"]]
        for place, branch in enumerate(decisions):
            branches[path, number, place] += branch["count"]


def percent(counts):
    return round(100 * sum(count > 0 for count in counts.values()) / max(len(counts), 1), 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/asan")
    parser.add_argument("--json", type=pathlib.Path, help="also write the figures to this file")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="compilations at a time")
    parser.add_argument("--targets", action="store_true", help="only print the tests to build")
    parser.add_argument("areas", nargs="*")
    options = parser.parse_args()
    floors = json.loads((HERE / "floors.json").read_text(encoding="utf-8"))
    unknown = sorted(set(options.areas) - set(floors))
    if unknown:
        parser.error(f"floors.json has no area {unknown[0]}; it has {', '.join(floors)}")
    wanted = {area: floor for area, floor in floors.items() if not options.areas or area in options.areas}
    if options.targets:
        print(*sorted({test for floor in wanted.values() for test in floor["tests"]}))
        return 0
    commands = BuildCommands(options.build.resolve())
    areas = [Area(name, floor["tests"], commands) for name, floor in wanted.items()]
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        for done in [pool.submit(call) for area in areas for call in area.compilations()]:
            done.result()
    found, low = {}, 0
    for area in areas:
        area.run_tests()
        own, floor = area.counts(), wanted[area.name]
        below = [kind for kind in ("lines", "branches") if own[kind] < floor[kind]]
        low += bool(below)
        print(f"{area.name}: {own['lines']} % of {own['of_lines']} lines, {own['branches']} % of branches "
              f"(floors {floor['lines']}, {floor['branches']})"
              + (f": TOO FEW {' and '.join(below)}" if below else ""), flush=True)
        found[area.name] = own
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 1 if low else 0


if __name__ == "__main__":
    sys.exit(main())
