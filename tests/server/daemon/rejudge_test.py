"""Rejudges in the real daemon: a board under other rules, beside the live one, until it is applied or
dropped. The runners play without physics; how well a policy does is in its name."""

import json
import shutil
import signal
import time
import unittest

from daemon_test import FINAL
from phases_test import AS_OTHERS, TEAMS, TRACK, moment, seeds
from rejudge_case import EPISODES, RejudgeCase, Skill, expected_order, shifted

LOW_FORCE = 500  # N
SKILLS = [("alpha", Skill(5, otherwise=1, force=900)), ("beta", Skill(4, otherwise=3)),
          ("gamma", Skill(4, otherwise=5, effort=2))]
OLD, NEW = ["alpha", "beta", "gamma"], ["beta", "gamma", "alpha"]
PLAYED = {"extends": TRACK, "rules": {"max_time_s": 20}}


class Graded(RejudgeCase):
    """Three teams have a submission each."""

    def setUp(self):
        super().setUp()
        self.submissions = {team: self.played(skill.mode, team, **self.more)
                            for team, skill in SKILLS}

    more = {}

    def expected(self, **how):
        return expected_order(SKILLS, EPISODES, line=90, factor=1.1, **how)

    def force_rule(self):
        return self.scoring(force_limit_n=LOW_FORCE)


