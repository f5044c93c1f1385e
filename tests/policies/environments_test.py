"""The graded environments in Python: Gymnasium's own check, and a server's digests to the bit. Runs with
the grader's maths functions (environments.sh)."""

import contextlib
import io
import json
import os
import pathlib
import re
import subprocess
import unittest
import unittest.mock
import warnings

import numpy as np
from gymnasium.utils.env_checker import check_env

import myograde
import myograde.envs
from environments_support import NAMES, SOURCE, InFolder, actions_of, make, read_log
from myograde import errors

TUNABLES = "GLIBC_TUNABLES"


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
        self.assertEqual(info["details"]["settle_time"], 0.02)
        low, high, limit_low, limit_high = info["details"]["joint_ranges"]["r_elbow_flex"]
        self.assertTrue(limit_low <= low < high <= limit_high, info["details"])

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
                (ValueError, r"must have the shape \(6,\), but has \(7,\)", lambda: env.step(np.zeros(7))),
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

    def test_official_names_are_there_or_say_what_stands_for_them(self):
        for name in NAMES:
            env = make(name)
            for ask in (lambda: env.obs_dict, lambda: env.rwd_dict, env.get_obs, env.get_env_state,
                        env.get_input_seed):
                with self.assertRaisesRegex(errors.WrongUse, r"before the first reset\(\)"):
                    ask()
            env.reset(seed=6)
            observation, reward, _, _, info = env.step(actions_of(env, 1)[0])
            self.assertEqual(env.dt, env.core.control_period_s)
            self.assertAlmostEqual(env.time, info["facts"]["sim_time"])
            self.assertEqual(env.horizon, myograde.envs.seeds(env.settings.track).max_steps)
            self.assertEqual(env.obs_keys, list(env.layout))
            np.testing.assert_array_equal(
                np.concatenate([env.obs_dict[key] for key in env.obs_keys]), observation)
            np.testing.assert_array_equal(env.get_obs(), observation)
            self.assertEqual({**env.rwd_dict, **info["rewards"]}, env.rwd_dict)
            self.assertEqual(env.rwd_dict["dense"], reward)
            self.assertEqual(sum(weight * info["rewards"][term]
                                 for term, weight in env.rwd_keys_wt.items()), reward)
            self.assertEqual(env.get_input_seed(), 6)
        for name, words in (("sim", "which the official environments have: .*get_env_state"),
                            ("seed", r"reset\(seed=N\)"), ("last_ctrl", "MYOSUITE.md"),
                            ("nothing", "object has no attribute 'nothing'")):
            with self.assertRaisesRegex(AttributeError, words):
                getattr(env, name)
            self.assertFalse(hasattr(env, name))

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


    def test_options_and_actions_of_a_wrong_kind_are_refused_in_a_sentence(self):
        env = myograde.envs.GradedEnv("elbow")
        self.addCleanup(env.close)
        with self.assertRaisesRegex(errors.WrongUse, r"options=\[1\] can't be used; it must be a dict"):
            env.reset(seed=1, options=[1])
        env.reset(seed=1)
        with self.assertRaisesRegex(errors.WrongUse, "the action must be an array of numbers"):
            env.step([10**400] * env.action_space.shape[0])

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
            self.assert_fits("check", said.stdout)
            self.assertTrue(told["equal"])
            self.assertEqual({track: (each["equal"], each["steps"], each["detail"])
                              for track, each in told["tracks"].items()},
                             {"baoding": (True, 20, ""), "chasetag": (True, 50, ""),
                              "elbow": (True, 50, ""), "locomotion": (True, 120, ""), "manipulation": (True, 100, ""),
                              "relocation": (True, 50, ""), "reorientation": (True, 50, "")})

    def assert_fits(self, schema, text):
        """By Debian's jsonschema, which is not a part of this test's Python."""
        script = ("import json, sys\nfrom support.schemas import validate\n"
                  "validate(json.load(sys.stdin), sys.argv[1])")
        said = subprocess.run(["/usr/bin/python3", "-c", script, schema], input=text, text=True,
                              capture_output=True, timeout=60,
                              env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(SOURCE / "tests")})
        self.assertEqual(said.returncode, 0, said.stderr)

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
                                      "the client but no environments")


class Documented(InFolder):
    def test_the_pages_scripts_run(self):
        page = (SOURCE / "policies/README.md").read_text()
        section = page[page.index("### Train"):page.index("### Results")]
        scripts = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
        self.assertEqual(len(scripts), 2)
        for script in scripts:
            said = self.python("-c", script)
            self.assertEqual((said.returncode, said.stderr), (0, ""))

    def test_the_page_for_people_of_myosuite_runs_and_has_every_official_name_that_there_is(self):
        from myograde.envs import official
        page = (SOURCE / "policies/MYOSUITE.md").read_text()
        for script in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
            said = self.python("-c", script)
            self.assertEqual((said.returncode, said.stderr), (0, ""))
        for name in vars(official.OfficialNames):
            if not name.startswith("_"):
                self.assertIn(f"`{name}", page)

    def test_the_pages_table_has_every_setting(self):
        page = (SOURCE / "policies/README.md").read_text()
        section = page[page.index("### Train"):page.index("### Results")]
        told = set(re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE))
        self.assertLessEqual(set(myograde.envs.settings.Settings.__dataclass_fields__) - {"track"},
                             told)


if __name__ == "__main__":
    unittest.main(verbosity=2)
