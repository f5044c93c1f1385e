"""Records the official environment of die reorientation into golden files of chosen or random seeds.

The same as record.py for the track reorientation; the files have the form of tests/golden.

usage: record_reorientation.py --out DIR [--seeds N | --seed S ...] [--steps N]
                               [--actions KIND ...] [--formula]
"""

import numpy as np

from official import (extras, fields, file_record, make, parser, plain, record, reset_record,
                      step_record)

NAME = "myoChallengeDieReorientP2-v0"
MUSCLES = 39


# --- actions -------------------------------------------------------------

def sine(step, _generator):
    return np.sin(0.1 * step + np.arange(MUSCLES))


def uniform(_step, generator):
    return generator.uniform(-1.0, 1.0, MUSCLES)


def wide(_step, generator):
    """Also out of the declared range, which the official code does not clip."""
    return generator.uniform(-2.0, 2.0, MUSCLES)


def rest(_step, _generator):
    """The hand stays open and the die lies on it."""
    return np.full(MUSCLES, -1.0)


ACTIONS = {"sine": sine, "uniform": uniform, "wide": wide, "rest": rest}


# --- the environment -----------------------------------------------------

def state(env):
    data = env.sim.data
    contacts = [[int(c.geom1), int(c.geom2)] for c in data.contact]
    return {**fields(data, ("time", "qpos", "qvel", "act", "ctrl", "qacc", "ncon", "nefc")),
            "contacts": contacts}


def model_record(env):
    """What the physics reads, after the reset's draws."""
    model = env.sim.model
    die = slice(env.object_gid0, env.object_gidn)
    return {
        **fields(model, ("body_mass", "body_inertia", "body_ipos", "body_iquat", "jnt_range",
                         "dof_M0", "dof_invweight0", "actuator_acc0", "actuator_lengthrange",
                         "tendon_length0")),
        "goal_pos": plain(np.array(model.body_pos[env.goal_bid])),
        "goal_quat": plain(np.array(model.body_quat[env.goal_bid])),
        "goal_size": plain(np.array(model.geom_size[env.target_gid])),
        "die_friction": plain(np.array(model.geom_friction[die])),
        "die_mass": float(model.body_mass[env.object_bid]),
        "die_size": plain(np.array(model.geom_size[die])),
        "die_pos": plain(np.array(model.geom_pos[die])),
        "die_rbound": plain(np.array(model.geom_rbound[die])),
    }


def record_die(gymnasium, versions, seed, steps, kind):
    wrapped = make(gymnasium, NAME, seed)
    env = wrapped.unwrapped
    reset = {
        **reset_record(wrapped),
        "model": model_record(env),
        "obs_extra": extras(env.obs_dict, squeeze=False),
        "state_after_reset": state(env),
    }
    generator = np.random.Generator(np.random.PCG64([seed, 2022]))
    for step in range(steps):
        played = step_record(wrapped, ACTIONS[kind](step, generator))
        played["obs_extra"] = extras(env.obs_dict, squeeze=True)
        reset["steps"].append(played | state(env))
        if played["terminated"] or played["truncated"]:
            break
    path = {"env_infos": {"rwd_dict": {
        key: np.array([step["rwd_dict"][key] for step in reset["steps"]])
        for key in ("solved", "act_reg")}}}
    return file_record(
        env, versions, NAME, seed, kind == "sine",
        f"env.unwrapped.seed(seed), reset, {steps} steps through the time limit's wrapper",
        [reset], metrics=env.get_metrics([path]))


def files(gymnasium, versions, seed, args):
    for kind in args.actions or (["sine"] if args.formula else ACTIONS):
        yield (f"reorientation_{kind}_seed{seed}.json",
               record_die(gymnasium, versions, seed, args.steps, kind))


if __name__ == "__main__":
    options = parser(__doc__.split("\n", 1)[0], 150, "the sine actions alone")
    options.add_argument("--actions", choices=ACTIONS, action="append",
                         help="which actions (default: all kinds)")
    record(options, files)
