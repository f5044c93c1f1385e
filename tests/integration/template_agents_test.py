"""Agents written for the templates of 2022 to 2024, on the real tracks, through the adapters that
serve their gRPC service. Needs the runtime template-2024 in the cache folder."""

import json
import os
import pathlib
import shutil
import unittest

from system import HERE, POLICIES, REFERENCES, SystemTest, track_config

AGENTS = HERE / "template_agents"
RUNTIME = pathlib.Path(os.environ.get("MYOGRADE_CACHE", "/nonexistent"), "runtimes/template-2024")
# What agent_2023.py is told for relocation.
RELOCATION_2023 = ("8085", "63", "hand_qpos", "hand_qvel", "obj_pos", "goal_pos", "pos_err",
                   "obj_rot", "goal_rot", "rot_err")


@unittest.skipUnless((RUNTIME / "grpc").is_dir(), f"there is no runtime {RUNTIME}")
class TemplateAgents(SystemTest):
    references = (*REFERENCES, "reorientation", "baoding", "relocation", "chasetag")
    tracks = {
        "short-arm": track_config("manipulation", seeds={"first": 7000, "count": 2}),
        "short-leg": track_config("locomotion"),
        "brief-arm": track_config("manipulation", seeds={"first": 7000, "count": 2},
                                  rules={"max_steps": 100}),
        "one-arm": track_config("manipulation", seeds={"first": 7000, "count": 1},
                                budgets={"startup_s": 6, "startup_wall_s": 30, "restarts": 1}),
        "short-die": track_config("reorientation"),
        "short-balls": track_config("baoding"),
        "short-bin": track_config("relocation"),
        "short-tag": track_config("chasetag"),
    }

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.daemon.configure(runtimes={"template-2024": {"path": str(RUNTIME)}})

    def agent(self, name, *arguments, files=(), **manifest):
        """A submission as a participant has it: the template's files, the agent and its own."""
        folder = self.root / "-".join([name, *arguments])
        if not folder.exists():
            shutil.copytree(AGENTS / "template", folder)
            for file in (f"{name}.py", *files):
                shutil.copy(AGENTS / file, folder)
            (folder / "policy.json").write_text(json.dumps({
                "name": name, "command": ["python3", f"{name}.py", *arguments],
                "adapter": "template-2024", **manifest}))
        return folder

    def play(self, policy, track, profile):
        result = self.ask("local", policy, "--track", track, "--profile", profile)
        self.assertEqual(len(result["episodes"]), 2 if track.endswith("-arm") else 3)
        for row in result["episodes"]:
            self.assertIn(row["outcome"], ("success", "failure"), row)
        return result

    def digests(self, policy, track, profile="myosuite"):
        return [row["digest"] for row in self.play(policy, track, profile)["episodes"]]

    def fault(self, mode):
        """How the only episode of a hostile agent ends, and what it said."""
        result = self.ask("local", self.agent("hostile_agent", mode), "--track", "one-arm",
                          "--profile", "myosuite", check=False)
        (row,) = result["episodes"]
        return row, "".join(output["stderr_tail"] for output in result["output"])

    def test_an_agent_of_zeros_is_the_zero_policy(self):
        mine = self.play(self.agent("manipulation_agent"), "short-arm", "as-graded")
        self.assertEqual([row["digest"] for row in mine["episodes"]],
                         self.digests(POLICIES / "zero", "short-arm", "as-graded"))
        said = mine["output"][0]["stderr_tail"].splitlines()
        self.assertEqual(said[-1], "all trials are over", said)

    def test_agents_of_2022_of_zeros_are_the_zero_policy(self):
        die = ("hand_qpos hand_qvel obj_pos goal_pos pos_err obj_rot goal_rot rot_err act")
        balls = ("hand_pos object1_pos object1_velp object2_pos object2_velp target1_pos target2_pos "
                 "target1_err target2_err act")
        for track, port, key, size, keys in (("short-die", "8085", "hand_qpos", "22", die),
                                             ("short-balls", "8086", "hand_pos", "23", balls)):
            with self.subTest(track):
                agent = self.agent("agent_2022", port, key, size, adapter="template-2022")
                mine = self.play(agent, track, "official")
                self.assertEqual([row["digest"] for row in mine["episodes"]],
                                 self.digests(POLICIES / "zero", track, "official"))
                said = mine["output"][0]["stderr_tail"].splitlines()
                self.assertIn(f"keys: {keys}", said)
                self.assertEqual(said[-1], "all trials are over", said)

    def test_agents_of_2023_of_zeros_are_the_zero_policy(self):
        # The dictionary is of the state where the first observation is not: in each episode of the
        # tag game, and where the object was drawn twice.
        for track, others, arguments in (
                ("short-bin", 2, RELOCATION_2023),
                ("short-tag", 3, (
                    "8086", "80", "internal_qpos", "internal_qvel", "grf", "torso_angle",
                    "opponent_pose", "opponent_vel", "model_root_pos", "model_root_vel",
                    "muscle_length", "muscle_velocity", "muscle_force"))):
            with self.subTest(track=track):
                agent = self.agent("agent_2023", *arguments, adapter="template-2023")
                mine = self.play(agent, track, "official")
                self.assertEqual([row["digest"] for row in mine["episodes"]],
                                 self.digests(POLICIES / "zero", track, "official"))
                said = mine["output"][0]["stderr_tail"].splitlines()
                self.assertEqual(said[-2:], [f"{others} first observations of other states",
                                             "all trials are over"], said)

    def test_an_agent_that_needs_finger_tips_and_forces(self):
        agent = self.agent("fingers_agent", files=["hand.json"], env={"POLICY_LOCAL": "1"})
        self.assertEqual(len(set(self.digests(agent, "short-arm"))), 2)

    def test_an_agent_of_raw_controls(self):
        def digests(angle):
            return self.digests(self.agent("direct_agent", angle), "brief-arm")

        beyond = digests("1.2")
        self.assertEqual(len(set(beyond)), 2)
        self.assertNotEqual(beyond, digests("1.0"), "controls above 1 are cut")

    def test_a_reset_before_the_end_ends_the_episode_as_it_stands(self):
        result = self.ask("local", self.agent("impatient_agent"), "--track", "short-arm",
                          "--profile", "myosuite")
        for row in result["episodes"]:
            self.assertEqual((row["outcome"], row["reason"]), ("failure", "given-up"), row)
        self.assertEqual([row["facts"]["steps"] for row in result["episodes"]], [3, 3])

    def test_an_agent_that_samples_from_torch_repeats(self):
        agent = self.agent("sampling_agent")
        (agent / "torch").mkdir()
        shutil.copy(AGENTS / "fake_torch.py", agent / "torch/__init__.py")
        first = self.digests(agent, "short-leg")
        self.assertEqual(first, self.digests(agent, "short-leg"))
        self.assertEqual(len(set(first)), 3)

    def test_a_walking_agent_with_its_own_parameter_sets(self):
        def digests(*arguments):
            return self.digests(self.agent("locomotion_agent", *arguments,
                                           files=["locomotion_sets.py"]), "short-leg")

        soft = digests("normalized", "0.1")
        self.assertEqual(len(set(soft)), 3)
        self.assertEqual(soft, digests("normalized", "0.1"), "its unseeded samples do not repeat")
        self.assertNotEqual(soft, digests("normalized", "0.5"), "its sets make no difference")
        self.assertNotEqual(soft, digests("direct", "0.1"))

    def test_a_parameter_set_is_in_force_from_change_osl_mode_on(self):
        def digests(*modes):
            return self.digests(self.agent("modes_agent", *modes, files=["locomotion_sets.py"]),
                                "short-leg")

        default = digests("-", "-", "-")
        stiff, soft = digests("2", "2", "2"), digests("3", "3", "3")
        for one, other in ((default, stiff), (default, soft), (stiff, soft)):
            self.assertTrue(all(a != b for a, b in zip(one, other)))
        self.assertEqual(digests("-", "2", "-"), [default[0], stiff[1], stiff[2]])
        self.assertEqual(digests("3", "-", "2"), [soft[0], soft[1], stiff[2]])
        self.assertEqual(digests("0", "1", "3"), [default[0], default[1], soft[2]])

    def test_hostile_pickles_end_in_their_own_sandbox(self):
        row, said = self.fault("pickles")
        self.assertEqual((row["outcome"], row["fault"]["whose"]), ("crash", "participant"), row)
        self.assertIn("still served", said)
        self.assertIn("an action has 80 entries, this one has 3", said)
        self.assertIn("can't be unpickled", said)

    def test_an_agent_that_floods_the_port(self):
        row, _ = self.fault("flood")
        self.assertIn(row["outcome"], ("memory_limit", "crash", "init_timeout"), row)
        self.assertEqual(row["fault"]["whose"], "participant", row)

    def test_an_agent_that_never_connects(self):
        row, _ = self.fault("silent")
        self.assertEqual(row["outcome"], "init_timeout", row)

    def test_an_agent_that_leaves(self):
        row, said = self.fault("leaves")
        self.assertEqual(row["outcome"], "crash", row)
        self.assertIn("status 7", row["fault"]["detail"])
        self.assertIn("I have seen enough", row["fault"]["detail"])

    def test_messages_that_are_too_large(self):
        row, said = self.fault("large")
        self.assertEqual(row["fault"]["whose"], "participant", row)
        self.assertIn("RESOURCE_EXHAUSTED", said)

    def test_the_profile_paper_has_no_finger_tips_and_says_so(self):
        result = self.ask("local", self.agent("fingers_agent", files=["hand.json"]), "--track",
                          "short-arm", "--profile", "paper", check=False)
        row = result["episodes"][0]
        self.assertEqual(row["outcome"], "crash", row)
        self.assertIn("max_force", row["fault"]["detail"])

    def test_a_track_that_the_template_did_not_have(self):
        run = self.run_cli("local", self.agent("manipulation_agent"), "--track", "elbow",
                           "--episodes", "1", check=False)
        self.assertEqual(run.returncode, 2, run)
        self.assertIn('does not support tracks of the kind "elbow"', run.stderr)

    def test_an_agent_of_another_year(self):
        for adapter, track, kind in (("template-2022", "short-arm", "manipulation"),
                                     ("template-2024", "short-bin", "relocation")):
            folder = self.agent("manipulation_agent", adapter, adapter=adapter)
            run = self.run_cli("local", folder, "--track", track, check=False)
            self.assertEqual(run.returncode, 2, run)
            self.assertIn(f'"adapter" is "{adapter}", which does not support tracks of the kind '
                          f'"{kind}"', run.stderr)

    def test_an_adapter_that_nobody_knows_is_refused(self):
        folder = self.agent("manipulation_agent", "unknown", adapter="template-1999")
        run = self.run_cli("local", folder, "--track", "short-arm", check=False)
        self.assertNotEqual(run.returncode, 0)
        self.assertIn("template-2024", run.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
