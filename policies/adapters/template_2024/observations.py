"""What the official environments of 2024 observe, from the grader's observation: the same names,
shapes and types. Joint angles and velocities are as the rule profile reports them."""

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
    extra = ()  # names and sizes beyond the graded observation
    defaults = ()

    def __init__(self, extra_observations):
        graded = myograde.track(self.track).observation
        self._parts = [(part.name, part.size) for part in graded.values()]
        if extra_observations:
            self._parts += self.extra
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

    def by_name(self):
        """A new dictionary of arrays of one dimension."""
        entries, offset = {}, 0
        for name, size in self._parts:
            entries[name] = self._values[offset:offset + size].copy()
            offset += size
        for name in self.integers:
            entries[name] = entries[name].astype(np.int64)
        return self.completed(entries)

    def vector(self, keys):
        """float32, as the official environments round what they return; by_name() does not."""
        entries = self.by_name()
        return np.concatenate([np.zeros(0), *(entries[key] for key in keys)]).astype(np.float32)

    def completed(self, entries):
        """With what follows from the entries."""
        return entries

    def reward(self):
        """The official environment's, with its own weights."""
        raise NotImplementedError


class Manipulation(Observations):
    track = "manipulation"
    integers = ("touching_body",)
    extra = (("max_force", 1), *((name, 3) for name in (
        "palm_pos", *_FINGERS, "Rpalm_pos", "MPL_ori", "MPL_ori_err", "obj_pos")))
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