class FromFacts(Graded):
    def test_what_scoring_changes_is_computed_from_facts(self):
        live = self.text(self.board_path)
        self.assertEqual(self.order(), OLD)
        self.assertEqual(self.expected(), OLD)
        rejudge = self.create(self.force_rule())
        self.assertEqual(self.text(self.board_path), live, "the live board is as it was")
        self.assertEqual((rejudge["state"], rejudge["complete"]), ("ready", True))
        self.assertEqual(rejudge["items"], {"total": 3, "ended": 3, "facts": 3, "play": 0})
        self.assertEqual(rejudge["differs"], ["/scoring/force_limit_n"])
        self.assertEqual(self.ranks(rejudge["rejudge"]),
                         {"alpha": (1, 3), "beta": (2, 1), "gamma": (3, 2)})
        row = rejudge["boards"][0]["rows"][-1]
        self.assertEqual((row["team"], row["before"]["aggregate"]["successes"],
                          row["after"]["aggregate"]["successes"]), ("alpha", 5, 0))
        self.assertEqual(self.act("apply", rejudge["rejudge"])["state"], "applied")
        self.assertEqual(self.order(), self.expected(limit=LOW_FORCE))
        self.assertEqual(self.order(), NEW)
        board = self.get(self.board_path)
        self.assertEqual(board["config"], rejudge["to_config"])
        self.assertEqual({row["rejudge"] for row in board["rows"]}, {rejudge["rejudge"]})
        facts = [[row["facts"] for row in self.get(
            f"/v1/evaluations/{number}?episodes=1")["episode_rows"]]
                 for number in (self.submissions["alpha"], board["rows"][-1]["evaluation"])]
        self.assertEqual(facts[0], facts[1], "what was recorded is what was judged")

    def test_apply_drop_apply_and_the_board_of_each_moment(self):
        old = self.text(self.board_path)
        rejudge = self.create(self.force_rule())["rejudge"]
        acts = []
        for verb, state, order in (("apply", "applied", NEW), ("drop", "dropped", OLD),
                                   ("apply", "applied", NEW)):
            shown = self.act(verb, rejudge)
            self.assertEqual(shown["state"], state)
            self.assertEqual(self.order(), order, f"after {verb}")
            self.restart()
            self.assertEqual(self.order(), order, f"after {verb} and a restart")
            if verb == "drop":
                self.assertEqual(json.loads(self.text(self.board_path))["rows"],
                                 json.loads(old)["rows"])
            acts.append((shown["events"][-1]["at"], order))
        shown = self.show(rejudge)
        self.assertEqual(self.check_signatures(shown),
                         ["created", "applied", "dropped", "applied"])
        before = OLD
        for at, order in acts:
            self.assertEqual(self.order(f"{self.board_path}&at={shifted(at, -5)}"), before)
            self.assertEqual(self.order(f"{self.board_path}&at={shifted(at, 5)}"), order)
            before = order
        for config, order in ((shown["from_config"], OLD), (shown["to_config"], NEW)):
            for text in (config, config[:10]):
                self.assertEqual(self.order(f"{self.board_path}&config={text}"), order)
        self.assertEqual(self.ranks(rejudge), {"alpha": (1, 3), "beta": (2, 1), "gamma": (3, 2)})

    def test_an_application_names_the_results_that_count(self):
        rejudge = self.create(self.force_rule())["rejudge"]
        document = self.act("apply", rejudge)["events"][-1]["document"]
        for result in document["results"]:
            evaluation = self.get(f"/v1/evaluations/{result['evaluation']}")
            self.assertEqual(evaluation["submission"], result["submission"])
            self.assertEqual(evaluation["hashes"]["results"], result["results"])
        self.assertEqual([one["submission"] for one in document["results"]],
                         sorted(self.submissions.values()))

    def test_what_people_read(self):
        created = self.cli("board", "rejudge", "create", "--track", TRACK, "--config", self.force_rule(),
                           "--reason", "softer", "--wait").stdout
        for words in ("Rejudge 1 of track demo-manipulation, profile paper is ready",
                      "3 of 3 results; from facts 3, played 0", "Board main: 3 changes",
                      "1 → 3", "down 2", "The live board is unchanged."):
            self.assertIn(words, created)
        self.assertIn("now has the results of rejudge 1",
                      self.cli("board", "rejudge", "apply", 1, "--reason", "as announced").stdout)
        listed = self.cli("board", "rejudge", "list").stdout
        self.assertIn("applied", listed)
        listed = self.ask("board", "rejudge", "list", schema="rejudges")["rejudges"]
        self.assertEqual([(one["rejudge"], one["state"]) for one in listed], [(1, "applied")])

    def test_new_submissions_are_graded_by_the_new_rules(self):
        rejudge = self.create(self.force_rule())
        self.act("apply", rejudge["rejudge"])
        late = self.played(Skill(5, force=700).mode, "delta")
        self.assertEqual(self.result(late)["hashes"]["config"], rejudge["to_config"])
        self.assertEqual(self.order(), [*NEW, "delta"])
        dropped = self.act("drop", rejudge["rejudge"])
        self.assertEqual(dropped["accepted_under_to_config"], 1)
        self.assertEqual(self.order(), OLD)
        self.assertEqual(self.result(late)["hashes"]["config"], rejudge["to_config"])


class Followed(Graded):
    def test_what_ends_later_is_judged_too(self):
        late = self.submit("slow", team="delta")
        rejudge = self.create(self.force_rule())["rejudge"]
        self.assertEqual(self.ended(late)["state"], "done")
        shown = self.wait(f"/v1/rejudges/{rejudge}", lambda one: one["items"]["ended"] == 4)
        self.assertEqual(shown["state"], "ready")
        running = self.submit("slow", team="epsilon")
        self.act("apply", rejudge)
        self.assertEqual(self.ended(running)["state"], "done")
        self.wait(self.board_path, lambda board: len(board["rows"]) == 5)
        self.assertEqual(sorted(self.order()), ["alpha", "beta", "delta", "epsilon", "gamma"])


