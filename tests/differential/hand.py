"""What the recorders of the hand's tracks share: actions, states and whole episodes."""

import numpy as np

from official import extras, fields, file_record, record, reset_record, step_record

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
    """The hand stays open and what is on it lies."""
    return np.full(MUSCLES, -1.0)


ACTIONS = {"sine": sine, "uniform": uniform, "wide": wide, "rest": rest}


# --- records -------------------------------------------------------------

def model_fields(env):
    """What the physics reads of every body, joint and muscle."""
    return fields(env.sim.model, (
        "body_mass", "body_inertia", "body_ipos", "body_iquat", "jnt_range", "dof_M0",
        "dof_invweight0", "actuator_acc0", "actuator_lengthrange", "tendon_length0"))


def _state(env):
    data = env.sim.data
    contacts = [[int(c.geom1), int(c.geom2)] for c in data.contact]
    return {**fields(data, ("time", "qpos", "qvel", "act", "ctrl", "ncon", "nefc")),
            "contacts": contacts}


def episode(wrapped, versions, name, seed, steps, act, model_record, made="env.unwrapped.seed(seed)"):
    """A golden file of one episode of the actions `act(step, generator)`. `model_record(env)`: what
    the reset's draws changed in the model."""
    env = wrapped.unwrapped
    reset = {
        **reset_record(wrapped),
        "model": {**model_fields(env), **model_record(env)},
        "obs_extra": extras(env.obs_dict, squeeze=False),
        "state_after_reset": _state(env),
    }
    generator = np.random.Generator(np.random.PCG64([seed, 2022]))
    for step in range(steps):
        played = step_record(wrapped, act(step, generator))
        played["obs_extra"] = extras(env.obs_dict, squeeze=True)
        reset["steps"].append(played | _state(env))
        if played["terminated"] or played["truncated"]:
            break
    path = {"env_infos": {"rwd_dict": {
        key: np.array([step["rwd_dict"][key] for step in reset["steps"]])
        for key in ("solved", "act_reg")}}}
    return file_record(
        env, versions, name, seed, act is sine,
        f"{made}, reset, {steps} steps through the time limit's wrapper",
        [reset], metrics=env.get_metrics([path]))


def record_actions(options, actions, files):
    """As official.record, of chosen kinds of `actions`: `files` gets their names as args.actions."""
    options.add_argument("--actions", choices=actions, action="append",
                         help="which actions (default: all kinds)")

    def of_kinds(gymnasium, versions, seed, args):
        args.actions = args.actions or (["sine"] if args.formula else list(actions))
        return files(gymnasium, versions, seed, args)
    record(options, of_kinds)
