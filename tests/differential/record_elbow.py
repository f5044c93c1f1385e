"""Records the official elbow environment into golden files of chosen or random seeds.

The same as record.py for the track elbow; the files have the form of tests/golden.

usage: record_elbow.py --out DIR [--seeds N | --seed S ...] [--steps N] [--actions KIND ...]
                       [--formula]
"""

import numpy as np

from official import (extras, fields, file_record, make, parser, plain, record, reset_record,
                      step_record)

NAME = "myoElbowPose1D6MRandom-v0"


# --- actions -------------------------------------------------------------

def sine(_env, step, _generator):
    return np.sin(0.1 * step + np.arange(6))


def uniform(_env, _step, generator):
    return generator.uniform(-1.0, 1.0, 6)


def wide(_env, _step, generator):
    """Also out of the declared range, which the official code does not clip."""
    return generator.uniform(-2.0, 2.0, 6)


def direct(_env, _step, generator):
    """Excitations as they are, some of them out of [0, 1]."""
    return generator.uniform(-0.2, 1.2, 6)


def reach(env, _step, generator):
    """Flexors and extensors pull towards the target, with some noise: the flag comes and goes."""
    pull = 1.5 * (env.target_jnt_value[0] - env.sim.data.qpos[0]) - 0.15 * env.sim.data.qvel[0]
    towards = np.where(np.arange(6) < 3, -pull, pull)
    return np.clip(towards - 0.2 + generator.normal(0, 0.3, 6), -1, 1)


ACTIONS = {"sine": sine, "uniform": uniform, "wide": wide, "direct": direct, "reach": reach}


# --- the environment -----------------------------------------------------

def state(env):
    return fields(env.sim.data, ("time", "qpos", "qvel", "act", "ctrl", "qacc", "actuator_force",
                                 "actuator_length", "ncon", "nefc"))


def model_record(env):
    return fields(env.sim.model, (
        "body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat",
        "jnt_range", "dof_damping", "dof_armature", "dof_M0", "dof_invweight0", "actuator_acc0",
        "actuator_lengthrange", "actuator_gainprm", "actuator_dynprm", "actuator_ctrlrange",
        "tendon_length0"))


def record_elbow(gymnasium, versions, seed, steps, kind):
    kwargs = {"normalize_act": False} if kind == "direct" else {}
    wrapped = make(gymnasium, NAME, seed, **kwargs)
    env = wrapped.unwrapped
    reset = {
        **reset_record(wrapped),
        "target": plain(env.target_jnt_value),
        "obs_extra": extras(env.obs_dict, squeeze=False),
        "state_after_reset": state(env),
    }
    generator = np.random.Generator(np.random.PCG64([seed, 2024]))
    for step in range(steps):
        played = step_record(wrapped, ACTIONS[kind](env, step, generator))
        played["obs_extra"] = extras(env.obs_dict, squeeze=True)
        reset["steps"].append(played | state(env))
        if played["terminated"] or played["truncated"]:
            break
    return file_record(
        env, versions, NAME, seed, kind == "sine",
        f"env.unwrapped.seed(seed), reset, {steps} steps through the time limit's wrapper",
        [reset], make_kwargs=kwargs, dt=float(env.dt), frame_skip=int(env.frame_skip),
        model=model_record(env))


def files(gymnasium, versions, seed, args):
    for kind in args.actions or (["sine"] if args.formula else ACTIONS):
        yield (f"elbow_{kind}_seed{seed}.json",
               record_elbow(gymnasium, versions, seed, args.steps, kind))


if __name__ == "__main__":
    options = parser(__doc__.split("\n", 1)[0], 100, "the sine actions alone")
    options.add_argument("--actions", choices=ACTIONS, action="append",
                         help="which actions (default: all kinds)")
    record(options, files)
