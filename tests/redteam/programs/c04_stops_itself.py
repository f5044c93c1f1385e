"""Stops itself with a signal that can't be caught."""
import os
import signal

import hostile

hostile.play(lambda _player: os.kill(os.getpid(), signal.SIGSTOP))
