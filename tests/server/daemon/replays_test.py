"""Which episodes everybody may watch: never more than the organiser allows and the phase shows."""

import os
import signal
import unittest

from phases_test import AS_OTHERS, PhasesCase, TEAMS, TRACK, moment, seeds

STRANGER = 61003
OPEN = {"seeds": seeds(3000), "public_replay": True}


class Replays(PhasesCase):
    phases = {"final": OPEN}

    def played(self, mode, team="alpha", **more):
        """The number of a submission that has ended, of a policy of its own."""
        self.policies = getattr(self, "policies", 0) + 1
        more["artefact"] = self.upload(mode, f"policy {self.policies}")
        return super().played(mode, team, **more)

    def mark(self, submission, mark):
        status, answer = self.call("POST", f"/v1/submissions/{submission}/marks",
                                   {"mark": mark, "set": True, "reason": "a test"})
        self.assertEqual(status, 200, answer)

    def replays(self):
        """What everybody is told, which is the same for whoever asks."""
        answers = [self.get("/v1/replays")["replays"]]
        if os.geteuid() == 0:
            for uid in (STRANGER, TEAMS["alpha"]):
                status, answer = self.call("GET", "/v1/replays", uid=uid)
                self.assertEqual(status, 200, answer)
                answers.append(answer["replays"])
        for answer in answers:
            self.assertEqual(answer, answers[0])
        return answers[0]

    def watched(self):
        return [replay["submission"] for replay in self.replays()]

    def why_not(self, log, uid=None):
        """The error's code for a trajectory that nobody wrote a log for."""
        status, answer = self.call("GET", f"/v1/replays/{log}/trajectory", uid=uid)
        self.assertEqual(status, 404, answer)
        return answer["error"]["code"]

    def test_the_leaders_best_episode_is_for_everybody(self):
        self.assertEqual(self.replays(), [])
        first = self.played("logged", phase="final")
        self.played("logged", "beta", phase="final")
        replay, = self.replays()
        best = self.get(f"/v1/submissions/{first}/result?summary=1")["highlights"]["best"]
        self.assertEqual(best["outcome"], "success")
        self.assertEqual(replay, {
            "phase": "final", "track": TRACK, "profile": "paper", "team": "alpha", "submission": first,
            "name": replay["name"], "baseline": False, "episode": best["index"], "log": best["log"]["sha256"]})
        self.assertEqual(self.why_not(replay["log"]), "not_found")
        self.assertEqual(self.call("GET", "/v1/replays?x=1")[0], 400)

    def test_nothing_is_public_that_the_organiser_does_not_allow(self):
        self.hold(final={"seeds": seeds(3000)})
        self.played("logged", phase="final")
        self.assertEqual(self.replays(), [])
        self.hold()
        self.played("logged")
        self.assertEqual(self.replays(), [])
        self.stop(signal.SIGTERM)
        self.configure(public_replay=True)
        self.start()
        replay, = self.replays()
        self.assertEqual((replay["phase"], replay["track"]), (None, TRACK))
        self.hold(final={"seeds": seeds(3000)})
        self.assertEqual([one["phase"] for one in self.replays()], [None])

    def test_what_a_phase_withholds_is_withheld_until_it_is_published(self):
        for part in ("outcomes", "metrics", "logs"):
            with self.subTest(part):
                self.hold(**{part: {**OPEN, "show": {part: False}}})
                self.played("logged", phase=part)
                self.assertEqual(self.replays(), [])
                self.ask("phase", "publish", part, "--reason", "over")
                self.assertEqual([one["phase"] for one in self.replays()], [part])
        self.hold(quiet={**OPEN, "show": {"output": False}})
        self.played("logged", phase="quiet")
        self.assertEqual([one["phase"] for one in self.replays()], ["quiet"], "it has no output")

    def test_hidden_seeds_stay_hidden_until_they_are_revealed(self):
        self.hold(final={"public_replay": True, "seeds": {"committed": 6}, "closes_at": moment(seconds=8)})
        self.played("logged", phase="final")
        self.assertEqual(self.replays(), [])
        self.ask("phase", "publish", "final", "--reason", "over")
        self.assertEqual(self.replays(), [], "published, but not revealed")
        # Whatever its file says later.
        self.hold(final={**OPEN, "closes_at": moment(seconds=8)})
        self.assertEqual(self.replays(), [])

    def test_a_frozen_board_has_the_leader_of_the_freeze(self):
        early = self.played("logged", phase="final")
        self.hold(final={**OPEN, "freeze_at": moment()})
        late = self.played("logged", phase="final")
        self.assertEqual(self.watched(), [early])
        log = self.replays()[0]["log"]
        self.mark(early, "hidden")
        self.assertNotIn(late, self.watched())
        self.assertEqual(self.why_not(log), "not_found")
        self.ask("phase", "publish", "final", "--reason", "ceremony")
        self.assertEqual(self.watched(), [late])

    def test_hidden_and_disqualified_submissions_and_banned_teams_are_not_shown(self):
        first, second = self.played("logged", phase="final"), self.played("logged", "beta", phase="final")
        self.assertEqual(self.watched(), [first])
        self.mark(first, "disqualified")
        self.assertEqual(self.watched(), [second])
        self.mark(second, "hidden")
        self.assertEqual(self.watched(), [])
        third = self.played("logged", "beta", phase="final")
        self.assertEqual(self.watched(), [third])
        status, answer = self.call("POST", "/v1/teams/beta/ban", {"banned": True, "reason": "a test"})
        self.assertEqual(status, 200, answer)
        self.assertEqual(self.watched(), [])

    def test_a_baseline_is_shown_as_long_as_nobody_leads(self):
        baseline = self.played("logged", phase="final")
        self.mark(baseline, "baseline")
        replay, = self.replays()
        self.assertEqual((replay["submission"], replay["baseline"]), (baseline, True))
        other = self.played("logged", "beta", phase="final")
        self.assertEqual(self.watched(), [other])

    @AS_OTHERS
    def test_other_logs_stay_their_teams(self):
        first = self.played("logged", phase="final")
        log = self.replays()[0]["log"]
        rows = self.get(f"/v1/submissions/{first}/result?episodes=1")["episode_rows"]
        other = next(row["log"]["sha256"] for row in rows if row["log"]["sha256"] != log)
        for uid in (STRANGER, TEAMS["beta"], TEAMS["alpha"]):
            self.assertEqual(self.why_not(other, uid), "not_found")
            for what in ("", "/trajectory", "/picture.png"):
                status, answer = self.call("GET", f"/v1/logs/{log}{what}", uid=uid)
                self.assertEqual(status, 403 if uid == STRANGER else 404, answer)


if __name__ == "__main__":
    unittest.main()
