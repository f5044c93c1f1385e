"""Records the official environment of chase-tag into golden files of chosen or random seeds.

The same as record.py for the track chasetag; the files have the form of tests/golden, but not every
step has its state, dictionary and action.

usage: record_chasetag.py --out DIR [--seeds N | --seed S ...] [--steps N]
                          [--actions KIND ...] [--formula]
"""

import hashlib

import numpy as np

from official import (contacts, extras, file_record, make, model_fields, muscle_actions, parser, plain,
                      record_actions, reset_record, state, step_record)

NAME = "myoChallengeChaseTagP2eval-v0"
MUSCLES = 80
# Steps whose state is recorded, and those whose dictionary is, too; so are every hundredth and the
# last. All have their contacts, opponent and rewards.
STATES = {0, 1, 2, 3, 4, 9, 14, 19}
DICTIONARIES = {0, 9, 19}
AT_REST = 1   # the opponent that this seed constructs does not move, so nothing of it is seen
ACTIONS = muscle_actions(MUSCLES, digits=3)


# --- the environment -----------------------------------------------------

def opponent(env):
    return {"opponent": plain(np.concatenate([env.opponent.get_opponent_pose(),
                                              env.opponent.opponent_vel]))}


def chase_state(env):
    return state(env) | opponent(env)


def model_record(env):
    """What the physics reads, and what the reset drew."""
    heights = np.array(env.heightfield.hfield.data, dtype=np.float32)
    noise = env.opponent.noise_process
    return {
        **model_fields(env),
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
        "state_after_reset": chase_state(env),
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
            played |= chase_state(env)
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
    for kind in args.actions:
        yield (f"chasetag_{kind}_seed{seed}.json",
               record_chase(gymnasium, versions, seed, args.steps, kind))


if __name__ == "__main__":
    options = parser(__doc__.split("\n", 1)[0], 60, "the sine actions alone")
    record_actions(options, ACTIONS, files, default=["sine", "uniform"])
