"""Records the official environments into golden files of chosen or random seeds.

The files have the form of tests/golden, so the golden tests read them as they
are; together the two are the differential test: `./dev differential`.
Needs the official packages of requirements.txt (Python 3.11).

usage: record.py --out DIR [--seeds N | --seed S ...] [--steps N] [--formula]
"""

import argparse
import contextlib
import io
import json
import os
import pathlib
import secrets
import sys

os.environ.setdefault("MUJOCO_GL", "disabled")

import numpy as np

ACTION_FORMULA = "a_t[i] = sin(0.1*t + i), t=0..N-1"


def load_official():
    """Imports the official packages without their banner."""
    with contextlib.redirect_stdout(io.StringIO()):
        import gymnasium
        import mujoco
        import myosuite  # noqa: F401  (registers the environments)
    versions = {
        "mujoco_version": mujoco.__version__,
        "numpy_version": np.__version__,
        "myosuite_version": "2.8.4",
        "gymnasium_version": gymnasium.__version__,
    }
    return gymnasium, mujoco, versions


def plain(value):
    """NumPy values as JSON has them; floats keep every bit."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    return value


def generator_state(env):
    state = env.np_random.bit_generator.state
    return {
        "state": str(state["state"]["state"]),
        "inc": str(state["state"]["inc"]),
        "has_uint32": state["has_uint32"],
        "uinteger": state["uinteger"],
    }


class ActionSource:
    """Uniform random actions in [-1, 1] of a generator of their own, or the formula's."""

    def __init__(self, seed, size, formula):
        self.generator = None if formula else np.random.Generator(np.random.PCG64([seed, 2024]))
        self.size = size

    def next(self, step):
        if self.generator is None:
            return np.sin(0.1 * step + np.arange(self.size))
        return self.generator.uniform(-1.0, 1.0, self.size)


def offsets(env):
    table, start = {}, 0
    for key in env.obs_keys:
        size = int(np.size(env.obs_dict[key]))
        table[key] = [start, start + size]
        start += size
    return table


def extras(obs_dict, keys, squeeze):
    return {
        key: plain(np.squeeze(obs_dict[key]) if squeeze else np.array(obs_dict[key]))
        for key in keys
    }


def make(gymnasium, name, seed, **kwargs):
    with contextlib.redirect_stdout(io.StringIO()):
        env = gymnasium.make(name, **kwargs).unwrapped
    env.seed(seed)
    np.random.seed(seed)
    return env


def step_record(env, action):
    obs, reward, terminated, truncated, info = env.step(action)
    return {
        "action": plain(np.asarray(action)),
        "obs": plain(obs),
        "reward": plain(reward),
        "terminated": bool(terminated),
        "truncated": bool(truncated),
        "rwd_dict": {key: plain(np.squeeze(v)) for key, v in env.rwd_dict.items()},
    }, info


# --- manipulation --------------------------------------------------------

MANIP_EXTRAS = [
    "time", "start_pos", "goal_pos", "elbow_fle", "max_force", "touching_body", "palm_pos",
    "fin0", "fin1", "fin2", "fin3", "fin4", "Rpalm_pos", "MPL_ori", "MPL_ori_err", "obj_pos",
    "reach_err", "pass_err",
]


def manip_state(env):
    data = env.sim.data
    contacts = [[int(c.geom1), int(c.geom2), float(c.dist)] for c in data.contact]
    return {
        "time": float(data.time),
        "qpos": plain(np.array(data.qpos)),
        "qvel": plain(np.array(data.qvel)),
        "act": plain(np.array(data.act)),
        "ctrl": plain(np.array(data.ctrl)),
        "sensordata": plain(np.array(data.sensordata)),
        "ncon": int(data.ncon),
        "contacts": contacts,
        "qacc": plain(np.array(data.qacc)),
        "goal_touch": int(env.goal_touch),
        "max_force": float(env.max_force),
    }


def manip_model(env):
    model, data = env.sim.model, env.sim.data
    geom = int(np.squeeze(env.obj_gid))
    return {
        "start_pos": plain(env.start_pos),
        "goal_pos": plain(env.goal_pos),
        "body_mass_obj": float(model.body_mass[env.obj_bid]),
        "geom_friction_obj": plain(np.array(model.geom_friction[geom])),
        "geom_size_obj": plain(np.array(model.geom_size[geom])),
        "body_inertia_obj": plain(np.array(model.body_inertia[env.obj_bid])),
        "geom_rbound_obj": float(model.geom_rbound[geom]),
        "body_pos_start": plain(np.array(model.body_pos[env.start_bid])),
        "body_pos_goal": plain(np.array(model.body_pos[env.goal_bid])),
        "mocap_pos": plain(np.array(data.mocap_pos)),
        "init_obj_z": float(env.init_obj_z),
        "init_palm_z": float(env.init_palm_z),
    }


def record_manipulation(gymnasium, versions, seed, steps, formula):
    env = make(gymnasium, "myoChallengeBimanual-v0", seed)
    resets = []
    for index in range(2):
        before = generator_state(env)
        obs, _ = env.reset()
        reset = {
            "reset_index": index,
            "scale_draw_skipped": index == 0,
            "rng_before": before,
            "rng_after": generator_state(env),
            "model": manip_model(env),
            "obs_at_reset": plain(obs),
            "obs_extra": extras(env.obs_dict, MANIP_EXTRAS, squeeze=False),
            "state_after_reset": manip_state(env),
            "steps": [],
        }
        actions = ActionSource(seed + index, env.sim.model.nu, formula)
        for step in range(steps):
            record, _ = step_record(env, actions.next(step))
            record["obs_extra"] = extras(env.obs_dict, MANIP_EXTRAS, squeeze=True)
            reset["steps"].append(record | manip_state(env))
        resets.append(reset)
    return {
        **versions,
        "action_formula": ACTION_FORMULA if formula else "recorded with each step",
        "env": "myoChallengeBimanual-v0",
        "seed": seed,
        "how": f"env.unwrapped.seed(seed), then two resets, each followed by {steps} steps",
        "obs_keys": list(env.obs_keys),
        "obs_offsets": offsets(env),
        "resets": resets,
    }


