"""Takes terminals until it gets no more, and makes one its controlling terminal."""
import fcntl
import os
import termios

import hostile


def attack(_player):
    pairs = []
    try:
        while len(pairs) < 5000:
            pairs.append(os.openpty())
    except OSError:
        pass
    hostile.report("terminals", "bounded" if len(pairs) < 1000 else len(pairs))
    if pairs:
        hostile.attempt("type_ahead",
                        lambda: fcntl.ioctl(pairs[0][1], termios.TIOCSTI, b"x"))
    hostile.attempt("own_terminal", lambda: os.open("/dev/tty", os.O_RDWR))
    for pair in pairs:
        os.close(pair[0])
        os.close(pair[1])


hostile.play(attack)
