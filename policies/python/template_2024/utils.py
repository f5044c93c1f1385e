"""Stands in for the module of the same name in the agent template of MyoChallenge 2024, so that an
agent written for it plays here unchanged: play_agent.py starts it. What differs is in
policies/README.md."""

import os

import gymnasium as gym
import numpy as np

import connection
import leg_sets as legs
import myograde
from myograde.policy import seeding


def _parts(track):
    """The dictionary's entries in the order of the observation vector, with sizes."""
    return tuple((part.name, part.size) for part in myograde.track(track).observation.values())


_MANIPULATION, _LOCOMOTION = _parts("manipulation"), _parts("locomotion")
# What the official environments return where an agent asks for no keys.
_MANIPULATION_KEYS = ("time", "myohand_qpos", "myohand_qvel", "pros_hand_qpos", "pros_hand_qvel",
                      "object_qpos", "object_qvel", "touching_body", "act")
_LOCOMOTION_KEYS = ("internal_qpos", "internal_qvel", "grf", "torso_angle", "model_root_pos",
                    "model_root_vel", "muscle_length", "muscle_velocity", "muscle_force", "act")
# The site that the official code calls the object's position, in the object's own frame (m).
_OBJECT_SITE = np.array([0.0, 0.0, 0.015])
_ELBOW = 14  # of the arm's joints


def _rotated(quaternion, vector):
    w, xyz = quaternion[0], quaternion[1:]
    turn = 2.0 * np.cross(xyz, vector)
    return vector + w * turn + np.cross(xyz, turn)


def _with_derived(entries):
    """The manipulation dictionary with what follows from its entries."""
    place = entries["object_qpos"]
    entries["obj_pos"] = place[:3] + _rotated(place[3:], _OBJECT_SITE)
    entries["palm_pos"] = entries["reach_err"] + entries["obj_pos"]
    entries["Rpalm_pos"] = entries["pass_err"] + entries["obj_pos"]
    entries["elbow_fle"] = entries["myohand_qpos"][_ELBOW:_ELBOW + 1]
    entries["qp"] = np.concatenate([entries["myohand_qpos"], entries["pros_hand_qpos"], place])
    entries["qv"] = np.concatenate([entries["myohand_qvel"], entries["pros_hand_qvel"],
                                    entries["object_qvel"]])
    return entries


