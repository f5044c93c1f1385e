"""Takes longer for its start than for any step, and never flushes its output."""
import hostile

hostile.burn(2.5)
print("ready at last", end="")
hostile.play(lambda _player: print("thinking", end=""))
