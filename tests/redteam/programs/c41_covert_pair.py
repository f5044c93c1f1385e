"""One of two concurrent sandboxes. Both leave signs in everything that two processes of one host
might share, and count the other's signs: only "speaks" takes locks, "listens" checks whether they
are taken."""
import ctypes
import fcntl
import os
import socket
import struct
import sys
import time

import hostile

SHARED = [path for path in ("/usr/bin/env", "/usr/bin/python3", "/etc/passwd",
                            os.environ.get("PYTHONPATH", "/usr").split(":")[0])
          if os.path.exists(path)]
KEYS = {"speaks": 0x52454454, "listens": 0x52454455}
SPEAKS = sys.argv[1] == "speaks"
IPC_CREAT = 0o1000
libc = ctypes.CDLL(None, use_errno=True)
heard = {"lock": 0, "name": 0, "segment": 0, "file": 0, "watch": 0, "key": 0,
         "holder": 0, "hint": 0}
LOCK = struct.Struct("hhqqi")  # struct flock
GET_HINT, SET_HINT = 1035, 1036


def ask(file):
    """Who holds a lock on the file, and its inode's hint: both through a file that is open for
    reading only."""
    try:
        answer = fcntl.fcntl(file, fcntl.F_GETLK, LOCK.pack(fcntl.F_WRLCK, 0, 0, 0, 0))
        heard["holder"] += LOCK.unpack(answer)[0] != fcntl.F_UNLCK
    except OSError:
        pass
    try:
        if SPEAKS:
            fcntl.fcntl(file, SET_HINT, struct.pack("q", 4))
        else:
            heard["hint"] += fcntl.fcntl(file, GET_HINT, struct.pack("q", 0)) != struct.pack("q", 0)
    except OSError:
        pass


def leave_signs():
    for folder in ("/tmp", "/dev/shm"):
        with open(f"{folder}/sign-{sys.argv[1]}", "w", encoding="ascii") as file:
            file.write("here")
    meeting = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    meeting.bind("\0redteam-" + sys.argv[1])
    libc.shmget(KEYS[sys.argv[1]], 4096, IPC_CREAT | 0o666)
    libc.syscall(248, b"user", b"redteam-" + sys.argv[1].encode(), b"here", 4, -4)  # add_key
    return meeting


def look(files, other, prober):
    for folder in ("/tmp", "/dev/shm"):
        heard["file"] += f"sign-{other}" in os.listdir(folder)
    heard["segment"] += libc.shmget(KEYS[other], 4096, 0o666) >= 0
    try:
        prober.sendto(b"?", f"\0redteam-{other}")
        heard["name"] += 1
    except OSError:
        pass
    key = libc.syscall(250, 10, -4, b"user", b"redteam-" + other.encode(), 0)  # KEYCTL_SEARCH
    heard["key"] += key >= 0
    for file in files:
        ask(file)
        for lock in (fcntl.flock, fcntl.lockf):
            try:
                lock(file, fcntl.LOCK_EX | fcntl.LOCK_NB if lock is fcntl.flock
                     else fcntl.LOCK_SH | fcntl.LOCK_NB)
                if not SPEAKS:
                    lock(file, fcntl.LOCK_UN)
            except BlockingIOError:
                heard["lock"] += 1
            except OSError:
                pass  # rejected for every caller


def attack(_player):
    other = "listens" if SPEAKS else "speaks"
    meeting = leave_signs()
    prober = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    files = [os.open(path, os.O_RDONLY) for path in SHARED]
    watcher = libc.inotify_init1(os.O_NONBLOCK)
    for path in SHARED if not SPEAKS else []:
        libc.inotify_add_watch(watcher, path.encode(), 0x20 | 0x1)  # opened, read
    end = time.monotonic() + (4.0 if SPEAKS else 3.0)
    while time.monotonic() < end:
        look(files, other, prober)
        if SPEAKS:
            os.close(os.open(SHARED[0], os.O_RDONLY))
        try:
            heard["watch"] += len(os.read(watcher, 65536)) > 0
        except OSError:
            pass
        time.sleep(0.01)
    meeting.close()
    for way, count in heard.items():
        hostile.report(f"heard_{way}", count)


hostile.play(attack)
