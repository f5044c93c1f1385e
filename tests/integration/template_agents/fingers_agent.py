"""An agent built as published ones of 2024: it makes its networks and a controller of its own for
the prosthetic hand before it connects, observes everything that the official environment knows, and
looks at the end of each trial."""

import json
import os
import pickle
import sys

import numpy as np
from utils import RemoteConnection

KEYS = ["time", "myohand_qpos", "myohand_qvel", "pros_hand_qpos", "pros_hand_qvel", "object_qpos",
        "object_qvel", "start_pos", "goal_pos", "max_force", "touching_body", "palm_pos", "fin0",
        "fin1", "fin2", "fin3", "fin4", "Rpalm_pos", "MPL_ori", "obj_pos", "reach_err", "pass_err",
        "act"]
OFFICIAL = {*KEYS, "qp", "qv", "elbow_fle", "MPL_ori_err"}
FINGERS = ["fin0", "fin1", "fin2", "fin3", "fin4"]


class Controller:
    """Moves the prosthetic hand along a table, whatever is observed."""

    def __init__(self, file):
        with open(file, encoding="utf-8") as table:
            self.poses = [np.array(pose) for pose in json.load(table)]
        self.reset()

    def reset(self):
        self.step = 0

    def predict(self):
        self.step += 1
        return self.poses[min(self.step // 5, len(self.poses) - 1)]


def observed(rc):
    entries = rc.get_obsdict()
    above = np.array([0.03, 0, 0.12 if entries["time"] < 0.05 else 0.04])
    return np.concatenate([rc.obsdict2obsvec(entries, KEYS),
                           entries["obj_pos"] - entries["Rpalm_pos"] - above])


controller = Controller(os.path.join(os.path.dirname(__file__), "hand.json"))
rc = RemoteConnection("environment:8085" if os.environ.get("POLICY_LOCAL") else "localhost:8085")
shape = observed(rc).shape
rc.set_output_keys(KEYS)
assert rc.observation_space.shape == (250,), rc.observation_space.shape
weights = pickle.loads(pickle.dumps(np.random.standard_normal((63, *shape)) * 0.01))
completed, entries = False, None
while not completed:
    observation, _ = rc.reset()
    controller.reset()
    entries = rc.get_obsdict()
    assert set(entries) == OFFICIAL, set(entries) ^ OFFICIAL
    assert len(entries) == 27
    assert observation.shape == (250,)
    for key in KEYS:
        assert np.isfinite(entries[key]).all(), key
    assert entries["touching_body"].dtype == np.int64
    # A hand: the finger tips are near its palm, and none is another.
    reach = [np.linalg.norm(entries[finger] - entries["palm_pos"]) for finger in FINGERS]
    assert all(0.01 < distance < 0.25 for distance in reach), reach
    assert len(set(reach)) == 5
    assert np.allclose(entries["MPL_ori"] - entries["MPL_ori_err"], [np.pi, 0, np.pi])
    assert np.allclose(entries["palm_pos"] - entries["obj_pos"], entries["reach_err"])
    ended, rewards = False, []
    while not ended:
        action = np.concatenate([np.tanh(weights @ observed(rc)), controller.predict()])
        base = rc.act_on_environment(action)
        ended, completed = base["feedback"][2], base["eval_completed"]
        rewards.append(base["feedback"][1])
    assert len(rewards) < 2 or all(reward < 0 for reward in rewards[:-1]), rewards
print(f"the last trial had {len(rewards)} steps", file=sys.stderr, flush=True)
