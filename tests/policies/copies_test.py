"""Copies of the graded environments, how long an episode is, what begins the next one, and seeds and
actions that are none. Runs with the oldest Gymnasium too (environments.sh)."""

import concurrent.futures
import copy
import multiprocessing
import pickle
import unittest

import cloudpickle
import gymnasium
import numpy as np

import myograde
import myograde.envs
from environments_support import NAMES, InFolder, actions_of, make
from myograde import errors

WAYS = {"pickle": lambda env: pickle.loads(pickle.dumps(env)),
        "cloudpickle": lambda env: cloudpickle.loads(cloudpickle.dumps(env)),
        "deepcopy": copy.deepcopy}


def play(env, actions):
    """The digest of the states after these steps."""
    for action in actions:
        *_, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            break
    return env.unwrapped.core.digest


def play_elsewhere(env):
    return play(env, actions_of(env, 5, seed=3))


class Copies(InFolder):
    def test_a_copy_goes_on_as_the_original_does_to_the_bit(self):
        for name in NAMES:
            settings = {"weights": {}, "observation": "dict"}
            if "Locomotion" in name:
                settings["leg_sets"] = myograde.leg_sets("myosuite")
            env = gymnasium.make(name, **settings)
            env.reset(seed=8)
            actions = actions_of(env, 8)  # no track ends in less
            play(env, actions[:4])
            copies = {way: make_copy(env) for way, make_copy in WAYS.items()}
            expected = play(env, actions[4:]), env.reset()[1]
            for way, other in copies.items():
                with self.subTest(f"{name} by {way}"):
                    self.assertEqual(other.unwrapped.settings, env.unwrapped.settings)
                    # The next seed is the same one, too.
                    self.assertEqual((play(other, actions[4:]), other.reset()[1]), expected)

    def test_an_ended_episode_stays_ended_and_a_new_one_is_begun(self):
        env = make("myograde/Elbow-v0", config=self.short("elbow", 5))
        self.assertEqual(WAYS["pickle"](env).reset(seed=2)[1], {"seed": 2})
        env.reset(seed=1)
        play(env, actions_of(env, 5))
        other = copy.deepcopy(env)
        with self.assertRaisesRegex(RuntimeError, r"call reset\(\) first"):
            other.step(np.zeros(6))
        self.assertEqual(other.core.end_of(), env.core.end_of())

    def test_where_state_carries_over_the_copy_has_played_everything(self):
        env = make("myograde/Manipulation-v0", profile="as-graded")
        actions = actions_of(env, 6)
        for seed in (4, 9):
            env.reset(seed=seed)
            play(env, actions)
        other = copy.deepcopy(env)
        for one in (env, other):
            one.reset()
        self.assertEqual(play(env, actions), play(other, actions))

    def test_many_are_copied_alike(self):
        for mode in ("next_step", "same_step"):
            envs = myograde.vec("myograde/Elbow-v0", 3, config=self.short("elbow", 7), threads=2,
                                autoreset_mode=mode)
            envs.reset(seed=5)
            actions = np.stack([actions_of(envs.unwrapped.core.first and make("myograde/Elbow-v0"),
                                           30, seed=i) for i in range(3)], axis=1)
            for action in actions[:9]:
                envs.step(action)
            for way, make_copy in WAYS.items():
                with self.subTest(f"{mode} by {way}"):
                    one, other = make_copy(envs), make_copy(envs)
                    for action in actions[9:]:
                        for mine, theirs in zip(one.step(action)[:4], other.step(action)[:4]):
                            np.testing.assert_array_equal(mine, theirs)
            other = copy.deepcopy(envs)
            for action in actions[9:]:
                for mine, theirs in zip(envs.step(action)[:4], other.step(action)[:4]):
                    np.testing.assert_array_equal(mine, theirs)

    def test_other_processes_get_copies_and_errors(self):
        env = make("myograde/Elbow-v0")
        env.reset(seed=1)
        with concurrent.futures.ProcessPoolExecutor(
                1, mp_context=multiprocessing.get_context("spawn")) as pool:
            there = pool.submit(play_elsewhere, env).result()
        self.assertEqual(there, play_elsewhere(env))

    def test_states_are_taken_and_set(self):
        env = make("myograde/Elbow-v0")
        env.reset(seed=1)
        actions = actions_of(env, 20)
        play(env, actions[:10])
        state = env.get_env_state()
        self.assertEqual({key: state[key].shape for key in ("time", "qpos", "qvel", "act")},
                         {"time": (1,), "qpos": (1,), "qvel": (1,), "act": (6,)})
        expected = play(env, actions[10:])
        env.reset(seed=2)
        env.set_env_state(state)
        self.assertEqual(play(env, actions[10:]), expected)
        with self.assertRaisesRegex(errors.WrongUse, "what get_env_state returned"):
            env.set_env_state({"qpos": state["qpos"]})
        for part, wrong in (("history", 1), ("history", [1]), ("last_reward", None), ("settings", 5)):
            with self.assertRaisesRegex(errors.WrongUse, f"{part}=.*what get_env_state.. returned"):
                env.set_env_state({**state, part: wrong})

    def test_states_of_other_environments_are_refused(self):
        other_rules = {"config": self.short("elbow", 40), "profile": "hold"}
        for track, made, other, differs in (
                ("elbow", {}, {"track": "locomotion"}, "its track is 'elbow', and here it is 'locomotion'"),
                ("manipulation", {}, {"profile": "myosuite"}, "its profile is 'paper'.* 'myosuite'"),
                ("elbow", {}, {"profile": "myosuite"}, "its profile is 'hold'"),
                ("elbow", {}, other_rules, "its config_hash"),
                ("elbow", {"actions": "direct"}, {}, "its actions is 'direct'"),
                ("manipulation", {"profile": "myosuite"},
                 {"profile": "myosuite", "extra_observations": True}, "its extra_observations is False"),
                ("locomotion", {"leg_sets": myograde.leg_sets("myosuite")}, {}, "its leg_sets")):
            env = myograde.envs.GradedEnv(track, **made)
            env.reset(seed=5)
            state = pickle.loads(pickle.dumps(env.get_env_state()))
            env.set_env_state(state)
            there = myograde.envs.GradedEnv(**{"track": track, **other})
            there.reset(seed=6)
            with self.assertRaisesRegex(errors.WrongUse, differs):
                there.set_env_state(state)
            self.assertEqual(there.get_input_seed(), 6)
        # The default profile by its name, and what changes no state.
        env = make("myograde/Elbow-v0")
        env.reset(seed=5)
        same = make("myograde/Elbow-v0", profile="hold", observation="dict", weights={"act_reg": 1})
        same.set_env_state(env.get_env_state())


