"""Fills the buffers of as many sockets as it gets, in several processes: kernel memory."""
import socket
import time

import hostile


def fill(end):
    end.setblocking(False)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    try:
        while True:
            end.send(b"x" * 65536)
    except OSError:
        pass


def hoard():
    kept = []
    try:
        while True:
            kept.append(socket.socketpair())
            fill(kept[-1][0])
            fill(kept[-1][1])
    except OSError:
        pass
    time.sleep(3600)


def attack(_player):
    for _ in range(4):
        hostile.spawn(hoard)
    hostile.report("hoarders", "started")


hostile.play(attack)
