"""Looks for the grader's files: those that it is told about, and those that it can guess."""
import os
import sys

import hostile


def read(path):
    if os.path.isdir(path):
        return os.listdir(path)
    with open(path, "rb") as file:
        return file.read(16)


def look(_player):
    for i, path in enumerate(sys.argv[1:]):
        hostile.attempt(f"named_{i}", lambda path=path: read(path))
    for i, path in enumerate(["/policy/../../testcase", "../data/store.db", "/policy/../seeds.json",
                              "/myograde/myograde-sim", "/myograde/../etc/shadow",
                              "/proc/self/root/../var/lib", "/proc/1/root/var", "/proc/1/cwd"]):
        hostile.attempt(f"guess_{i}", lambda path=path: read(path))
    hostile.report("myograde", ",".join(sorted(os.listdir("/myograde"))))
    hostile.report("root", ",".join(sorted(os.listdir("/"))))


hostile.play(look)
