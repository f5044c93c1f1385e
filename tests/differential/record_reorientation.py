"""Records the official environment of die reorientation into golden files of chosen or random seeds.

The same as record.py for the track reorientation; the files have the form of tests/golden.

usage: record_reorientation.py --out DIR [--seeds N | --seed S ...] [--steps N]
                               [--actions KIND ...] [--formula]
"""

import numpy as np

import hand
from official import make, parser, plain, record_actions

NAME = "myoChallengeDieReorientP2-v0"


def drawn(env):
    model = env.sim.model
    die = slice(env.object_gid0, env.object_gidn)
    return {
        "goal_pos": plain(np.array(model.body_pos[env.goal_bid])),
        "goal_quat": plain(np.array(model.body_quat[env.goal_bid])),
        "goal_size": plain(np.array(model.geom_size[env.target_gid])),
        "die_friction": plain(np.array(model.geom_friction[die])),
        "die_mass": float(model.body_mass[env.object_bid]),
        "die_size": plain(np.array(model.geom_size[die])),
        "die_pos": plain(np.array(model.geom_pos[die])),
        "die_rbound": plain(np.array(model.geom_rbound[die])),
    }


def files(gymnasium, versions, seed, args):
    for kind in args.actions:
        env = make(gymnasium, NAME, seed)
        yield (f"reorientation_{kind}_seed{seed}.json",
               hand.episode(env, versions, NAME, seed, args.steps, hand.ACTIONS[kind], drawn))


if __name__ == "__main__":
    options = parser(__doc__.split("\n", 1)[0], 150, "the sine actions alone")
    record_actions(options, hand.ACTIONS, files)
