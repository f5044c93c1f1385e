"""What the bundled policies promise, on the real tracks. Minutes long: label slow."""

import statistics
import unittest

from system import POLICIES, SystemTest

EPISODES = 20


class BundledPolicies(SystemTest):
    def play(self, policy, track, episodes):
        result = self.ask("local", POLICIES / policy, "--track", track, "--episodes", episodes)
        return result["episodes"]

    def test_reaching_brings_the_hand_near(self):
        def distance(policy):
            rows = self.play(policy, "manipulation", EPISODES)
            return statistics.mean(
                row["facts"]["manipulation"]["final_hand_distance"] for row in rows)

        self.assertLessEqual(distance("scripted-manipulation"), 0.5 * distance("zero"))

    def test_standing_lasts_twice_as_long(self):
        def steps(policy):
            return statistics.mean(
                row["steps"] for row in self.play(policy, "locomotion", EPISODES))

        self.assertGreaterEqual(steps("scripted-locomotion"), 2.0 * steps("zero"))


class HundredEpisodes(SystemTest):
    """The random policy over the full seed lists, twice."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.start_daemon()

    def test_full_evaluations_differ_within_and_repeat_without(self):
        for track in ("manipulation", "locomotion"):
            with self.subTest(track=track):
                first = self.ask("submit", POLICIES / "random", "--track", track,
                                 "--team", "Random", "--wait")
                rows = self.ask("show", first["submission"], "--episodes")["episode_rows"]
                self.assertEqual(len(rows), 100)
                self.assertEqual(len({row["digest"] for row in rows}), 100)
                again = self.ask("rerun", first["submission"], "--wait")
                self.assertEqual(again["comparison"]["equal"], 100)
                board = self.ask("leaderboard", "--track", track)
                self.assertEqual(board["rows"][0]["team"], "Random")


if __name__ == "__main__":
    unittest.main(verbosity=2)
