"""Sends descriptors of sockets through themselves and closes them, so that only the kernel's
collector can find them."""
import array
import socket

import hostile


def attack(_player):
    sent = 0
    for _ in range(2000):
        left, right = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        with left, right:
            fds = array.array("i", [left.fileno(), right.fileno()])
            try:
                left.sendmsg([b"x" * 1000], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, fds)])
                sent += 1
            except OSError:
                pass
    hostile.report("cycles", "made" if sent else "none")


hostile.play(attack)
