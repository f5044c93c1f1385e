"""Tries to change its own program, the libraries, the configuration and the sandbox itself."""
import os
import sys

import hostile


def create(folder):
    os.close(os.open(f"{folder}/redteam", os.O_CREAT | os.O_WRONLY, 0o644))


def attempt_all(_player):
    runtime = os.environ.get("PYTHONPATH", "/policy").split(":")[0]
    for name, folder in {"policy": "/policy", "usr": "/usr", "lib": "/usr/lib", "bin": "/bin",
                         "etc": "/etc", "root": "/", "runtime": runtime, "dev": "/dev",
                         "myograde": "/myograde", "proc": "/proc"}.items():
        hostile.attempt(f"create_{name}", lambda folder=folder: create(folder))
    for name, path in {"own": __file__, "manifest": "/policy/policy.json", "python": sys.executable,
                       "passwd": "/etc/passwd", "hosts": "/etc/hosts",
                       "bridge": "/myograde/myograde-bridge"}.items():
        hostile.attempt(f"open_{name}", lambda path=path: os.close(os.open(path, os.O_WRONLY)))
        hostile.attempt(f"chmod_{name}", lambda path=path: os.chmod(path, 0o777))
    hostile.attempt("unlink_own", lambda: os.unlink(__file__))
    hostile.attempt("rename_own", lambda: os.rename(__file__, "/policy/other.py"))
    hostile.attempt("move_policy", lambda: os.rename("/policy", "/elsewhere"))
    hostile.attempt("link_out", lambda: os.symlink("/tmp", "/policy/link"))
    hostile.attempt("touch_own", lambda: os.utime(__file__))


hostile.play(attempt_all)
