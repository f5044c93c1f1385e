"""An agent that tells by its trials which of the leg's parameter sets is in force: it uploads two
(2 and 3) in each reset, changes to those of its arguments, one for each trial ("-": to none), and
lets the muscles rest."""

import sys

import numpy as np
from utils import LocoRemoteConnection

from locomotion_sets import parameter_sets

rc = LocoRemoteConnection("localhost:8086")
completed = False
for mode in sys.argv[1:]:
    rc.reset({2: parameter_sets(0.9)[0], 3: parameter_sets(0.1)[0]})
    if mode != "-":
        rc.change_osl_mode(np.array([int(mode)]))
    while not rc.act_on_environment(np.zeros(54))["feedback"][2]:
        pass
