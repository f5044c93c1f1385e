"""A challenge in the real daemon: phases that open, pause, freeze, are published and end."""

import datetime
import json
import os
import pathlib
import shutil
import signal
import sqlite3
import tempfile
import unittest

from organiser_test import OrganiserCase

TRACK = "demo-manipulation"
PROFILE = "paper"
TEAMS = {"alpha": 61001, "beta": 61002}
AS_OTHERS = unittest.skipUnless(os.geteuid() == 0, "only root can act as other users")


def moment(**ahead):
    """UTC, so far from now."""
    at = datetime.datetime.now(datetime.timezone.utc) + datetime.timedelta(**ahead)
    return at.strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def seeds(first, count=6):
    return {"first": first, "count": count}


class PhasesCase(OrganiserCase):
    """The daemon's user is the organiser, and each team has a user of its own where tests have
    several."""

    phases = {}

    def setUp(self):
        self.open = pathlib.Path(tempfile.mkdtemp(prefix="myograde-open-"))
        self.open.chmod(0o755)
        self.addCleanup(shutil.rmtree, self.open, ignore_errors=True)
        super().setUp()
        self.hold(**self.phases)

    def start(self):
        self.daemon.socket = self.open / "socket"
        self.configure(http={"socket_mode": "0666"})
        super().start()

    def cli(self, *words, data=None, check=True):
        result = self.daemon.run_verb(*words, "--socket", self.daemon.socket, timeout_s=60,
                                      text=True)
        if check:
            self.assertEqual(result.returncode, 0, result.stderr)
        return result

    def hold(self, **phases):
        """Restarts the daemon with a challenge of these phases; none: without it."""
        if self.daemon.running:
            self.stop(signal.SIGTERM)
        file = self.configs / "challenges/cup.json"
        if phases:
            entries = [{"name": name.replace("_", "-"), "title": f"Phase {name}", "track": TRACK,
                        "profile": PROFILE, **keys} for name, keys in phases.items()]
            file.write_text(json.dumps({"form": 1, "title": "A cup", "phases": entries}))
        else:
            file.unlink(missing_ok=True)
        self.configure(access={"users": [{"uid": uid, "role": "participant", "team": team}
                                         for team, uid in TEAMS.items()]})
        self.start()

    def challenges(self):
        return self.ask("phase", "status", schema="challenge-status")

    def phase(self, name):
        for challenge in self.challenges()["challenges"]:
            for phase in challenge["phases"]:
                if phase["phase"] == name:
                    return phase
        return None

    def try_submit(self, mode, team="alpha", **more):
        return self.call("POST", "/v1/submissions", {
            "artefact": self.upload(mode), "team": team, "track": TRACK, **more})

    def refused(self, code, *words, status=409, **more):
        got, answer = self.try_submit("ok", **more)
        self.assertEqual((got, answer["error"]["code"]), (status, code), answer)
        for word in words:
            self.assertIn(word, answer["error"]["message"])

    def board_of(self, phase, schema="leaderboard"):
        return self.ask("leaderboard", "--phase", phase, schema=schema)

    def submissions_on(self, board):
        return [row["submission"] for row in board["rows"]]


