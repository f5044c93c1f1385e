"""One of two concurrent sandboxes. "speaks" moves a count that the kernel keeps for the whole host, up
and down; "listens" samples that count."""
import ctypes
import fcntl
import mmap
import struct
import sys
import tempfile
import time

import hostile

SUBJECT, SPEAKS = sys.argv[1], sys.argv[2] == "speaks"
OFD_SETLK = 37
LOCK = struct.Struct("hhqqi")  # struct flock
MANY = 500


def take_locks(file):
    for place in range(MANY):
        for command, start in ((fcntl.F_SETLK, 2 * place), (OFD_SETLK, 10**6 + 2 * place)):
            fcntl.fcntl(file, command, LOCK.pack(fcntl.F_WRLCK, 0, start, 1, 0))


def move_locks():
    with tempfile.TemporaryFile() as file:
        try:
            take_locks(file)
        except OSError:
            pass  # refused
        time.sleep(0.1)


def move_counters():
    """Page faults: 20,000 within some milliseconds."""
    with mmap.mmap(-1, 20000 * 4096, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as memory:
        ctypes.memset(ctypes.addressof(ctypes.c_char.from_buffer(memory)), 1, 1)
        for page in range(20000):
            memory[page * 4096] = 1


def lines(path):
    try:
        with open(path, encoding="ascii") as file:
            return file.read().splitlines()
    except OSError:
        return []


def count():
    if SUBJECT == "locks":
        return len(lines("/proc/locks"))
    return sum(int(line.split()[1]) for line in lines("/proc/vmstat")
               if line.startswith(("pgfault ", "pgalloc_")))


def attack(_player):
    end = time.monotonic() + (5.0 if SPEAKS else 4.0)
    heard = 0
    last = count()
    while time.monotonic() < end:
        if SPEAKS:
            (move_locks if SUBJECT == "locks" else move_counters)()
        time.sleep(0.05)
        now = count()
        heard += abs(now - last) >= (MANY if SUBJECT == "locks" else 10000)
        last = now
    hostile.report("heard", heard)


hostile.play(attack)
