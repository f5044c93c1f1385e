"""Tries to be another program in its second episode, and reports what it is in both."""
import hashlib
import os

import hostile


def change(player):
    with open(__file__, "rb") as file:
        digest = hashlib.sha256(file.read()).hexdigest()[:16]
    hostile.report(f"hash{player.now[0]}", digest)
    hostile.attempt("overwrite", lambda: os.open(__file__, os.O_WRONLY | os.O_TRUNC))
    hostile.attempt("replace", lambda: os.rename("/tmp/other.py", __file__))
    hostile.attempt("rename_folder", lambda: os.rename("/policy", "/policy2"))


with open("/tmp/other.py", "w", encoding="utf-8") as other:
    other.write("raise SystemExit(3)\n")
hostile.play(on_reset=change)