class PlayedAgain(Graded):
    def test_other_rules_of_the_environment_are_played(self):
        live = self.text(self.board_path)
        rejudge = self.create(self.file(PLAYED))
        self.assertEqual(rejudge["items"], {"total": 3, "ended": 3, "facts": 0, "play": 3})
        self.assertEqual(self.text(self.board_path), live)
        expected = self.expected(rules=False)
        self.assertEqual(expected, ["gamma", "beta", "alpha"])
        self.assertEqual([row["team"] for row in rejudge["boards"][0]["rows"]], expected)
        self.act("apply", rejudge["rejudge"])
        self.assertEqual(self.order(), expected)
        self.act("drop", rejudge["rejudge"])
        self.assertEqual(self.order(), OLD)

    def test_another_build_of_the_grader_is_played(self):
        self.assertEqual(self.create(self.force_rule())["items"]["facts"], 3)
        self.use_build("two")
        rejudge = self.create(self.scoring(force_limit_n=LOW_FORCE, full_time_s=20))
        self.assertEqual((rejudge["items"]["facts"], rejudge["items"]["play"]), (0, 3))
        same = self.create()
        self.assertEqual((same["differs"], same["from_config"]), ([], same["to_config"]))
        self.assertEqual(same["items"]["play"], 3)
        builds = self.get(self.board_path)["builds"]
        self.act("apply", same["rejudge"])
        self.assertEqual(self.order(), OLD)
        after = self.get(self.board_path)["builds"]
        self.assertNotEqual(builds, after)
        self.assertEqual([one["rows"] for one in after], [3])

    def test_live_submissions_go_first(self):
        for team in ("delta", "epsilon", "zeta"):
            self.played("slow", team)
        rejudge = self.create(self.file(PLAYED), "--repeat", 5, wait=False)["rejudge"]
        self.wait("/v1/health", lambda health: len(health["leases"]) == self.slots)
        live = self.submit("ok", team="omega")
        self.assertEqual(self.ended(live)["state"], "done")
        shown = self.get(f"/v1/rejudges/{rejudge}")
        self.assertEqual(shown["state"], "computing", "there was much left to play")
        self.assertEqual(shown["without_result"], [])
        dropped = self.act("drop", rejudge)
        self.assertEqual(dropped["state"], "dropped")
        self.wait("/v1/health", lambda health: not health["leases"])
        self.assertIn("can't be applied again", self.fails("apply", rejudge, "--reason", "r"))

    def test_repetitions_tell_which_policies_are_not_repeatable(self):
        odd = self.played("unrepeatable", "delta")
        rejudge = self.create(None, "--repeat", 2)
        self.assertEqual(rejudge["items"]["play"], 8)
        self.assertEqual([(one["submission"], one["team"]) for one in rejudge["not_repeatable"]],
                         [(odd, "delta")])
        episodes = rejudge["not_repeatable"][0]["episodes"]
        self.assertEqual([one["index"] for one in episodes], list(range(EPISODES)))
        self.assertEqual({tuple(one["differs"]) for one in episodes}, {("digest",)})

    def test_one_without_its_files_is_left_out_by_name_only(self):
        gone = self.submissions["beta"]
        artefact = self.result(gone)["hashes"]["artefact"]
        shutil.rmtree(self.data / "artefacts" / artefact)
        rejudge = self.create(self.file(PLAYED), wait=False)
        self.assertEqual(rejudge["plan"]["without_files"], [gone])
        number = rejudge["rejudge"]
        self.computed(number)
        self.assertEqual(self.cli("board", "rejudge", "show", number, "--wait", check=False).returncode, 1)
        shown = self.show(number)
        self.assertEqual([(one["submission"], one["state"]) for one in shown["without_result"]],
                         [(gone, "grader_error")])
        live = self.text(self.board_path)
        for more in ((), ("--without", "1"), ("--without", f"1,{gone}")):
            self.assertIn(str(gone), self.fails("apply", number, "--reason", "r", *more))
        self.assertEqual(self.text(self.board_path), live)
        self.act("apply", number, "--without", gone)
        self.assertEqual(self.order(), ["gamma", "alpha"])


