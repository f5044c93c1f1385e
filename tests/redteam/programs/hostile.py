"""Shared by the hostile programs in Python: an honest player that misbehaves once at a given
moment, findings that the suite reads, and a bus without checks.

A finding is a line "RT NAME RESULT" on standard error. RESULT is the name of an error ("EPERM") for
what was denied, "allowed" for what worked, or a value. Only the last 4 KiB of standard error are
kept, so findings are short.
"""

import errno
import os
import random
import socket
import struct
import sys
import time

import myograde
from myograde.action_t import action_t

GROUP, PORT = "239.255.76.67", 7667
SHORT, FRAGMENT = 0x4C433032, 0x4C433033
ACTION_SIZE = 55  # of the locomotion track


def report(name, result):
    sys.stderr.write(f"RT {name} {result}\n")
    sys.stderr.flush()


def attempt(name, action):
    """Reports whether `action` was allowed; returns its value, or None if it was denied."""
    try:
        value = action()
    except OSError as refused:
        report(name, errno.errorcode.get(refused.errno, refused.errno))
        return None
    report(name, "allowed")
    return value if value is not None else True


class Player(myograde.Policy):
    """Plays honestly and calls attack(self) once, before it answers `step` of `episode`."""

    name = "hostile"

    def __init__(self, attack=None, episode=0, step=3, on_reset=None):
        self.attack = attack
        self.when = (episode, step)
        self.on_reset = on_reset
        self.now = (-1, -1)
        self.policy_seed = 0

    def reset(self, episode):
        self.now = (episode.episode, -1)
        self.policy_seed = episode.policy_seed
        if self.on_reset is not None:
            self.on_reset(self)

    def act(self, observation):
        self.now = (self.now[0], self.now[1] + 1)
        if self.now == self.when and self.attack is not None:
            self.attack(self)
        return [0.0] * self.welcome.action_size


def play(attack=None, episode=0, step=3, on_reset=None):
    myograde.serve(Player(attack, episode, step, on_reset))


def burn(cpu_s):
    """Uses this much CPU time of this thread."""
    end = time.thread_time() + cpu_s
    while time.thread_time() < end:
        pass


class RawBus:
    """Sends arbitrary bytes to the bus, and receives from it without a queue in between."""

    def __init__(self):
        self.sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        self.sequence = random.randrange(1 << 16)

    def send(self, datagram):
        try:
            self.sender.sendto(datagram, (GROUP, PORT))
        except OSError:
            time.sleep(0.001)  # the queue is full, as the grader may decide

    def publish(self, channel, payload):
        self.sequence += 1
        self.send(struct.pack(">II", SHORT, self.sequence) + channel.encode() + b"\0" + payload)

    def fragment(self, sequence, size, offset, number, count, rest=b""):
        """LCM's fragment header: magic, sequence, whole size, offset, number and count."""
        self.send(struct.pack(">IIIIHH", FRAGMENT, sequence, size, offset, number, count) + rest)


def listener(group=GROUP, port=PORT):
    """A socket that hears a multicast group."""
    heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    heard.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    heard.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    heard.bind((group, port))
    heard.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                     socket.inet_aton(group) + socket.inet_aton("0.0.0.0"))
    return heard


def action(episode, step, values):
    """An encoded action with any values."""
    message = action_t()
    message.episode, message.step = episode, step
    message.size, message.values = len(values), list(values)
    return message.encode()


def still(episode, step, value=0.0):
    return action(episode, step, [value] * ACTION_SIZE)


def spawn(work):
    """Runs work() in a child process; the parent gets its pid."""
    pid = os.fork()
    if pid == 0:
        try:
            work()
        finally:
            os._exit(0)
    return pid
