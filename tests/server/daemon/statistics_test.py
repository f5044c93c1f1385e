"""Places that are close, in the real daemon: groups, tests and intervals of a board, ranks of groups,
and further episodes on hidden seeds. The runners play without physics; a policy's name tells in how
many episodes it succeeds."""

import hashlib
import hmac
import json
import math
import signal
import sqlite3
import subprocess
import unittest

from phases_test import AS_OTHERS, TEAMS, TRACK, PhasesCase, moment, seeds
from record_test import RecordCase
from rejudge_case import Skill
from support.waiting import wait_until

EPISODES = 30
PLACED = {"alpha": 26, "beta": 22, "gamma": 5}
STATISTICS = "/v1/leaderboard/statistics?phase=final"
BOARD = "/v1/leaderboard?phase=final"


def binomial(differing, ahead):
    """The p-value of a two-sided binomial test with probability 1/2."""
    fewer = min(ahead, differing - ahead)
    tail = sum(math.comb(differing, i) for i in range(fewer + 1))
    return min(1, 2 * tail / 2 ** differing)


def wilson(successes, episodes, z=1.959963984540054):
    rate = successes / episodes
    centre = (rate + z * z / (2 * episodes)) / (1 + z * z / episodes)
    half = z / (1 + z * z / episodes) * math.sqrt(
        rate * (1 - rate) / episodes + z * z / (4 * episodes ** 2))
    return centre - half, centre + half


def derived(secret, first, count):
    """Seeds of the phase "final" by the published formula."""
    digest = lambda i: hmac.new(secret, f"myograde seeds/final/{i}".encode(), hashlib.sha256).digest()
    return [int.from_bytes(digest(i)[-8:], "big") & (2**63 - 1) for i in range(first, first + count)]


class CloseCase(PhasesCase):
    phases = {"final": {"seeds": {"committed": EPISODES}, "opens_at": moment(hours=-1)}}

    def grade(self):
        self.submissions = {team: self.played(Skill(placed).mode, team, phase="final")
                            for team, placed in PLACED.items()}

    def rows(self):
        return {row["team"]: row for row in self.get(STATISTICS)["rows"]}

    def groups(self):
        return [row["group"] for row in self.get(STATISTICS)["rows"]]

    def evaluate(self, more_seeds, *more):
        return self.ask("board", "evaluate", "--phase", "final", "--more-seeds", more_seeds, *more,
                        schema="evaluate")

    def refusal(self, *words):
        """The sentence of a request for further episodes that is refused."""
        done = self.cli("board", "evaluate", *words, check=False)
        self.assertEqual(done.returncode, 2, f"{words}\n{done.stdout}{done.stderr}")
        self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)
        return done.stderr

    def all_ended(self, answer):
        for one in answer["rejudges"]:
            wait_until(lambda one=one: self.get(f"/v1/rejudges/{one['rejudge']}"), 120,
                       "its episodes are not played", lambda shown: shown["complete"])

    def secret(self):
        with sqlite3.connect(f"file:{self.data}/store.db?mode=ro", uri=True) as store:
            return store.execute("SELECT secret FROM phase_secret WHERE phase = 'final'").fetchone()[0]

    def seeds_of(self, evaluation):
        rows = self.get(f"/v1/evaluations/{evaluation}?episodes=1")["episode_rows"]
        return [row["seed"] for row in rows]

    def evaluations_of(self, rejudge):
        with sqlite3.connect(f"file:{self.data}/store.db?mode=ro", uri=True) as store:
            return [row[0] for row in store.execute(
                "SELECT id FROM evaluation WHERE rejudge = ? ORDER BY submission",
                (rejudge,))]


