#!/usr/bin/env python3
"""Plays hostile programs against a real daemon and prints one line for each: PASS, FAIL or SKIP.

usage: run.py --build BUILD [--quick] [--json] [--user UID] [--mix SECONDS] [--list] [CASE ...]
"""

import argparse
import json
import os
import pathlib
import signal
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import mix  # noqa: E402  (needs the folder above)
import suite as suites  # noqa: E402

WRONG_USE, HOST_TROUBLE = 2, 4
SOURCE = pathlib.Path(__file__).resolve().parents[2]


def arguments():
    parser = argparse.ArgumentParser(prog="./dev redteam", description=__doc__.split("\n")[0])
    parser.add_argument("cases", metavar="CASE", type=int, nargs="*",
                        help="numbers of cases (default: all)")
    parser.add_argument("--build", type=pathlib.Path, required=True, help=argparse.SUPPRESS)
    parser.add_argument("--list", action="store_true", help="list the cases and end")
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")
    parser.add_argument("--quick", action="store_true", help="a choice of cases, in two minutes")
    parser.add_argument("--mix", type=int, metavar="SECONDS",
                        help="instead: hostile and honest submissions mixed at random, this long")
    parser.add_argument("--seed", type=int, default=1, help="of the mixture (default: 1)")
    parser.add_argument("--user", type=int, metavar="UID",
                        help="as root: run the daemon as this ordinary user")
    options = parser.parse_args()
    options.build = options.build.resolve()  # the daemon runs in a folder of its own
    if options.mix is not None and options.mix < 1:
        parser.error("--mix needs a number of seconds from 1")
    if options.user is not None and (options.user < 1 or os.geteuid() != 0):
        parser.error("--user needs an ordinary user's number, and root to take it")
    return options


def chosen(options):
    cases = suites.all_cases()
    unknown = set(options.cases) - {case.number for case in cases}
    if unknown:
        print(f"error: there is no case {min(unknown)}; --list tells which there are",
              file=sys.stderr)
        sys.exit(WRONG_USE)
    if options.cases:
        return [case for case in cases if case.number in options.cases]
    return [case for case in cases if case.quick] if options.quick else cases


def run_cases(cases, options):
    rows = []
    with suites.Suite(options.build, SOURCE, options.user) as suite:
        for case in cases:
            begin = time.monotonic()
            try:
                verdict, words = suite.run(case)
            except (RuntimeError, OSError) as trouble:
                verdict, words = "FAIL", f"{trouble}"
            row = {"case": case.number, "title": case.title, "verdict": verdict, "detail": words,
                   "wall_s": round(time.monotonic() - begin, 1)}
            rows.append(row)
            if not options.json:
                told = f": {words}" if words else ""
                print(f"{verdict} {case.number:2} {case.title}{told} ({row['wall_s']:.0f} s)",
                      flush=True)
    return rows


def main():
    options = arguments()
    cases = chosen(options)
    if options.list:
        for case in cases:
            print(f"{case.number:2} {case.title}")
        return 0
    if options.mix is not None:
        return mix.run(options.mix, options.seed, options.build, SOURCE, options.user,
                       options.json)
    rows = run_cases(cases, options)
    count = {verdict: sum(row["verdict"] == verdict for row in rows)
             for verdict in ("PASS", "FAIL", "SKIP")}
    if options.json:
        print(json.dumps({"cases": rows, "passed": count["PASS"], "failed": count["FAIL"],
                          "skipped": count["SKIP"]}, indent=1))
    else:
        print(f"redteam: {count['PASS']} passed, {count['FAIL']} failed, {count['SKIP']} skipped")
    return 1 if count["FAIL"] else 0


if __name__ == "__main__":
    # If terminated from outside, it still ends its daemon.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        sys.exit(main())
    except RuntimeError as trouble:
        print(f"error: {trouble}", file=sys.stderr)
        sys.exit(HOST_TROUBLE)