class Admission(PhasesCase):
    phases = {"over": {"closes_at": moment(hours=-1), "seeds": seeds(1000)},
              "final": {"opens_at": moment(hours=-1), "closes_at": moment(hours=1)},
              "later": {"opens_at": moment(hours=1), "seeds": seeds(2000)}}

    def test_late_and_early_ones_are_refused_and_say_when(self):
        self.refused("phase_closed", 'phase "over" closed at ', phase="over")
        self.refused("phase_closed", 'phase "later" opens at ', phase="later")
        self.refused("unknown_phase", "known: over, final, later", phase="none", status=400)
        self.refused("bad_request", "played as a whole", phase="final", episodes=2, status=400)
        self.assertEqual(self.get("/v1/submissions")["submissions"], [])

    def test_the_host_s_text_is_told_without_html(self):
        self.stop(signal.SIGTERM)
        text = self.configs / "challenges/cup.md"
        text.write_text("Hello **all** <b>x</b>, see [rules](/docs).\n")
        self.start()
        [paragraph] = self.challenges()["challenges"][0]["text"]
        self.assertEqual([node["type"] for node in paragraph["children"]],
                         ["text", "strong", "text", "text", "text", "link", "text"])
        self.assertNotIn("<b>", json.dumps(paragraph))
        self.stop(signal.SIGTERM)
        text.write_bytes(b"x" * (64 * 1024 + 1))
        checked = self.daemon.run_verb("phase", "check", self.configs / "challenges/cup.json", text=True)
        self.assertIn("cup.md", checked.stdout + checked.stderr)
        self.assertEqual(checked.returncode, 2)
        text.unlink()
        self.start()

    def test_phases_are_listed_in_the_order_of_their_file(self):
        self.hold(walk={"opens_at": moment(hours=2), "seeds": seeds(3000)},
                  final={"opens_at": moment(hours=1), "seeds": seeds(4000)}, arm={})
        phases = self.challenges()["challenges"][0]["phases"]
        self.assertEqual([phase["phase"] for phase in phases], ["walk", "final", "arm"])

    def test_the_only_open_one_is_taken(self):
        submission = self.submit("ok")
        self.ended(submission)
        status = self.get(f"/v1/submissions/{submission}")
        self.assertEqual((status["phase"], status["ranked"]), ("final", True))
        practice = self.submit("ok", episodes=2)
        self.ended(practice)
        status = self.get(f"/v1/submissions/{practice}")
        self.assertEqual((status["phase"], status["ranked"]), (None, False))
        self.assertEqual(self.submissions_on(self.board_of("final")), [submission])
        self.assertEqual(self.board()["rows"], [], "the track's own board is another one")
        self.assertIn("phase final", self.cli("show", submission).stdout)
        listed = self.get("/v1/submissions?phase=final")["submissions"]
        self.assertEqual([row["submission"] for row in listed], [submission])

    def test_where_several_are_open_one_is_named(self):
        self.hold(one={"seeds": seeds(1000)}, two={"seeds": seeds(2000)})
        self.refused("bad_request", "has 2 open phases", "one, two", status=400)
        self.assertEqual(self.try_submit("ok", phase="two")[0], 201)

    def test_where_none_is_open_the_next_one_is_named(self):
        self.hold(over=self.phases["over"], later=self.phases["later"])
        self.refused("phase_closed", '"later" opens at ')
        self.assertEqual(self.try_submit("ok", episodes=2)[0], 201, "practice goes on")

    def test_each_phase_has_a_quota_of_its_own(self):
        self.hold(small={"seeds": seeds(1000), "quota": {"official_total": 1}},
                  large={"seeds": seeds(2000)})
        self.submit("ok", phase="small")
        status, answer = self.try_submit("slow", phase="small")
        self.assertEqual((status, answer["error"]["code"]), (409, "quota"), answer)
        self.assertIn('1 ranked evaluation of phase "small"', answer["error"]["message"])
        self.assertEqual(self.try_submit("slow", phase="large")[0], 201)
        quota = self.ask("quota", "--team", "alpha", schema="quota")
        used = {entry["phase"]: entry["official"]["total"]["used"] +
                entry["official"]["total"]["open"] for entry in quota["phases"]}
        self.assertEqual(used, {"small": 1, "large": 1})
        self.ask("team", "grant", "alpha", "--track", TRACK, "--phase", "small", "--units", 1,
                 "--reason", "a broken host", schema="quota")
        self.assertEqual(self.try_submit("slow", phase="small")[0], 201)

    def test_accepted_work_is_finished_after_the_close(self):
        submission = self.submit("slow")
        self.wait(f"/v1/submissions/{submission}", lambda b: b["state"] == "running")
        self.hold(final={**self.phases["final"], "closes_at": moment(minutes=-1)})
        self.assertEqual(self.ended(submission)["state"], "done")
        self.assertEqual(self.phase("final")["state"], "closed")
        self.assertEqual(self.submissions_on(self.board_of("final")), [submission])
        # Whoever did not get the answer gets it now.
        status, again = self.try_submit("slow", phase="final")
        self.assertEqual((status, again["linked"], again["submission"]), (200, True, submission))


