"""Plays the arm by raw controls: chooses them with a dictionary of one key after its outputs, and
counts the phases of its plan from the time 0 of each trial. The argument is the angle in rad that
the prosthesis holds its first joint at."""

import sys
import time

import numpy as np
from utils import RemoteConnection

KEYS = ["myohand_qpos", "act", "touching_body", "time"]

time.sleep(10)
rc = RemoteConnection("localhost:8085")
rc.get_obsdict()
rc.set_output_keys(KEYS)
size = rc.get_observation_space()
rc.set_environment_keys({"normalize_act": False})
assert rc.get_observation_space() == size, "the outputs were chosen before"

action = np.concatenate([np.full(63, 0.1), np.zeros(17)])
action[63] = float(sys.argv[1])
over = False
while not over:
    rc.reset()
    steps, ended = 0, False
    while not ended:
        observation = rc.obsdict2obsvec(rc.get_obsdict(), KEYS)
        assert observation.size == size
        assert (observation[-1] == 0.0) == (steps == 0), (steps, observation[-1])
        base = rc.act_on_environment(action)
        ended, over = base["feedback"][2], base["eval_completed"]
        steps += 1
