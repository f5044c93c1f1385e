"""Teams and tokens: names, members, merges and bans, through the API and the command line."""

import datetime
import json
import os
import pty
import re
import select
import signal
import sqlite3
import subprocess
import time
import unittest
import urllib.parse

from organiser_test import TRACK, OrganiserCase
from support.client import Connection
from support.submission import played_by_stand_in
from support.waiting import stay_within_a_day


def quoted(name):
    return urllib.parse.quote(name, safe="")


class PeopleCase(OrganiserCase):
    def team(self, *words):
        return self.ask("team", *words, schema="team")

    def refused(self, words, *verb):
        done = self.cli(*verb, check=False)
        self.assertEqual(done.returncode, 2, done)
        self.assertRegex(done.stderr, "^myograde: error: [^\n]*\n$")
        self.assertIn(words, done.stderr)

    def try_submit(self, team, mode="ok"):
        return self.call("POST", "/v1/submissions", {
            "artefact": self.upload(mode), "team": team, "track": TRACK})

    def teams_of_rows(self):
        return [(row["team"], row["submission"]) for row in self.board()["rows"]]


class Teams(PeopleCase):
    def test_a_team_is_created_renamed_and_found_by_its_old_names(self):
        made = self.team("create", "Team Blue", "--reason", "signed up")
        self.assertEqual((made["team"], made["changed"], made["members"]),
                         ("Team Blue", True, []))
        self.refused('there is a team "Team Blue" already', "team", "create", "Team Blue")
        self.refused("looks like that of team \"Team Blue\"", "team", "create", "team blue")
        self.played("ok", team="Team Blue")
        renamed = self.team("rename", "Team Blue", "a/b c?\u6771", "--reason", "asked for")
        self.assertEqual((renamed["team"], renamed["other_names"]),
                         ("a/b c?\u6771", ["Team Blue"]))
        self.assertFalse(self.team("rename", "Team Blue", "a/b c?\u6771")["changed"])
        for name in ("Team Blue", "Team  Blue", "a/b c?\u6771"):
            shown = self.team("show", name)
            self.assertEqual((shown["team"], shown["submissions"]), ("a/b c?\u6771", 1))
            self.assertEqual([event["event"] for event in shown["events"]],
                             ["created", "renamed"])
            self.assertEqual(shown["events"][1]["detail"], "Team Blue")
            query = urllib.parse.urlencode({"team": name})
            self.assertEqual(len(self.get(f"/v1/submissions?{query}")["submissions"]), 1)
            self.assertEqual(self.get(f"/v1/quota?{query}")["team"], "a/b c?\u6771")
        self.assertEqual(self.teams_of_rows(), [("a/b c?\u6771", 1)])
        status, answer = self.try_submit("Team Blue")
        self.assertEqual((status, answer["team"], answer["linked"]), (200, "a/b c?\u6771", True))
        self.team("create", "beta")
        self.refused('"Team Blue" is a former name of team', "team", "rename", "beta",
                     "Team Blue")
        self.refused('there is no team "nobody"', "team", "show", "nobody")
        self.assertEqual(self.call("GET", "/v1/teams/nobody")[0], 404)
        listed = self.ask("team", "list", schema="teams")
        self.assertEqual([team["team"] for team in listed["teams"]], ["beta", "a/b c?\u6771"])
        self.call("POST", "/v1/tokens", {"role": "participant", "team": "beta", "label": "x"})
        listed = self.ask("team", "list", schema="teams")["teams"]
        self.assertEqual([(team["submissions"], team["tokens"]) for team in listed], [(0, 1), (1, 0)])

    def test_members_are_users_of_the_host(self):
        self.team("create", "alpha")
        added = self.team("add-member", "alpha", "uid 4001")
        self.assertEqual(added["members"], ["uid 4001"])
        self.assertFalse(self.team("add-member", "alpha", "4001")["changed"])
        self.assertEqual(self.team("add-member", "alpha", "nobody")["members"],
                         ["uid 4001", "uid 65534"])
        removed = self.team("remove-member", "alpha", "uid 4001")
        self.assertEqual((removed["members"], removed["changed"]), (["uid 65534"], True))
        for person in ("no such user", "uid -1", "uid 4294967295", "uid x", ""):
            status, answer = self.call("POST", "/v1/teams/alpha/members",
                                       {"person": person, "belongs": True})
            self.assertEqual((status, answer["error"]["code"]), (400, "bad_request"), answer)
            self.assertIn("has no user", answer["error"]["message"])
        text = self.cli("team", "add-member", "alpha", "4002").stdout
        self.assertEqual(text, "Team alpha has the member 4002.\n")
        self.assertIn("nothing changed", self.cli("team", "add-member", "alpha", "4002").stdout)
        self.assertIn("uid 4002", self.cli("team", "show", "alpha").stdout)
        self.assertIn("uid 4002", self.cli("team", "list").stdout)

    def test_a_merge_shows_what_it_does_and_counts_both(self):
        stay_within_a_day(60)
        for team, submissions in (("alpha", 2), ("beta", 1)):
            for number in range(submissions):
                self.played("ok", team, **({"seeds": [101, 102]} if number else {}))
        self.call("POST", "/v1/tokens", {"role": "participant", "team": "beta", "label": "x"})
        self.ask("team", "grant", "beta", "--track", TRACK, "--units", 3, "--reason", "r")
        before = self.rows_of_the_past()
        plan = self.ask("team", "merge", "beta", "--into", "alpha", "--dry-run",
                        schema="team_merge")
        self.assertEqual((plan["merged"], plan["submissions_of_team"], plan["submissions"],
                          plan["tokens_of_team"]), (False, 1, 3, 1))
        sums = {track["track"]: track for track in plan["tracks"]}[TRACK]
        total = sums["official"]["total"]
        self.assertEqual((total["used_by_team"], total["used_by_into"], total["used"],
                          total["granted"]), (1, 1, 2, 3))
        self.assertEqual(total["left"], total["limit"] + 3 - 2, "the limit is that of one team")
        self.assertEqual(sums["practice"]["per_day"]["used"], 1)
        self.assertEqual(len(self.teams_of_rows()), 2, "a dry run changes nothing")
        self.refused("give --yes", "team", "merge", "beta", "--into", "alpha")
        self.refused("give --yes", "team", "merge", "beta", "--into", "alpha", "--json")
        self.assertEqual(len(self.teams_of_rows()), 2)
        merged = self.ask("team", "merge", "beta", "--into", "alpha", "--yes",
                          schema="team_merge")
        self.assertEqual({**merged, "merged": False}, plan)
        self.assertEqual(self.rows_of_the_past(), before)
        self.assertEqual(self.teams_of_rows(), [("alpha", 1)], "the board shows one of the two")
        track = self.quota("beta")[0]
        self.assertEqual((track["official"]["total"]["used"], track["official"]["total"]["granted"],
                          track["practice"]["total"]["used"]), (2, 3, 1))
        self.assertEqual(self.get("/v1/quota?team=beta")["team"], "alpha")
        self.assertEqual(len(self.get("/v1/submissions?team=alpha")["submissions"]), 3)
        self.assertEqual(self.get("/v1/tokens")["tokens"][0]["team"], "alpha")
        self.assertEqual(self.team("show", "beta")["other_names"], ["beta"])
        for team, into, words in (("beta", "alpha", 'team "beta" was merged into team "alpha"'),
                                  ("alpha", "beta", 'team "beta" was merged into team "alpha"'),
                                  ("alpha", "alpha", "into itself"),
                                  ("alpha", "nobody", 'there is no team "nobody"')):
            self.refused(words, "team", "merge", team, "--into", into, "--yes")
        self.stop(signal.SIGTERM)
        self.start()
        self.assertEqual(self.teams_of_rows(), [("alpha", 1)])

    def rows_of_the_past(self):
        store = sqlite3.connect(f"file:{self.data}/store.db?mode=ro", uri=True)
        self.addCleanup(store.close)
        return [store.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall()
                for table in ("submission", "ledger")]

    def test_on_a_terminal_a_merge_asks(self):
        for team in ("alpha", "beta"):
            self.team("create", team)
        for answer, status, after in (("n\n", 1, 2), ("\n", 1, 2), ("y\n", 0, 1)):
            leader, follower = pty.openpty()
            verb = subprocess.Popen(
                [self.daemon.programs / "myograde", "team", "merge", "beta", "--into", "alpha",
                 "--data", self.data], stdin=follower, stdout=follower, stderr=follower,
                env=self.daemon.environment)
            try:
                os.close(follower)
                shown = self.read_until(leader, "[y/N] ")
                self.assertIn("a merge can't be undone", " ".join(shown.split()))
                os.write(leader, answer.encode())
                self.assertEqual(verb.wait(timeout=60), status)
            finally:
                verb.kill()
                verb.wait()
                os.close(leader)
            left = [team for team in self.get("/v1/teams")["teams"] if not team["merged_into"]]
            self.assertEqual(len(left), after, answer)

    def read_until(self, terminal, words):
        text, deadline = "", time.monotonic() + 60
        while words not in text:
            self.assertLess(time.monotonic(), deadline, text)
            if select.select([terminal], [], [], 1)[0]:
                text += os.read(terminal, 4096).decode(errors="replace")
        return text

    def test_what_waits_follows_its_team(self):
        first = self.submit("slow", team="alpha")
        second = self.submit("slow", team="beta")
        third = self.submit("slow", team="beta", seeds=[101, 102])
        self.wait(f"/v1/submissions/{first}", lambda b: b["state"] == "running")
        self.ask("team", "merge", "alpha", "--into", "beta", "--yes")
        self.team("rename", "beta", "gamma")
        fourth = self.submit("ok", team="alpha", seeds=[103, 104])
        for submission in (first, second, third, fourth):
            ended = self.ended(submission)
            self.assertEqual((ended["state"], ended["team"]), ("done", "gamma"))

    def test_a_banned_team_hands_in_nothing_and_leaves_the_boards(self):
        self.played("ok", team="alpha")
        self.played("ok", team="beta")
        running = self.submit("slow", team="alpha", seeds=[101, 102, 103, 104])
        self.refused("--reason", "team", "ban", "alpha")
        banned = self.team("ban", "alpha", "--reason", "two names of one group")
        self.assertTrue(banned["banned"])
        self.assertFalse(self.team("ban", "alpha", "--reason", "again")["changed"])
        self.assertEqual(self.teams_of_rows(), [("beta", 2)])
        sentence = ('team "alpha" is banned by the organisers (two names of one group): nothing '
                    "more is taken from it")
        for status, answer in (self.try_submit("alpha"),
                               self.call("POST", f"/v1/artefacts?team=alpha&track={TRACK}", b"x")):
            self.assertEqual((status, answer["error"]["code"]), (403, "banned"), answer)
            self.assertIn(sentence, answer["error"]["message"])
        self.refused("unban it first", "team", "merge", "alpha", "--into", "beta", "--yes")
        self.assertEqual(self.ended(running)["state"], "done", "what was accepted goes on")
        self.assertEqual(self.get("/v1/submissions/1")["team"], "alpha")
        self.assertFalse(self.team("unban", "alpha")["banned"])
        self.assertEqual(sorted(self.teams_of_rows()), [("alpha", 1), ("beta", 2)])
        self.assertEqual(self.try_submit("alpha")[0], 200, "and its ranked evaluation is there")

    def test_bad_requests_are_told_in_one_sentence(self):
        self.team("create", "alpha")
        for path, body, words in (
                ("/v1/teams", {}, "team"),
                ("/v1/teams", {"team": "x\u3164"}, "U+3164"),
                ("/v1/teams", {"team": "x", "colour": 1}, "colour"),
                ("/v1/teams", {"team": "x", "reason": ""}, "reason"),
                ("/v1/teams/alpha/rename", {"name": 7}, "name"),
                ("/v1/teams/alpha/rename", {"name": "x" * 65}, "64"),
                ("/v1/teams/alpha/members", {"person": "root"}, "belongs"),
                ("/v1/teams/alpha/merge", {"into": "b", "dry_run": "yes"}, "dry_run"),
                ("/v1/teams/alpha/ban", {"banned": True}, "reason")):
            status, answer = self.call("POST", path, body)
            self.assertEqual((status, answer["error"]["code"]), (400, "bad_request"), answer)
            self.assertIn(words, answer["error"]["message"])
        for path, status in (("/v1/teams/" + "x" * 65, 404), ("/v1/teams/", 404),
                             ("/v1/teams/alpha/paint", 405)):
            self.assertEqual(self.call("POST", path, {})[0], status, path)
        self.assertEqual(self.call("GET", "/v1/teams/%00")[0], 400)
        self.assertEqual(self.call("GET", "/v1/teams?x=1")[0], 400)

    def test_an_export_takes_teams_along_and_no_tokens(self):
        self.played("ok", team="alpha")
        self.team("rename", "alpha", "beta")
        self.team("add-member", "alpha", "uid 4001")
        token = self.ask("token", "create", "--team", "beta", "--label", "x")["token"]
        export, copy = str(self.folder / "export.json"), str(self.folder / "copy")
        self.cli("store", "export", export)
        with open(export, encoding="utf-8") as file:
            text = file.read()
        self.assertNotIn(token, text)
        board = self.board()
        self.stop(signal.SIGTERM)
        self.cli("store", "import", export, data=copy)
        self.daemon.data = copy
        self.start()
        self.assertIn("uid 4001", self.team("show", "alpha")["members"])
        self.assertEqual(self.board(), board)
        self.assertEqual(self.get("/v1/tokens")["tokens"], [])