class Pauses(PhasesCase):
    phases = {"final": {}}

    def test_a_pause_refuses_submissions_only(self):
        running = self.submit("slow")
        self.wait(f"/v1/submissions/{running}", lambda b: b["state"] == "running")
        paused = self.ask("phase", "pause", "final", "--reason", "a slot is broken",
                          schema="phase")
        self.assertEqual((paused["changed"], paused["state"]), (True, "paused"))
        self.assertFalse(self.ask("phase", "pause", "final", "--reason",
                                  "a slot is broken")["changed"])
        self.refused("paused", 'phase "final" is paused', "a slot is broken")
        self.assertEqual(self.phase("final")["paused"]["reason"], "a slot is broken")
        self.assertEqual(self.try_submit("ok", episodes=2)[0], 201)
        self.ask("phase", "pause", "--all", "--reason", "the host moves", schema="phase")
        self.refused("paused", "submissions are paused", "the host moves", episodes=2)
        resumed = self.ask("phase", "resume", "final", "--reason", "it is repaired")
        self.assertEqual((resumed["changed"], resumed["state"]), (True, "paused"))
        self.hold(**self.phases)  # a restart keeps it
        self.refused("paused", "the host moves")
        self.assertIn("All submissions are paused", self.cli("phase", "status").stdout)
        self.ask("phase", "resume", "--all", "--reason", "here we are", schema="phase")
        self.assertEqual(self.ended(running)["state"], "done")
        self.assertEqual(self.try_submit("ok")[0], 201)

    def test_all_can_be_paused_without_a_challenge(self):
        self.hold()
        self.assertEqual(self.challenges()["challenges"], [])
        self.ask("phase", "pause", "--all", "--reason", "maintenance")
        self.refused("paused", "maintenance")

    @AS_OTHERS
    def test_only_organisers_act(self):
        for path in ("/v1/phases/final/pause", "/v1/phases/final/publish", "/v1/pause"):
            status, answer = self.call("POST", path, {"reason": "r"}, uid=TEAMS["alpha"])
            self.assertEqual((status, answer["error"]["code"]), (403, "forbidden"), answer)
        self.assertEqual(self.phase("final")["state"], "open")

    def test_what_makes_no_sense_is_refused(self):
        for words in (("pause", "gone", "--reason", "r"), ("pause", "--reason", "r"),
                      ("pause", "final"), ("pause", "final", "--all", "--reason", "r")):
            self.assertEqual(self.cli("phase", *words, check=False).returncode, 2, words)
        self.hold(later={"opens_at": moment(hours=1)})
        early = self.cli("phase", "publish", "later", "--reason", "r", check=False)
        self.assertEqual(early.returncode, 2)
        self.assertIn("publish it afterwards", early.stderr)


