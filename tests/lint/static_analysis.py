#!/usr/bin/env python3
"""clang-tidy over all that is installed, by the checks of .clang-tidy, among them that what a mutex
guards is touched under it. Exit status: 0 nothing found, 1 something, 77 there is no clang-tidy."""

import argparse
import concurrent.futures
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys

CLANG_TIDY = "clang-tidy-14"  # docker/packages-full.txt
KEPT = ("-I", "-D", "-std=", "-isystem")  # the rest of a command is its compiler's


def arguments_of(command):
    """What of a compiler's command line says how its file is to be read."""
    words = shlex.split(command)
    kept = []
    for word, following in zip(words, words[1:] + [""]):
        if word == "-isystem":
            kept += [word, following]
        elif word.startswith(KEPT) and word != "-isystem":
            kept.append(word)
    return kept


def sources(root, build):
    """The compilations outside tests/: file, arguments and folder."""
    tests = (f"{build}/cmake/tests/", f"{root}/tests/")
    for entry in json.loads((build / "compile_commands.json").read_text()):
        if entry["file"].startswith(tests):
            continue
        yield entry["file"], arguments_of(entry["command"]), entry["directory"]


def analyse(root, file, arguments, directory):
    run = subprocess.run(
        [CLANG_TIDY, "--quiet", f"--config-file={root}/.clang-tidy", file, "--", *arguments,
         "-Wthread-safety"], cwd=directory, text=True, capture_output=True, timeout=1200)
    return file, run.returncode, run.stdout + (run.stderr if run.returncode else "")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True, help="a configured build")
    parser.add_argument("only", nargs="*", help="parts of the names of targets")
    options = parser.parse_args()
    if shutil.which(CLANG_TIDY) is None:
        print(f"skipped: {CLANG_TIDY} is not installed")
        return 77
    root = pathlib.Path(__file__).resolve().parents[2]
    build = options.build.resolve()
    todo = [source for source in sources(root, build)
            if not options.only or any(part in source[0] for part in options.only)]
    if not todo:
        print(f"error: {build}/compile_commands.json names nothing to look at", file=sys.stderr)
        return 1
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for file, status, text in pool.map(lambda s: analyse(root, *s), todo):
            if status != 0:
                failed += 1
                print(f"{file}\n{text}")
    print(f"{len(todo)} compilations, {failed} with findings")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
