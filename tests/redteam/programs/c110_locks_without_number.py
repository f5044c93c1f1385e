"""Takes record locks, each of which is memory of the kernel, and leaves memory policies in a file; and
looks whether a database still works."""
import ctypes
import fcntl
import os
import sqlite3
import struct
import tempfile

import hostile

OFD_SETLK, OFD_SETLKW = 37, 38
LOCK = struct.Struct("hhqqi")  # struct flock
libc = ctypes.CDLL(None, use_errno=True)
libc.mmap.restype = ctypes.c_void_p


def is_real(command):
    """Whether a lock excludes another process, so that the kernel keeps it."""
    with tempfile.NamedTemporaryFile() as file:
        lock = LOCK.pack(fcntl.F_WRLCK, 0, 0, 1, 0)
        fcntl.fcntl(file, command, lock)

        def try_too():
            with open(file.name, "r+b") as other:
                try:
                    fcntl.fcntl(other, fcntl.F_SETLK, lock)
                except OSError:
                    os._exit(1)
        return os.waitpid(hostile.spawn(try_too), 0)[1] != 0


def leaves_policies():
    """Whether mbind does anything: to an address that is none, it can't."""
    mask = ctypes.c_ulong(1)
    return libc.syscall(237, ctypes.c_void_p(4096), ctypes.c_ulong(4096), 1, ctypes.byref(mask), 64, 0) != 0


def database():
    path = "/tmp/data.db"
    for value in range(3):
        with sqlite3.connect(path) as data:
            data.execute("CREATE TABLE IF NOT EXISTS numbers (value)")
            data.execute("INSERT INTO numbers VALUES (?)", (value,))
    with sqlite3.connect(path) as data:
        return data.execute("SELECT sum(value) FROM numbers").fetchone()[0]


def attack(_player):
    kept = [name for name, command in (("set", fcntl.F_SETLK), ("wait", fcntl.F_SETLKW),
                                       ("description", OFD_SETLK),
                                       ("description_wait", OFD_SETLKW)) if is_real(command)]
    hostile.report("record_locks", ",".join(kept) or "none")
    if os.uname().machine == "x86_64":
        hostile.report("memory_policies", "kept" if leaves_policies() else "none")
    hostile.report("database", database())


hostile.play(attack)
