"""How results count, end and sort, as the Python client says to organisers and to sites that show them elsewhere."""

import unittest
import unittest.mock

from connect_support import LONG_S, TRACK, WithChallenge
from myograde.client import Client, ServerError, WrongUse, band_openers, packed_score
from myograde.client import client as implementation
from support.submission import played_by_stand_in as manifest
from support.waiting import wait_until

TIERED = {"line_successes": 90, "line_episodes": 100, "bands": "time", "band_factor": 1.1, "ties": "time"}
DISTANCE = {"time_from_m": 20, "distance_band": 0}


def result(successes=0, time_s=None, effort=None, distance_m=None, **more):
    return {"episodes": 100, "successes": successes, "success_rate": successes / 100, "time_s": time_s,
            "effort": effort, "distance_m": distance_m, "spread": {}, **more}


def board_of(rules, *bands):
    """A board with the results of the first band, of the second and so on."""
    return {"rules": rules, "rows": [{"band": place + 1, "aggregate": aggregate}
                                     for place, band in enumerate(bands) for aggregate in band]}


class Scores(unittest.TestCase):
    def assert_falls(self, board, results):
        scores = [packed_score(board, one) for one in results]
        self.assertEqual(scores, sorted(set(scores), reverse=True))

    def test_tiers(self):
        below = [result(89, 3.0, 0.1), result(89, 3.1, 0.01), result(89, 3.1, 0.02), result(89, None, 0.02),
                 result(12, 9.9, 0.5), result(0, 10, 0.5), result(0, 10, None)]
        self.assert_falls(board_of(TIERED, [result(99, 2.0, 0.02)]), [
            result(90, 2.19, 0.01), result(99, 2.0, 0.02), result(100, 2.2, 0.03), result(90, 2.21, 0.01),
            result(90, 9.0, 0.01), *below])
        # A result that is not on the board, and in none of its bands, has its own.
        empty = board_of(TIERED)
        self.assertLess(packed_score(empty, result(90, 2.2, 0.01)), packed_score(empty, result(90, 2.0, 0.03)))
        self.assert_falls(board_of({**TIERED, "ties": "acceptance"}), [result(50), result(49)])
        by_success = board_of({**TIERED, "bands": "success"}, [result(100, 1, 0.02)])
        self.assert_falls(by_success, [result(91, 1, 0.01), result(100, 1, 0.02), result(90, 1, 0.001)])

    def test_distances(self):
        board = board_of(DISTANCE)
        self.assert_falls(board, [result(distance_m=43.5, time_s=30), result(distance_m=20.5, time_s=10),
                                  result(distance_m=20.5, time_s=11), result(distance_m=19.0, time_s=1)])
        self.assertEqual(packed_score(board, result(distance_m=3, time_s=1)),
                         packed_score(board, result(distance_m=3, time_s=2)))
        results = [result(distance_m=39, time_s=20), result(distance_m=40, time_s=30), result(distance_m=30, time_s=1),
                   result(distance_m=19.5, time_s=1)]
        self.assert_falls(board_of({**DISTANCE, "distance_band": 0.05}, results[:2]), results)
        self.assert_falls(board_of({"qualify_m": 20, "means": "steps"}), [
            result(distance_m=20, pain_over_steps=of, effort_over_steps=effort)
            for of, effort in ((0.1, 0.5), (0.2, 0.1), (0.2, 0.2))] + [result(distance_m=19)])

    def test_boards_without_rules_go_by_the_mean_score(self):
        results = [{"score": score, "effort": effort} for score, effort in ((1, 0.5), (0.87, 0.1), (0.87, 0.2), (0, 0.1))]
        self.assert_falls(board_of(None, results), results)
        self.assertEqual(band_openers(board_of(None, results)), [])

    def test_bands_are_those_of_the_board(self):
        times = [1.0, 1.7, 1.9, 2.0, 2.3, 2.6, 3.0, 3.4, 20.0, 2000.0]
        self.assert_falls(board_of(TIERED, [result(90, 2.0)], [result(90, 3.0)]),
                          [result(90, time_s, 0.1) for time_s in times])
        board = board_of(TIERED, [result(90, 2.2), result(90, 2.0)], [result(90, 2.21)], [result(90, 9)])
        board["rows"] += [{"band": None, "aggregate": result(90, 1)}, {"band": 0, "aggregate": result(20, 0.5)}]
        self.assertEqual(band_openers(board), [2.0, 2.21, 9])
        self.assertEqual(band_openers(board_of({"qualify_m": 20, "means": "steps"}, [result(distance_m=30)])), [])


