"""Prints everything that might tell it which episode it plays."""
import os
import sys
import time

import hostile


def tell(player):
    print("seed", player.policy_seed, "clock", time.time(), "random", os.getrandom(8).hex())
    for key, value in sorted(os.environ.items()):
        print(key, value)
    print(sys.argv, open("/proc/self/cmdline", "rb").read())
    print("x" * 200000, flush=True)
    hostile.report(f"policy_seed{player.now[0]}", player.policy_seed)


hostile.play(on_reset=tell)
