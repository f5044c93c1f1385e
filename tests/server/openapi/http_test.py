"""What clients of an open API expect of HTTP: methods, tags, pages."""

import json
import re
import unittest

from support.client import Connection
from world import TRACK, World, moment

BOARD = f"/v1/leaderboard?track={TRACK}"
LIST = "/v1/submissions"
LOGO = "/v1/challenges/cup/logo.png"


class Http(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # On another track, whose own board it does not touch.
        cls.world = World({"form": 1, "title": "A cup", "phases": [
            {"name": "past", "title": "Past", "track": "elbow", "profile": "hold", "closes_at": moment(-2)}]})
        cls.addClassCleanup(cls.world.close)
        (cls.world.configs / "challenges/cup.png").write_bytes(b"\x89PNG\r\n\x1a\n and so on")
        cls.world.start()

    def ask(self, method, path, body=None, **headers):
        """Status, headers and body of an answer. The connection is used for a second request, so
        that an answer that is longer or shorter than it says is noticed."""
        connection = Connection(self.world.socket_path)
        try:
            connection.request(method, path, body, {key.replace("_", "-"): value
                                                    for key, value in headers.items()})
            answer = connection.getresponse()
            text = answer.read()
            connection.request("GET", "/v1/key")
            self.assertEqual(connection.getresponse().status, 200)
            return answer.status, answer.headers, text
        finally:
            connection.close()

    # --- methods ---

    def test_options_names_the_methods(self):
        for path, allowed in ((LIST, "GET, HEAD, OPTIONS, POST"), ("/v1/health", "GET, HEAD, OPTIONS"),
                              ("/v1/submissions/1/cancel", "OPTIONS, POST"),
                              ("/v1/submissions/999?x=1", "GET, HEAD, OPTIONS")):
            status, headers, text = self.ask("OPTIONS", path)
            self.assertEqual((status, headers["Allow"], text), (204, allowed, b""))
            self.assertNotIn("Content-Length", headers)
            self.assertFalse([name for name in headers if name.startswith("Access-Control")])

    def test_another_method_is_405_and_told_what_there_is(self):
        for method, path in (("DELETE", LIST), ("PUT", "/v1/health"), ("PATCH", LIST),
                             ("POST", "/v1/health"), ("GET", "/v1/submissions/1/cancel"),
                             ("TRACE", LIST), ("QUERY", LIST), ("FETCH", LIST + "?team=a")):
            body = "{}" if method in ("PUT", "POST", "PATCH") else None
            status, headers, text = self.ask(method, path, body)
            self.assertEqual(status, 405, (method, path))
            self.assertIn("OPTIONS", headers["Allow"])
            self.assertNotIn(method, headers["Allow"])
            error = json.loads(text)["error"]
            self.assertEqual(error["code"], "method_not_allowed")
            self.assertIn(headers["Allow"], error["message"])

    def test_an_address_that_is_not_there_has_no_methods(self):
        for method in ("GET", "OPTIONS", "DELETE", "POST"):
            status, headers, text = self.ask(method, "/v1/nothing", "{}" if method == "POST" else None)
            self.assertEqual(status, 404)
            self.assertNotIn("Allow", headers)
            self.assertEqual(json.loads(text)["error"]["code"], "not_found")

    def test_head_is_get_without_the_body(self):
        for path in (LIST, BOARD, "/v1/openapi.json", "/v1/export", "/v1/submissions/99",
                     "/v1/logs/" + "a" * 64, "/v1/submissions?limit=0"):
            got = self.ask("GET", path)
            status, headers, text = self.ask("HEAD", path)
            self.assertEqual((status, text), (got[0], b""), path)
            self.assertEqual(headers["Content-Type"], got[1]["Content-Type"])
            self.assertEqual(headers["ETag"], got[1]["ETag"])
            self.assertEqual(int(headers["Content-Length"]), len(got[2]), path)

    # --- tags ---

    def test_what_has_a_tag_is_not_sent_twice(self):
        for path in (BOARD, f"/v1/leaderboard/statistics?track={TRACK}", f"/v1/leaderboard/explain?track={TRACK}&a=alpha&b=beta",
                     "/v1/openapi.json", LOGO):
            status, headers, text = self.ask("GET", path)
            self.assertEqual(status, 200, text)
            tag = headers["ETag"]
            self.assertRegex(tag, r'^"[0-9a-f]{64}"$')
            self.assertEqual(headers["Cache-Control"], "no-cache")
            for given in (tag, f'"x", W/{tag}', "*"):
                status, headers, text = self.ask("GET", path, If_None_Match=given)
                self.assertEqual((status, headers["ETag"], text), (304, tag, b""))
                self.assertNotIn("Content-Length", headers)
            self.assertEqual(self.ask("HEAD", path, If_None_Match=tag)[0], 304)
            for given in ('"x"', tag.strip('"'), ""):
                self.assertEqual(self.ask("GET", path, If_None_Match=given)[0], 200, given)

    def test_a_board_that_changes_has_another_tag(self):
        tag = self.ask("GET", BOARD)[1]["ETag"]
        self.world.post(f"/v1/submissions/{self.world.submissions[0]}/marks",
                        {"mark": "baseline", "set": True})
        status, headers, _ = self.ask("GET", BOARD, If_None_Match=tag)
        self.assertEqual(status, 200)
        self.assertNotEqual(headers["ETag"], tag)
        self.world.post(f"/v1/submissions/{self.world.submissions[0]}/marks",
                        {"mark": "baseline", "set": False})
        self.assertEqual(self.ask("GET", BOARD)[1]["ETag"], tag)

    def test_other_answers_are_not_kept(self):
        for path in (LIST, "/v1/health", "/v1/whoami", "/v1/submissions/99", "/v1/nothing"):
            headers = self.ask("GET", path)[1]
            self.assertEqual(headers["Cache-Control"], "no-store")
            self.assertNotIn("ETag", headers)

    # --- pages ---

    def pages_of(self, path, rows):
        """The rows of all pages of one row each."""
        collected, address = [], path + ("&" if "?" in path else "?") + "limit=1"
        while address:
            status, headers, text = self.ask("GET", address)
            self.assertEqual(status, 200, text)
            page = json.loads(text)
            collected += page[rows]
            link, address = headers["Link"], None
            if link is None:
                self.assertIsNone(page["next_before"])
            else:
                address = re.fullmatch(r'<(/v1/.*)>; rel="next"', link).group(1)
                self.assertIn(f"before={page['next_before']}", address)
                self.assertIn("limit=1", address)
        return collected

    def check_pages(self, path, rows, key, count):
        # Acts are written after their answer: the list may still grow.
        for _ in range(10):
            whole = self.world.get(path)
            collected = self.pages_of(path, rows)
            if self.world.get(path) == whole:
                break
        self.assertGreaterEqual(len(whole[rows]), count, path)
        self.assertIsNone(whole["next_before"])
        self.assertNotIn("Link", self.ask("GET", path)[1])
        self.assertEqual([row[key] for row in collected], [row[key] for row in whole[rows]])
        numbers = [row[key] for row in collected if isinstance(row[key], int)]
        self.assertEqual(numbers, sorted(numbers, reverse=True))

    def test_every_list_has_pages(self):
        for team in ("alpha", "beta"):
            self.world.post("/v1/quota/grants", {"team": team, "track": TRACK, "amount": 1,
                                                 "budget": "official", "reason": "a & b"})
        self.check_pages("/v1/submissions", "submissions", "submission", 2)
        self.check_pages("/v1/submissions?team=alpha&state=done", "submissions", "submission", 1)
        self.check_pages("/v1/quota?team=alpha", "ledger", "id", 2)
        self.check_pages("/v1/teams", "teams", "team", 2)
        self.check_pages("/v1/tokens", "tokens", "id", 3)
        self.check_pages("/v1/events?kind=act", "events", "id", 2)

    def test_a_page_is_asked_for_with_numbers(self):
        for path in ("/v1/submissions", "/v1/quota?team=alpha", "/v1/teams", "/v1/tokens",
                     "/v1/events"):
            joint = "&" if "?" in path else "?"
            for query in ("limit=0", "limit=1001", "limit=", "limit=%2B5", "limit=1&limit=2",
                          "before=0", "before=9223372036854775808", "before=x"):
                status, _, text = self.ask("GET", path + joint + query)
                self.assertEqual(status, 400, path + joint + query)
                self.assertIn(query.split("=")[0], json.loads(text)["error"]["message"])


if __name__ == "__main__":
    unittest.main(verbosity=2)
