"""Keeps as many descriptors in flight as the kernel allows, long enough for other leases to start
meanwhile."""
import array
import socket
import time

import hostile

MOST = 253  # in one message


def attack(_player):
    sent, kept = 0, []
    for count in [MOST] * 40 + [1] * 300:
        left, right = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        kept += [left, right]
        try:
            left.sendmsg([b"x"], [(socket.SOL_SOCKET, socket.SCM_RIGHTS,
                                   array.array("i", [right.fileno()] * count))])
            sent += count
        except OSError:
            left.close()
            right.close()
            del kept[-2:]
    hostile.report("in_flight", "many" if sent > 200 else sent)
    time.sleep(4)


hostile.play(attack)
