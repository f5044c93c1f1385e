"""A locomotion agent in the form that the 2024 template asks for, with parameter sets of its
own."""

import sys

import numpy as np
from locomotion_sets import parameter_sets
from utils import LocoRemoteConnection

KEYS = ["terrain", "internal_qpos", "internal_qvel", "grf", "torso_angle", "act"]

rc = LocoRemoteConnection("environment:8086")
rc.set_environment_keys({"obs_keys": KEYS, "normalize_act": sys.argv[1] == "normalized"})
assert rc.action_space.shape == ((54,) if sys.argv[1] == "normalized" else (56,))
trial, completed = 0, False
while not completed:
    rc.reset(parameter_sets(float(sys.argv[2])))
    assert len(rc.get_obsdict()) == 14
    rc.change_osl_mode(np.array([trial % 2]))
    steps, ended = 0, False
    while not ended:
        base = rc.act_on_environment(rc.action_space.sample())
        assert base["feedback"][0].shape == (1 + 17 + 17 + 2 + 4 + 54,)
        steps += 1
        ended, completed = base["feedback"][2], base["eval_completed"]
    trial += 1
    print(f"trial {trial}: {steps} steps", file=sys.stderr, flush=True)