# --- locomotion ----------------------------------------------------------

LOCO_EXTRAS = [
    "time", "terrain", "internal_qpos", "internal_qvel", "grf", "socket_force", "torso_angle",
    "model_root_pos", "model_root_vel", "hfield",
]


def loco_state(env):
    data = env.sim.data
    return {
        "time": float(data.time),
        "qpos": plain(np.array(data.qpos)),
        "qvel": plain(np.array(data.qvel)),
        "act": plain(np.array(data.act)),
        "ctrl": plain(np.array(data.ctrl)),
        "sensordata": plain(np.array(data.sensordata)),
        "ncon": int(data.ncon),
        "nefc": int(data.nefc),
        "osl_state": env.OSL_CTRL.STATE_MACHINE.get_current_state.get_name(),
        "osl_mode": int(env.OSL_CTRL.OSL_PARAM_SELECT),
        "qacc": plain(np.array(data.qacc)),
        "head_site": plain(np.array(data.site("head").xpos)),
        "talus_l": plain(np.array(data.body("talus_l").xpos)),
        "osl_foot": plain(np.array(data.body("osl_foot_assembly").xpos)),
    }


def field_record(env):
    import base64
    import hashlib
    import zlib

    heights = np.array(env.trackfield.hfield.data, dtype="<f4")
    rows = list(range(0, heights.shape[0], 25)) + [1, 24, heights.shape[0] - 1]
    return {
        "sha256_f32le": hashlib.sha256(heights.tobytes()).hexdigest(),
        "nonzero": int(np.count_nonzero(heights)),
        "max": float(heights.max()),
        "min": float(heights.min()),
        "sum_f64": float(heights.astype(np.float64).sum()),
        "samples": [[r, c, float(heights[r, c])] for r in sorted(rows) for c in (0, 7, 19)],
        "b64_zlib_f32le": base64.b64encode(zlib.compress(heights.tobytes(), 9)).decode(),
    }


def record_locomotion(gymnasium, versions, seed, steps, formula, name, **kwargs):
    env = make(gymnasium, name, seed, **kwargs)
    before = generator_state(env)
    obs, _ = env.reset()
    terrain = env.trackfield.terrain_type
    reset = {
        "reset_index": 0,
        "rng_before": before,
        "rng_after": generator_state(env),
        "terrain_type": terrain.name,
        "terrain_code": int(terrain.value),
        "hfield": field_record(env),
        "obs_at_reset": plain(obs),
        "obs_extra": extras(env.obs_dict, LOCO_EXTRAS, squeeze=False),
        "state_after_reset": loco_state(env),
        "steps": [],
    }
    actions = ActionSource(seed, env.sim.model.na, formula)
    for step in range(steps):
        sensed = {key: float(value) for key, value in env.get_osl_sens().items()}
        record, _ = step_record(env, actions.next(step))
        record["obs_extra"] = extras(env.obs_dict, LOCO_EXTRAS, squeeze=True)
        record["osl_sens_before"] = sensed
        torque = env.OSL_CTRL.get_osl_torque()
        record["osl_torque_cmd"] = {key: float(value) for key, value in torque.items()}
        reset["steps"].append(record | loco_state(env))
        if record["terminated"]:
            break
    return {
        **versions,
        "action_formula": ACTION_FORMULA if formula else "recorded with each step",
        "env": name,
        "make_kwargs": kwargs,
        "seed": seed,
        "how": f"env.unwrapped.seed(seed), numpy.random.seed(seed), reset, {steps} steps",
        "obs_keys": list(env.obs_keys),
        "obs_offsets": offsets(env),
        "dt": float(env.dt),
        "body_mass": float(np.sum(env.sim.model.body_mass)),
        "maxTime": float(env.maxTime),
        "resets": [reset],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--out", required=True, type=pathlib.Path, help="folder for the files")
    parser.add_argument("--seeds", type=int, default=3, help="how many random seeds (default 3)")
    parser.add_argument("--seed", type=int, action="append", help="a seed of your choice")
    parser.add_argument("--steps", type=int, default=20, help="control steps after each reset")
    parser.add_argument("--formula", action="store_true", help="the sine actions of tests/golden")
    args = parser.parse_args()
    if args.steps < 1 or args.seeds < 1:
        parser.error("--steps and --seeds must be at least 1")
    gymnasium, _, versions = load_official()
    args.out.mkdir(parents=True, exist_ok=True)
    for seed in args.seed or [secrets.randbelow(2**31) for _ in range(args.seeds)]:
        common = (gymnasium, versions, seed, args.steps, args.formula)
        files = {
            f"manip_seed{seed}.json": record_manipulation(*common),
            f"loco_random_seed{seed}.json": record_locomotion(
                *common, "myoChallengeOslRunRandom-v0"),
            f"loco_fixed_seed{seed}.json": record_locomotion(
                *common, "myoChallengeOslRunFixed-v0"),
            f"loco_random_seed{seed}_unnormalized.json": record_locomotion(
                *common, "myoChallengeOslRunRandom-v0", normalize_act=False),
        }
        for name, content in files.items():
            (args.out / name).write_text(json.dumps(content))
            print(f"recorded {name}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
