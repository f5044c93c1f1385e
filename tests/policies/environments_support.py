"""What the tests of the environments share."""

import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

import gymnasium
import numpy as np

import myograde
import myograde.envs

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
NAMES = list(myograde.envs.ENVIRONMENTS)


def make(name, **settings):
    """Without the wrappers of gymnasium.make."""
    return gymnasium.make(name, **settings).unwrapped


def actions_of(env, count, seed=0):
    """Random ones, the same for the same seed."""
    generator = np.random.default_rng(seed)
    low, high = env.action_space.low, env.action_space.high
    return generator.uniform(low, high, (count, *low.shape))


def read_log(track):
    """An episode that a server graded: the header, the actions, and how it ended."""
    file = SOURCE / f"configs/reference/{track}.lcmlog.zst"
    data = subprocess.run(["zstd", "-dc", file], check=True, capture_output=True).stdout
    place, header, end, actions = 0, None, None, []
    while place < len(data):
        _, _, _, name_size, size = struct.unpack_from(">IqqII", data, place)
        name = data[place + 28:place + 28 + name_size].decode()
        body = data[place + 28 + name_size:place + 28 + name_size + size]
        place += 28 + name_size + size
        if name == "MYOGRADE_LOG_HEADER":
            header = json.loads(myograde.log_text_t.decode(body).json)
        elif name == "MYOGRADE_LOG_END":
            end = json.loads(myograde.log_text_t.decode(body).json)
        elif name == "MYOGRADE_ACTION":
            actions.append(list(myograde.action_t.decode(body).values))
    return header, np.array(actions), end


class InFolder(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def short(self, track, steps):
        """A config of short episodes."""
        rules = {"elbow": {"max_steps": steps, "hold_steps": 5},
                 "manipulation": {"max_steps": steps},
                 "reorientation": {"max_steps": steps},
                 "baoding": {"max_steps": steps},
                 "relocation": {"max_steps": steps},
                 "chasetag": {"max_steps": steps},
                 "locomotion": {"end": {"time_limit_s": steps / 200}}}[track]
        file = self.folder / f"{track}-{steps}.json"
        file.write_text(json.dumps({"extends": track, "rules": rules}))
        return file

    def python(self, *words, **variables):
        environment = {**os.environ, **variables}
        return subprocess.run([sys.executable, "-B", *map(str, words)], capture_output=True,
                              text=True, timeout=120, cwd=self.folder,
                              env={name: value for name, value in environment.items()
                                   if value is not None})
