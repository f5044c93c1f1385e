"""Writes to the files of /proc that say what a process may do."""
import os

import hostile

WRITES = {
    "uid_map": "0 0 1", "gid_map": "0 0 1", "setgroups": "allow", "timens_offsets": "monotonic 9 0",
    "projid_map": "0 0 1", "attr/current": "unconfined", "attr/exec": "unconfined",
    "loginuid": "0",
}


def write(path, text):
    fd = os.open(path, os.O_WRONLY)
    try:
        os.write(fd, text.encode())
    finally:
        os.close(fd)


def attack(_player):
    for name, text in WRITES.items():
        hostile.attempt(name.replace("/", "_"), lambda: write(f"/proc/self/{name}", text))
    hostile.attempt("oom_score", lambda: write("/proc/self/oom_score_adj", "-1000"))
    hostile.attempt("first_oom_score", lambda: write("/proc/1/oom_score_adj", "1000"))
    hostile.attempt("first_mem", lambda: write("/proc/1/mem", "x"))


hostile.play(attack)
