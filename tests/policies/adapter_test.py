"""The adapters of the templates without a grader: what they make of observations, parameter sets and
pickles. tests/integration/template_agents_test.py has them play."""

import os
import pathlib
import pickle
import subprocess
import sys
import tempfile
import unittest

import numpy as np

ADAPTER = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"]).parent / "adapters/template-2024"
sys.path.insert(0, str(ADAPTER))

import myograde  # noqa: E402
from agent import HOOKS, Agent, agent_environment  # noqa: E402
from challenges import CHALLENGES  # noqa: E402
from environment import Refused, environment_of  # noqa: E402
from leg_sets import Leg  # noqa: E402
from observations import Baoding, Locomotion, Manipulation, Relocation, Reorientation  # noqa: E402
from pickles import pack, unpack  # noqa: E402

STATES = ("e_stance", "l_stance", "e_swing", "l_swing")


def a_set(stiffness):
    gain = {f"{joint}_{key}": value for joint in ("knee", "ankle")
            for key, value in (("stiffness", stiffness), ("damping", 1), ("target_angle", 0.1))}
    return {state: {"gain": gain, "threshold": {"load": (100.0, "above")}} for state in STATES}


def stiffness(sets, index):
    (entry,) = [entry for entry in sets if entry.index == index]
    return entry.states[0].knee_stiffness


class LegSets(unittest.TestCase):
    def in_force(self, leg, sets):
        return stiffness(sets, leg.selected)

    def test_an_upload_acts_from_the_next_change_on_and_stays(self):
        leg = Leg()
        leg.upload({np.int64(1): a_set(11), 2: a_set(12)})
        default = self.in_force(leg, leg.begin("myosuite"))
        self.assertNotIn(default, (11, 12))
        sets = leg.begin("myosuite")
        leg.change(1)
        self.assertEqual(self.in_force(leg, sets), 11)
        leg.upload({1: a_set(21)})
        sets = leg.begin("myosuite")
        self.assertEqual(self.in_force(leg, sets), 11, "a change before it counts on")
        leg.change(1)
        self.assertEqual(self.in_force(leg, sets), 21)
        leg.change(0)
        self.assertEqual(self.in_force(leg, sets), default)

    def test_each_set_of_the_library_can_be_chosen_in_every_profile(self):
        for profile in ("paper", "myosuite", "as-graded"):
            leg = Leg()
            leg.upload({index: a_set(10 + index) for index in range(4)})
            for trial in range(3):
                sets = leg.begin(profile)
                indices = [entry.index for entry in sets]
                self.assertEqual(indices, sorted(set(indices)))
                for index in (2, 0, 3, 1):
                    leg.change(index)
                    self.assertEqual(self.in_force(leg, sets), 10 + index, (profile, trial))

    def test_equal_sets_leave_a_place_for_the_one_in_force(self):
        leg = Leg()
        leg.upload({index: a_set(5) for index in range(4)})
        sets = leg.begin("myosuite")
        self.assertNotEqual(self.in_force(leg, sets), 5)
        for index in range(4):
            leg.change(index)
            self.assertEqual(self.in_force(leg, sets), 5)

    def test_nothing_is_uploaded_where_the_agent_uploads_nothing(self):
        leg = Leg()
        self.assertEqual(leg.begin("paper"), [])
        leg.change(3)
        self.assertEqual((leg.begin("paper"), leg.selected), ([], 3))

    def test_mistakes_are_told(self):
        broken = a_set(1)
        del broken["e_swing"]["gain"]["knee_damping"]
        sideways = a_set(1)
        sideways["e_stance"]["threshold"] = {"load": (1.0, "beside")}
        for sets, words in (({0: broken}, "knee_damping"), ({0: sideways}, "beside"),
                            ({4: a_set(1)}, "no parameter set 4"), ({-1: a_set(1)}, "set -1"),
                            ([1], "dictionaries"), ({0: None}, "dictionaries"),
                            ({"one": a_set(1)}, "one")):
            leg = Leg()
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                leg.upload(sets)
            self.assertEqual(leg.begin("paper"), [], "half of an upload was taken")
        with self.assertRaisesRegex(ValueError, "no parameter set 4"):
            Leg().change(4)


