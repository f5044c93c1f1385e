"""Records the official environment of relocation into golden files of chosen or random seeds.

The same as record.py for the track relocation; the files have the form of tests/golden. The first steps
are recorded in full, of later ones the contacts and the rewards, and each tenth state.

usage: record_relocation.py --out DIR [--seeds N | --seed S ...] [--steps N]
                            [--actions KIND ...] [--formula]
"""

import numpy as np

from official import (contacts, extras, file_record, make, model_fields, muscle_actions, parser, plain,
                      record_actions, reset_record, state, step_record)

NAME = "myoChallengeRelocateP2eval-v0"
MUSCLES = 63
IN_FULL = 20  # steps
ACTIONS = muscle_actions(MUSCLES, digits=3)


# --- the environment -----------------------------------------------------

def model_record(env):
    """What the physics reads, after the reset's draws."""
    model = env.sim.model
    first = model.body_geomadr[env.object_bid]
    geoms = slice(first, first + model.body_geomnum[env.object_bid])
    return {
        **model_fields(env),
        "goal_pos": plain(np.array(model.body_pos[env.goal_bid])),
        "goal_quat": plain(np.array(model.body_quat[env.goal_bid])),
        "object_pos": plain(np.array(model.body_pos[env.object_bid])),
        "object_mass": float(model.body_mass[env.object_bid]),
        **{f"shape_{name}": plain(np.array(getattr(model, f"geom_{name}")[geoms]))
           for name in ("type", "size", "pos", "quat", "rgba", "friction", "rbound")},
    }


def record_object(gymnasium, versions, seed, steps, kind):
    wrapped = make(gymnasium, NAME, seed)
    env = wrapped.unwrapped
    reset = {
        **reset_record(wrapped),
        "model": model_record(env),
        "obs_dict": extras(env.obs_dict, squeeze=False),
        "state_after_reset": state(env),
    }
    generator = np.random.Generator(np.random.PCG64([seed, 2023]))
    for step in range(steps):
        played = step_record(wrapped, ACTIONS[kind](step, generator))
        over = played["terminated"] or played["truncated"]
        if step < IN_FULL or over:
            played["obs_extra"] = extras(env.obs_dict, squeeze=True)
        else:
            del played["obs"]
        keep_state = step < IN_FULL or step % 10 == 9 or over
        reset["steps"].append(played | (state if keep_state else contacts)(env))
        if over:
            break
    path = {"env_infos": {"rwd_dict": {
        key: np.array([step["rwd_dict"][key] for step in reset["steps"]])
        for key in ("solved", "act_reg")}}}
    return file_record(
        env, versions, NAME, seed, kind == "sine",
        f"env.unwrapped.seed(seed), reset, {steps} steps through the time limit's wrapper",
        [reset], metrics=env.get_metrics([path]))


def files(gymnasium, versions, seed, args):
    for kind in args.actions:
        yield (f"relocation_{kind}_seed{seed}.json",
               record_object(gymnasium, versions, seed, args.steps, kind))


if __name__ == "__main__":
    options = parser(__doc__.split("\n", 1)[0], 150, "the sine actions alone")
    record_actions(options, ACTIONS, files)