class Groups(CloseCase, RecordCase):
    def setUp(self):
        super().setUp()
        self.grade()

    def test_of_a_board(self):
        answer = self.ask("leaderboard", "--phase", "final", "--statistics", schema="leaderboard")
        rows = {row["team"]: row for row in answer["rows"]}
        self.assertEqual([row["team"] for row in answer["rows"]], list(PLACED))
        self.assertEqual([row["group"] for row in answer["rows"]], [1, 1, 2])
        self.assertEqual([row["rank"] for row in answer["rows"]], [1, 2, 3])
        self.assertEqual(answer["groups"], [{"group": 1, "first": 1, "last": 2, "rows": 2},
                                            {"group": 2, "first": 3, "last": 3, "rows": 1}])
        self.assertEqual((answer["undecided"], answer["statistics"]["tests"]), (2, 3))
        self.assertIsNone(rows["alpha"]["above"])
        for team, other in (("beta", "alpha"), ("gamma", "beta")):
            test = rows[team]["above"]
            differing = PLACED[other] - PLACED[team]
            self.assertEqual((test["team"], test["metric"], test["method"]),
                             (other, "success_rate", "exact"))
            self.assertEqual((test["pairs"], test["differing"]), (EPISODES, differing))
            self.assertAlmostEqual(test["p"], binomial(differing, differing), places=12)
            self.assertAlmostEqual(test["difference"], differing / EPISODES, places=12)
        # Half of the level is kept for further looks. By Holm the largest p-value of three counts
        # once, the second one twice.
        self.assertEqual(answer["statistics"]["spending"], "halving")
        self.assertEqual([rows[team]["above"]["looks"] for team in ("beta", "gamma")], [1, 1])
        self.assertAlmostEqual(rows["beta"]["above"]["p_adjusted"], 2 * 0.125)
        self.assertAlmostEqual(rows["gamma"]["above"]["p_adjusted"], 2 * 2 * binomial(17, 17))
        self.assertEqual(rows["gamma"]["opener"]["team"], "alpha")
        for team, row in rows.items():
            interval = row["intervals"]["success_rate"]
            self.assertEqual(interval["method"], "wilson")
            for end, expected in zip(("low", "high"), wilson(PLACED[team], EPISODES)):
                self.assertAlmostEqual(interval[end], expected, places=12)
            self.assertEqual(row["intervals"]["time_s"]["method"], "normal")
            self.assertEqual((row["participant_faults"], row["further_episodes"]), (0, 0))

    def test_what_people_read(self):
        text = self.cli("leaderboard", "--phase", "final", "--statistics").stdout
        for words in ("Statistics of demo-manipulation", "group", "faults", "0.2500",
                      "2 places share a group", "at the level 0.05"):
            self.assertIn(words, text)
        self.assertNotIn("group", self.cli("leaderboard", "--phase", "final").stdout)
        done = self.cli("leaderboard", "--statistics", check=False)
        self.assertEqual(done.returncode, 2)
        self.assertIn("--phase", done.stderr)

    def test_faults_and_untested_places_are_shown_too(self):
        self.hold(final={**self.phases["final"], "statistics": {"places": 2}})
        rows = self.rows()
        self.assertEqual([rows[team]["group"] for team in PLACED], [1, 1, None])
        self.assertIsNone(rows["gamma"]["above"])
        self.assertAlmostEqual(rows["gamma"]["intervals"]["success_rate"]["value"], 5 / EPISODES)

    def test_ranks_of_groups_where_a_phase_wants_them(self):
        before = self.get(BOARD)
        self.assertEqual(before["ranks"], "rules")
        self.hold(final={**self.phases["final"], "statistics": {"ranks": "groups"}})
        board = self.board_of("final")
        self.assertEqual(board["ranks"], "groups")
        self.assertEqual([row["rank"] for row in board["rows"]], [1, 1, 3])
        self.assertEqual([row["rank_by_rules"] for row in board["rows"]], [1, 2, 3])
        self.assertEqual([row["rank"] for row in self.get(STATISTICS)["rows"]], [1, 1, 3])
        self.assertEqual(board["config"], before["config"], "no result depends on it")
        # The record has what follows from the rules.
        answer = self.verify(self.exported())
        self.assertTrue(answer["valid"], answer["checks"])

    def test_of_the_board_of_a_moment(self):
        at = moment()
        self.played(Skill(29).mode, "delta", phase="final")
        self.assertEqual(len(self.rows()), 4)
        then = self.get(f"{STATISTICS}&at={at}")
        self.assertEqual([row["team"] for row in then["rows"]], list(PLACED))
        self.assertEqual([row["group"] for row in then["rows"]], [1, 1, 2])

    def test_figures_are_of_the_same_numbers(self):
        alpha, beta = (self.submissions[team] for team in ("alpha", "beta"))
        paired = self.ask("plot", "paired", alpha, beta, schema="plot")["numbers"]
        self.assertEqual(paired["pairs"], EPISODES)
        success = paired["metrics"][0]
        self.assertAlmostEqual(success["p"], binomial(4, 4), places=12)
        self.assertAlmostEqual(success["difference"], 4 / EPISODES, places=12)
        report = self.ask("report", "--phase", "final", schema="report")["numbers"]
        self.assertEqual([(row["rank"], row["team"], row["group"]) for row in report["ranking"]],
                         [(1, "alpha", 1), (2, "beta", 1), (3, "gamma", 2)])
        self.assertEqual(report["ranking"][0]["numbers"]["success_rate"]["low"],
                         self.rows()["alpha"]["intervals"]["success_rate"]["low"])
        history = self.ask("plot", "board", "--phase", "final", schema="plot")["numbers"]
        self.assertEqual({team["team"]: team["values"][-1] for team in history["teams"]},
                         {team: placed / EPISODES for team, placed in PLACED.items()})
        # Teams came one after the other.
        self.assertEqual(len({team["values"].count(None) for team in history["teams"]}), 3)
        for kind in ("distributions", "survival"):
            self.ask("plot", kind, alpha, schema="plot")
        one = self.ask("report", alpha, schema="report")["numbers"]
        self.assertEqual(one["headline"]["success"]["part"], PLACED["alpha"])

    @AS_OTHERS
    def test_figures_show_nobody_more_than_the_api_does(self):
        def drawn_by(uid, *words):
            return subprocess.run([self.daemon.programs / "myograde", *map(str, words), "--json",
                                   "--socket", self.daemon.socket], user=uid, group=uid,
                                  extra_groups=[], env={**self.daemon.environment, "HOME": "/"},
                                  capture_output=True, text=True, timeout=60, check=False)
        done = drawn_by(TEAMS["alpha"], "report", "--phase", "final")
        self.assertEqual(done.returncode, 0, done.stderr)
        numbers = json.loads(done.stdout)["numbers"]
        self.assertEqual(len(numbers["ranking"]), 3)
        self.assertEqual([row["team"] for row in numbers["records"]["rows"]], ["alpha"])
        self.assertTrue(any("2 submissions are not shown" in one for one in numbers["missing"]))
        for words in (("plot", "survival", self.submissions["beta"]),
                      ("report", self.submissions["beta"]),
                      ("plot", "paired", self.submissions["alpha"], self.submissions["beta"])):
            done = drawn_by(TEAMS["alpha"], *words)
            self.assertEqual((done.returncode, done.stdout), (2, ""), words)
            self.assertIn("no submission", done.stderr)

    @AS_OTHERS
    def test_of_a_frozen_board(self):
        self.hold(final={**self.phases["final"], "freeze_at": moment(minutes=-30)})
        self.assertEqual(len(self.get(STATISTICS)["rows"]), 3)
        status, seen = self.call("GET", STATISTICS, uid=TEAMS["alpha"])
        self.assertEqual((status, seen["rows"], seen["complete"]), (200, [], False))