class Observed(unittest.TestCase):
    def test_the_official_names_shapes_and_types(self):
        arm = Manipulation(extra_observations=True).by_name()
        self.assertEqual(len(arm), 27)
        sizes = {"time": 1, "qp": 71, "qv": 70, "elbow_fle": 1, "max_force": 1, "touching_body": 5,
                 "fin4": 3, "MPL_ori": 3, "act": 63, "Rpalm_pos": 3}
        self.assertEqual({name: arm[name].shape for name in sizes},
                         {name: (size,) for name, size in sizes.items()})
        integers = {name for name, entry in arm.items() if entry.dtype == np.int64}
        self.assertEqual(integers, {"touching_body", "max_force"})
        leg = Locomotion(extra_observations=True).by_name()
        self.assertEqual((len(leg), leg["hfield"].shape, leg["terrain"].dtype),
                         (14, (100,), np.int64))

    def test_a_force_is_a_number_with_a_point(self):
        arm = Manipulation(extra_observations=True)
        arm.take(np.linspace(1, 2, arm._values.size))
        self.assertEqual(arm.by_name()["max_force"].dtype, np.float64)

    def test_derived_entries_follow_from_the_graded_ones(self):
        arm = Manipulation(extra_observations=False)
        values = np.random.default_rng(1).uniform(-1, 1, arm._values.size)
        arm.take(values)
        entries = arm.by_name()
        self.assertEqual(set(entries) & {"fin0", "max_force", "MPL_ori"}, set())
        self.assertTrue(np.array_equal(entries["qp"][:38], entries["myohand_qpos"]))
        self.assertTrue(np.array_equal(entries["qv"][-6:], entries["object_qvel"]))
        self.assertEqual(entries["elbow_fle"][0], entries["myohand_qpos"][14])
        self.assertTrue(np.allclose(entries["palm_pos"] - entries["obj_pos"], entries["reach_err"]))
        self.assertEqual(arm.reward(), 0.0)

    def test_vectors_are_rounded_and_entries_are_not(self):
        leg = Locomotion(extra_observations=False)
        leg.take(np.full(leg._values.size, 1 / 3))
        vector = leg.vector(leg.default_keys())
        self.assertEqual((vector.dtype, vector.size), (np.float32, 260))
        self.assertEqual(leg.by_name()["act"][0], 1 / 3)
        self.assertEqual(leg.reward(), -1 / 3)
        leg.by_name()["act"][0] = 5.0
        self.assertEqual(leg.by_name()["act"][0], 1 / 3, "a caller changed the observation")


class Years(unittest.TestCase):
    def taken(self, kind, extra_observations=False):
        observed = kind(extra_observations)
        observed.take(np.random.default_rng(3).uniform(-1, 1, observed._values.size))
        return observed

    def test_each_name_is_a_copy_of_one_program(self):
        files = {name: {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*")
                        if path.is_file() and "__pycache__" not in path.parts}
                 for name in CHALLENGES for folder in [ADAPTER.with_name(name)]}
        self.assertIn(pathlib.Path("challenges.py"), files["template-2022"])
        self.assertEqual(files["template-2022"], files["template-2024"])
        self.assertEqual(files["template-2023"], files["template-2024"])

    def test_an_unchanged_vector_is_the_graded_observation(self):
        for kind, size in ((Reorientation, 102), (Baoding, 86), (Relocation, 156)):
            with self.subTest(kind.track):
                observed = self.taken(kind)
                vector = observed.vector(observed.default_keys())
                self.assertEqual((vector.dtype, vector.size), (np.float32, size))
                self.assertTrue(np.array_equal(vector, observed._values.astype(np.float32)))

    def test_names_of_2022_have_their_meaning_of_2022(self):
        entries = self.taken(Reorientation, extra_observations=True).by_name()
        self.assertEqual(entries["hand_qpos"].shape, (22,))
        self.assertTrue(np.array_equal(entries["hand_qpos"], entries["hand_qpos_noMD5"]))
        self.assertTrue(np.array_equal(entries["t"], entries["time"]))
        self.assertNotIn("t", Baoding(extra_observations=False).by_name())
        self.assertEqual(Baoding(extra_observations=True).by_name()["t"].shape, (1,))

    def test_rewards_have_the_official_weights(self):
        die = self.taken(Reorientation)
        entries = die.by_name()
        self.assertAlmostEqual(die.reward(), -100 * np.linalg.norm(entries["pos_err"])
                               - np.linalg.norm(entries["rot_err"]))
        balls = self.taken(Baoding)
        entries = balls.by_name()
        self.assertAlmostEqual(balls.reward(), -5 * np.linalg.norm(entries["target1_err"])
                               - 5 * np.linalg.norm(entries["target2_err"]))

    def test_each_challenge_has_the_tracks_of_its_year(self):
        for name, kinds in (("template-2022", {"reorientation": 39, "baoding": 39}),
                            ("template-2023", {"relocation": 63, "chasetag": 80}),
                            ("template-2024", {"manipulation": 80, "locomotion": 54})):
            known = {kind.track: kind for kind in CHALLENGES[name].environments}
            self.assertEqual(set(known), set(kinds))
            for track, actions in kinds.items():
                if track not in myograde.policy.layout.tracks():
                    continue
                environment = environment_of(name, track, True, None)
                self.assertEqual(environment.get_action_space(None), actions)
                observed = environment.get_obsdict(None)
                for key in environment.get_output_keys(None):
                    self.assertIn(key, observed)
                if name != "template-2024":
                    with self.assertRaisesRegex(Refused, "no prosthetic leg"):
                        environment.change_osl_mode([1])
        with self.assertRaisesRegex(SystemExit, "template-2022 has no environment for the track "
                                                "manipulation; it has baoding and reorientation"):
            environment_of("template-2022", "manipulation", False, None)


