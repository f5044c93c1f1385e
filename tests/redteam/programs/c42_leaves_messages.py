"""Leaves data behind in every place that it may write to, and reports what it found there at the
beginning of its run."""
import ctypes
import os

import hostile

libc = ctypes.CDLL(None, use_errno=True)
KEY = 0x52454455
PLACES = ["/tmp", "/dev/shm", "/var/tmp", "/run", os.path.expanduser("~/.cache")]


def found():
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
    libc.shmget(KEY, 4096, 0o1666)
    libc.msgget(KEY, 0o1666)
    libc.syscall(248, b"user", b"redteam", b"remember", 8, -4)
    hostile.report("left", "files" if left >= 2 else left)


found()
hostile.play(leave)
