"""Takes every descriptor it can get, of every kind that the kernel keeps memory for."""
import os
import socket

import hostile

KINDS = {
    "memory": lambda: os.memfd_create("hoard", os.MFD_ALLOW_SEALING),
    "event": lambda: os.eventfd(1) if hasattr(os, "eventfd") else os.dup(0),
    "pipe": os.pipe,
    "pair": socket.socketpair,
    "zero": lambda: os.open("/dev/zero", os.O_RDWR),
}


def attack(_player):
    for name, take in KINDS.items():
        kept = []
        try:
            while len(kept) < 100000:
                kept.append(take())
        except OSError:
            pass
        hostile.report(name, "bounded" if len(kept) < 300 else len(kept))
        for thing in kept:
            for fd in thing if isinstance(thing, tuple) else (thing,):
                fd.close() if isinstance(fd, socket.socket) else os.close(fd)


hostile.play(attack)
