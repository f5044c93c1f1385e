#!/usr/bin/env python3
"""Tries the mutants that operators.py makes of scoring/ and server/scheduler/ (./dev mutants). Prints each that survives
the tests, and a score for each folder; exit status 1 if one survives that equal.json does not list.

Use: sweep.py --build build/mutants                all of them
     sweep.py --every 50 [--first K]               every 50th, from the Kth on
     sweep.py --only scoring/board.cc              of files that begin so
     sweep.py --survivors                          only those that survived when they were last tried

What was found is kept in the build folder (mutants.jsonl): a run that was broken off goes on where it stopped, and what
was tried with the same tests and the same sources is not tried again."""

import argparse
import collections
import concurrent.futures
import hashlib
import json
import pathlib
import sys
import tempfile
import threading

import operators
import trial

ROOT = operators.ROOT
OPTIONS = ("--gtest_brief=1", "--gtest_fail_fast")
# These need ten times what all others do, and are nearly never the only ones to notice.
LONG = ("SchedulerTest.APlaceCostsLittle*", "PairedTest.OfManyPairs*", "PairedTestProperties.RandomWays*",
        "GroupsProperties.GrowByOne*", "Groups.CompareBands*", "Groups.ComparePain*")
# First the short tests with few random cases, which kill most mutants; only what survives them gets all. The seeds are
# fixed, so that a mutant has the same end each time. Of each round: further options, what RapidCheck reads, and seconds
# of the processor, several times what the tests need.
ROUNDS = ((("--gtest_filter=-" + ":".join(LONG),), "seed=1 noshrink=1 max_success=50", 4),
          ((), "seed=1 noshrink=1 max_success=50", 15),
          ((), "seed=2 noshrink=1 max_success=500", 60))


def attempt(mutant, build):
    program, file, number, _, changed_line = mutant
    source = ROOT / file
    lines = source.read_text(encoding="utf-8").split("\n")
    lines[number] = changed_line
    changed = "\n".join(lines)
    with tempfile.TemporaryDirectory() as folder:
        if build.compile(source, changed, pathlib.Path(folder)):
            return "no code"
        wrong = build.link(program, folder)
        if wrong:
            sys.exit(f"{file} does not link: {wrong}")
        for options, cases, seconds in ROUNDS:
            result = trial.run(folder, [*OPTIONS, *options], {"RC_PARAMS": cases}, seconds, limited=True)
            if result != "SURVIVES":
                return result
    return "same code" if build.same_code(source, changed) else "SURVIVES"


def name_of(mutant):
    _, file, number, line, changed = mutant
    return f"{file}:{number + 1}: {line.strip()}  ->  {changed.strip()}"


class Results:
    """What was found before, and what is found now: one JSON line each."""

    def __init__(self, file, build):
        self.file, self.by_digest, self.latest = file, {}, {}
        self.programs = {program: hashlib.sha256((build.folder / "tests" / program).read_bytes()).hexdigest()
                         for program in operators.AREAS.values()}
        if file.exists():
            for line in file.read_text(encoding="utf-8").splitlines():
                try:
                    entry = json.loads(line)
                except ValueError:
                    continue  # the last line of a run that was broken off
                self.by_digest[entry["digest"]] = entry["result"]
                self.latest[tuple(entry["mutant"])] = entry["result"]

    @staticmethod
    def key(mutant):
        return mutant[1], mutant[3].strip(), mutant[4].strip()

    def digest(self, mutant):
        program, file, number, _, changed = mutant
        return hashlib.sha256("\0".join([self.programs[program], file, str(number), changed]).encode()).hexdigest()

    def known(self, mutant):
        return self.by_digest.get(self.digest(mutant))

    def add(self, mutant, result):
        with self.file.open("a", encoding="utf-8") as out:
            out.write(json.dumps({"digest": self.digest(mutant), "mutant": self.key(mutant), "result": result}) + "\n")


def score(wanted, results):
    """Prints a line for each area: what became of its mutants."""
    for area, program in operators.AREAS.items():
        counts = collections.Counter(result for mutant, result in zip(wanted, results) if mutant[0] == program)
        killed = counts["killed"] + counts["timeout"]
        tried = killed + counts["SURVIVES"]
        if not counts:
            continue
        listed = sum(file.startswith(area + "/") for file, _, _ in operators.equal_ones())
        print(f"{area}: {killed} of {tried} mutants are killed ({counts['timeout']} of them by their time), "
              f"{counts['SURVIVES']} survive; {counts['same code'] + listed} change nothing "
              f"({listed} of them are listed), {counts['no code']} do not compile")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/mutants")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("--survivors", action="store_true")
    options = parser.parse_args()
    build = trial.Build(options.build.resolve(), set(operators.AREAS.values()))
    known = Results(build.folder / "mutants.jsonl", build)
    wanted = [mutant for mutant in operators.sample(options.every, options.first)
              if mutant[1].startswith(options.only)
              and (not options.survivors or known.latest.get(known.key(mutant)) == "SURVIVES")]

    results = []
    preparing = threading.Lock()

    def end_of(mutant):
        source = ROOT / mutant[1]
        with preparing:
            if known.known(mutant) is None and source not in build.preambles:
                build.prepare(source, preambles)
        return known.known(mutant) or attempt(mutant, build)

    with (tempfile.TemporaryDirectory() as preambles,
          concurrent.futures.ThreadPoolExecutor(options.jobs) as pool):
        for mutant, result in zip(wanted, pool.map(end_of, wanted)):
            if known.known(mutant) is None:
                known.add(mutant, result)
            results.append(result)
            if result == "SURVIVES":
                print(f"{result} {name_of(mutant)}", flush=True)
    score(wanted, results)
    return 1 if "SURVIVES" in results else 0


if __name__ == "__main__":
    sys.exit(main())
