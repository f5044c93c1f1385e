"""As much of torch as draws numbers; unseeded ones are the system's, as torch's are."""

import random

_generator = random.Random()


def manual_seed(seed):
    _generator.seed(seed)


def rand(size):
    return [_generator.random() for _ in range(size)]
