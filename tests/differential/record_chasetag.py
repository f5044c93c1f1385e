"""Records the official environment of chase-tag into golden files of chosen or random seeds.

The same as record.py for the track chasetag; the files have the form of tests/golden, but not every
step has its state, dictionary and action.

usage: record_chasetag.py --out DIR [--seeds N | --seed S ...] [--steps N]
                          [--actions KIND ...] [--formula]
"""

import hashlib

import numpy as np

from official import (extras, fields, file_record, make, parser, plain, record, reset_record,
                      step_record)

NAME = "myoChallengeChaseTagP2eval-v0"
MUSCLES = 80
# Steps whose state is recorded, and those whose dictionary is, too; so are every hundredth and the
# last. All have their contacts, opponent and rewards.
STATES = {0, 1, 2, 3, 4, 9, 14, 19}
DICTIONARIES = {0, 9, 19}
AT_REST = 1   # the opponent that this seed constructs does not move, so nothing of it is seen


# --- actions -------------------------------------------------------------

def sine(step, _generator):
    return np.sin(0.1 * step + np.arange(MUSCLES))


def uniform(_step, generator):
    return generator.uniform(-1.0, 1.0, MUSCLES).round(3)


def wide(_step, generator):
    """Also out of the declared range, which the official code does not clip."""
    return generator.uniform(-2.0, 2.0, MUSCLES).round(3)


def rest(_step, _generator):
    """The person falls, and may lie there until the time is over."""
    return np.full(MUSCLES, -1.0)


ACTIONS = {"sine": sine, "uniform": uniform, "wide": wide, "rest": rest}


# --- the environment -----------------------------------------------------

def contacts(env):
    return {"contacts": [[int(c.geom1), int(c.geom2)] for c in env.sim.data.contact]}


def opponent(env):
    return {"opponent": plain(np.concatenate([env.opponent.get_opponent_pose(),
                                              env.opponent.opponent_vel]))}


def state(env):
    return (fields(env.sim.data, ("time", "qpos", "qvel", "act", "ctrl", "nefc")) | contacts(env)
            | opponent(env))


def model_record(env):
    """What the physics reads, and what the reset drew."""
    model = env.sim.model
    heights = np.array(env.heightfield.hfield.data, dtype=np.float32)
    noise = env.opponent.noise_process
    return {
        **fields(model, ("body_mass", "body_inertia", "body_ipos", "jnt_range", "dof_M0",
                         "dof_invweight0", "actuator_acc0", "actuator_lengthrange",
                         "tendon_length0")),
        "heights_sha256": hashlib.sha256(heights.tobytes()).hexdigest(),
        "policy": env.opponent.opponent_policy,
        "chase_velocity": float(env.opponent.chase_velocity),
        "noise": plain(noise.buffer[:, ::100]),
    }


def record_chase(gymnasium, versions, seed, steps, kind):
    wrapped = make(gymnasium, NAME, seed, made_with=AT_REST)
    env = wrapped.unwrapped
    reset = {
        **reset_record(wrapped),
        "model": model_record(env),
        "obs_dict": extras(env.obs_dict, squeeze=False),
        "state_after_reset": state(env),
    }
    generator = np.random.Generator(np.random.PCG64([seed, 2023]))
    times = []
    for step in range(steps):
        played = step_record(wrapped, ACTIONS[kind](step, generator))
        times.append(float(np.squeeze(env.obs_dict["time"])))
        over = played["terminated"] or played["truncated"]
        if step in DICTIONARIES or over:
            played["obs_extra"] = extras(env.obs_dict, squeeze=True)
        else:
            del played["obs"]
        if kind in ("sine", "rest"):  # these follow from the step
            del played["action"]
        if step in STATES or step % 100 == 99 or over:
            played |= state(env)
        else:
            played |= contacts(env) | opponent(env)
        reset["steps"].append(played)
        if over:
            break
    path = {"env_infos": {
        "rwd_dict": {key: np.array([step["rwd_dict"][key] for step in reset["steps"]])
                     for key in ("sparse", "solved")},
        "obs_dict": {"time": np.array(times)}}}
    return file_record(
        env, versions, NAME, seed, kind == "sine",
        f"constructed with seed={AT_REST}, env.unwrapped.seed(seed), reset, {steps} steps through "
        "the time limit's wrapper", [reset], actions_are=kind, metrics=env.get_metrics([path]))


def files(gymnasium, versions, seed, args):
    for kind in args.actions or (["sine"] if args.formula else ["sine", "uniform"]):
        yield (f"chasetag_{kind}_seed{seed}.json",
               record_chase(gymnasium, versions, seed, args.steps, kind))


if __name__ == "__main__":
    options = parser(__doc__.split("\n", 1)[0], 60, "the sine actions alone")
    options.add_argument("--actions", choices=ACTIONS, action="append",
                         help="which actions (default: sine and uniform)")
    record(options, files)
