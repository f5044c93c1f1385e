"""What the official environments observe, from the grader's observation: the same names, shapes and
types. Joint angles and velocities are as the rule profile reports them."""

import numpy as np

import myograde

_ELBOW = 14  # of the arm's joints
_FINGERS = ("fin0", "fin1", "fin2", "fin3", "fin4")
# The site that the official code calls the object's position, in the object's own frame (m).
_OBJECT_SITE = np.array([0.0, 0.0, 0.015])


class Observations:
    """The last observation, by name and as a vector. Zeros until take()."""

    track = ""
    integers = ()  # entries that the official environment counts in integers
    defaults = ()
    older_names = {}  # of the template's year, and what the grader calls the same
    reward_weights = {}  # of the distance that an entry is

    def __init__(self, extra_observations):
        track = myograde.track(self.track)
        parts = [*track.observation.values(), *(track.extra.values() if extra_observations else ())]
        self._parts = [(part.name, part.size) for part in parts]
        self._values = np.zeros(sum(size for _, size in self._parts))

    def default_keys(self):
        """What an environment returns if nobody chose otherwise."""
        return [*self.defaults, "act"]

    def expect(self, layout):
        """What the grader is going to send."""
        self._parts = [(part.name, part.size) for part in layout.values()]
        self._values = np.zeros(layout.size)

    def take(self, values):
        self._values = np.array(values)

    def by_name(self, of_state=False):
        """A new dictionary of arrays, of one dimension but for the tag game's "task". `of_state`: as
        the official dictionary, which does not repeat a first observation that is of another state."""
        entries, offset = {}, 0
        for name, size in self._parts:
            entries[name] = self._values[offset:offset + size].copy()
            offset += size
        for name in [name for name in entries if name.startswith("state_")]:
            value = entries.pop(name)
            if of_state:
                entries[name.removeprefix("state_")] = value
        for name in self.integers:
            entries[name] = entries[name].astype(np.int64)
        entries = self.completed(entries)
        entries.update({old: entries[new] for old, new in self.older_names.items() if new in entries})
        return entries

    def vector(self, keys):
        """float32, as the official environments round what they return; by_name() does not."""
        entries = self.by_name()
        parts = [np.zeros(0), *(entries[key].ravel() for key in keys)]
        return np.concatenate(parts).astype(np.float32)

    def completed(self, entries):
        """With what follows from the entries."""
        return entries

    def reward(self):
        """The official environment's, with its own weights."""
        entries = self.by_name()
        return float(sum(weight * np.linalg.norm(entries[name])
                         for name, weight in self.reward_weights.items()))


class Reorientation(Observations):
    """In 2022 the name hand_qpos meant the angles without the last joint, as in the graded vector."""

    track = "reorientation"
    defaults = ("hand_qpos", "hand_qvel", "obj_pos", "goal_pos", "pos_err", "obj_rot", "goal_rot",
                "rot_err")
    older_names = {"t": "time", "hand_qpos": "hand_qpos_noMD5"}
    reward_weights = {"pos_err": -100.0, "rot_err": -1.0}


class Baoding(Observations):
    track = "baoding"
    defaults = ("hand_pos", "object1_pos", "object1_velp", "object2_pos", "object2_velp",
                "target1_pos", "target2_pos", "target1_err", "target2_err")
    older_names = {"t": "time"}
    reward_weights = {"target1_err": -5.0, "target2_err": -5.0}


class Relocation(Observations):
    track = "relocation"
    defaults = ("hand_qpos", "hand_qvel", "obj_pos", "goal_pos", "pos_err", "obj_rot", "goal_rot",
                "rot_err")
    reward_weights = {"pos_err": -100.0, "rot_err": -1.0}


class ChaseTag(Observations):
    track = "chasetag"
    defaults = ("internal_qpos", "internal_qvel", "grf", "torso_angle", "opponent_pose",
                "opponent_vel", "model_root_pos", "model_root_vel", "muscle_length",
                "muscle_velocity", "muscle_force")

    def completed(self, entries):
        if "task" in entries:
            entries["task"] = entries["task"].astype(np.int16).reshape(1, 1)
        return entries

    def reward(self):
        """The distance to the opponent; a loss ends the episode and comes after the last
        observation."""
        entries = self.by_name()
        return -0.1 * np.linalg.norm(entries["model_root_pos"] - entries["opponent_pose"][:2])


class Manipulation(Observations):
    track = "manipulation"
    integers = ("touching_body",)
    defaults = ("time", "myohand_qpos", "myohand_qvel", "pros_hand_qpos", "pros_hand_qvel",
                "object_qpos", "object_qvel", "touching_body")

    def completed(self, entries):
        place = entries["object_qpos"]
        derived = {
            "qp": np.concatenate([entries["myohand_qpos"], entries["pros_hand_qpos"], place]),
            "qv": np.concatenate([entries["myohand_qvel"], entries["pros_hand_qvel"],
                                  entries["object_qvel"]]),
            "elbow_fle": entries["myohand_qpos"][_ELBOW:_ELBOW + 1],
            "obj_pos": place[:3] + _rotated(place[3:], _OBJECT_SITE)}
        derived["palm_pos"] = entries["reach_err"] + derived["obj_pos"]
        derived["Rpalm_pos"] = entries["pass_err"] + derived["obj_pos"]
        # What the grader reports itself comes before what can be derived.
        entries = {**derived, **entries}
        if "max_force" in entries and not entries["max_force"].any():
            entries["max_force"] = entries["max_force"].astype(np.int64)
        return entries

    def reward(self):
        """Weights -0.1, -0.5 and -1. 0 in a profile without finger tips."""
        entries = self.by_name()
        if any(finger not in entries for finger in _FINGERS):
            return 0.0
        reach = np.linalg.norm(entries["reach_err"])
        hand_over = np.linalg.norm(entries["pass_err"])
        fingers = sum(np.linalg.norm(entries[finger] - entries["obj_pos"]) for finger in _FINGERS)
        return (-0.1 * (reach + np.log(reach + 1e-6)) - 0.5 * (fingers + np.log(fingers + 1e-6))
                - (hand_over + np.log(hand_over + 1e-3)))


class Locomotion(Observations):
    track = "locomotion"
    integers = ("terrain",)
    defaults = ("internal_qpos", "internal_qvel", "grf", "torso_angle", "model_root_pos",
                "model_root_vel", "muscle_length", "muscle_velocity", "muscle_force")

    def reward(self):
        """The speed towards the end of the course; its bonus for the end comes after the last
        observation."""
        return -self.by_name()["model_root_vel"][1]


def _rotated(quaternion, vector):
    w, xyz = quaternion[0], quaternion[1:]
    turn = 2.0 * np.cross(xyz, vector)
    return vector + w * turn + np.cross(xyz, turn)
