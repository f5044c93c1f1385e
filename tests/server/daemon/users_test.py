"""Who the users of this host are: with a challenge, and without one."""

import json
import os
import threading
import unittest

from daemon_test import DaemonCase
from support.submission import played_by_stand_in

ROOT = os.geteuid() == 0
TRACK = "demo-manipulation"


class UsersCase(DaemonCase):
    """A socket for everybody, and a user whom the settings make an organiser, and the next one a
    participant of team gamma."""
    ada, bob, lab = 64011, 64012, 64013

    def start(self):
        self.daemon.socket = self.daemon.root / "open.sock"
        self.daemon.root.chmod(0o711)
        self.configure(http={"socket_mode": "0666"}, access={"users": [
            {"uid": self.lab, "role": "organiser"},
            {"uid": self.lab + 1, "role": "participant", "team": "gamma"}]})
        super().start()

    def submit_as(self, uid, team, mode="ok"):
        _, body = self.call("POST", "/v1/artefacts", played_by_stand_in(mode, f"of {uid}"),
                            uid=uid)
        return self.call("POST", "/v1/submissions", {
            "artefact": body["artefact"], "team": team, "track": TRACK, "episodes": 1}, uid=uid)


@unittest.skipUnless(ROOT, "only root can be somebody else")
class Alone(UsersCase):
    """Without a challenge, whoever comes takes part."""

    def test_the_first_who_submits_for_a_team_is_its_member(self):
        status, body = self.submit_as(self.ada, "alpha")
        self.assertEqual(status, 201, body)
        submission = body["submission"]
        self.assertEqual(self.call("GET", "/v1/whoami", uid=self.ada)[1]["teams"], ["alpha"])
        status, body = self.submit_as(self.bob, "alpha")
        self.assertEqual((status, body["error"]["code"]), (403, "forbidden"), body)
        # Nor does another name give another turn.
        status, body = self.submit_as(self.ada, "more")
        self.assertEqual((status, body["error"]["code"]), (403, "forbidden"), body)
        self.assertEqual(self.submit_as(self.bob, "beta")[0], 201)
        self.assertEqual(self.submit_as(self.ada, "alpha")[0], 201)
        for part in ("", "/result", "/receipt"):
            status, body = self.call("GET", f"/v1/submissions/{submission}{part}", uid=self.bob)
            self.assertEqual((status, body["error"]["message"]),
                             (404, f"there is no submission {submission}"))
        self.assertEqual(self.call("POST", f"/v1/submissions/{submission}/cancel", {},
                                   uid=self.bob)[0], 404)
        self.assertEqual(self.call("GET", f"/v1/submissions/{submission}", uid=self.ada)[0], 200)

    def test_two_who_found_one_team_at_once_are_one_member_and_one_refusal(self):
        answers = {}
        def submit(uid):
            answers[uid] = self.submit_as(uid, "alpha")
        threads = [threading.Thread(target=submit, args=[uid]) for uid in (self.ada, self.bob)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(sorted(status for status, _ in answers.values()), [201, 403], answers)

    def test_an_upload_for_a_team_founds_it_too(self):
        address = f"/v1/artefacts?team=alpha&track={TRACK}"
        archive = played_by_stand_in("ok")
        self.assertEqual(self.call("POST", address, archive, uid=self.ada)[0], 201)
        status, body = self.call("POST", address, archive, uid=self.bob)
        self.assertEqual((status, body["error"]["code"]), (403, "forbidden"), body)

    def test_a_team_that_an_operator_submitted_for_is_nobody_elses(self):
        self.submit("ok", team="service")
        status, body = self.submit_as(self.ada, "service")
        self.assertEqual((status, body["error"]["code"]), (403, "forbidden"), body)
        self.submit_as(self.ada, "alpha")
        self.submit("ok", team="alpha", episodes=1)

    def test_a_team_that_the_settings_give_to_somebody_is_nobody_elses(self):
        # The third is the same name in letters of full width.
        for name in ("gamma", " gamma", "\uff47amma"):
            status, body = self.submit_as(self.ada, name)
            self.assertIn((status, body["error"]["code"]),
                          ((403, "forbidden"), (400, "bad_request")), body)
        self.assertEqual(self.submit_as(self.lab + 1, "gamma")[0], 201)

    def test_a_team_of_people_with_tokens_is_nobody_elses(self):
        self.assertEqual(self.call("POST", "/v1/teams", {"team": "remote"})[0], 201)
        self.assertEqual(self.call("POST", "/v1/tokens", {
            "role": "participant", "team": "remote", "label": "x"})[0], 201)
        status, body = self.submit_as(self.ada, "remote")
        self.assertEqual((status, body["error"]["code"]), (403, "forbidden"), body)

    def test_the_settings_say_who_is_an_organiser(self):
        self.assertEqual(self.call("GET", "/v1/events", uid=self.lab)[0], 200)
        self.assertEqual(self.call("GET", "/v1/events", uid=self.ada)[0], 403)
        self.assertEqual(self.call("GET", "/v1/backup", uid=self.lab)[0], 403)

    def test_status_works_for_everybody(self):
        self.submit_as(self.ada, "alpha")
        for uid, count in ((self.ada, 1), (self.bob, 0)):
            listed = self.call("GET", "/v1/submissions", uid=uid)[1]["submissions"]
            self.assertEqual(len(listed), count)
            health = self.call("GET", "/v1/health", uid=uid)[1]
            self.assertEqual((health["slots"], "pid" in health), (self.slots, False))

@unittest.skipUnless(ROOT, "only root can be somebody else")
class Challenged(UsersCase):
    """With a challenge, organisers say who takes part."""

    def start(self):
        (self.configs / "challenges/cup.json").write_text(json.dumps({
            "form": 1, "title": "A cup", "phases": [{
                "name": "final", "title": "The final", "track": TRACK, "profile": "paper",
                "opens_at": "2020-01-01T00:00:00Z", "seeds": {"first": 5000, "count": 6}}]}))
        super().start()

    def role(self, uid):
        who = self.call("GET", "/v1/whoami", uid=uid)[1]
        return who["role"], who["teams"]

    def test_a_user_whom_nobody_added_is_nobody(self):
        self.assertEqual(self.role(self.ada), ("public", []))
        for method, path, body in (("GET", "/v1/submissions", None),
                                   ("GET", "/v1/submissions/1", None),
                                   ("POST", "/v1/artefacts", played_by_stand_in("ok")),
                                   ("POST", "/v1/submissions", {})):
            status, answer = self.call(method, path, body, uid=self.ada)
            self.assertEqual((status, answer["error"]["code"]), (403, "forbidden"), answer)
        health = self.call("GET", "/v1/health", uid=self.ada)[1]
        self.assertEqual(set(health), {"status", "version", "api"})
        for path in ("/v1/tracks", f"/v1/leaderboard?track={TRACK}", "/v1/challenges"):
            self.assertEqual(self.call("GET", path, uid=self.ada)[0], 200)

    def test_a_member_takes_part_until_they_are_removed(self):
        self.assertEqual(self.call("POST", "/v1/teams", {"team": "alpha"})[0], 201)
        member = {"person": f"uid {self.ada}", "belongs": True}
        status, answer = self.call("POST", "/v1/teams/alpha/members", member)
        self.assertEqual(status, 200, answer)
        self.assertEqual(self.role(self.ada), ("participant", ["alpha"]))
        status, answer = self.submit_as(self.ada, "alpha")
        self.assertEqual(status, 201, answer)
        # Teams are the organisers' to make.
        status, answer = self.submit_as(self.ada, "beta")
        self.assertEqual((status, answer["error"]["code"]), (404, "not_found"), answer)
        member["belongs"] = False
        self.assertEqual(self.call("POST", "/v1/teams/alpha/members", member)[0], 200)
        self.assertEqual(self.role(self.ada), ("public", []))
        self.assertEqual(self.call("GET", "/v1/submissions", uid=self.ada)[0], 403)

    def test_a_team_has_all_its_names(self):
        self.assertEqual(self.submit_as(self.lab + 1, "gamma")[0], 201)
        status, answer = self.call("POST", "/v1/teams/gamma/rename", {"name": "delta"})
        self.assertEqual(status, 200, answer)
        self.assertEqual(self.role(self.lab + 1), ("participant", ["delta"]))
        for name in ("gamma", "delta"):
            self.assertEqual(self.submit_as(self.lab + 1, name)[0], 201)
            status, listed = self.call("GET", f"/v1/submissions?team={name}", uid=self.lab + 1)
            self.assertGreater(len(listed["submissions"]), 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
