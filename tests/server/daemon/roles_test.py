"""Who may do what: every address of the API is asked as every role, and each must answer as
GET /v1/addresses says (tests/server/openapi compares that with what is documented)."""

import http.client
import json
import re
import unittest
import urllib.parse

from organiser_test import OrganiserCase
from support.submission import played_by_stand_in
from support.waiting import wait_until

TRACK = "demo-manipulation"
MISSING = 987654
NO_HASH = "0" * 64
RANKS = ("public", "participant", "organiser", "operator")
# A body that no address takes: an error of its own shows that the caller was let through.
WRONG = {"no such key": 1}
# What lists a team's own, and nothing for others.
LISTS = ("/v1/queue", "/v1/queue/events", "/v1/submissions")


class AccessCase(OrganiserCase):
    """A daemon with a port, two teams with a token each, and tokens of an organiser and an
    operator. Team alpha has a submission, whose episodes have logs."""

    def start(self):
        self.configure(http={"listen": {"address": "127.0.0.1", "port": 0}})
        super().start()
        # Of the last daemon, it would name a port that is closed.
        url = urllib.parse.urlsplit((self.data / "listen").read_text().strip())
        self.address = (url.hostname, url.port)

    def ask_as(self, token, method, path, body=None, kind=None, headers=()):
        """Status, headers and text of an answer over TCP."""
        connection = http.client.HTTPConnection(*self.address, timeout=60)
        try:
            sent = dict(headers)
            if token is not None:
                sent["Authorization"] = f"Bearer {token}"
            if isinstance(body, dict):
                body, kind = json.dumps(body), kind or "application/json"
            if kind:
                sent["Content-Type"] = kind
            connection.request(method, path, body, sent)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def make(self, path, body):
        status, answer = self.call("POST", path, body)
        self.assertIn(status, (200, 201), answer)
        return answer

    def token(self, role, team=None, **more):
        body = {"role": role, "label": "test", **more, **({"team": team} if team else {})}
        return self.make("/v1/tokens", body)

    def setUp(self):
        super().setUp()
        self.tokens = {"public": None}
        for team in ("alpha", "beta"):
            self.make("/v1/teams", {"team": team})
            self.tokens[team] = self.token("participant", team)["token"]
        for role in ("organiser", "operator"):
            self.tokens[role] = self.token(role)["token"]
        self.submission = self.submit_as("alpha", "logged")
        self.ended(self.submission)

    def submit_as(self, team, mode, name="fake"):
        status, _, text = self.ask_as(self.tokens[team], "POST", "/v1/artefacts",
                                      played_by_stand_in(mode, name), "application/x-tar")
        self.assertIn(status, (200, 201), text)
        self.artefact = json.loads(text)["artefact"]
        status, _, text = self.ask_as(self.tokens[team], "POST", "/v1/submissions", {
            "artefact": self.artefact, "team": team, "track": TRACK})
        self.assertEqual(status, 201, text)
        return json.loads(text)["submission"]

    def events(self, **wanted):
        """The events with these values, once there are any."""
        def found():
            return [event for event in self.get("/v1/events?limit=1000")["events"]
                    if all(event[key] == value for key, value in wanted.items())]
        return wait_until(found, 30, f"there is no event {wanted}")


