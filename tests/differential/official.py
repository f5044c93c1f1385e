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
