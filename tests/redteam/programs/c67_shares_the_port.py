"""Shares the bridge's port and makes the kernel choose its own socket for each packet."""
import ctypes
import socket
import struct

import hostile

SO_ATTACH_REUSEPORT_CBPF = 51


def attack(_player):
    rivals = [hostile.listener() for _ in range(10)]
    code = ctypes.create_string_buffer(struct.pack("HBBI", 0x06, 0, 0, 0))  # always socket 0
    program = struct.pack("HL", 1, ctypes.addressof(code))
    hostile.attempt("chosen", lambda: rivals[0].setsockopt(
        socket.SOL_SOCKET, SO_ATTACH_REUSEPORT_CBPF, program))
    attack.rivals = rivals


hostile.play(attack)
