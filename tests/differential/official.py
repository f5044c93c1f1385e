"""What the recorders share: the official environments, their values as JSON has them, and the form
of the golden files (tests/golden). Needs the packages of requirements.txt (Python 3.11)."""

import argparse
import contextlib
import io
import json
import os
import pathlib
import secrets

os.environ.setdefault("MUJOCO_GL", "disabled")

import numpy as np  # noqa: E402  (after the choice of no renderer)

ACTION_FORMULA = "a_t[i] = sin(0.1*t + i), t=0..N-1"


def load():
    """Imports the official packages without their banner: gymnasium and everybody's versions."""
    with contextlib.redirect_stdout(io.StringIO()):
        import gymnasium
        import mujoco
        import myosuite  # noqa: F401  (registers the environments)
    return gymnasium, {
        "mujoco_version": mujoco.__version__,
        "numpy_version": np.__version__,
        "myosuite_version": "2.8.4",
        "gymnasium_version": gymnasium.__version__,
    }


def make(gymnasium, name, seed, made_with=None, **kwargs):
    """An environment with its wrappers. It and NumPy draw from `seed` on. `made_with`: the seed of
    what the constructor draws."""
    if made_with is not None:
        kwargs["seed"] = made_with
    with contextlib.redirect_stdout(io.StringIO()):
        env = gymnasium.make(name, **kwargs)
    env.unwrapped.seed(seed)
    np.random.seed(seed)
    return env


# --- values --------------------------------------------------------------

def plain(value):
    """NumPy values as JSON has them; floats keep every bit."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    return value


def fields(source, names):
    """Arrays of a MjModel or MjData by their names."""
    return {name: plain(np.array(getattr(source, name))) for name in names}


def extras(obs_dict, squeeze):
    """The whole dictionary of an observation."""
    return {
        key: plain(np.squeeze(value) if squeeze else np.array(value))
        for key, value in obs_dict.items()
    }


def _generator_state(env):
    state = env.np_random.bit_generator.state
    return {
        "state": str(state["state"]["state"]),
        "inc": str(state["state"]["inc"]),
        "has_uint32": state["has_uint32"],
        "uinteger": state["uinteger"],
    }


def _offsets(env):
    table, start = {}, 0
    for key in env.obs_keys:
        size = int(np.size(env.obs_dict[key]))
        table[key] = [start, start + size]
        start += size
    return table


# --- tracks of muscles ---------------------------------------------------

def muscle_actions(muscles, digits=None):
    """Kinds of actions `act(step, generator)`; random ones are rounded to so many `digits`."""
    def uniform(largest):
        return lambda _step, generator: (
            generator.uniform(-largest, largest, muscles) if digits is None
            else generator.uniform(-largest, largest, muscles).round(digits))

    return {
        "sine": lambda step, _generator: np.sin(0.1 * step + np.arange(muscles)),
        "uniform": uniform(1.0),
        "wide": uniform(2.0),  # also out of the declared range, which the official code does not clip
        "rest": lambda _step, _generator: np.full(muscles, -1.0),
    }


def model_fields(env, *more):
    """What the physics reads of every body, joint and muscle."""
    return fields(env.sim.model, (
        "body_mass", "body_inertia", "body_ipos", "jnt_range", "dof_M0", "dof_invweight0",
        "actuator_acc0", "actuator_lengthrange", "tendon_length0", *more))


def contacts(env):
    return {"contacts": [[int(c.geom1), int(c.geom2)] for c in env.sim.data.contact]}


def state(env, *more):
    return fields(env.sim.data, ("time", "qpos", "qvel", "act", "ctrl", "nefc", *more)) | contacts(env)


# --- parts of a file -----------------------------------------------------

def reset_record(env, index=0):
    """Resets the environment. Its steps are added by whoever plays on."""
    before = _generator_state(env.unwrapped)
    obs, _ = env.reset()
    return {
        "reset_index": index,
        "rng_before": before,
        "rng_after": _generator_state(env.unwrapped),
        "obs_at_reset": plain(obs),
        "steps": [],
    }


def step_record(env, action):
    obs, reward, terminated, truncated, _ = env.step(action)
    return {
        "action": plain(np.asarray(action)),
        "obs": plain(obs),
        "reward": plain(reward),
        "terminated": bool(terminated),
        "truncated": bool(truncated),
        "rwd_dict": {key: plain(np.squeeze(v)) for key, v in env.unwrapped.rwd_dict.items()},
    }


def file_record(env, versions, name, seed, formula, how, resets, **more):
    """A whole golden file."""
    return {
        **versions,
        "action_formula": ACTION_FORMULA if formula else "recorded with each step",
        "env": name,
        "seed": seed,
        "how": how,
        "obs_keys": list(env.unwrapped.obs_keys),
        "obs_offsets": _offsets(env.unwrapped),
        **more,
        "resets": resets,
    }


# --- the command line ----------------------------------------------------

def parser(about, steps, formula):
    """The options that every recorder has. `steps`: how many by default."""
    made = argparse.ArgumentParser(description=about)
    made.add_argument("--out", required=True, type=pathlib.Path, help="folder for the files")
    made.add_argument("--seeds", type=int, default=3, help="how many random seeds (default 3)")
    made.add_argument("--seed", type=int, action="append", help="a seed of your choice")
    made.add_argument("--steps", type=int, default=steps, help="control steps after each reset")
    made.add_argument("--formula", action="store_true", help=formula)
    return made


def record(options, files):
    """Writes what `files(gymnasium, versions, seed, args)` yields for each seed: pairs of a file's
    name and content."""
    args = options.parse_args()
    if args.steps < 1 or args.seeds < 1:
        options.error("--steps and --seeds must be at least 1")
    gymnasium, versions = load()
    args.out.mkdir(parents=True, exist_ok=True)
    for seed in args.seed or [secrets.randbelow(2**31) for _ in range(args.seeds)]:
        for name, content in files(gymnasium, versions, seed, args):
            (args.out / name).write_text(json.dumps(content))
            print(f"recorded {name}", flush=True)


def record_actions(options, actions, files, default=None):
    """As record, of chosen kinds of `actions`: `files` gets their names as args.actions. `default`: the kinds
    that are played unless told otherwise."""
    default = default or list(actions)
    options.add_argument("--actions", choices=actions, action="append",
                         help=f"which actions (default: {', '.join(default)})")

    def of_kinds(gymnasium, versions, seed, args):
        args.actions = args.actions or (["sine"] if args.formula else default)
        return files(gymnasium, versions, seed, args)
    record(options, of_kinds)
