"""The graded environments in Python: Gymnasium's own check, a server's digests to the bit, and many
environments side by side. Runs with the grader's maths functions (environments.sh)."""

import contextlib
import io
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import unittest.mock
import warnings

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

import myograde
import myograde.envs
from myograde import errors

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
NAMES = list(myograde.envs.ENVIRONMENTS)
TUNABLES = "GLIBC_TUNABLES"


def make(name, **settings):
    """Without the wrappers of gymnasium.make."""
    return gymnasium.make(name, **settings).unwrapped


def actions_of(env, count, seed=0):
    """Random ones, the same for the same seed."""
    generator = np.random.default_rng(seed)
    low, high = env.action_space.low, env.action_space.high
    return generator.uniform(low, high, (count, *low.shape))


def read_log(track):
    """An episode that a server graded: the header, the actions, and how it ended."""
    file = SOURCE / f"configs/reference/{track}.lcmlog.zst"
    data = subprocess.run(["zstd", "-dc", file], check=True, capture_output=True).stdout
    place, header, end, actions = 0, None, None, []
    while place < len(data):
        _, _, _, name_size, size = struct.unpack_from(">IqqII", data, place)
        name = data[place + 28:place + 28 + name_size].decode()
        body = data[place + 28 + name_size:place + 28 + name_size + size]
        place += 28 + name_size + size
        if name == "MYOGRADE_LOG_HEADER":
            header = json.loads(myograde.log_text_t.decode(body).json)
        elif name == "MYOGRADE_LOG_END":
            end = json.loads(myograde.log_text_t.decode(body).json)
        elif name == "MYOGRADE_ACTION":
            actions.append(list(myograde.action_t.decode(body).values))
    return header, np.array(actions), end


