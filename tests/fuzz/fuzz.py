#!/usr/bin/env python3
"""Builds the fuzz targets with clang and runs one under libFuzzer.

  fuzz.py --build DIR --cache DIR build
  fuzz.py --build DIR --cache DIR run TARGET [--seconds N]

Exit status 77: this host has no clang with libFuzzer, so there is nothing to do.
A run starts from corpus/TARGET; its findings are kept in DIR/findings."""

import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parent.parent
CLANG = "clang++-14"
SKIPPED = 77


def missing():
    """Why fuzzing is impossible here; empty if it is possible."""
    if shutil.which(CLANG) is None:
        return f"{CLANG} is not installed (Debian packages clang-14 and libclang-rt-14-dev)"
    with tempfile.TemporaryDirectory() as folder:
        probe = pathlib.Path(folder, "probe.cc")
        probe.write_text("#include <cstddef>\n#include <cstdint>\nextern \"C\" int "
                         "LLVMFuzzerTestOneInput(const uint8_t*, size_t) { return 0; }\n")
        done = subprocess.run(
            [CLANG, "-fsanitize=fuzzer,address", probe, "-o", probe.with_suffix("")],
            capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return f"{CLANG} has no libFuzzer (Debian package libclang-rt-14-dev)"
    return ""


def build(options):
    configure = ["cmake", "--preset", "fuzz", "-S", SOURCE, "-B", options.build,
                 f"-DMYOGRADE_CACHE={options.cache}"]
    for command in (configure, ["cmake", "--build", options.build, "--target", "fuzzers"]):
        done = subprocess.run(command, cwd=SOURCE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True, check=False)
        if done.returncode != 0:
            sys.exit(done.stdout[-4000:] + "\nerror: the fuzz targets can't be built; see above")
    return 0


def run(options):
    program = options.build / "tests" / f"fuzz_{options.target}"
    if not program.exists():
        sys.exit(f"error: there is no {program}; build it first, and check the target's name")
    findings = options.build / "findings" / options.target
    findings.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as grown:
        done = subprocess.run(
            [program, f"-max_total_time={options.seconds}", "-timeout=20", "-rss_limit_mb=2048",
             "-max_len=8192", "-print_final_stats=1", f"-artifact_prefix={findings}/", grown,
             HERE / "corpus" / options.target],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False,
            env={**os.environ, "UBSAN_OPTIONS": "print_stacktrace=1"})
    text = done.stderr.decode(errors="replace")
    if done.returncode != 0:
        print(text[-8000:])
        print(f"error: {options.target} broke; the input is in {findings}. Mend what broke and put "
              f"the input into tests/fuzz/corpus/{options.target}")
        return 1
    runs = re.search(r"number_of_executed_units:\s*(\d+)", text)
    reached = re.findall(r"cov: (\d+)", text)
    print(f"{options.target}: {runs.group(1) if runs else '?'} inputs in {options.seconds} s, "
          f"{reached[-1] if reached else '?'} places of the code reached, nothing broken")
    return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--cache", required=True)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("build")
    one = verbs.add_parser("run")
    one.add_argument("target")
    one.add_argument("--seconds", type=int, default=60)
    options = parser.parse_args()
    if options.verb == "run" and options.seconds < 1:
        sys.exit("error: --seconds must be at least 1")
    if why := missing():
        print(f"skipped: not on this host: {why}")
        return SKIPPED
    return build(options) if options.verb == "build" else run(options)


if __name__ == "__main__":
    sys.exit(main())