class EveryAddress(AccessCase):
    def setUp(self):
        super().setUp()
        result = self.get(f"/v1/submissions/{self.submission}/result?episodes=1")
        self.evaluation = result["evaluation"]
        self.log = result["episode_rows"][0]["log"]["sha256"]
        (self.data / "logs" / f"{self.log}.lcmlog.zst").write_bytes(b"a log")

    def requests(self, method, path):
        """What to ask: pairs of a path and a body for alpha's thing, and for one that there is not;
        for an address without things the same twice."""
        submit = {"artefact": self.artefact, "track": TRACK}
        special = {
            ("POST", "/v1/artefacts"): [
                (f"{path}?team={team}&track={TRACK}", played_by_stand_in("logged"))
                for team in ("alpha", "nobody")],
            ("POST", "/v1/submissions"): [
                (path, {**submit, "team": team}) for team in ("alpha", "nobody")],
            ("GET", "/v1/quota"): [(f"{path}?team={team}", None) for team in ("alpha", "nobody")],
            # It would go on: whether it is refused shows before.
            ("GET", "/v1/queue/events"): [(f"{path}?no_such_key=1", None)] * 2,
            ("GET", "/v1/leaderboard"): [(f"{path}?track={TRACK}", None)] * 2,
            ("GET", "/v1/leaderboard/badge"): [(f"{path}?track={TRACK}&team=alpha", None)] * 2,
            ("GET", "/v1/leaderboard/feed"): [(f"{path}?track={TRACK}", None)] * 2,
            ("GET", "/v1/leaderboard/statistics"): [
                (f"{path}?track={TRACK}", None)] * 2,
            ("GET", "/v1/leaderboard/explain"): [(f"{path}?track={TRACK}&a=1&b=2", None)] * 2,
        }
        if (method, path) in special:
            return special[method, path]
        own = self.evaluation if "evaluations" in path else self.submission
        takes_nothing = path.endswith(("/cancel", "/choose", "/rerun"))
        body = None if method in ("GET", "DELETE") else {} if takes_nothing else WRONG
        if method == "POST" and "/leases/" in path and path.endswith(("/records", "/HASH")):
            body = b"no records"
        here = path.replace("ID", str(own)).replace("HASH", self.log).replace("NAME", "alpha")
        gone = path.replace("ID", str(MISSING)).replace("HASH", NO_HASH).replace("NAME", "nobody")
        return [(here, body), (gone, body)]

    def ask(self, caller, method, request):
        path, body = request
        kind = "application/octet-stream" if isinstance(body, bytes) else None
        return self.ask_as(self.tokens[caller], method, path, body, kind)

    def anonymous(self, text):
        """An answer in which nothing tells what was asked for."""
        for name in (str(MISSING), str(self.submission), str(self.evaluation), NO_HASH, self.log):
            text = re.sub(rb"\b%s\b" % name.encode(), b"#", text)
        return re.sub(rb'team \\"(alpha|nobody)\\"', b"#", text)

    def test_each_answers_each_role_as_the_list_says(self):
        addresses = {(a["method"], a["path"]): (a["role"], a["own_team"])
                     for a in self.get("/v1/addresses")["addresses"]}
        for (method, path), (role, own_team) in sorted(addresses.items()):
            own, missing = self.requests(method, path)
            for caller in ("public", "beta", "alpha", "organiser", "operator"):
                with self.subTest(f"{method} {path} as {caller}"):
                    rank = "participant" if caller in ("alpha", "beta") else caller
                    status, headers, text = self.ask(caller, method, own)
                    if RANKS.index(rank) < RANKS.index(role):
                        self.check_refusal(caller, status, headers, text)
                        # Neither does it tell what there is.
                        self.assertEqual(text, self.ask(caller, method, missing)[2])
                    elif own_team and caller == "beta" and path not in LISTS or (
                            own_team and caller == "beta" and method == "POST"):
                        gone, _, told = self.ask(caller, method, missing)
                        self.assertEqual((status, gone), (404, 404), text)
                        self.assertEqual(self.anonymous(text), self.anonymous(told))
                    else:
                        self.assertNotIn(status, (401, 403, 405, 429, 500, 503), text)
                        if own_team and "HASH" not in path:
                            self.assertNotEqual(status, 404, text)

    def check_refusal(self, caller, status, headers, text):
        code = json.loads(text)["error"]["code"]
        if caller == "public":
            self.assertEqual((status, code, headers["WWW-Authenticate"]),
                             (401, "no_token", "Bearer"))
        else:
            self.assertEqual((status, code), (403, "forbidden"), text)

    def test_another_team_sees_nothing_in_lists(self):
        for caller, seen in (("alpha", [self.submission]), ("beta", []),
                             ("organiser", [self.submission])):
            for query in ("", "?team=alpha", f"?track={TRACK}"):
                _, _, text = self.ask_as(self.tokens[caller], "GET", "/v1/submissions" + query)
                listed = json.loads(text)
                self.assertEqual([row["submission"] for row in listed["submissions"]], seen)
                self.assertIsNone(listed["next_before"])

    def test_a_log_is_for_the_teams_that_have_it(self):
        def log_as(caller):
            return self.ask_as(self.tokens[caller], "GET", f"/v1/logs/{self.log}")
        self.assertEqual(log_as("alpha")[2], b"a log")
        self.assertEqual(log_as("beta")[0], 404)
        # The same policy plays the same.
        other = self.submit_as("beta", "logged")
        self.ended(other)
        self.assertEqual(log_as("beta")[2], b"a log")

    def test_nobody_but_organisers_sees_who_handed_in_the_same_bytes(self):
        other = self.submit_as("beta", "logged")
        for caller, told in (("beta", False), ("organiser", True)):
            _, _, text = self.ask_as(self.tokens[caller], "GET", f"/v1/submissions/{other}")
            self.assertEqual(b"same artefact" in text, told)

    def test_health_tells_each_what_is_theirs(self):
        keys = {}
        for caller in self.tokens:
            _, _, text = self.ask_as(self.tokens[caller], "GET", "/v1/health")
            keys[caller] = set(json.loads(text))
        public = {"status", "version", "api"}
        participant = public | {"slots", "running", "pending_blocks"}
        self.assertEqual((keys["public"], keys["alpha"]), (public, participant))
        self.assertLess(participant | {"pid", "data", "leases", "host"}, keys["organiser"])

    def test_large_bodies_are_refused_before_they_are_received(self):
        for caller, status in (("public", 401), ("organiser", 403)):
            connection = http.client.HTTPConnection(*self.address, timeout=30)
            token = self.tokens[caller]
            head = {"Content-Length": str(1 << 30)}
            if token:
                head["Authorization"] = f"Bearer {token}"
            connection.putrequest("POST", "/v1/import")
            for name, value in head.items():
                connection.putheader(name, value)
            connection.endheaders()
            self.assertEqual(connection.getresponse().status, status)
            connection.close()


