"""An agent in the form that the 2024 template asks for: it asks for its environment and steps
it."""

import sys
import time

import evaluation_pb2  # noqa: F401  as the template does
import grpc  # noqa: F401
import gymnasium  # noqa: F401
import numpy as np
from utils import DummyManiEnv, RemoteConnection

KEYS = ["time", "myohand_qpos", "object_qpos", "goal_pos", "obj_pos", "reach_err", "act",
        "touching_body"]

time.sleep(60)
rc = RemoteConnection("localhost:8085")
rc.set_output_keys(KEYS)
rc.set_observation_space(rc.obsdict2obsvec(rc.get_obsdict(), KEYS).shape)
spaces = DummyManiEnv("myoChallengeBimanual-v0", rc)
assert spaces.action_space.shape == (80,), spaces.action_space.shape
trial, completed = 0, False
while not completed:
    observation, info = rc.reset()
    assert observation.shape == rc.observation_space.shape and observation.dtype == np.float32
    assert info == {}
    first = rc.get_obsdict()
    # The object starts turned so that its own third axis is the world's -y.
    offset = first["obj_pos"] - first["object_qpos"][:3]
    assert np.allclose(offset, [0, -0.015, 0], atol=1e-4), offset
    steps, ended = 0, False
    while not ended:
        base = rc.act_on_environment(np.zeros(80))
        steps += 1
        assert base["current_score"] == steps
        ended, completed = base["feedback"][2], base["eval_completed"]
    again = rc.act_on_environment(np.ones(80))  # changes nothing any more
    assert again["feedback"][2] and again["current_score"] == steps
    trial += 1
    print(f"trial {trial}: {steps} steps", file=sys.stderr, flush=True)
print("all trials are over", file=sys.stderr, flush=True)
