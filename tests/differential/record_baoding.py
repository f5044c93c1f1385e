"""Records the official environment of Baoding balls into golden files of chosen or random seeds.

The same as record.py for the track baoding; the files have the form of tests/golden.

usage: record_baoding.py --out DIR [--seeds N | --seed S ...] [--steps N]
                         [--actions KIND ...] [--formula]
"""

import numpy as np

import hand
from official import make, parser, plain, record_actions

NAME = "myoChallengeBaodingP2-v1"
MADE_WITH = 0  # the constructor draws too, and places what the first observation shows


def cup(_step, _generator):
    """The hand holds the balls in its hollow, of many seeds for the whole episode."""
    action = np.full(hand.MUSCLES, -1.0)
    action[0:3] = 0.3  # extensors of the wrist
    action[3:6] = -0.4  # its flexors
    action[6:8] = -0.2  # pronators
    action[8:12] = -0.3  # superficial flexors of the fingers
    action[12:16] = -0.9  # deep ones
    action[[24, 26]] = 0.15  # FPL and OP of the thumb
    action[27:] = 1.0  # within the palm
    return action


ACTIONS = hand.ACTIONS | {"cup": cup}


def drawn(env):
    model = env.sim.model
    bodies = [env.object1_bid, env.object2_bid]
    geoms = [env.object1_gid, env.object2_gid]
    sites = [env.target1_sid, env.target2_sid]
    return {
        "task": env.which_task.value,
        "start_angle": float(env.ball_1_starting_angle),
        "radii": [float(env.x_radius), float(env.y_radius)],
        "goal": plain(np.array(env.goal[:201, 0])),
        "ball_mass": plain(np.array(model.body_mass[bodies])),
        "ball_friction": plain(np.array(model.geom_friction[geoms])),
        "ball_size": plain(np.array(model.geom_size[geoms])),
        "ball_rbound": plain(np.array(model.geom_rbound[geoms])),
        "target_site_pos": plain(np.array(model.site_pos[sites])),
    }


def files(gymnasium, versions, seed, args):
    for kind in args.actions:
        env = make(gymnasium, NAME, seed, made_with=MADE_WITH)
        yield (f"baoding_{kind}_seed{seed}.json",
               hand.episode(env, versions, NAME, seed, args.steps, ACTIONS[kind], drawn,
                            f"gymnasium.make(env, seed={MADE_WITH}), env.unwrapped.seed(seed)"))


if __name__ == "__main__":
    options = parser(__doc__.split("\n", 1)[0], 200, "the sine actions alone")
    record_actions(options, ACTIONS, files)