class Tokens(AccessCase):
    def refused(self, token, message, code="bad_token"):
        status, headers, text = self.ask_as(token, "GET", "/v1/tracks")
        self.assertEqual((status, headers["WWW-Authenticate"]), (401, "Bearer"), text)
        error = json.loads(text)["error"]
        self.assertEqual(error["code"], code)
        self.assertIn(message, error["message"])
        return text

    def test_wrong_ones_are_told_alike_and_old_ones_how(self):
        unknown = "myo_" + "0" * 64
        self.assertEqual(self.refused(unknown, "not a token of this server"),
                         self.refused("nonsense", "not a token of this server"))
        made = self.token("participant", "alpha")
        self.make(f"/v1/tokens/{made['id']}/revoke", {})
        self.refused(made["token"], "revoked at 2")
        self.assertEqual(len(self.events(kind="denied", detail="wrong token")), 1)
        self.assertEqual(self.events(detail="revoked token")[0]["who"], f"token {made['id']}")

    def test_one_that_is_revoked_ends_at_once(self):
        made = self.token("organiser")
        self.assertEqual(self.ask_as(made["token"], "GET", "/v1/events")[0], 200)
        self.make(f"/v1/tokens/{made['id']}/revoke", {})
        self.refused(made["token"], "revoked")

    def test_an_operators_alone_makes_organisers(self):
        for role, status in (("organiser", 403), ("operator", 403)):
            self.assertEqual(self.ask_as(self.tokens["organiser"], "POST", "/v1/tokens", {
                "role": role, "label": "x"})[0], status)
        self.assertEqual(self.ask_as(self.tokens["operator"], "POST", "/v1/tokens", {
            "role": "organiser", "label": "x"})[0], 201)

    def test_two_are_none(self):
        connection = http.client.HTTPConnection(*self.address, timeout=30)
        connection.putrequest("GET", "/v1/tracks")
        for caller in ("alpha", "operator"):
            connection.putheader("Authorization", f"Bearer {self.tokens[caller]}")
        connection.endheaders()
        self.assertEqual(connection.getresponse().status, 400)
        connection.close()

    def test_guessing_costs_time_and_those_with_a_token_do_not_wait(self):
        self.assertEqual(self.ask_as(self.tokens["alpha"], "GET", "/v1/tracks")[0], 200)
        waits = []
        for _ in range(5):
            status, headers, text = self.ask_as("myo_" + "1" * 64, "GET", "/v1/tracks")
            if status == 429:
                waits.append(int(headers["Retry-After"]))
                self.assertIn("wrong tokens", json.loads(text)["error"]["message"])
        self.assertTrue(waits)
        # One that nobody has shown before has to wait as well, as it could be a guess.
        self.assertEqual(self.ask_as(self.tokens["beta"], "GET", "/v1/tracks")[0], 429)
        self.assertEqual(self.ask_as(self.tokens["alpha"], "GET", "/v1/tracks")[0], 200)
        # Nor do those who show none.
        self.assertEqual(self.ask_as(None, "GET", "/v1/tracks")[0], 200)

    def test_over_the_socket_a_token_replaces_the_user(self):
        connection = self.daemon_connection()
        connection.request("GET", "/v1/whoami", headers={
            "Authorization": f"Bearer {self.tokens['alpha']}"})
        who = json.loads(connection.getresponse().read())
        connection.close()
        self.assertEqual((who["role"], who["teams"], who["remote"]),
                         ("participant", ["alpha"], False))
        self.assertEqual(self.get("/v1/whoami")["role"], "operator")

    def daemon_connection(self):
        from support.client import Connection
        return Connection(self.daemon.socket_path)

    def test_when_it_was_used_is_noted(self):
        self.ask_as(self.tokens["beta"], "GET", "/v1/tracks")
        def used():
            return [t for t in self.get("/v1/tokens")["tokens"]
                    if t["team"] == "beta" and t["last_used_at"]]
        wait_until(used, 30, "it was never used")


