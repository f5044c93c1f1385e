"""Tries to get a core file, in a folder of its choice."""
import os
import resource

import hostile


def raise_limit():
    try:
        resource.setrlimit(resource.RLIMIT_CORE, (1 << 30, 1 << 30))
    except ValueError as refused:
        raise PermissionError(1, "refused") from refused


def attack(_player):
    hostile.attempt("core_limit", raise_limit)
    os.chdir("/tmp")
    os.abort()


hostile.play(attack)