class Organisers(WithChallenge):
    def graded(self, team, mode="ok", phase="warm-up", until="done"):
        number = self.submitted(team, mode, phase)
        self.assertEqual(self.client.wait(number, timeout_s=LONG_S)["state"], until)
        return number

    def submitted(self, team, mode, phase="warm-up"):
        path = self.daemon.root / f"{team} {mode[:20]}.tar"
        path.write_bytes(manifest(mode, path.name))
        return self.client.submit(path, team=team, phase=phase)["submission"]

    def test_a_team_is_made_once_and_under_nobody_elses_name(self):
        self.client.ask("/v1/teams", {"team": "local", "reason": "ours"})
        for _ in range(2):
            made = self.client.make_team("local", "\u202eevil", "l\u043ecal", "local (7)", "local 7", reason="number 7")
            self.assertEqual((made["team"], made["events"][0]["reason"]), ("local (7)", "number 7"))
        self.client.ask("/v1/teams/local%20(7)/rename", {"name": "visitors", "reason": "asked to"})
        self.assertEqual(self.client.team("local (7)")["team"], "visitors")
        self.assertEqual(self.client.make_team("local (7)", reason="number 7")["team"], "visitors")
        with self.assertRaises(ServerError) as refused:
            self.client.make_team("local", reason="number 8")
        self.assertEqual(refused.exception.code, "conflict")
        with self.assertRaisesRegex(WrongUse, "at least one name"):
            self.client.make_team(reason="number 9")

    def test_marks_and_bans_keep_a_submission_off_boards(self):
        number = self.graded("marked")
        size, _ = self.client.changed_since(None)
        self.assertEqual(self.client.changed_since(size), (size, set()))
        self.client.mark(number, "baseline", reason="ours")
        self.assertEqual(self.client.kept_off(number), [])
        self.client.mark(number, "disqualified", reason="reads seeds")
        self.assertEqual(self.client.kept_off(number), ["disqualified by the organisers: reads seeds"])
        ended = self.client.ending(number)
        self.assertEqual((ended["kind"], ended["why"], ended["result"]["state"]),
                         ("cancelled", "disqualified by the organisers: reads seeds", "done"))
        self.assertEqual(self.client.changed_since(size)[1], {number})
        self.client.mark(number, "disqualified", hold=False)
        self.client.ask("/v1/teams/marked/ban", {"banned": True, "reason": "two accounts"})
        self.assertEqual(self.client.kept_off(number), ["the organisers have banned the team: two accounts"])
        self.assertIsNone(self.client.changed_since(size)[1])
        with unittest.mock.patch.object(implementation, "PAGE", 2):
            entries = [entry["index"] for entry in self.client.record(1)]
        self.assertEqual(entries, list(range(1, self.client.changed_since(size)[0])))

    def test_how_submissions_end(self):
        number = self.submitted("ends", "slow")
        self.assertIsNone(self.client.ending(number))
        self.client.wait(number, timeout_s=LONG_S)
        ended = self.client.ending(number)
        self.assertEqual((ended["kind"], ended["why"], ended["result"]["submission"]), ("finished", "", number))
        self.assertEqual(ended["words"], [f"MyoGrade's submission {number} is finished (done): 10 of 10 episodes were "
                                          "played.", "failure: 5, success: 5"])
        self.assertRegex(ended["stderr"], "^\nepisodes 0 to 1:\nhello from the policy")
        said = "no way"
        failed = self.client.ending(self.graded("ends", f"says-{said.encode().hex()}", until="failed"))
        self.assertEqual((failed["kind"], failed["words"][1]), ("failed", failed["why"]))
        self.assertIn(said, failed["stdout"] + failed["stderr"])
        withheld = [{**phase, "show.output": False, "show.outcomes": False} for phase in self.client.phases()]
        with unittest.mock.patch.object(self.client, "phases", lambda: withheld):
            ended = self.client.ending(number)
        self.assertEqual((ended["shown"], ended["stdout"], ended["stderr"], len(ended["words"])),
                         ({"aggregate": True, "outcomes": False, "output": False}, "", "", 1))

    def test_what_is_withdrawn_is_cancelled_or_hidden(self):
        numbers = [self.submitted("withdraws", f"slow {place}") for place in range(4)]
        self.client.withdraw(numbers[3], "a mistake")  # the others are before it
        self.assertEqual(self.client.wait(numbers[3], timeout_s=LONG_S)["state"], "cancelled")
        self.client.wait(numbers[0], timeout_s=LONG_S)
        self.client.withdraw(numbers[0], "a mistake")
        self.assertEqual(self.client.kept_off(numbers[0]), ["hidden by the organisers: a mistake"])
        self.assertEqual(self.client.status(numbers[0])["state"], "done")

    def test_the_result_that_counts_is_that_of_the_rejudge_in_force(self):
        number = self.graded("rejudged", "skill-2-7-10-1", "final")
        rejudge = self.client.ask("/v1/rejudges", {"phase": "final", "reason": "longer", "config": {
            "extends": TRACK, "rules": {"max_time_s": 20}}})["rejudge"]
        wait_until(lambda: self.client.ask(f"/v1/rejudges/{rejudge}")["complete"], LONG_S, "not played again")
        self.assertEqual(self.client.counting_result(number)["aggregate"]["success_rate"], 0.2)
        size, _ = self.client.changed_since(None)
        for act, rate in (("apply", 0.7), ("drop", 0.2)):
            self.client.ask(f"/v1/rejudges/{rejudge}/{act}", {"reason": "as announced"})
            self.assertEqual(self.client.counting_result(number)["aggregate"]["success_rate"], rate)
            changed = self.client.changed_since(size)
            self.assertIsNone(changed[1])
            size = changed[0]

    def test_where_packed_scores_sort_otherwise(self):
        for team, mode in (("first", "skill-10-0-10-1"), ("earlier", "skill-4-0-10-1")):
            self.graded(team, mode, "final")
        self.assertEqual(self.client.out_of_order(self.client.board(phase="final")), [])
        self.graded("newer", "skill-4-0-10-1", "final")
        board = self.client.board(phase="final")
        self.assertEqual(self.client.out_of_order(board), [("earlier", "newer", True)])
        self.assertEqual([row["team"] for row in board["rows"]],
                         [row["team"] for row in self.client.leaderboard(phase="final")])
        with self.assertRaisesRegex(WrongUse, "the track or the phase"):
            self.client.board()

    def test_pages_and_roles(self):
        self.assertEqual(self.client.page_of(7), "")
        self.assertEqual(self.client.page_of(7, "https://x.org/"), "https://x.org/submission?id=7")
        self.assertEqual(Client("https://y.org").page_of(7), "https://y.org/submission?id=7")
        self.client.require_organiser()
        self.client.ask("/v1/teams", {"team": "member"})
        token = self.client.ask("/v1/tokens", {"role": "participant", "team": "member", "label": "x"})["token"]
        with self.assertRaisesRegex(WrongUse, "takes this for a participant, .* organiser's token"):
            Client(socket=self.daemon.socket_path, token=token).require_organiser()


if __name__ == "__main__":
    unittest.main(verbosity=2)