class OfAPhase(Graded):
    phases = {"final": {"seeds": {"committed": EPISODES}, "entry": "last",
                        "opens_at": moment(hours=-1)}}
    board_path = "/v1/leaderboard?phase=final"
    more = {"phase": "final"}
    board = ("--phase", "final")

    def setUp(self):
        super().setUp()

    def as_team(self, path, team="alpha"):
        status, body = self.call("GET", path, uid=TEAMS[team])
        return status, json.dumps(body)

    @AS_OTHERS
    def test_its_seeds_stay_secret_and_nobody_sees_what_is_not_applied(self):
        before = self.get("/v1/challenges")
        seen = self.as_team(self.board_path)
        rejudge = self.create(self.force_rule(), board=self.board)
        self.assertEqual(rejudge["differs"], ["/scoring/force_limit_n"])
        self.assertEqual(self.as_team(self.board_path), seen)
        evaluation = next(row["after"]["evaluation"] for row in rejudge["boards"][0]["rows"]
                          if row["team"] == "alpha")
        there, missing = (self.as_team(f"/v1/evaluations/{number}")
                          for number in (evaluation, 987654))
        self.assertEqual(there[0], 404)
        self.assertEqual(there[1].replace(str(evaluation), "N"), missing[1].replace("987654", "N"))
        for path in ("/v1/rejudges", "/v1/rejudges/1", "/v1/rejudges/2"):
            status, text = self.as_team(path)
            self.assertEqual(status, 403)
            self.assertNotIn("rejudge 1", text)
        refused = self.as_team(f"{self.board_path}&config={rejudge['to_config']}")
        self.assertNotIn(NEW, [refused[1]])
        self.act("apply", rejudge["rejudge"])
        self.assertEqual(self.order(), NEW)
        self.assertEqual(self.as_team(f"/v1/evaluations/{evaluation}")[0], 200)
        after = self.get("/v1/challenges")
        phases = [one["challenges"][0]["phases"][0] for one in (before, after)]
        self.assertEqual(phases[0]["seeds"], phases[1]["seeds"])
        self.assertEqual(phases[1]["config"], rejudge["to_config"])

    def test_a_file_that_says_something_new_wins(self):
        rejudge = self.create(self.force_rule(), board=self.board)["rejudge"]
        self.act("apply", rejudge)
        self.hold(final={**self.phases["final"], "entry": "best"})
        self.assertEqual(self.order(), [])
        # The check of the reference episodes runs beside it and may warn of something later.
        warnings = [line for line in self.daemon.log().splitlines() if " warning " in line and "reference" not in line]
        self.assertIn("final", warnings[-1])
        self.hold(**self.phases)
        self.assertIn("other_config", self.get(self.board_path))


class OfAPhaseWhereTeamsChoose(Graded):
    phases = {"final": {"entry": "chosen", "opens_at": moment(hours=-1)}}
    board_path = "/v1/leaderboard?phase=final"
    more = {"phase": "final"}
    board = ("--phase", "final")

    def test_the_record_holds_where_a_chosen_one_is_left_out(self):
        chosen = self.played(Skill(3).mode, "beta", **self.more)
        for submission in (*self.submissions.values(), chosen):
            self.ask("choose", submission)
        artefact = self.result(chosen)["hashes"]["artefact"]
        shutil.rmtree(self.data / "artefacts" / artefact)
        rejudge = self.create(self.file(PLAYED), board=self.board, wait=False)["rejudge"]
        self.computed(rejudge)
        self.act("apply", rejudge, "--without", chosen)
        self.assertEqual(self.order(), ["gamma", "alpha"], "beta chose one that has no result")
        self.cli("proof", "key", "-o", self.folder / "organiser.pem")
        self.cli("proof", "record", "export", self.folder / "record")
        done = self.daemon.run_verb("verify", "--all", self.folder / "record", "--key",
                                    self.folder / "organiser.pem", timeout_s=60, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)


