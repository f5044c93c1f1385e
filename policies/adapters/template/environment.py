"""The calls of the template's service on top of a conversation with the grader."""

import numpy as np

import myograde
from challenges import CHALLENGES
from connection import Connection, EvaluationOver
from leg_sets import Leg


class Refused(Exception):
    """What the agent asked for can't be done; the sentence says why."""


def environment_of(name, track, extra_observations, stop):
    """The environment that the adapter `name` has for a kind of track, with all that the official one
    observes or what the graded observation has. SystemExit with a sentence if it has none."""
    challenge = CHALLENGES[name]
    environments = {observations.track: observations for observations in challenge.environments}
    if track not in environments:
        raise SystemExit(f"error: {name} has no environment for the track {track}; it has "
                         f"{' and '.join(sorted(environments))}")
    observations = environments[track](extra_observations)
    return Environment(name, challenge.reset_pair, observations, stop)


class Environment:
    """Its public methods named in CALLS are the service's calls: what they take and return is
    pickled on the way. The grader hears from it at the first reset; until then observations are
    zeros. `policy_seed` is the episode's, 0 before the first one."""

    CALLS = ("act_on_environment", "change_osl_mode", "get_action_space", "get_observation_space",
             "get_obsdict", "get_output_keys", "reset", "set_environment_keys", "set_output_keys")

    def __init__(self, name, reset_pair, observations, stop):
        self._name, self._reset_pair, self._stop = name, reset_pair, stop
        self._connection = None
        self._observations = observations
        self._keys = self._observations.default_keys()
        self._direct = False
        action = myograde.track(observations.track).action
        self._leg = Leg() if "leg_set" in action else None
        self._actions = action.size - (1 if self._leg else 0)
        self._uploaded = False  # since the episode began
        self._steps = 0
        self._feedback = None  # of the episode's end; None while it is played
        self._over = False
        self.policy_seed = 0

    def get_action_space(self, _nothing):
        # With the leg, the official environment declares two more entries when actions are direct, and
        # does not use them.
        return self._actions + (2 if self._leg and self._direct else 0)

    def get_observation_space(self, _nothing):
        return self._observations.vector(self._keys).size

    def get_obsdict(self, _nothing):
        return self._observations.by_name(of_state=True)

    def get_output_keys(self, _nothing):
        return list(self._keys)

    def set_output_keys(self, keys):
        keys = [str(key) for key in keys]
        known = self._observations.by_name()
        unknown = [key for key in keys if key not in known]
        if unknown:
            raise Refused(f"{', '.join(unknown)}: not observed in this track and profile; there "
                          f"are {', '.join(known)}")
        # As the official environment does, whose vectors always have the activations.
        self._keys = keys if "act" in keys else [*keys, "act"]

    def set_environment_keys(self, settings):
        if not isinstance(settings, dict):
            raise Refused('it takes {"obs_keys": [...], "normalize_act": True or False}')
        if "normalize_act" in settings:
            self._choose(direct=not settings["normalize_act"])
        self.set_output_keys(settings.get("obs_keys", self._keys))

    def change_osl_mode(self, mode):
        if not self._leg:
            raise Refused("there is no prosthetic leg in this track")
        self._leg.change(int(np.ravel(mode)[0]))
        return {"feedback": True}

    def reset(self, leg_sets):
        """Begins the next episode. One that is played is given up, unless nothing happened in it:
        then it begins again."""
        if leg_sets is not None and self._leg:
            self._leg.upload(leg_sets)
            self._uploaded = True
        if self._connection is None or self._steps > 0 or self._feedback or self._uploaded:
            self._begin()
        first = self._observations.vector(self._keys)
        return (first, {}) if self._reset_pair else first

    def act_on_environment(self, action):
        """Plays a step; after the episode's end, tells that again. The grader does not send the
        observation after the last step: the one before is repeated, with the reward 0."""
        if self._connection is None:
            self._begin()
        if self._feedback is None:
            self._step(self._checked(action))
        feedback = self._feedback or [self._observations.vector(self._keys),
                                      self._observations.reward(), False]
        return {"feedback": feedback, "current_score": self._steps, "eval_completed": self._over}

    def _step(self, values):
        try:
            observed = self._connection.step(values)
        except EvaluationOver:
            # The grader ended the evaluation in place of answering: this step was the last.
            observed, self._over = None, True
        self._steps += 1
        if observed is None:
            self._feedback = [self._observations.vector(self._keys), 0.0, True]
        else:
            self._observations.take(observed)

    def _checked(self, action):
        try:
            values = np.asarray(action, dtype=float).ravel()
        except (TypeError, ValueError) as error:
            raise Refused(f"an action is a vector of numbers ({error})") from error
        if values.size < self._actions or (not self._leg and values.size > self._actions):
            raise Refused(f"an action has {self._actions} entries, this one has {values.size}")
        values = values[:self._actions].tolist()
        return [*values, float(self._leg.selected)] if self._leg else values

    def _choose(self, direct):
        if self._connection is not None and direct != self._direct:
            raise Refused("normalize_act can only be chosen before the first reset")
        self._direct = direct

    def _begin(self):
        if self._connection is None:
            self._connection = Connection(self._name, self._direct, self._stop)
            self._observations.expect(
                myograde.policy.layout.layout_of(self._connection.welcome.observation_parts))
        sets = self._leg.begin(self._connection.welcome.profile) if self._leg else []
        self._observations.take(self._connection.begin_episode(sets))
        self.policy_seed = self._connection.policy_seed
        self._steps, self._feedback, self._uploaded = 0, None, False
