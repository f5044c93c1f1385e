"""A locomotion agent in the form that the 2024 template asks for, with parameter sets of its
own."""

import sys

import numpy as np
from utils import LocoRemoteConnection

KEYS = ["terrain", "internal_qpos", "internal_qvel", "grf", "torso_angle", "act"]


def state(knee, ankle, **thresholds):
    return {"gain": {"knee_stiffness": 99.372, "knee_damping": 3.18, "knee_target_angle": knee,
                     "ankle_stiffness": 19.874, "ankle_damping": 0.0, "ankle_target_angle": ankle},
            "threshold": thresholds}


def parameter_sets(knee):
    states = {"e_stance": state(knee, 0.0, ankle_angle=(0.1, "above")),
              "l_stance": state(knee, 0.1, load=(115.0, "below")),
              "e_swing": state(1.0, 0.2, knee_angle=(0.9, "above"), knee_vel=(0.05, "below")),
              "l_swing": state(0.1, 0.2, load=(300.0, "above"), knee_angle=(0.5, "below"))}
    return {index: states for index in range(4)}


rc = LocoRemoteConnection("localhost:8086")
rc.set_environment_keys({"obs_keys": KEYS, "normalize_act": sys.argv[1] == "normalized"})
trial = 0
while True:
    rc.reset(parameter_sets(float(sys.argv[2])))
    rc.change_osl_mode(np.array([trial % 2]))
    steps, ended = 0, False
    while not ended:
        base = rc.act_on_environment(rc.action_space.sample())
        assert base["feedback"][0].shape == (1 + 17 + 17 + 2 + 4 + 54,)
        steps += 1
        ended = base["feedback"][2]
    trial += 1
    print(f"trial {trial}: {steps} steps", file=sys.stderr, flush=True)
