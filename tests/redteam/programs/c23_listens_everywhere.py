"""Listens on its bus and on other multicast groups and ports, and calls out on all of them, so
that another sandbox doing the same would be heard."""
import os
import select
import time

import hostile

TOKEN = os.urandom(8).hex().encode()
PLACES = [("239.255.76.67", 7667), ("239.255.76.67", 7668), ("239.255.76.68", 7667),
          ("239.255.0.1", 5000), ("239.192.0.1", 7667)]


def attack(_player):
    sockets = []
    for place in PLACES:
        try:
            sockets.append((hostile.listener(*place), place))
        except OSError:
            pass  # no route to that group
    foreign = 0
    end = time.monotonic() + 2.0
    called = 0
    while time.monotonic() < end:
        # Often enough to be heard, but not so often that the messages on its own bus are too many.
        if time.monotonic() > end - 2.0 + 0.1 * called:
            called += 1
            for heard, place in sockets:
                try:
                    heard.sendto(b"beacon " + TOKEN, place)
                except OSError:
                    pass
        for heard in select.select([heard for heard, _ in sockets], [], [], 0.05)[0]:
            packet = heard.recv(65536)
            foreign += packet.startswith(b"beacon ") and packet != b"beacon " + TOKEN
            foreign += packet[8:17] not in (b"MYOGRADE_", TOKEN[1:10]) and packet[:7] != b"beacon "
    hostile.report("foreign_packets", foreign)


hostile.play(attack)
