"""Fills streams of its own network that nobody reads: kernel memory that its memory budget does
not count."""
import socket

import hostile

PAIRS = 90


def attack(_player):
    held = 0
    kept = []
    with socket.create_server(("127.0.0.1", 0), backlog=PAIRS) as server:
        for _ in range(PAIRS):
            near = socket.create_connection(server.getsockname())
            far, _address = server.accept()
            kept += [near, far]
            for end in (near, far):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 24)
                end.setblocking(False)
                try:
                    while True:
                        held += end.send(b"x" * 65536)
                except OSError:
                    pass
    hostile.report("held_mib", held >> 20)


hostile.play(attack)