class Pickles(unittest.TestCase):
    def test_old_pythons_and_numpys_read_what_is_sent(self):
        packed = pack({"a": np.arange(3.0), "b": np.float64(1)})
        self.assertEqual(packed[:2], b"\x80\x04")
        self.assertIn(b"numpy.core.multiarray", packed)

    def test_what_newer_ones_send_is_read(self):
        sent = np.arange(3.0)
        # As NumPy 2 names it; a text protocol, so that the length does not matter.
        newer = pickle.dumps(sent, 2).replace(b"numpy.core.", b"numpy._core.")
        self.assertIn(b"numpy._core.multiarray", newer)
        self.assertTrue(np.array_equal(unpack(newer), sent))
        self.assertTrue(np.array_equal(unpack(pickle.dumps(sent, 5)), sent))

    def test_rubbish_is_refused_in_a_sentence(self):
        for rubbish in (b"", b"\xff" * 9, b"\x80\x04.", b"cno_such_module\nthing\n."):
            with self.assertRaisesRegex(ValueError, "unpickled|needs no_such_module"):
                unpack(rubbish)


class AgentProcess(unittest.TestCase):
    def run_agent(self, *command):
        agent = Agent(command, agent_environment([], []), "/")
        agent.start()
        return agent.wait()

    def test_its_exit_status_or_signal_is_known(self):
        self.assertEqual(self.run_agent("/bin/sh", "-c", "exit 3"), 3)
        self.assertEqual(self.run_agent("/bin/sh", "-c", "kill -9 $$"), -9)
        self.assertEqual(self.run_agent("/no/such/program"), 127)

    def test_it_can_be_ended_with_all_that_it_started(self):
        agent = Agent(["/bin/sh", "-c", "sleep 100 & sleep 100"], agent_environment([], []), "/")
        agent.start()
        agent.end(0.05)
        self.assertLess(agent.wait(), 0)

    def test_its_variables(self):
        own = {"PATH": "/bin", "MYOGRADE_LCM_URL": "udpm://", "PYTHONHOME": "/x",
               "PYTHONPATH": "/y"}
        variables = agent_environment(["PYTHONPATH=/policy/packages", "A=b=c"], ["/r"], own)
        self.assertEqual(variables, {"PATH": "/bin", "A": "b=c",
                                     "PYTHONPATH": f"{HOOKS}:/policy/packages:/r"})


class Hooks(unittest.TestCase):
    """In another Python process, as an agent has it."""

    def run_python(self, text, **files):
        with tempfile.TemporaryDirectory() as folder:
            for name, content in files.items():
                pathlib.Path(folder, f"{name}.py").write_text(content, encoding="utf-8")
            path = f"{HOOKS}:{folder}:{os.environ.get('PYTHONPATH', '')}"
            done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True,
                                  env=dict(os.environ, PYTHONPATH=path), check=False, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout + done.stderr

    def test_what_an_agent_draws_repeats(self):
        text = "import random, numpy; print(random.random(), numpy.random.random())"
        self.assertEqual(self.run_python(text), self.run_python(text))

    def test_a_minute_of_waiting_is_skipped_and_a_moment_is_not(self):
        self.run_python("import time\nbegun = time.monotonic()\ntime.sleep(3600)\n"
                        "time.sleep(0.05)\nassert 0.05 <= time.monotonic() - begun < 30")

    def test_the_sitecustomize_that_it_hides_runs_too(self):
        self.assertEqual(self.run_python("", sitecustomize="print('mine')"), "mine\n")

    def test_gymnasium_stands_for_gym_where_there_is_none(self):
        text = "import gym; print(gym.whose); import gymnasium; print(gymnasium.whose)"
        self.assertEqual(self.run_python(text, gymnasium="whose = 'theirs'"), "theirs\ntheirs\n")
        self.assertEqual(self.run_python("import gym; print(gym.whose)", gym="whose = 'mine'",
                                         gymnasium="whose = 'theirs'"), "mine\n")
        text = "try:\n    import gym\nexcept ImportError as error:\n    print(error.name)"
        self.assertEqual(self.run_python(text), "gym\n")

    def test_another_grpc_does_not_stop_the_agent(self):
        said = self.run_python("import grpc; print(grpc.other)", grpc="other = 1")
        self.assertIn("1\n", said)
        self.assertIn("can't seed grpc", said)


if __name__ == "__main__":
    unittest.main()