class Limits(AccessCase):
    def start(self):
        self.configure(http={"requests_per_s": 0.5, "burst": 20})
        super().start()

    def test_each_caller_has_a_limit_of_their_own_and_organisers_none(self):
        answers = [self.ask_as(self.tokens["beta"], "GET", "/v1/tracks") for _ in range(40)]
        refused = [(headers["Retry-After"], text) for status, headers, text in answers
                   if status == 429]
        self.assertGreater(len(refused), 10)
        self.assertIn(refused[0][0], ("1", "2"))
        self.assertEqual(json.loads(refused[0][1])["error"]["code"], "too_many")
        # Addresses that there are none of count as well.
        self.assertEqual(self.ask_as(self.tokens["beta"], "GET", "/v1/nothing")[0], 429)
        self.assertEqual(self.ask_as(None, "GET", "/v1/tracks")[0], 200)
        for _ in range(40):
            self.assertEqual(self.ask_as(self.tokens["organiser"], "GET", "/v1/tracks")[0], 200)
            self.assertEqual(self.call("GET", "/v1/tracks")[0], 200)


class Events(AccessCase):
    def test_denials_are_counted_and_acts_are_told(self):
        for _ in range(3):
            self.ask_as(self.tokens["beta"], "GET", f"/v1/submissions/{self.submission}")
            self.ask_as(self.tokens["beta"], "GET", "/v1/events")
        self.ask("submission", "disqualify", self.submission, "--reason", "reads the seeds")
        denied = self.events(kind="denied", action="read submission", detail="another team's")
        self.assertEqual((denied[0]["who"], denied[0]["role"], denied[0]["subject"]),
                         ("token 2", "participant", None))
        act = self.events(kind="act", action="mark")[0]
        self.assertEqual((act["subject"], act["detail"], act["role"]),
                         (f"submission {self.submission}", "disqualified: reads the seeds",
                          "operator"))
        listed = self.ask("events", "--kind", "act", "--limit", 1, schema="events")
        self.assertEqual([event["kind"] for event in listed["events"]], ["act"])
        older = self.ask("events", "--before", listed["next_before"], schema="events")
        self.assertLess(older["events"][0]["id"], listed["events"][0]["id"])
        # None is lost when the daemon stops.
        self.stop(2)
        self.start()
        total = sum(event["count"] for event in self.events(kind="denied", detail="role"))
        self.assertEqual(total, 3)
        status, answer = self.call("GET", "/v1/events?kind=other")
        self.assertEqual(status, 400, answer)


if __name__ == "__main__":
    unittest.main(verbosity=2)