class InFolder(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def short(self, track, steps):
        """A config of short episodes."""
        rules = {"elbow": {"max_steps": steps, "hold_steps": 5},
                 "manipulation": {"max_steps": steps},
                 "locomotion": {"end": {"time_limit_s": steps / 200}}}[track]
        file = self.folder / f"{track}-{steps}.json"
        file.write_text(json.dumps({"extends": track, "rules": rules}))
        return file

    def python(self, *words, **variables):
        environment = {**os.environ, **variables}
        return subprocess.run([sys.executable, "-B", *map(str, words)], capture_output=True,
                              text=True, timeout=120, cwd=self.folder,
                              env={name: value for name, value in environment.items()
                                   if value is not None})


class Gymnasium(InFolder):
    def test_each_environment_passes_its_check(self):
        for name in NAMES:
            for form in ("flat", "dict"):
                env = make(name, observation=form)
                with warnings.catch_warnings(record=True) as heard:
                    warnings.simplefilter("always")
                    check_env(env, skip_render_check=True)
                # Positions and forces have no natural limits, and a leg set is chosen by its number.
                expected = "infinity" if name != "myograde/Locomotion-v0" else "infinity|symmetric"
                for warning in heard:
                    self.assertRegex(str(warning.message), expected)

    def test_spaces_and_layouts_are_what_a_policy_gets(self):
        for name, track in myograde.envs.ENVIRONMENTS.items():
            env, kit = make(name), myograde.track(track)
            self.assertEqual(dict(env.layout), dict(kit.observation))
            self.assertEqual(dict(env.action_layout), dict(kit.action))
            self.assertEqual(env.observation_space.shape, (kit.observation.size,))
            self.assertEqual(env.observation_space.dtype, np.float64)
            observation, info = env.reset(seed=7)
            self.assertEqual(info, {"seed": 7})
            named = make(name, observation="dict")
            for part, values in named.reset(seed=7)[0].items():
                np.testing.assert_array_equal(values, kit.observation.split(observation)[part])

    def test_time_truncates_and_the_goal_terminates(self):
        env = make("myograde/Elbow-v0", config=self.short("elbow", 12))
        env.reset(seed=1)
        for step in range(12):
            *_, terminated, truncated, info = env.step(np.full(6, -1.0))
            self.assertEqual((terminated, truncated), (False, step == 11))
        self.assertEqual((info["end"], info["steps"], info["seed"]), ("time", 12, 1))
        with self.assertRaisesRegex(RuntimeError, r"call reset\(\) first"):
            env.step(np.zeros(6))
        held = {"extends": "elbow", "profiles": {"hold": {"rules": {"tolerance_rad": 2.5}}}}
        (self.folder / "held.json").write_text(json.dumps(held))
        env = make("myograde/Elbow-v0", config=self.folder / "held.json")
        env.reset(seed=1)
        for step in range(25):
            *_, terminated, truncated, info = env.step(np.zeros(6))
            self.assertEqual((terminated, truncated), (step == 24, False))
        self.assertEqual(info["end"], "held")
        self.assertTrue(info["facts"]["held"])

    def test_the_reward_is_the_weighted_sum_of_the_official_terms(self):
        for name in NAMES:
            env = make(name)
            env.reset(seed=2)
            weights = dict(env.core.reward_terms)
            chosen = make(name, weights={next(iter(weights)): 7.0})
            chosen.reset(seed=2)
            for action in actions_of(env, 5):
                _, reward, _, _, info = env.step(action)
                self.assertEqual(set(info["rewards"]), set(weights))
                self.assertAlmostEqual(
                    reward, sum(weights[term] * info["rewards"][term] for term in weights))
                _, other, _, _, info = chosen.step(action)
                first = next(iter(weights))
                self.assertAlmostEqual(
                    other, reward + (7 - weights[first]) * info["rewards"][first])

    def test_extra_observations_follow_the_graded_ones(self):
        env = make("myograde/Manipulation-v0", profile="myosuite")
        more = make("myograde/Manipulation-v0", profile="myosuite", extra_observations=True)
        self.assertIn("MPL_ori", more.layout)
        self.assertGreater(more.layout.size, env.layout.size)
        np.testing.assert_array_equal(more.reset(seed=3)[0][:222], env.reset(seed=3)[0])
        with self.assertRaisesRegex(errors.WrongUse, "no extra observations in its profile paper"):
            make("myograde/Manipulation-v0", extra_observations=True)

    def test_leg_sets_replace_the_graders(self):
        def distance(*sets, **options):
            env = make("myograde/Locomotion-v0", leg_sets=sets)
            env.reset(seed=4, options=options or None)
            for _ in range(30):
                env.step(np.zeros(55))
            return env.core.digest
        usual = myograde.leg_sets()
        stiff = myograde.LegState(myograde.Joint(2000, 0, 0), myograde.Joint(2000, 0, 0),
                                  (myograde.Threshold("load", 1e6, True),))
        other = myograde.LegSet(0, stiff, stiff, stiff, stiff)
        self.assertEqual(distance(), distance(*usual))
        self.assertNotEqual(distance(), distance(other))
        self.assertEqual(distance(other), distance(leg_sets=[other]))
        wild = myograde.LegState(myograde.Joint(1e9, 0, 0), myograde.Joint(0, 0, 0), stiff.until)
        with self.assertRaisesRegex(ValueError, "set 0.*1e\\+09"):
            distance(myograde.LegSet(0, wild, stiff, stiff, stiff))
        with self.assertRaisesRegex(ValueError, "index 5"):
            distance(myograde.LegSet(5, stiff, stiff, stiff, stiff))

    def test_mistakes_are_sentences(self):
        env = make("myograde/Elbow-v0")
        with self.assertRaisesRegex(RuntimeError, r"reset\(\)"):
            env.step(np.zeros(6))
        env.reset(seed=0)
        for error, words, wrong in (
                (ValueError, "6 entries, this one has 7", lambda: env.step(np.zeros(7))),
                (ValueError, "entry 2 of the action is nan",
                 lambda: env.step([0, 0, float("nan"), 0, 0, 0])),
                (errors.WrongUse, "out of range", lambda: env.reset(seed=2**63)),
                (errors.WrongUse, 'no rules profile "papers".*hold, myosuite',
                 lambda: make("myograde/Elbow-v0", profile="papers")),
                (errors.WrongUse, 'no reward term "posture"; there are: pose',
                 lambda: make("myograde/Elbow-v0", weights={"posture": 1})),
                (errors.WrongUse, 'observation="image" is unknown; there are: flat, dict',
                 lambda: make("myograde/Elbow-v0", observation="image")),
                (errors.WrongUse, "nowhere.json", lambda: make("myograde/Elbow-v0",
                                                               config="nowhere.json")),
                (errors.MyogradeError, "no models yet.*get-models",
                 lambda: make("myograde/Elbow-v0", cache=self.folder)),
                (errors.WrongUse, 'no track config "arm"', lambda: myograde.envs.seeds("arm"))):
            with self.assertRaisesRegex(error, words):
                wrong()

    def test_models_are_compiled_as_graders_do(self):
        cache = pathlib.Path(os.environ["MYOGRADE_CACHE"])
        (self.folder / "myosuite-2.8.4").symlink_to(cache / "myosuite-2.8.4")
        script = "import myograde.envs.extension as e; print(e.provide_models(), e.exact())"
        said = self.python("-c", script, MYOGRADE_CACHE=str(self.folder), GLIBC_TUNABLES=None)
        self.assertEqual(said.stdout, f"{self.folder} False\n", said.stderr)
        for model in (self.folder / "models").iterdir():
            self.assertEqual(model.read_bytes(), (cache / "models" / model.name).read_bytes())

    def test_seeds_are_those_of_the_config(self):
        known = myograde.envs.seeds("elbow")
        self.assertEqual((known.profile, known.max_steps), ("hold", 100))
        self.assertEqual((known.seeds, known.practice_seeds),
                         (tuple(range(100)), tuple(range(100, 200))))
        self.assertEqual(len(set(known.policy_seeds)), 100)


class Digests(InFolder):
    def test_the_same_seed_and_actions_give_a_servers_digests(self):
        self.assertTrue(myograde.envs.exact())
        for name, track in myograde.envs.ENVIRONMENTS.items():
            header, actions, end = read_log(track)
            config = self.folder / f"{track}.json"
            # The config that the log names, as a file.
            graded = header["track"]
            profile = graded.pop("profile")
            del graded["id"]
            config.write_text(json.dumps({**graded, "default_profile": profile,
                                          "profiles": {profile: {}}}))
            env = make(name, config=config, exact=True)
            env.reset(seed=header["seed"])
            for action in actions:
                *_, terminated, truncated, info = env.step(action)
            self.assertTrue(terminated or truncated)
            self.assertEqual((info["digest"], info["end"], info["steps"]),
                             (end["digest"], end["end"], end["steps"]), track)

    def test_check_plays_them_in_a_process_of_the_graders_maths(self):
        for tunables in (None, os.environ[TUNABLES], "glibc.malloc.check=0"):
            said = self.python("-m", "myograde", "check", "--json", GLIBC_TUNABLES=tunables)
            self.assertEqual(said.returncode, 0, said.stderr)
            told = json.loads(said.stdout)
            self.assertTrue(told["equal"])
            self.assertEqual({track: (each["equal"], each["steps"], each["detail"])
                              for track, each in told["tracks"].items()},
                             {"elbow": (True, 50, ""), "locomotion": (True, 120, ""),
                              "manipulation": (True, 100, "")})

    def test_check_tells_of_a_difference(self):
        # What a server would have logged of another action.
        data = bytearray(subprocess.run(
            ["zstd", "-dc", SOURCE / "configs/reference/elbow.lcmlog.zst"], check=True,
            capture_output=True).stdout)
        data[data.index(b"MYOGRADE_ACTION") + 60] ^= 1
        (self.folder / "elbow.lcmlog").write_bytes(data)
        with self.assertRaisesRegex(errors.MyogradeError, "checksum|SHA-256|damaged"):
            myograde.envs.replay(self.folder / "elbow.lcmlog")
        different = myograde.envs.Replayed(False, 3, "the state after step 3 is not the logged one")
        with unittest.mock.patch("myograde.envs.extension.replay", return_value=different), \
                unittest.mock.patch("sys.argv", ["myograde", "check"]), \
                contextlib.redirect_stdout(io.StringIO()) as said:
            from myograde import __main__ as program
            self.assertEqual(program.main(), 1)
        self.assertIn("elbow: the state after step 3", said.getvalue())
        self.assertIn("may differ from a server's", said.getvalue())

    def test_run_starts_a_script_with_the_graders_maths(self):
        script = self.folder / "script.py"
        script.write_text("import sys, myograde.envs\n"
                          "print(myograde.envs.exact(), sys.argv[1:])\n"
                          "myograde.envs.extension.require_exact()\nsys.exit(7)\n")
        said = self.python("-m", "myograde", "run", script, "--steps", "3", GLIBC_TUNABLES=None)
        self.assertEqual((said.stdout, said.returncode), ("True ['--steps', '3']\n", 7))
        said = self.python(script, GLIBC_TUNABLES=None)
        self.assertEqual((said.stdout, said.returncode), ("False []\n", 1))
        self.assertRegex(said.stderr, "WrongUse: .*python -m myograde run .*script.py")
        # Set by the script itself, it comes too late.
        late = "import os; os.environ['GLIBC_TUNABLES'] = %r; import myograde.envs as e; " \
               "print(e.exact())" % os.environ[TUNABLES]
        self.assertEqual(self.python("-c", late, GLIBC_TUNABLES=None).stdout, "False\n")
        said = self.python("-m", "myograde", "run")
        self.assertEqual(said.returncode, 2)
        self.assertRegex(said.stderr, "run needs a script")

    def test_a_config_that_is_exact_refuses_a_process_that_is_not(self):
        said = self.python("-c", "import gymnasium, myograde\n"
                           "gymnasium.make('myograde/Elbow-v0', exact=True)",
                           GLIBC_TUNABLES=None)
        self.assertRegex(said.stderr, "WrongUse: this process was not started with the grader's")


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
            for key, value in expected[4]["facts"].items():
                self.assertEqual(info["facts"][key][i], value, key)
        elif "seed" in expected[4]:
            self.assertTrue(info["_seed"][i])
            self.assertEqual(info["seed"][i], expected[4]["seed"])
        for term, value in expected[4].get("rewards", {}).items():
            self.assertEqual(info["rewards"][term][i], value)

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
                (ValueError, "must be an array of 2 x 6, it is one of 2 x 5",
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
        self.assertRegex(said.stdout, "^these environments were made in another process.*0\n$")


class Lacking(InFolder):
    def test_without_gymnasium_the_sentence_names_the_extra(self):
        script = ("import sys; sys.modules['gymnasium'] = None\nimport myograde.envs\n"
                  "print(myograde.envs.seeds('elbow').profile)\n"
                  "myograde.vec('myograde/Elbow-v0', 2)")
        said = self.python("-c", script)
        self.assertEqual(said.stdout, "hold\n", said.stderr)
        self.assertRegex(said.stderr, r'MyogradeError: the package gymnasium is missing.*'
                                      r'pip install "myograde\[gym\]"')

    def test_without_the_extension_the_kit_works_and_says_what_is_missing(self):
        script = ("import sys; sys.modules['myograde._env'] = None\nimport myograde.client\n"
                  "import myograde.envs, gymnasium; print(myograde.track('elbow').action.size)\n"
                  "gymnasium.make('myograde/Elbow-v0')")
        said = self.python("-c", script)
        self.assertEqual(said.stdout, "6\n", said.stderr)
        self.assertRegex(said.stderr, "MyogradeError: this installation of myograde has the kit and "
                                      "the client, and no environments")


if __name__ == "__main__":
    unittest.main(verbosity=2)
