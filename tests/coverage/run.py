#!/usr/bin/env python3
"""Measures which lines the unit tests of each area run, and compares with the floors of floors.json.

Use: run.py --build build/coverage [--json FILE] [AREA ...]     (./dev coverage)
The build folder is of the preset "coverage", with the areas' tests in it. Needs gcovr. Exit status 1 if a test
fails or an area is below its floor."""

import argparse
import json
import os
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]


def measure(area, tests, build):
    """Percent of the area's lines and branches that its tests run."""
    for counts in (build / "cmake" / area).rglob("*.gcda"):
        counts.unlink()
    for test in tests:
        done = subprocess.run([build / "tests" / test, "--gtest_brief=1"], capture_output=True, text=True,
                              timeout=900, check=False, cwd=build,
                              env={**os.environ, "RC_PARAMS": "max_success=100"})
        if done.returncode != 0:
            sys.exit(f"{area}: {test} fails:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    report = subprocess.run(["gcovr", "--root", ROOT, "--filter", f"{ROOT}/{area}/", "--exclude-throw-branches",
                             "--exclude-unreachable-branches", "--json-summary-pretty",
                             build / "cmake" / area], capture_output=True, text=True, check=False)
    if report.returncode != 0:
        sys.exit(f"{area}: gcovr fails: {report.stderr[-2000:]}")
    total = json.loads(report.stdout)
    if total["line_total"] == 0:
        sys.exit(f"{area}: no line of it was compiled for this; build the preset coverage")
    return {"lines": total["line_percent"], "branches": total["branch_percent"],
            "of_lines": total["line_total"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/coverage")
    parser.add_argument("--json", type=pathlib.Path, help="also write the figures to this file")
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
    found, low = {}, 0
    for area, floor in wanted.items():
        found[area] = measure(area, floor["tests"], options.build.resolve())
        below = [kind for kind in ("lines", "branches") if found[area][kind] < floor[kind]]
        low += bool(below)
        print(f"{area}: {found[area]['lines']} % of {found[area]['of_lines']} lines, "
              f"{found[area]['branches']} % of branches (floors {floor['lines']}, {floor['branches']})"
              + (f": TOO FEW {' and '.join(below)}" if below else ""), flush=True)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 1 if low else 0


if __name__ == "__main__":
    sys.exit(main())
