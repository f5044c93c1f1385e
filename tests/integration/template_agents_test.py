"""Agents written for the template of 2024, on the real tracks, by the kit that stands in for it."""

import shutil
import unittest

from system import HERE, POLICIES, SystemTest, track_config


class TemplateAgents(SystemTest):
    tracks = {
        "short-arm": track_config("manipulation"),
        "short-leg": track_config("locomotion"),
    }

    def agent(self, name, *arguments):
        return self.python_policy("-".join([name, *arguments]),
                                  ["play_agent.py", f"{name}.py", *arguments],
                                  HERE / f"template_agents/{name}.py", kit="kit-template-2024")

    def play(self, policy, track, profile):
        result = self.ask("local", policy, "--track", track, "--profile", profile)
        self.assertEqual(len(result["episodes"]), 3)
        for row in result["episodes"]:
            self.assertIn(row["outcome"], ("success", "failure"), row)
        return result["episodes"]

    def test_an_agent_of_zeros_is_the_zero_policy(self):
        for profile in ("myosuite", "as-graded"):
            with self.subTest(profile=profile):
                agent = self.agent("manipulation_agent", profile)
                mine = self.play(agent, "short-arm", profile)
                zero = self.play(POLICIES / "zero", "short-arm", profile)
                self.assertEqual([row["digest"] for row in mine],
                                 [row["digest"] for row in zero])

    def test_a_reset_before_the_end_ends_the_episode_as_it_stands(self):
        result = self.ask("local", self.agent("impatient_agent"), "--track", "short-arm",
                          "--profile", "myosuite")
        for row in result["episodes"]:
            self.assertEqual((row["outcome"], row["reason"]), ("failure", "given-up"), row)
        self.assertEqual([row["facts"]["steps"] for row in result["episodes"]], [3, 0, 3])

    def test_an_agent_that_samples_from_torch_repeats(self):
        agent = self.agent("sampling_agent")
        (agent / "torch").mkdir()
        shutil.copy(HERE / "template_agents/fake_torch.py", agent / "torch/__init__.py")
        first = [row["digest"] for row in self.play(agent, "short-leg", "myosuite")]
        again = [row["digest"] for row in self.play(agent, "short-leg", "myosuite")]
        self.assertEqual(first, again)
        self.assertEqual(len(set(first)), 3)

    def test_a_walking_agent_with_its_own_parameter_sets(self):
        def digests(*arguments):
            rows = self.play(self.agent("locomotion_agent", *arguments), "short-leg", "myosuite")
            return [row["digest"] for row in rows]

        soft = digests("normalized", "0.1")
        self.assertEqual(len(set(soft)), 3)
        stiff = digests("normalized", "0.5")
        self.assertNotEqual(soft, stiff, "its parameter sets make no difference")
        self.assertNotEqual(soft, digests("direct", "0.1"))


if __name__ == "__main__":
    unittest.main(verbosity=2)
