"""Takes terminals, which are few for a whole host, and makes one its controlling terminal."""
import fcntl
import os
import termios

import hostile


def attack(_player):
    for name in ("/dev/ptmx", "/dev/pts/ptmx"):
        hostile.attempt(name.strip("/").replace("/", "_"),
                        lambda name=name: os.open(name, os.O_RDWR))
    hostile.attempt("pair", os.openpty)
    hostile.attempt("type_ahead", lambda: fcntl.ioctl(0, termios.TIOCSTI, b"x"))
    hostile.attempt("own_terminal", lambda: os.open("/dev/tty", os.O_RDWR))


hostile.play(attack)