class Tokens(PeopleCase):
    def ask_with(self, token, method, path, body=None):
        connection = Connection(self.daemon.socket_path)
        self.addCleanup(connection.close)
        sent = json.dumps(body) if isinstance(body, dict) else body
        connection.request(method, path, sent, {"Authorization": f"Bearer {token}"})
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())

    def make(self, **more):
        return self.ask("token", "create", "--label", "x", *[
            word for key, value in more.items() for word in (f"--{key}", value)])

    def test_a_holder_acts_for_the_team_whatever_becomes_of_it(self):
        for team in ("alpha", "beta"):
            self.team("create", team)
        token = self.make(team="alpha")["token"]
        status, own = self.ask_with(token, "GET", "/v1/teams/alpha")
        self.assertEqual((status, own["team"]), (200, "alpha"), own)
        others = self.ask_with(token, "GET", "/v1/teams/beta")
        nobody = self.ask_with(token, "GET", "/v1/teams/nobo")
        self.assertEqual(others[0], 404, others)
        self.assertEqual(json.dumps(others).replace("beta", "nobo"), json.dumps(nobody),
                         "nothing tells that there is a team")
        for method, path, body in (
                ("GET", "/v1/teams", None), ("POST", "/v1/teams", {"team": "gamma"}),
                ("POST", "/v1/teams/alpha/rename", {"name": "gamma"}),
                ("POST", "/v1/teams/alpha/members", {"person": "root", "belongs": True}),
                ("POST", "/v1/teams/alpha/merge", {"into": "beta"}),
                ("POST", "/v1/teams/alpha/ban", {"banned": False}),
                ("GET", "/v1/tokens", None), ("POST", "/v1/tokens", {"role": "operator"}),
                ("POST", "/v1/tokens/1/revoke", {})):
            status, answer = self.ask_with(token, method, path, body)
            self.assertEqual((status, answer["error"]["code"]), (403, "forbidden"), path)
        self.team("rename", "alpha", "gamma")
        status, upload = self.ask_with(token, "POST", f"/v1/artefacts?team=alpha&track={TRACK}",
                                       played_by_stand_in("ok"))
        self.assertEqual(status, 201, upload)
        submitted = {"artefact": upload["artefact"], "team": "alpha", "track": TRACK}
        status, answer = self.ask_with(token, "POST", "/v1/submissions", submitted)
        self.assertEqual((status, answer["team"]), (201, "gamma"), answer)
        self.ended(answer["submission"])
        self.ask("team", "merge", "gamma", "--into", "beta", "--yes")
        status, answer = self.ask_with(token, "GET", f"/v1/submissions/{answer['submission']}")
        self.assertEqual((status, answer["team"]), (200, "beta"), answer)
        self.team("ban", "beta", "--reason", "r")
        for path, body in ((f"/v1/artefacts?team=beta&track={TRACK}", b"x"),
                           ("/v1/artefacts", played_by_stand_in("slow")),
                           ("/v1/submissions", submitted),
                           (f"/v1/submissions/{answer['submission']}/rerun", {})):
            refused = self.ask_with(token, "POST", path, body)
            self.assertEqual((refused[0], refused[1]["error"]["code"]), (403, "banned"), refused)
        self.assertEqual(self.ask_with(token, "GET",
                                       f"/v1/submissions/{answer['submission']}")[0], 200)
        used = self.get("/v1/tokens")["tokens"][0]["last_used_at"]
        self.assertRegex(used, ":00.000Z$")

    def test_tokens_that_are_not_valid_open_nothing(self):
        self.team("create", "alpha")
        made = self.make(team="alpha")
        self.ask("token", "revoke", made["id"])
        for token in (made["token"], "myo_" + "0" * 64, "myo_", "x", made["token"].upper()):
            status, answer = self.ask_with(token, "GET", "/v1/teams/alpha")
            self.assertIn(status, (400, 401, 429), answer)
            self.assertNotIn(made["token"], json.dumps(answer))

    def test_only_operators_make_tokens_of_organisers(self):
        organiser = self.make(role="organiser")
        operator = self.make(role="operator")
        self.team("create", "alpha")
        for role, status in (("participant", 201), ("organiser", 403), ("operator", 403)):
            body = {"role": role, "label": "x", **({"team": "alpha"} if status == 201 else {})}
            answer = self.ask_with(organiser["token"], "POST", "/v1/tokens", body)
            self.assertEqual(answer[0], status, answer)
        for token in (organiser, operator):
            path = f"/v1/tokens/{token['id']}/revoke"
            self.assertEqual(self.ask_with(organiser["token"], "POST", path, {})[0], 403)
        path = f"/v1/tokens/{organiser['id']}/revoke"
        self.assertEqual(self.ask_with(operator["token"], "POST", path, {})[0], 200)

    def test_a_token_is_shown_once_and_kept_as_a_hash(self):
        self.team("create", "alpha")
        made = self.ask("token", "create", "--team", "alpha", "--label", "Ada's laptop", "--days",
                        3, schema="token")
        self.assertRegex(made["token"], "^myo_[0-9a-f]{64}$")
        self.assertEqual((made["role"], made["team"], made["state"], made["last_used_at"]),
                         ("participant", "alpha", "active", None))
        ends = datetime.datetime.fromisoformat(made["expires_at"].replace("Z", "+00:00"))
        begins = datetime.datetime.fromisoformat(made["created_at"].replace("Z", "+00:00"))
        self.assertAlmostEqual((ends - begins).total_seconds(), 3 * 86400, delta=60)
        listed = self.ask("token", "list", schema="tokens")
        self.assertEqual(listed["tokens"],
                         [{key: value for key, value in made.items() if key != "token"}])
        text = self.cli("token", "list").stdout + (self.folder / "daemon.log").read_text()
        digits = made["token"][4:]
        self.assertNotIn(digits, text)
        for path in self.data.rglob("*"):
            if path.is_file():
                self.assertNotIn(digits.encode(), path.read_bytes(), path)
        other = self.ask("token", "create", "--team", "alpha", "--label", "y")
        self.assertNotEqual(other["token"], made["token"])
        self.assertIsNone(other["expires_at"])
        shown = self.cli("token", "create", "--role", "operator", "--label", "the service").stdout
        self.assertRegex(shown, r"(?m)^myo_[0-9a-f]{64}$")
        self.assertEqual(len(re.findall("myo_", shown)), 1)

    def test_a_token_is_revoked_and_expires(self):
        self.team("create", "alpha")
        first = self.ask("token", "create", "--team", "alpha", "--label", "x")["id"]
        revoked = self.ask("token", "revoke", first, schema="token")
        self.assertEqual((revoked["state"], revoked["changed"]), ("revoked", True))
        again = self.ask("token", "revoke", first, schema="token")
        self.assertFalse(again["changed"])
        self.assertEqual(again["revoked_at"], revoked["revoked_at"])
        self.assertIn("was already revoked", self.cli("token", "revoke", first).stdout)
        self.refused("there is no token 99", "token", "revoke", 99)
        self.assertEqual(self.call("POST", "/v1/tokens/99/revoke", {})[0], 404)
        made_at = datetime.datetime.fromisoformat(revoked["created_at"].replace("Z", "+00:00"))
        end = (made_at + datetime.timedelta(seconds=5)).strftime("%Y-%m-%dT%H:%M:%SZ")
        second = self.ask("token", "create", "--team", "alpha", "--label", "y", "--expires", end)
        self.assertEqual(second["state"], "active")
        self.wait("/v1/tokens", lambda b: b["tokens"][0]["state"] == "expired")
        self.assertEqual(self.get("/v1/tokens?limit=1")["tokens"][0]["id"], second["id"])

    def test_bad_requests_are_told_in_one_sentence(self):
        self.team("create", "alpha")
        good = {"role": "participant", "team": "alpha", "label": "x"}
        for change, code, words in (
                ({"role": "emperor"}, "bad_request", "role"),
                ({"role": "organiser"}, "bad_request", "team"),
                ({"team": "beta"}, "unknown_team", 'there is no team "beta"; create it first'),
                ({"label": ""}, "bad_request", "label"),
                ({"label": "x" * 101}, "bad_request", "label"),
                ({"valid_days": 0}, "bad_request", "valid_days"),
                ({"valid_days": 3651}, "bad_request", "valid_days"),
                ({"valid_days": 1, "expires_at": "2999-01-01T00:00:00Z"}, "bad_request", "one of"),
                ({"expires_at": "2020-01-01T00:00:00Z"}, "bad_request", "in the past"),
                ({"expires_at": "2999-01-01T00:00:00Z"}, "bad_request", "3650 days ahead"),
                ({"expires_at": "tomorrow"}, "bad_request", "must be a time like"),
                ({"hash": "0" * 64}, "bad_request", "hash")):
            status, answer = self.call("POST", "/v1/tokens", {**good, **change})
            self.assertEqual((status, answer["error"]["code"]), (400, code), answer)
            self.assertIn(words, answer["error"]["message"])
        self.assertEqual(self.get("/v1/tokens")["tokens"], [])
        self.refused("--label", "token", "create", "--team", "alpha")
        self.refused("--days", "token", "create", "--label", "x", "--days", "0")
        self.refused("not a token's number", "token", "revoke", "x")


if __name__ == "__main__":
    unittest.main(verbosity=2)
