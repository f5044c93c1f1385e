"""Tries to change its network: the interface, the routes, the bus itself."""
import fcntl
import socket
import struct

import hostile

SIOCADDRT, SIOCSIFFLAGS, SIOCSIFADDR, SIOCSIFMTU, SIOCDELRT = 0x890B, 0x8914, 0x8916, 0x8922, 0x890C


def change(request, rest):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, request, struct.pack("16s24s", b"lo", rest))


def priority():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        any_socket.setsockopt(socket.SOL_SOCKET, 33, 1 << 20)  # SO_RCVBUFFORCE


def transparent():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        any_socket.setsockopt(socket.IPPROTO_IP, 19, 1)  # IP_TRANSPARENT


def attack(_player):
    hostile.attempt("interface_down", lambda: change(SIOCSIFFLAGS, struct.pack("h", 0)))
    hostile.attempt("address", lambda: change(SIOCSIFADDR, struct.pack("HH4s", 2, 0, b"\n\0\0\1")))
    hostile.attempt("mtu", lambda: change(SIOCSIFMTU, struct.pack("i", 68)))
    hostile.attempt("route", lambda: change(SIOCADDRT, b"\0" * 24))
    hostile.attempt("no_route", lambda: change(SIOCDELRT, b"\0" * 24))
    hostile.attempt("buffers", priority)
    hostile.attempt("transparent", transparent)
    groups = [hostile.listener() for _ in range(20)]
    hostile.report("memberships", len(groups))


hostile.play(attack)
