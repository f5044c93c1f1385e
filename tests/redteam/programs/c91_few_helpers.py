"""Honest: has some work done by helpers, and waits for only every second one."""
import os
import signal

import hostile


def help_me(player):
    episode, step = player.now
    signal.signal(signal.SIGCHLD, (signal.SIG_IGN, signal.SIG_DFL)[step % 2])
    hostile.spawn(lambda: hostile.burn(0.01))
    try:
        os.wait()
    except ChildProcessError:
        pass
    player.when = (episode, step + 1) if step < 40 else player.when
    if step == 40:
        hostile.report("helpers", "done")


hostile.play(help_me)