class Boards(PhasesCase):
    phases = {"final": {"entry": "last", "seeds": seeds(1000)}}

    def as_team(self, team, path):
        status, answer = self.call("GET", path, uid=TEAMS[team])
        self.assertEqual(status, 200, answer)
        return answer

    @AS_OTHERS
    def test_a_freeze_hides_what_ends_later_until_it_is_published(self):
        path = "/v1/leaderboard?phase=final"
        early = self.played("ok", "alpha")
        before = self.as_team("beta", path)
        self.assertEqual((before["frozen_at"], before["complete"]), (None, True))
        self.hold(final={**self.phases["final"], "freeze_at": moment()})
        late, other = self.played("once", "alpha"), self.played("ok", "beta")
        whole = self.board_of("final")
        self.assertEqual(sorted(self.submissions_on(whole)), sorted([late, other]))
        self.assertTrue(whole["complete"])
        for team in TEAMS:
            frozen = self.as_team(team, path)
            self.assertEqual(frozen["rows"], before["rows"])
            self.assertEqual((frozen["frozen_at"], frozen["complete"]),
                             (whole["frozen_at"], False))
            explain = f"/v1/leaderboard/explain?phase=final&a={late}&b={early}"
            status, answer = self.call("GET", explain, uid=TEAMS[team])
            self.assertEqual(status, 404, answer)
        self.assertTrue(self.phase("final")["frozen"])
        published = self.ask("phase", "publish", "final", "--reason", "ceremony", schema="phase")
        self.assertTrue(published["changed"])
        self.assertFalse(self.ask("phase", "publish", "final", "--reason", "again")["changed"])
        self.assertEqual(self.as_team("beta", path)["rows"], whole["rows"])
        self.assertIsNone(self.as_team("beta", path)["frozen_at"])
        self.stop(signal.SIGTERM)
        self.start()
        self.assertEqual(self.as_team("beta", path)["rows"], whole["rows"], "after a restart")

    @AS_OTHERS
    def test_a_team_chooses_its_entry(self):
        self.hold(final={**self.phases["final"], "entry": "chosen"})
        first, second = self.played("ok"), self.played("once")
        practice = self.played("ok", episodes=2)
        self.assertEqual(self.board_of("final")["rows"], [])
        chosen = self.ask("choose", first, schema="choose")
        self.assertEqual((chosen["changed"], chosen["phase"]), (True, "final"))
        self.assertFalse(self.ask("choose", first)["changed"])
        self.assertEqual(self.submissions_on(self.board_of("final")), [first])
        self.ask("choose", second)
        self.assertEqual(self.submissions_on(self.board_of("final")), [second])
        for other in (practice, 99):
            self.assertEqual(self.cli("choose", other, check=False).returncode, 2)
        foreign = self.call("POST", f"/v1/submissions/{first}/choose", {}, uid=TEAMS["beta"])
        missing = self.call("POST", "/v1/submissions/99/choose", {}, uid=TEAMS["beta"])
        self.assertEqual(foreign[0], 404)
        self.assertEqual(json.dumps(foreign).replace(f" {first}", " N"),
                         json.dumps(missing).replace(" 99", " N"))
        self.stop(signal.SIGTERM)
        self.start()
        self.assertEqual(self.submissions_on(self.board_of("final")), [second], "after a restart")
        self.hold(final={**self.phases["final"], "entry": "chosen", "closes_at": moment()})
        late = self.cli("choose", first, check=False)
        self.assertEqual(late.returncode, 2)
        self.assertIn('phase "final" closed at', late.stderr)

    @AS_OTHERS
    def test_a_team_cancels_its_own_evaluation_and_no_rerun(self):
        submission = self.played("slow")
        path = f"/v1/submissions/{submission}"
        status, rerun = self.call("POST", f"{path}/rerun", {})
        self.assertEqual(status, 201, rerun)
        status, answer = self.call("POST", f"{path}/cancel", {}, uid=TEAMS["alpha"])
        self.assertEqual(status, 409, answer)
        self.assertIn("only organisers can end its reruns", answer["error"]["message"])
        self.assertIn(self.get(f"/v1/evaluations/{rerun['evaluation']}")["state"],
                      ("queued", "running"))
        status, answer = self.call("POST", f"{path}/cancel", {"reason": "enough"})
        self.assertEqual(status, 200, answer)
        self.assertEqual(self.get(f"/v1/evaluations/{rerun['evaluation']}")["state"], "cancelled")
        waiting = self.submit("stubborn")
        status, _ = self.call("POST", f"/v1/submissions/{waiting}/cancel", {"reason": "wrong file"},
                              uid=TEAMS["alpha"])
        self.assertEqual(status, 200)
        acts = lambda: [(row["subject"], row["detail"]) for row in
                        self.get("/v1/events?kind=act")["events"] if row["action"] == "cancel"]
        self.wait("/v1/events?kind=act", lambda _: len(acts()) == 2)
        self.assertEqual(acts(), [(f"submission {waiting}", "wrong file"),
                                  (f"submission {submission}", "enough")])

    @AS_OTHERS
    def test_a_clock_that_was_set_back_shows_nothing_that_is_as_late_as_the_freeze(self):
        first, second = self.played("ok", "alpha"), self.played("ok", "beta")
        self.stop(signal.SIGTERM)
        with sqlite3.connect(self.data / "store.db") as db:
            db.execute("DROP TRIGGER journal_fixed")
            db.execute("UPDATE journal SET at = at + 7200000 WHERE evaluation IN "
                       "(SELECT id FROM evaluation WHERE submission = ?)", (second,))
        self.hold(final={**self.phases["final"], "freeze_at": moment(hours=1)})
        seen = self.as_team("beta", "/v1/leaderboard?phase=final")
        self.assertEqual((self.submissions_on(seen), seen["complete"]), ([first], False))
        whole = self.board_of("final")
        self.assertEqual((len(whole["rows"]), whole["complete"]), (2, True))

    def test_where_teams_do_not_choose_it_is_refused(self):
        submission = self.played("ok")
        refused = self.cli("choose", submission, check=False)
        self.assertEqual(refused.returncode, 2)
        self.assertIn("board ranks each team's last submission", refused.stderr)

    @AS_OTHERS
    def test_a_choice_after_the_freeze_is_not_on_the_frozen_board(self):
        self.hold(final={**self.phases["final"], "entry": "chosen"})
        first, second = self.played("ok"), self.played("once")
        self.ask("choose", first)
        self.hold(final={**self.phases["final"], "entry": "chosen", "freeze_at": moment()})
        self.ask("choose", second)
        self.assertEqual(self.submissions_on(self.board_of("final")), [second])
        frozen = self.as_team("beta", "/v1/leaderboard?phase=final")
        self.assertEqual(self.submissions_on(frozen), [first])

    def test_an_old_phase_is_readable_without_its_file(self):
        submission = self.played("ok")
        board = self.board_of("final")
        self.hold(other={"seeds": seeds(3000)})
        self.assertEqual(self.board_of("final"), board)
        former = self.challenges()["former_phases"]
        self.assertEqual([(p["phase"], p["submissions"]) for p in former], [("final", 1)])
        self.assertIn("Former phase final", self.cli("phase", "status").stdout)
        self.refused("unknown_phase", phase="final", status=400)
        self.hold()
        self.assertEqual(self.board_of("final"), board)
        self.assertEqual(self.get(f"/v1/submissions/{submission}")["phase"], "final")
        self.assertEqual(self.call("GET", "/v1/leaderboard?phase=never")[1]["error"]["code"],
                         "unknown_phase")
        status, answer = self.call("GET", "/v1/leaderboard?phase=final&track=elbow")
        self.assertEqual(status, 400, answer)