class Horizons(InFolder):
    def test_a_spec_has_the_steps_of_the_longest_episode(self):
        for name, track in myograde.envs.ENVIRONMENTS.items():
            for profile in ("", "as-graded" if track == "manipulation" else ""):
                steps = myograde.envs.seeds(track, profile).max_steps
                env = gymnasium.make(name, profile=profile)
                self.assertEqual((env.spec.max_episode_steps, env.unwrapped.horizon), (steps, steps))
                self.assertEqual(myograde.vec(name, 1, profile=profile).spec.max_episode_steps, steps)
        self.assertIsNone(gymnasium.spec(name).max_episode_steps)
        # Nothing but the environment itself ends an episode of full length.
        env = gymnasium.make("myograde/Elbow-v0")
        wrapper = env
        while wrapper is not env.unwrapped:
            self.assertNotIsInstance(wrapper, gymnasium.wrappers.TimeLimit)
            wrapper = wrapper.env

    def test_a_shorter_limit_truncates(self):
        env = gymnasium.make("myograde/Elbow-v0", max_episode_steps=10)
        self.assertEqual(env.spec.max_episode_steps, 10)
        envs = myograde.vec("myograde/Elbow-v0", 2, max_episode_steps=10)
        self.assertEqual((envs.spec.max_episode_steps, envs.unwrapped.horizon), (10, 10))
        env.reset(seed=3)
        envs.reset(seed=3)
        for step in range(10):
            *_, truncated, _ = env.step(np.zeros(6))
            *_, many, info = envs.step(np.zeros((2, 6)))
            self.assertEqual((truncated, many.tolist()), (step == 9, [step == 9] * 2))
        self.assertEqual(info["end"].tolist(), ["time", "time"])
        with self.assertRaisesRegex(errors.WrongUse, "max_episode_steps=0 .* at least 1"):
            myograde.vec("myograde/Elbow-v0", 2, max_episode_steps=0)