class Further(CloseCase):
    def setUp(self):
        super().setUp()
        self.grade()

    def test_further_episodes_decide_and_change_no_rank(self):
        board = self.get(BOARD)
        answer = self.evaluate(60)
        self.assertEqual([(one["submissions"], one["episodes"]) for one in answer["rejudges"]],
                         [([self.submissions["alpha"], self.submissions["beta"]], 60)])
        self.all_ended(answer)
        self.assertEqual(self.groups(), [1, 2, 3])
        rows = self.rows()
        self.assertEqual([rows[team]["further_episodes"] for team in PLACED], [60, 60, 0])
        self.assertEqual((rows["beta"]["above"]["pairs"], rows["beta"]["above"]["differing"]),
                         (EPISODES + 60, 8))
        self.assertEqual(rows["gamma"]["above"]["pairs"], EPISODES)
        self.assertEqual([rows[team]["above"]["looks"] for team in ("beta", "gamma")], [2, 1])
        self.assertAlmostEqual(rows["beta"]["above"]["p_adjusted"], 4 * binomial(8, 8))
        self.assertEqual(self.get(BOARD), board)
        self.assertIn("further", self.cli("leaderboard", "--phase", "final", "--statistics").stdout)
        self.assertIn("share a group", self.refusal("--phase", "final", "--more-seeds", 60))
        # Their seeds follow the phase's own.
        evaluations = self.evaluations_of(answer["rejudges"][0]["rejudge"])
        for evaluation in evaluations:
            self.assertEqual(self.seeds_of(evaluation), derived(self.secret(), EPISODES, 60))
        self.assertEqual(answer["commitment"],
                         hashlib.sha256(self.secret().hex().encode()).hexdigest())

    def test_only_what_is_missing_is_played(self):
        self.all_ended(self.evaluate(10))
        self.assertIn("already", self.refusal("--phase", "final", "--more-seeds", 10))
        answer = self.evaluate(12, "--places", "1..3", "--reason", "the podium")
        played = {tuple(one["submissions"]): one["episodes"] for one in answer["rejudges"]}
        self.assertEqual(played, {(self.submissions["alpha"], self.submissions["beta"]): 2,
                                  (self.submissions["gamma"],): 12})
        self.all_ended(answer)
        self.assertEqual({row["further_episodes"] for row in self.rows().values()}, {12})
        looks = [self.rows()[team]["above"]["looks"] for team in ("beta", "gamma")]
        self.assertEqual(looks, [3, 3], "at 10 and at 12 further episodes")
        self.stop(signal.SIGKILL)
        self.start()
        self.assertEqual({row["further_episodes"] for row in self.rows().values()}, {12})

    def test_those_that_cant_be_read_are_left_out_and_stop_nothing(self):
        answer = self.evaluate(10)
        self.all_ended(answer)
        number = answer["rejudges"][0]["rejudge"]
        evaluation = self.evaluations_of(number)[0]
        with sqlite3.connect(self.data / "store.db", timeout=20) as store:
            triggers = store.execute("SELECT name FROM sqlite_schema WHERE type = 'trigger' AND "
                                     "tbl_name = 'evaluation'").fetchall()
            for (name,) in triggers:
                store.execute(f"DROP TRIGGER {name}")
            store.execute("UPDATE evaluation SET reason = CAST(x'ff' AS TEXT) WHERE id = ?", (evaluation,))
        store.close()
        self.assertEqual({row["further_episodes"] for row in self.rows().values()}, {0})
        self.assertEqual(self.get("/v1/rejudges")["rejudges"], [])
        self.assertEqual(self.call("GET", f"/v1/rejudges/{number}")[0], 500)
        self.assertIn(f"evaluation {evaluation} of the store can't be read", self.daemon.log())

    def test_a_drop_takes_them_out(self):
        answer = self.evaluate(60)
        self.all_ended(answer)
        number = answer["rejudges"][0]["rejudge"]
        done = self.cli("board", "rejudge", "apply", number, "--reason", "r", check=False)
        self.assertEqual(done.returncode, 2)
        self.cli("board", "rejudge", "drop", number, "--reason", "played under a wrong name")
        self.assertEqual(self.groups(), [1, 1, 2])

    @AS_OTHERS
    def test_participants_see_them_once_the_seeds_are_revealed(self):
        answer = self.evaluate(60)
        self.all_ended(answer)
        evaluation = self.evaluations_of(answer["rejudges"][0]["rejudge"])[0]
        path = f"/v1/evaluations/{evaluation}?episodes=1"
        self.assertEqual(self.call("GET", path, uid=TEAMS["alpha"])[0], 404)
        status, body = self.call("POST", "/v1/phases/final/more-seeds",
                                 {"episodes": 90, "reason": "r"}, uid=TEAMS["alpha"])
        self.assertEqual(status, 403, body)
        texts = json.dumps([self.call("GET", address, uid=TEAMS["alpha"])[1] for address in (
            STATISTICS, BOARD, f"/v1/submissions/{self.submissions['alpha']}",
            f"/v1/submissions/{self.submissions['alpha']}/result?episodes=1", "/v1/challenges")])
        for seed in derived(self.secret(), 0, EPISODES + 60):
            self.assertNotIn(str(seed), texts)
        self.hold(final={**self.phases["final"], "closes_at": moment(minutes=-1)})
        status, revealed = self.call("POST", "/v1/phases/final/reveal", {"reason": "over"})
        self.assertEqual(status, 200, revealed)
        self.assertEqual(revealed["seeds"] + revealed["further_seeds"],
                         derived(self.secret(), 0, EPISODES + 60))
        status, seen = self.call("GET", path, uid=TEAMS["alpha"])
        self.assertEqual(status, 200, seen)
        self.assertEqual([row["seed"] for row in seen["episode_rows"]], revealed["further_seeds"])