class Files(PhasesCase):
    phases = {"final": {}}

    def test_a_daemon_does_not_start_with_a_mistake(self):
        self.stop(signal.SIGTERM)
        file = self.configs / "challenges/cup.json"
        good = json.loads(file.read_text())
        for change, word in (({"track": "flying"}, '"flying"'), ({"colour": 1}, '"colour"'),
                             ({"opens_at": "tomorrow"}, "a time with a zone")):
            phase = {**good["phases"][0], **change}
            file.write_text(json.dumps({**good, "phases": [phase]}))
            self.assertEqual(self.daemon.launch().wait(timeout=20), 2)
            last = self.daemon.log().splitlines()[-1]
            self.assertIn(word, last)
            self.assertIn("cup.json", last)
        file.write_text(json.dumps(good))
        self.start()

    def test_check_finds_every_mistake_and_looks_at_the_other_files(self):
        mine = self.folder / "mine.json"
        phase = {"name": "final", "title": "t", "track": TRACK, "profile": PROFILE}
        mine.write_text(json.dumps({"form": 1, "title": "t", "phases": [
            phase, {**phase, "name": "a", "track": "flying"}, {**phase, "name": "b", "x": 1}]}))
        words = ("phase", "check", mine, "--configs", self.configs)
        result = self.daemon.run_verb(*words, "--json", timeout_s=60, text=True)
        self.assertEqual(result.returncode, 2, result.stderr)
        found = json.loads(result.stdout)
        text = "\n".join(found["mistakes"])
        for word in ('"x"', "the name is taken by", '"flying"'):
            self.assertIn(word, text)
        mine.write_text(json.dumps({"form": 1, "title": "t", "phases": [
            {**phase, "name": "mine", "seeds": seeds(5000), "opens_at": moment(hours=-1)}]}))
        result = self.daemon.run_verb(*words, timeout_s=60, text=True)
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertIn("Warning: ", result.stdout)
        self.assertIn("2 challenges, 0 mistakes, 1 warning", result.stdout)
        # A changed file is checked in place of the one that is there.
        own = self.folder / "cup.json"
        own.write_text((self.configs / "challenges/cup.json").read_text())
        result = self.daemon.run_verb("phase", "check", own, "--configs", self.configs,
                                      timeout_s=60, text=True)
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertIn("1 challenge, 0 mistakes", result.stdout)

    def test_a_track_without_a_reference_episode_is_for_practice_only(self):
        self.stop(signal.SIGTERM)
        start = len(self.daemon.log())
        (self.configs / "reference/manipulation.lcmlog.zst").unlink()
        self.start()
        said = self.daemon.log()[start:]
        self.assertIn(f"track {TRACK} is only for practice: no reference episode", said)
        self.assertNotIn("elbow is only for practice", said)
        self.refused("not_official", "no reference episode", status=503, phase="final")
        self.assertEqual(self.try_submit("ok", episodes=1)[0], 201)
        result = self.daemon.run_verb("phase", "check", "--configs", self.configs, timeout_s=60,
                                      text=True)
        self.assertEqual(result.returncode, 2)
        self.assertIn(f"nothing of the track {TRACK} can be ranked: no reference episode", result.stdout)
        result = self.daemon.run_verb("doctor", "--json", "--configs", self.configs, timeout_s=120,
                                      text=True)
        lacking = [check for check in json.loads(result.stdout)["checks"] if check["name"] == "reference"]
        self.assertIn(TRACK, " ".join(check["found"] for check in lacking))
        self.assertEqual({check["state"] for check in lacking}, {"degraded"})

    def test_a_changed_phase_is_told_in_the_log(self):
        self.played("ok")
        self.hold(final={"entry": "last"})
        self.assertIn('phase "final" was changed after it got submissions', self.daemon.log())
        self.assertEqual(self.board_of("final")["other_config"], 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