class Autoreset(InFolder):
    def make(self, mode, **settings):
        return myograde.vec("myograde/Elbow-v0", 3, config=self.short("elbow", 5), threads=2,
                            autoreset_mode=mode, **settings)

    def test_the_step_that_ends_an_episode_can_begin_the_next_one(self):
        for given in ({}, {"copy": False}, {"observation": "dict"}):
            later, same = self.make("next_step", **given), self.make("SameStep", **given)
            later.reset(seed=1)
            same.reset(seed=1)
            actions = np.full((3, 6), 0.3)
            for _ in range(4):
                later.step(actions)
                info = same.step(actions)[-1]
                self.assertNotIn("final_obs", info)
                self.assertEqual(len(info["facts"]["final_error"]), 3)
            last = copy.deepcopy(later.step(actions))
            observations, rewards, terminated, truncated, info = same.step(actions)
            np.testing.assert_array_equal(rewards, last[1])
            self.assertEqual((terminated.tolist(), truncated.tolist()), ([False] * 3, [True] * 3))
            self.assertEqual(info["final_info"]["digest"].tolist(), last[-1]["digest"].tolist())
            self.assertEqual(info["final_info"]["end"].tolist(), ["time"] * 3)
            first, *_, begun = later.step(actions)
            self.assertEqual(info["seed"].tolist(), begun["seed"].tolist())
            for i in range(3):
                for mine, theirs in ((observations, first), ):
                    for part in mine if isinstance(mine, dict) else [slice(None)]:
                        np.testing.assert_array_equal(mine[part][i], theirs[part][i])
                final, ended = info["final_obs"][i], last[0]
                if isinstance(final, dict):
                    final, ended = final["qpos"], ended["qpos"]
                np.testing.assert_array_equal(final, ended[i])
            # Both play on alike.
            np.testing.assert_array_equal(later.step(actions)[1], same.step(actions)[1])

    def test_it_can_be_switched_off(self):
        envs = self.make("disabled")
        self.assertEqual(envs.unwrapped.autoreset_mode, envs.metadata["autoreset_mode"])
        self.assertEqual(str(getattr(envs.unwrapped.autoreset_mode, "value", "Disabled")), "Disabled")
        envs.reset(seed=1)
        for _ in range(5):
            *_, truncated, _ = envs.step(np.zeros((3, 6)))
        self.assertTrue(truncated.all())
        with self.assertRaisesRegex(RuntimeError, "autoreset is disabled"):
            envs.step(np.zeros((3, 6)))
        envs.reset(options={"reset_mask": truncated})
        envs.step(np.zeros((3, 6)))
        with self.assertRaisesRegex(errors.WrongUse, "next_step, same_step, disabled"):
            self.make("sometimes")


