"""Messages that do not match their channel: fingerprints, lengths, counts, strings."""
import struct
import sys
import time

import hostile
from myograde.give_up_t import give_up_t
from myograde.hello_t import hello_t


def hello(name_length, name=b"x\0", sets=0, rest=b""):
    """An encoded hello with arbitrary lengths."""
    return (hello_t._get_packed_fingerprint() + struct.pack(">ii", 1, name_length) + name
            + struct.pack(">bi", 0, sets) + rest)


def sized(size, count):
    """An action that claims `size` values and carries `count`."""
    head = hostile.still(0, 3)[:24]
    return head + struct.pack(">i", size) + bytes(8 * count)


GOOD = hostile.still(0, 3)
WAYS = {
    "fingerprint": ("ACTION", b"\xde\xad\xbe\xef" * 2 + GOOD[8:]),
    "other-type": ("ACTION", hello(2)),
    "short": ("ACTION", GOOD[:-1]),
    "header-only": ("ACTION", GOOD[:8]),
    "empty": ("ACTION", b""),
    "long": ("ACTION", GOOD + b"\0"),
    "negative-size": ("ACTION", sized(-1, 55)),
    "smallest-size": ("ACTION", sized(-2**31, 55)),
    "huge-size": ("ACTION", sized(2**31 - 1, 55)),
    "wrapping-size": ("ACTION", sized(2**29 + 55, 55)),
    "empty-string": ("HELLO", hello(0, b"")),
    "negative-string": ("HELLO", hello(-1, b"")),
    "huge-string": ("HELLO", hello(2**31 - 1)),
    "endless-string": ("HELLO", hello(2, b"xx")),
    "negative-sets": ("HELLO", hello(2, sets=-1)),
    "huge-sets": ("HELLO", hello(2, sets=2**31 - 1)),
    "cut-sets": ("EPISODE_READY", bytes(12)),
    "giving-up-short": ("GIVE_UP", give_up_t._get_packed_fingerprint() + bytes(15)),
    "giving-up-as-action": ("GIVE_UP", GOOD),
}


def attack(_player):
    bus = hostile.RawBus()
    for _ in range(20):
        bus.publish("MYOGRADE_" + WAYS[sys.argv[1]][0], WAYS[sys.argv[1]][1])
        time.sleep(0.005)


hostile.play(attack)
