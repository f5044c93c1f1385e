"""Leaves links, pipes and devices wherever the grader might read or clean up."""
import os
import stat
import sys

import hostile

CANARY = sys.argv[1]
NAMES = ["stdout", "stderr", "log", "order.json", "result.json", "core", "artefact.tar"]


def traps(_player):
    for folder in ("/tmp", "/dev/shm"):
        os.chdir(folder)
        for name in NAMES:
            os.symlink(CANARY, name)
            os.symlink("/proc/1/root" + CANARY, name + ".up")
            os.mkfifo(name + ".pipe")
        os.symlink("/", "up")
        os.symlink("self", "self")
        for i in range(40):
            os.symlink(f"loop{(i + 1) % 40}", f"loop{i}")
    hostile.attempt("device", lambda: os.mknod("/tmp/sda", stat.S_IFBLK | 0o666, os.makedev(8, 0)))
    hostile.attempt("character", lambda: os.mknod("/tmp/mem", stat.S_IFCHR | 0o666,
                                                  os.makedev(1, 1)))
    hostile.attempt("hard_link", lambda: os.link("/etc/passwd", "/tmp/passwd"))
    hostile.attempt("hard_link_own", lambda: os.link(__file__, "/tmp/own.py"))
    hostile.attempt("canary", lambda: os.open(CANARY, os.O_RDWR))
    os.makedirs("/tmp/closed/within")
    os.chmod("/tmp/closed", 0)
    hostile.report("traps", "set")


hostile.play(traps)
