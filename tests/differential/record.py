"""Records the official environments into golden files of chosen or random seeds.

The files have the form of tests/golden, so the golden tests read them as they
are; together the two are the differential test: `./dev differential`.
Needs the official packages of requirements.txt (Python 3.11).

usage: record.py --out DIR [--seeds N | --seed S ...] [--steps N] [--formula]
"""

import numpy as np

from official import (extras, fields, file_record, make, parser, plain, record, reset_record,
                      step_record)


class ActionSource:
    """Uniform random actions in [-1, 1] of a generator of their own, or the formula's."""

    def __init__(self, seed, size, formula):
        self.generator = None if formula else np.random.Generator(np.random.PCG64([seed, 2024]))
        self.size = size

    def next(self, step):
        if self.generator is None:
            return np.sin(0.1 * step + np.arange(self.size))
        return self.generator.uniform(-1.0, 1.0, self.size)


# --- manipulation --------------------------------------------------------

def manip_state(env):
    data = env.sim.data
    contacts = [[int(c.geom1), int(c.geom2), float(c.dist)] for c in data.contact]
    return {
        **fields(data, ("time", "qpos", "qvel", "act", "ctrl", "sensordata", "ncon", "qacc")),
        "contacts": contacts,
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
    name = "myoChallengeBimanual-v0"
    env = make(gymnasium, name, seed).unwrapped
    resets = []
    for index in range(2):
        reset = {
            **reset_record(env, index),
            "scale_draw_skipped": index == 0,
            "model": manip_model(env),
            "obs_extra": extras(env.obs_dict, squeeze=False),
            "state_after_reset": manip_state(env),
        }
        actions = ActionSource(seed + index, env.sim.model.nu, formula)
        for step in range(steps):
            played = step_record(env, actions.next(step))
            played["obs_extra"] = extras(env.obs_dict, squeeze=True)
            reset["steps"].append(played | manip_state(env))
        resets.append(reset)
    return file_record(
        env, versions, name, seed, formula,
        f"env.unwrapped.seed(seed), then two resets, each followed by {steps} steps", resets)


# --- locomotion ----------------------------------------------------------

def loco_state(env):
    data = env.sim.data
    return {
        **fields(data, ("time", "qpos", "qvel", "act", "ctrl", "sensordata", "ncon", "nefc",
                        "qacc")),
        "osl_state": env.OSL_CTRL.STATE_MACHINE.get_current_state.get_name(),
        "osl_mode": int(env.OSL_CTRL.OSL_PARAM_SELECT),
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
    env = make(gymnasium, name, seed, **kwargs).unwrapped
    reset = reset_record(env)
    terrain = env.trackfield.terrain_type
    reset |= {
        "terrain_type": terrain.name,
        "terrain_code": int(terrain.value),
        "hfield": field_record(env),
        "obs_extra": extras(env.obs_dict, squeeze=False),
        "state_after_reset": loco_state(env),
    }
    actions = ActionSource(seed, env.sim.model.na, formula)
    for step in range(steps):
        sensed = {key: float(value) for key, value in env.get_osl_sens().items()}
        played = step_record(env, actions.next(step))
        played["obs_extra"] = extras(env.obs_dict, squeeze=True)
        played["osl_sens_before"] = sensed
        torque = env.OSL_CTRL.get_osl_torque()
        played["osl_torque_cmd"] = {key: float(value) for key, value in torque.items()}
        reset["steps"].append(played | loco_state(env))
        if played["terminated"]:
            break
    return file_record(
        env, versions, name, seed, formula,
        f"env.unwrapped.seed(seed), numpy.random.seed(seed), reset, {steps} steps", [reset],
        make_kwargs=kwargs, dt=float(env.dt), body_mass=float(np.sum(env.sim.model.body_mass)),
        maxTime=float(env.maxTime))


def files(gymnasium, versions, seed, args):
    common = (gymnasium, versions, seed, args.steps, args.formula)
    yield f"manip_seed{seed}.json", record_manipulation(*common)
    for kind in ("Random", "Fixed"):
        yield (f"loco_{kind.lower()}_seed{seed}.json",
               record_locomotion(*common, f"myoChallengeOslRun{kind}-v0"))
    yield (f"loco_random_seed{seed}_unnormalized.json",
           record_locomotion(*common, "myoChallengeOslRunRandom-v0", normalize_act=False))


if __name__ == "__main__":
    record(parser(__doc__.split("\n", 1)[0], 20, "the sine actions of tests/golden"), files)
