"""An agent of an image: it opens its files at absolute paths, as they are in Docker, and samples
its actions."""

import os

import numpy as np
from utils import LocoRemoteConnection

with open("/locomotion_sets.py", encoding="utf-8") as text:
    sets = {}
    exec(compile(text.read(), "locomotion_sets.py", "exec"), sets)
assert os.getcwd() == "/" and not os.path.exists("/policy"), os.listdir("/")
rc = LocoRemoteConnection("environment:8086")
completed, trial = False, 0
while not completed:
    rc.reset(sets["parameter_sets"](0.3))
    rc.change_osl_mode(np.array([trial % 4]))
    ended = False
    while not ended:
        base = rc.act_on_environment(rc.action_space.sample())
        ended, completed = base["feedback"][2], base["eval_completed"]
    trial += 1