class BadInput(Graded):
    def test_a_config_that_does_not_fit(self):
        live = self.text(self.board_path)
        configs = [
            ("{not json", "rules.json"),
            ("[1]", "rules.json"),
            ('{"extends": "demo-manipulation", "extends": "manipulation"}', "extends"),
            ({}, '"profiles"'),
            ({"extends": "nothing"}, "nothing"),
            ({"extends": "../../etc/passwd"}, "not a name of a track config"),
            ({"extends": TRACK, "colour": 1}, '"colour"'),
            ({"extends": TRACK, "scoring": {"force_limit_n": None}}, '"force_limit_n"'),
            ({"extends": TRACK, "scoring": {"force_limit_n": -1}}, '"force_limit_n"'),
            ({"extends": TRACK, "scoring": 7}, '"scoring"'),
            ({"extends": TRACK, "profiles": None}, "profiles"),
            ({"extends": TRACK, "seeds": {"first": 0, "count": 7}}, "7 seeds"),
            ({"extends": "demo-locomotion"}, "environment"),
        ]
        for config, words in configs:
            with self.subTest(config=config):
                said = self.fails("create", "--track", TRACK, "--config", self.file(config),
                                  "--reason", "r")
                self.assertIn(words, said)
        self.assertEqual(self.get("/v1/rejudges")["rejudges"], [])
        self.assertEqual(self.text(self.board_path), live)

    def test_words_that_make_no_sense(self):
        good = ("--config", self.force_rule(), "--reason", "r")
        for words in (("create", *good), ("create", "--track", TRACK, "--phase", "final", *good),
                      ("create", "--phase", "final", *good),
                      ("create", "--track", "flying", *good),
                      ("create", "--track", TRACK, "--profile", "none", *good),
                      ("create", "--track", TRACK, "--repeat", 0, *good),
                      ("create", "--track", TRACK, "--repeat", 21, *good),
                      ("create", "--track", TRACK, "--method", "guess", *good),
                      ("create", "--track", TRACK, "--config", self.force_rule()),
                      ("create", "--track", TRACK, "--reason", "x" * 201),
                      ("create", "--track", TRACK, "--config", "/nowhere.json", "--reason", "r"),
                      ("create", "--track", TRACK, "--config", self.file(PLAYED), "--method",
                       "facts", "--reason", "r"),
                      ("show", 1), ("show", 0), ("apply", 1, "--reason", "r"),
                      ("drop", 1, "--reason", "r"), ("apply", 1)):
            with self.subTest(words=words):
                self.fails(*words)
        self.assertEqual(self.get("/v1/rejudges")["rejudges"], [])

    def test_acts_at_the_wrong_time(self):
        live = self.text(self.board_path)
        self.played("slow", "delta")
        live = self.text(self.board_path)
        first = self.create(self.file(PLAYED), wait=False)["rejudge"]
        self.assertIn("rejudge 1", self.fails("apply", first, "--reason", "early"))
        self.assertEqual(self.text(self.board_path), live)
        second = self.create(self.force_rule())["rejudge"]
        self.act("apply", second)
        applied = self.text(self.board_path)
        self.assertIn("applied", self.fails("apply", second, "--reason", "twice"))
        self.computed(first)
        said = self.fails("apply", first, "--reason", "the board has other rules by now")
        self.assertIn("config", said)
        third = self.create(self.scoring(force_limit_n=LOW_FORCE, full_time_s=20))["rejudge"]
        self.act("apply", third)
        self.assertIn(f"rejudge {third}", self.fails("drop", second, "--reason", "r"))
        self.act("drop", third)
        self.assertEqual(self.text(self.board_path), applied)
        self.assertIn("dropped", self.fails("drop", third, "--reason", "twice"))
        self.act("drop", second)
        self.assertEqual(json.loads(self.text(self.board_path))["rows"], json.loads(live)["rows"])


if __name__ == "__main__":
    unittest.main(verbosity=2)