class Mistakes(InFolder):
    def test_a_seed_is_a_whole_number(self):
        env, envs = make("myograde/Elbow-v0"), myograde.vec("myograde/Elbow-v0", 2)
        for seed in (5.7, 5.0, "5", True, np.float64(3), b"5", [5]):
            for reset in (env.reset, *([] if isinstance(seed, list) else [envs.reset])):
                with self.assertRaisesRegex(TypeError, "seeds are whole numbers"):
                    reset(seed=seed)
        for seeds in ([1, 2.5], np.array([1.0, 2.0]), ["1", "2"]):
            with self.assertRaisesRegex(TypeError, "seeds are whole numbers"):
                envs.reset(seed=seeds)
        self.assertEqual(env.reset(seed=np.int64(5))[1], {"seed": 5})
        self.assertEqual(envs.reset(seed=np.array([7, 9]))[1]["seed"].tolist(), [7, 9])

    def test_reset_seeds_the_generator_of_many(self):
        envs = myograde.vec("myograde/Elbow-v0", 2).unwrapped
        drawn = []
        for seed in (11, 11, [11, 3], 12):
            envs.reset(seed=seed)
            drawn.append(envs.np_random.integers(2**62))
        self.assertEqual(drawn[0], drawn[1])
        self.assertEqual(drawn[0], drawn[2])
        self.assertNotEqual(drawn[0], drawn[3])

    def test_a_wrong_action_names_both_shapes(self):
        env, envs = make("myograde/Elbow-v0"), myograde.vec("myograde/Elbow-v0", 2).unwrapped
        env.reset(seed=0)
        envs.reset(seed=0)
        for action in (np.zeros(7), np.zeros((1, 6)), 0.5, np.zeros(0)):
            with self.assertRaisesRegex(ValueError, r"must have the shape \(6,\), but has \("):
                env.step(action)
            with self.assertRaisesRegex(ValueError, r"must have the shape \(2, 6\), but has \("):
                envs.step(action)
        for action in ("up", {"muscles": 1}, [[1], [1, 2]]):
            with self.assertRaisesRegex(ValueError, "must be an array of numbers"):
                env.step(action)

    def test_an_argument_of_the_wrong_type_is_named(self):
        def elbow(**settings):
            return lambda: make("myograde/Elbow-v0", **settings)

        def many(num_envs=2, **settings):
            return lambda: myograde.vec("myograde/Elbow-v0", num_envs, **settings)
        env = make("myograde/Elbow-v0")
        for words, mistake in (
                ("profile=None .* text", elbow(profile=None)), ("track=5 .* text", elbow(track=5)),
                ("extra_observations=None .* True or False", elbow(extra_observations=None)),
                ("exact='no' .* True or False", elbow(exact="no")),
                ("cache=5 .* path", elbow(cache=5)), ("config=.*udcff.* path", elbow(config="\udcff")),
                ("weights=.'act_reg'. .* dict", elbow(weights=["act_reg"])),
                ("weights=.*nan.* finite numbers", elbow(weights={"act_reg": float("nan")})),
                ("leg_sets=5 .*LegSet", elbow(leg_sets=5)),
                ("leg_sets=.1. .*LegSet", lambda: env.reset(options={"leg_sets": [1]})),
                ("width=1.5 .* from 1 to 4096", elbow(width=1.5)),
                ("height=None .* from 1 to 4096", elbow(height=None)),
                ("camera='top' .* dict", elbow(camera="top")),
                ("body=5 .* text", elbow(camera={"body": 5})),
                ("look_at=.1. .* three finite numbers", elbow(camera={"look_at": [1]})),
                ("distance='x' .* a finite number", elbow(camera={"distance": "x"})),
                ("azimuth=nan .* a finite number", elbow(camera={"azimuth": float("nan")})),
                ("num_envs=2.5 .* whole number", many(2.5)), ("num_envs='2' .* whole", many("2")),
                ("threads=1.5 .* whole number", many(threads=1.5)),
                ("max_episode_steps=2.5 .* whole", many(max_episode_steps=2.5)),
                ("max_episode_steps=1180.* below 2.63", many(max_episode_steps=2**70)),
                ("track=None.* must be text", lambda: myograde.envs.seeds(None)),
                ("config=5 .* a path", lambda: myograde.envs.seeds("elbow", config=5))):
            with self.subTest(words), self.assertRaisesRegex(errors.WrongUse, words):
                mistake()
        # Numbers of NumPy are numbers.
        picture = make("myograde/Elbow-v0", render_mode="rgb_array", width=np.int64(32), height=32,
                       weights={"act_reg": np.float32(1)}, extra_observations=np.bool_(False),
                       camera={"look_at": np.zeros(3), "distance": np.float32(2), "azimuth": None})
        picture.reset(seed=1)
        self.assertEqual(picture.render().shape, (32, 32, 3))

    def test_errors_can_be_sent_to_another_process(self):
        for error in (errors.ServerError(404, "unknown_track", "there is no such track"),
                      errors.Unreachable("nobody answers"), errors.DeadlinePassed("over"),
                      errors.WrongUse("no"), errors.MyogradeError("neither")):
            for make_copy in WAYS.values():
                other = make_copy(error)
                self.assertEqual((type(other), str(other), vars(other)),
                                 (type(error), str(error), vars(error)))


if __name__ == "__main__":
    unittest.main(verbosity=2)
