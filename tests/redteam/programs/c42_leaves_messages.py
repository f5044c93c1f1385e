"""Leaves data in every place that it may write to, and reports what it found there at the start
of its run."""
import ctypes
import fcntl
import os
import struct

import hostile

libc = ctypes.CDLL(None, use_errno=True)
KEY = 0x52454455
PLACES = ["/tmp", "/dev/shm", "/var/tmp", "/run", os.path.expanduser("~/.cache")]


# Files that this submission's next run sees as well: the system's, and its own.
KEPT = [path for path in ("/usr/bin/env", "/usr/bin/python3", "/policy/policy.json")
        if os.path.exists(path)]
NO_HINT, HINT = struct.pack("q", 0), struct.pack("q", 4)  # RWH_WRITE_LIFE_LONG


def hint(path, command, value):
    """An inode's hint of how long its data will live, kept until the inode is dropped from
    memory."""
    with open(path, "rb") as file:
        try:
            return fcntl.fcntl(file, command, value)
        except OSError:
            return NO_HINT


def touched(path):
    """Whether reading the file changes its times."""
    before = os.stat(path)
    with open(path, "rb") as file:
        file.read(1)
    after = os.stat(path)
    return (before.st_atime_ns, before.st_ctime_ns) != (after.st_atime_ns, after.st_ctime_ns)


def found():
    hostile.report("found_hint", sum(hint(path, 1035, NO_HINT) != NO_HINT for path in KEPT))
    hostile.report("found_time", sum(map(touched, KEPT)))
    entries = [entry for place in PLACES if os.path.isdir(place) for entry in os.listdir(place)]
    hostile.report("found_files", len(entries))
    hostile.report("found_segment", int(libc.shmget(KEY, 4096, 0o666) >= 0))
    hostile.report("found_queue", int(libc.msgget(KEY, 0o666) >= 0))
    # keyctl(KEYCTL_SEARCH, user keyring, ...)
    key = libc.syscall(250, 10, -4, b"user", b"redteam", 0)
    hostile.report("found_key", int(key >= 0))


def leave(_player):
    left = 0
    for place in PLACES:
        try:
            os.makedirs(place, exist_ok=True)
            with open(f"{place}/message", "w", encoding="ascii") as file:
                file.write("remember")
            left += 1
        except OSError:
            pass
    for path in KEPT:
        hint(path, 1036, HINT)
    libc.shmget(KEY, 4096, 0o1666)
    libc.msgget(KEY, 0o1666)
    libc.syscall(248, b"user", b"redteam", b"remember", 8, -4)
    hostile.report("left", "files" if left >= 2 else left)


found()
hostile.play(leave)
