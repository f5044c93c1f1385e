"""The verbs team and token: what they ask of the daemon, and what they print.
usage: people_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import subprocess
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import BIN_DIR, CliCase, Handler, myograde  # pylint: disable=wrong-import-position

LISTED = {"team": "alpha", "created_at": "2026-01-01T00:00:00.000Z", "banned": False,
          "merged_into": None, "other_names": ["Team \x1b[2JBlue"], "members": ["uid 1001"]}
TEAM = {**LISTED, "submissions": 3, "changed": True, "unreadable": [],
        "memberships": [{"person": "uid 1001", "since_at": "2026-01-01T00:00:00.000Z",
                         "who": "uid 0"}],
        "events": [{"at": "2026-01-01T00:00:00.000Z", "team": "alpha", "event": "renamed",
                    "detail": "Team Blue", "who": "uid 0", "reason": None}]}
SUM = {"limit": 5, "granted": 1, "used_by_team": 2, "used_by_into": 4, "used": 6, "left": 0}
BUDGET = {"per_day": SUM, "total": {**SUM, "limit": 100, "left": 95}}
MERGE = {"team": "beta", "into": "alpha", "merged": False, "submissions_of_team": 1,
         "submissions": 4, "tokens_of_team": 1, "members": ["uid 1001", "uid 1002"],
         "phases": [{"phase": "final", "track": "t", "official": BUDGET, "failed": BUDGET}],
         "tracks": [{"track": "t", "official": BUDGET, "practice": BUDGET, "failed": BUDGET}]}
TOKEN = {"id": 7, "role": "participant", "team": "alpha", "label": "laptop", "state": "active",
         "created_at": "2026-01-01T00:00:00.000Z", "created_by": "uid 0", "expires_at": None,
         "revoked_at": None, "revoked_by": None, "last_used_at": None}
PAGE = f"?limit=1000&before={2**63 - 1}"  # the first of a list
TEXT = "myo_" + "0123456789abcdef" * 4


class PeopleTest(CliCase):
    def heard(self):
        return [(command, path, json.loads(body or b"null"))
                for command, path, body in Handler.heard]

    def test_every_part_has_help_with_an_example(self):
        for verb, parts in (("team", ("create", "list", "show", "rename", "add-member",
                                      "remove-member", "merge", "ban", "unban")),
                            ("token", ("create", "list", "revoke"))):
            for part in parts:
                done = myograde(verb, part, "--help")
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertIn(f"Example:\n  myograde {verb} {part}", done.stdout)
                self.assertIn("--json", done.stdout)

    def test_wrong_use(self):
        self.refused(2, 'did you mean "team rename"?', "team", "renam", "a", "b")
        self.refused(2, 'did you mean "token revoke"?', "token", "revok", "7")
        self.refused(2, "no verb given", "team")
        for words in (("team", "create"), ("team", "rename", "a"), ("team", "add-member", "a"),
                      ("team", "merge", "a"), ("team", "ban", "a"), ("token", "create"),
                      ("token", "revoke"), ("team", "list", "a")):
            self.refused(2, "", *words)
        for bad in ("0", "x", "-1", "1.5"):
            self.refused(2, "not a token's number", "token", "revoke", bad)
        self.refused(2, "--role", "token", "create", "--label", "x", "--role", "emperor")
        self.refused(2, "", "token", "create", "--label", "x", "--days", "1", "--expires",
                     "2999-01-01T00:00:00Z")

    def test_what_is_asked_and_answered(self):
        path = "/v1/teams/a%2Fb%20%C3%A4"
        socket = self.serve({
            "POST /v1/teams": (201, TEAM), f"GET /v1/teams{PAGE}": (200, {"teams": [{**LISTED, "submissions": 3, "tokens": 1}],
                                                                   "unreadable": []}),
            f"GET {path}": (200, TEAM), f"POST {path}/rename": (200, TEAM),
            f"POST {path}/members": (200, TEAM), f"POST {path}/ban": (200, TEAM),
            f"POST {path}/merge": (200, MERGE),
            "POST /v1/tokens": (201, {**TOKEN, "token": TEXT}),
            f"GET /v1/tokens{PAGE}": (200, {"tokens": [TOKEN], "unreadable": []}),
            "POST /v1/tokens/7/revoke": (200, {**TOKEN, "changed": True})})
        at, name = ("--socket", socket), "a/b \u00e4"
        self.checked("team", "team", "create", name, "--reason", "r", *at)
        self.checked("teams", "team", "list", *at)
        self.checked("team", "team", "show", name, *at)
        self.checked("team", "team", "rename", name, "new", *at)
        self.checked("team", "team", "add-member", name, "ada", *at)
        self.checked("team", "team", "remove-member", name, "ada", *at)
        self.checked("team", "team", "ban", name, "--reason", "r", *at)
        self.checked("team", "team", "unban", name, *at)
        self.checked("team_merge", "team", "merge", name, "--into", "b", "--dry-run", *at)
        self.checked("token", "token", "create", "--team", "b", "--label", "l", "--days", "2", *at)
        self.checked("tokens", "token", "list", *at)
        self.checked("token", "token", "revoke", "7", *at)
        self.assertEqual(self.heard(), [
            ("POST", "/v1/teams", {"team": name, "reason": "r"}),
            ("GET", f"/v1/teams{PAGE}", None), ("GET", path, None),
            ("POST", f"{path}/rename", {"name": "new"}),
            ("POST", f"{path}/members", {"person": "ada", "belongs": True}),
            ("POST", f"{path}/members", {"person": "ada", "belongs": False}),
            ("POST", f"{path}/ban", {"banned": True, "reason": "r"}),
            ("POST", f"{path}/ban", {"banned": False}),
            ("POST", f"{path}/merge", {"into": "b", "dry_run": True}),
            ("POST", "/v1/tokens", {"role": "participant", "team": "b", "label": "l",
                                    "valid_days": 2}),
            ("GET", f"/v1/tokens{PAGE}", None), ("POST", "/v1/tokens/7/revoke", {})])

    def test_text_for_people(self):
        socket = self.serve({
            f"GET /v1/teams{PAGE}": (200, {"teams": [LISTED, {**LISTED, "team": "beta", "banned": True},
                                              {**LISTED, "team": "c", "merged_into": "alpha"}],
                                    "unreadable": []}),
            "GET /v1/teams/alpha": (200, TEAM),
            "POST /v1/teams/beta/merge": (200, MERGE),
            "POST /v1/tokens": (201, {**TOKEN, "token": TEXT}),
            f"GET /v1/tokens{PAGE}": (200, {"tokens": [], "unreadable": []})})
        at = ("--socket", socket)
        listed = myograde("team", "list", *at).stdout
        self.assertNotIn("\x1b", listed)
        self.assertRegex(listed, r"(?m)^beta .*banned$")
        self.assertRegex(listed, r"(?m)^c .*merged into alpha$")
        self.assertIn("Team Blue", myograde("team", "show", "alpha", *at).stdout)
        merge = myograde("team", "merge", "beta", "--into", "alpha", "--yes", *at).stdout
        self.assertIn("4 + 2 = 6 of 6", merge)
        self.assertRegex(merge, r"(?m)^final +official ")
        self.assertIn("the limits stay those of one team", merge)
        self.assertIn("Team beta is now a part of team alpha, which has 4 submissions.", merge)
        self.assertEqual([body["dry_run"] for command, _, body in self.heard()
                          if command == "POST"], [True, False])
        created = myograde("token", "create", "--team", "alpha", "--label", "l", *at).stdout
        self.assertIn(f"\n{TEXT}\n", created)
        self.assertIn("shown only once", created)
        self.assertIn("There are no tokens yet", myograde("token", "list", *at).stdout)

    def test_a_token_that_cannot_be_printed_is_revoked(self):
        socket = self.serve({"POST /v1/tokens": (201, {**TOKEN, "token": TEXT}),
                             "POST /v1/tokens/7/revoke": (200, {**TOKEN, "changed": True})})
        for more in ((), ("--json",)):
            Handler.heard.clear()
            with open("/dev/full", "w", encoding="utf-8") as full:
                done = subprocess.run(
                    [f"{BIN_DIR}/myograde", "token", "create", "--label", "l", "--socket", socket, *more],
                    stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
            self.assertEqual(done.returncode, 4)
            self.assertIn("token 7 could not be printed (No space left on device), so it is revoked",
                          done.stderr)
            self.assertNotIn(TEXT, done.stderr)
            self.assertEqual(self.heard()[-1][1], "/v1/tokens/7/revoke")

    def test_without_a_terminal_a_merge_needs_yes_and_asks_nothing_before(self):
        socket = self.serve({})
        self.refused(2, "give --yes", "team", "merge", "a", "--into", "b", "--socket", socket)
        self.assertEqual(self.heard(), [])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
