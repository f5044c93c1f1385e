"""Records the official elbow environment into golden files of chosen or random seeds.

The same as record.py for the track elbow; the files have the form of tests/golden.

usage: record_elbow.py --out DIR [--seeds N | --seed S ...] [--steps N] [--actions KIND ...] [--formula]
"""

import argparse
import contextlib
import io
import json
import pathlib
import secrets
import sys

import numpy as np

from record import ACTION_FORMULA, extras, generator_state, load_official, offsets, plain

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
    data = env.sim.data
    return {
        "time": float(data.time),
        "qpos": plain(np.array(data.qpos)),
        "qvel": plain(np.array(data.qvel)),
        "act": plain(np.array(data.act)),
        "ctrl": plain(np.array(data.ctrl)),
        "qacc": plain(np.array(data.qacc)),
        "actuator_force": plain(np.array(data.actuator_force)),
        "actuator_length": plain(np.array(data.actuator_length)),
        "ncon": int(data.ncon),
        "nefc": int(data.nefc),
    }


def step_record(wrapped, env, action):
    obs, reward, terminated, truncated, _ = wrapped.step(action)
    return {
        "action": plain(action),
        "obs": plain(obs),
        "reward": plain(reward),
        "terminated": bool(terminated),
        "truncated": bool(truncated),
        "rwd_dict": {key: plain(np.squeeze(v)) for key, v in env.rwd_dict.items()},
    }


def model_record(env):
    model = env.sim.model
    fields = [
        "body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat",
        "jnt_range", "dof_damping", "dof_armature", "dof_M0", "dof_invweight0", "actuator_acc0",
        "actuator_lengthrange", "actuator_gainprm", "actuator_dynprm", "actuator_ctrlrange",
        "tendon_length0",
    ]
    return {field: plain(np.array(getattr(model, field))) for field in fields}


def record_elbow(gymnasium, versions, seed, steps, kind):
    kwargs = {"normalize_act": False} if kind == "direct" else {}
    with contextlib.redirect_stdout(io.StringIO()):
        wrapped = gymnasium.make(NAME, **kwargs)
    env = wrapped.unwrapped
    env.seed(seed)
    before = generator_state(env)
    obs, _ = wrapped.reset()
    reset = {
        "reset_index": 0,
        "rng_before": before,
        "rng_after": generator_state(env),
        "target": plain(env.target_jnt_value),
        "obs_at_reset": plain(obs),
        "obs_extra": extras(env.obs_dict, ["time", "pose_err"], squeeze=False),
        "state_after_reset": state(env),
        "steps": [],
    }
    generator = np.random.Generator(np.random.PCG64([seed, 2024]))
    for step in range(steps):
        record = step_record(wrapped, env, ACTIONS[kind](env, step, generator))
        reset["steps"].append(record | state(env))
        if record["terminated"] or record["truncated"]:
            break
    return {
        **versions,
        "action_formula": ACTION_FORMULA if kind == "sine" else "recorded with each step",
        "env": NAME,
        "make_kwargs": kwargs,
        "seed": seed,
        "how": f"env.unwrapped.seed(seed), reset, {steps} steps through the time limit's wrapper",
        "obs_keys": list(env.obs_keys),
        "obs_offsets": offsets(env),
        "dt": float(env.dt),
        "frame_skip": int(env.frame_skip),
        "model": model_record(env),
        "resets": [reset],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--out", required=True, type=pathlib.Path, help="folder for the files")
    parser.add_argument("--seeds", type=int, default=3, help="how many random seeds (default 3)")
    parser.add_argument("--seed", type=int, action="append", help="a seed of your choice")
    parser.add_argument("--steps", type=int, default=100, help="control steps after the reset")
    parser.add_argument("--actions", choices=ACTIONS, action="append",
                        help="which actions (default: all kinds)")
    parser.add_argument("--formula", action="store_true", help="the sine actions alone")
    args = parser.parse_args()
    if args.steps < 1 or args.seeds < 1:
        parser.error("--steps and --seeds must be at least 1")
    gymnasium, _, versions = load_official()
    args.out.mkdir(parents=True, exist_ok=True)
    for seed in args.seed or [secrets.randbelow(2**31) for _ in range(args.seeds)]:
        for kind in args.actions or (["sine"] if args.formula else ACTIONS):
            name = f"elbow_{kind}_seed{seed}.json"
            content = record_elbow(gymnasium, versions, seed, args.steps, kind)
            (args.out / name).write_text(json.dumps(content))
            print(f"recorded {name}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