class OfPublicSeeds(CloseCase):
    phases = {"final": {"seeds": seeds(5000, EPISODES), "opens_at": moment(hours=-1)}}

    def test_further_seeds_are_secret_all_the_same(self):
        self.grade()
        answer = self.evaluate(60)
        self.all_ended(answer)
        self.assertEqual(self.groups(), [1, 2, 3])
        evaluation = self.evaluations_of(answer["rejudges"][0]["rejudge"])[0]
        self.assertEqual(self.seeds_of(evaluation), derived(self.secret(), EPISODES, 60))
        self.assertEqual(self.call("POST", "/v1/phases/final/reveal", {"reason": "early"})[0], 409)
        self.hold(final={**self.phases["final"], "closes_at": moment(minutes=-1)})
        status, revealed = self.call("POST", "/v1/phases/final/reveal", {"reason": "over"})
        self.assertEqual((status, revealed["further_seeds"]),
                         (200, derived(self.secret(), EPISODES, 60)))


class BadInput(CloseCase):
    def test_requests_that_make_no_sense(self):
        self.assertIn("share a group", self.refusal("--phase", "final", "--more-seeds", 5))
        self.grade()
        for words, said in (
                (("--phase", "final"), "--more-seeds"),
                (("--more-seeds", 5), "--phase"),
                (("--phase", "none", "--more-seeds", 5), "none"),
                (("--phase", "final", "--more-seeds", 0), "episodes"),
                (("--phase", "final", "--more-seeds", 10_000), "episodes"),
                (("--phase", "final", "--more-seeds", 5, "--places", "2"), "2..4"),
                (("--phase", "final", "--more-seeds", 5, "--places", "3..2"), "2..4"),
                (("--phase", "final", "--more-seeds", 5, "--places", "7..9"), "0 rows"),
                (("--phase", "final", "--more-seeds", 5, "--board", "none"), "none"),
                (("--phase", "final", "--more-seeds", 5, "--reason", "x" * 201), "reason")):
            with self.subTest(words=words):
                self.assertIn(said, self.refusal(*words))
        for body in ({}, {"episodes": 5}, {"episodes": "5", "reason": "r"},
                     {"episodes": 5, "reason": "r", "places": [1]},
                     {"episodes": 5, "reason": "r", "places": [1, 10**20]},
                     {"episodes": 5, "reason": "r", "colour": 1}):
            with self.subTest(body=body):
                status, answer = self.call("POST", "/v1/phases/final/more-seeds", body)
                self.assertEqual((status, answer["error"]["code"]), (400, "bad_request"), answer)
        self.assertEqual(self.get("/v1/rejudges")["rejudges"], [])

    def test_settings_that_could_decide_nothing(self):
        self.stop(signal.SIGTERM)
        self.configure(statistics={"places": 50})
        done = self.daemon.run_verb("serve", "--data", self.data, "--configs", self.configs,
                                    timeout_s=60, text=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("24500", done.stderr)
        self.assertIn("statistics", done.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