class RemoteConnection:
    """The manipulation agent's way to its environment. The address is not used. The grader hears
    from it at the first reset; until then observations are zeros."""

    _parts = _MANIPULATION
    _track = "manipulation"
    _low = -1.0

    def __init__(self, _address=""):
        self._connection = None
        self.policy_seed = 0  # of the episode, for what only the agent can seed (jax)
        self._direct = False
        self._keys = list(_MANIPULATION_KEYS if self._track == "manipulation" else _LOCOMOTION_KEYS)
        self._values = np.zeros(sum(size for _, size in self._parts))
        self._steps = 0
        self._construct_action_and_observation_space()

    def set_environment_keys(self, new_env_keys):
        if "normalize_act" in new_env_keys:
            self._set_direct(not new_env_keys["normalize_act"])
        self.set_output_keys(new_env_keys.get("obs_keys", self._keys))

    def set_output_keys(self, new_out_keys):
        known = self.get_obsdict()
        unknown = [key for key in new_out_keys if key not in known]
        if unknown:
            raise KeyError(f"{', '.join(unknown)}: not in the observation of this track; there are "
                           f"{', '.join(known)}")
        self._keys = list(new_out_keys)
        self._construct_action_and_observation_space()

    def get_action_space(self):
        """The number of entries of an action."""
        return 80

    def get_observation_space(self):
        """The number of entries of the observation that reset and act_on_environment return."""
        return self._vector().size

    def set_observation_space(self, shape):
        self.observation_space = gym.spaces.Box(shape=shape, high=1e6, low=-1e6)

    def get_obsdict(self):
        """Everything that is observed, by name: float64 arrays of one dimension, SI units."""
        entries, offset = {}, 0
        for key, size in self._parts:
            entries[key] = self._values[offset:offset + size].copy()
            offset += size
        return _with_derived(entries) if self._track == "manipulation" else entries

    def obsdict2obsvec(self, obs_dict, ordered_obs_keys):
        return np.concatenate([np.zeros(0), *(np.ravel(obs_dict[key]) for key in ordered_obs_keys)])

    def reset(self):
        return self._begin([])

    def act_on_environment(self, action):
        """Plays a step. "feedback" is observation, reward (always 0: a grader gives none), and
        whether the episode ended. "eval_completed" stays False: the grader ends the process."""
        values = self._connection.step(self._answer(np.asarray(action, dtype=float).ravel()))
        self._steps += 1
        if values is not None:
            self._values = np.array(values)
        return {"feedback": [self._vector(), 0.0, values is None], "current_score": self._steps,
                "eval_completed": False}

    def _answer(self, action):
        return action.tolist()

    def _set_direct(self, direct):
        if self._connection is not None and direct != self._direct:
            raise RuntimeError("normalize_act can only be chosen before the first reset")
        self._direct = direct

    def _begin(self, sets):
        if self._connection is None:
            name = os.environ.get("MYOGRADE_POLICY_NAME", "template-2024")
            self._connection = connection.Connection(name, self._direct)
            track = self._connection.welcome.track
            if track != self._track:
                raise RuntimeError(f"this is an agent for the {self._track} track, but the "
                                   f"track that is graded is {track}")
        self._steps = 0
        self._values = np.array(self._connection.begin_episode(sets))
        self._seed_generators(self._connection.policy_seed)
        return self._vector()

    def _seed_generators(self, seed):
        """The usual sources of randomness, so that an episode can be played again."""
        self.policy_seed = seed
        seeding.seed(seed)
        self.action_space.seed(seed % 2**32)

    def _vector(self):
        # The official environments round what they return, and not what get_obsdict tells.
        return self.obsdict2obsvec(self.get_obsdict(), self._keys).astype(np.float32)

    def _construct_action_and_observation_space(self):
        self.set_observation_space((self.get_observation_space(),))
        self.action_space = gym.spaces.Box(shape=(self.get_action_space(),), high=1.0,
                                           low=self._low)


class LocoRemoteConnection(RemoteConnection):
    """The locomotion agent's. The parameter set that change_osl_mode chose stays chosen."""

    _parts = _LOCOMOTION
    _track = "locomotion"
    _low = 0.0  # as in the template, whichever way actions are normalised

    def __init__(self, _address=""):
        self._mode = 0
        self._sets = []
        super().__init__(_address)

    def get_action_space(self):
        # The official environment declares two more entries when actions are direct and uses 54.
        return 56 if self._direct else 54

    def reset(self, reset_dict=None):
        # In the official environment an uploaded set acts from the next change_osl_mode on: never,
        # for an agent without one.
        if reset_dict is not None and legs.agent_changes_sets():
            self._sets = legs.from_dictionary(reset_dict)
        return self._begin(self._sets)

    def change_osl_mode(self, mode):
        chosen = int(np.ravel(mode)[0])
        if 0 <= chosen < legs.COUNT:
            self._mode = chosen

    def _answer(self, action):
        return [*action[:54].tolist(), float(self._mode)]


class _Dummy:
    def __init__(self, env_name, stub, low):
        self.env_name = env_name
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (stub.get_observation_space(),))
        self.action_space = gym.spaces.Box(low, 1, (stub.get_action_space(),))


class DummyLocoEnv(_Dummy):
    def __init__(self, env_name, stub):
        super().__init__(env_name, stub, 0)


class DummyManiEnv(_Dummy):
    def __init__(self, env_name, stub):
        super().__init__(env_name, stub, -1)
