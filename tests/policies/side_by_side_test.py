"""Many environments side by side: each plays what a single one does, in threads, into one array.
Runs with the grader's maths functions (environments.sh)."""

import sys
import threading
import time
import unittest
import warnings

import gymnasium
import numpy as np

import myograde
import myograde.envs
from environments_support import NAMES, InFolder, actions_of, make
from myograde import errors


class SideBySide(InFolder):
    def settings(self, name, steps=8):
        return {"config": self.short(myograde.envs.ENVIRONMENTS[name], steps)}

    def test_each_plays_what_a_single_one_does_whatever_the_threads(self):
        for name in NAMES:
            settings = self.settings(name)
            singles = [make(name, **settings) for _ in range(3)]
            actions = np.stack([actions_of(singles[0], 20, seed=i) for i in range(3)])
            told = [self.play_alone(env, 50 + i, actions[i]) for i, env in enumerate(singles)]
            for threads in (1, 2, 3):
                envs = myograde.vec(name, 3, threads=threads, **settings)
                self.assertEqual(envs.unwrapped.threads, threads)
                observations, info = envs.reset(seed=50)
                self.assertEqual(info["seed"].tolist(), [50, 51, 52])
                for i in range(3):
                    np.testing.assert_array_equal(observations[i], told[i][0][0])
                for step in range(20):
                    results = envs.step(actions[:, step])
                    for i in range(3):
                        self.compare(results, i, told[i][step + 1])

    def play_alone(self, env, seed, actions):
        """As many environments do it: (observation, reward, terminated, truncated, info)."""
        steps = [(env.reset(seed=seed)[0], 0.0, False, False, {"seed": seed})]
        for action in actions:
            if steps[-1][2] or steps[-1][3]:
                observation, info = env.reset()
                steps.append((observation, 0.0, False, False, info))
            else:
                steps.append(env.step(action))
        return steps

    def compare(self, results, i, expected):
        observation, reward, terminated, truncated, info = results
        np.testing.assert_array_equal(observation[i], expected[0])
        self.assertEqual((reward[i], terminated[i], truncated[i]), expected[1:4])
        if "digest" in expected[4]:
            self.assertTrue(info["_digest"][i])
            self.assertEqual(info["digest"][i], expected[4]["digest"])
            self.assertEqual(info["end"][i], expected[4]["end"])
            self.assertTrue(info["_details"][i])
            self.assertEqual(info["details"][i], expected[4]["details"])
            for key, value in expected[4]["facts"].items():
                self.assertEqual(info["facts"][key][i], value, key)
        elif "seed" in expected[4]:
            self.assertTrue(info["_seed"][i])
            self.assertEqual(info["seed"][i], expected[4]["seed"])
        for term, value in expected[4].get("rewards", {}).items():
            self.assertEqual(info["rewards"][term][i], value)

    @unittest.skipUnless(hasattr(gymnasium, "VectorizeMode"), "myograde.vec makes them with Gymnasium 0.29")
    def test_gymnasium_makes_them(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            envs = gymnasium.make_vec("myograde/Elbow-v0", num_envs=4, threads=2,
                                      observation="dict")
        self.assertIs(type(envs.unwrapped), myograde.envs.GradedVectorEnv)
        self.assertEqual(envs.metadata["autoreset_mode"],
                         gymnasium.vector.AutoresetMode.NEXT_STEP)
        observations, _ = envs.reset(seed=1)
        self.assertTrue(envs.observation_space.contains(observations))
        self.assertTrue(envs.action_space.contains(envs.action_space.sample()))
        self.assertEqual({len(part) for part in observations.values()}, {4})
        # Gymnasium's own wrappers take them.
        recorded = gymnasium.wrappers.vector.RecordEpisodeStatistics(envs)
        recorded.reset(seed=1)
        self.assertEqual(recorded.step(envs.action_space.sample())[1].shape, (4,))
        envs.close()

    def test_arrays_are_copied_or_stay_in_place(self):
        for copy in (True, False):
            envs = myograde.vec("myograde/Elbow-v0", 2, copy=copy)
            first, _ = envs.reset(seed=0)
            before = first.copy()
            second, reward, terminated, truncated, _ = envs.step(np.ones((2, 6)))
            third, *_ = envs.step(np.ones((2, 6)))
            self.assertEqual(np.shares_memory(second, third), not copy)
            self.assertEqual(np.array_equal(first, before), copy)
            self.assertEqual((reward.dtype, terminated.dtype, truncated.dtype),
                             (np.float64, np.bool_, np.bool_))
        del envs
        self.assertTrue(np.isfinite(third).all())  # it keeps what it is a view of

    def test_some_can_be_reset(self):
        envs = myograde.vec("myograde/Elbow-v0", 3)
        envs.reset(seed=9)
        for _ in range(3):
            moved, *_ = envs.step(np.ones((3, 6)))
        observations, info = envs.reset(seed=[9, 9, 9],
                                        options={"reset_mask": np.array([False, True, False])})
        self.assertEqual(info["_seed"].tolist(), [False, True, False])
        np.testing.assert_array_equal(observations[[0, 2]], moved[[0, 2]])
        self.assertFalse(np.array_equal(observations[1], moved[1]))

    def test_mistakes_step_nothing(self):
        envs = myograde.vec("myograde/Elbow-v0", 2)
        with self.assertRaisesRegex(RuntimeError, r"call reset\(\) first"):
            envs.step(np.zeros((2, 6)))
        envs.reset(seed=5)
        wrong = np.zeros((2, 6))
        wrong[1, 4] = np.inf
        for error, words, mistake in (
                (ValueError, "environment 1: entry 4 .* inf", lambda: envs.step(wrong)),
                (ValueError, r"must have the shape \(2, 6\), but has \(2, 5\)",
                 lambda: envs.step(np.zeros((2, 5)))),
                (ValueError, "1 seeds were given for 2", lambda: envs.reset(seed=[1])),
                (ValueError, "reset_mask", lambda: envs.reset(options={"reset_mask": [1]})),
                (errors.WrongUse, "at least 1", lambda: myograde.vec("myograde/Elbow-v0", 0)),
                (errors.WrongUse, "no pictures",
                 lambda: myograde.vec("myograde/Elbow-v0", 1, render_mode="rgb_array"))):
            with self.assertRaisesRegex(error, words):
                mistake()
        alone = make("myograde/Elbow-v0")
        alone.reset(seed=5)
        np.testing.assert_array_equal(envs.step(np.ones((2, 6)))[0][0], alone.step(np.ones(6))[0])

    def test_python_goes_on_while_they_step(self):
        envs = myograde.vec("myograde/Manipulation-v0", 2, threads=1)
        envs.reset(seed=0)
        counted, done = [0], threading.Event()

        def count():
            while not done.is_set():
                counted[0] += 1
                time.sleep(0)
        thread = threading.Thread(target=count)
        interval = sys.getswitchinterval()
        sys.setswitchinterval(60)  # nobody is made to give Python's lock away
        try:
            thread.start()
            before = counted[0]
            for _ in range(500):
                envs.step(np.zeros((2, 80)))
                after = counted[0]
                if after > before:
                    break
        finally:
            sys.setswitchinterval(interval)
            done.set()
            thread.join()
        self.assertGreater(after, before)

    def test_a_fork_is_told_that_the_threads_are_gone(self):
        script = ("import os, numpy, warnings, myograde.envs\n"
                  "envs = myograde.vec('myograde/Elbow-v0', 2, threads=2)\n"
                  "envs.reset(seed=0)\n"
                  "child = os.fork()\n"
                  "if child == 0:\n"
                  "    try:\n        envs.step(numpy.zeros((2, 6)))\n"
                  "    except RuntimeError as error:\n"
                  "        os.write(1, str(error).encode())\n        os._exit(0)\n"
                  "    os._exit(1)\n"
                  "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
                  "envs.step(numpy.zeros((2, 6)))\n")
        said = self.python("-c", script)
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertRegex(said.stdout, "^these environments were created in another process.*0\n$")

if __name__ == "__main__":
    unittest.main(verbosity=2)
