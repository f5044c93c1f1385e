"""The web pages as they are served: their types, headers and tags, that no script of theirs parses
markup, and the queue's events, which they follow."""

import contextlib
import csv
import gzip
import http.client
import json
import pathlib
import re
import shutil
import subprocess
import tempfile
import unicodedata
import unittest
import urllib.parse
import xml.etree.ElementTree

from support import submission
from support.client import ApiError
from support.hostile_texts import NAMES, OTHERS
from support.waiting import wait_until
from world import MARKUP, SCRIPT, SOURCE, TRACK, World

FILES = SOURCE / "server/web/files"
PAGES = ("/", "/board", "/queue", "/replay", "/sign-in", "/submission", "/submit", "/team")
TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8",
         ".js": "text/javascript; charset=utf-8", ".svg": "image/svg+xml"}
# What would make markup of a text, or run one.
PARSERS = re.compile(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|DOMParser|setHTML|"
                     r"createContextualFragment|srcdoc|\beval\b|new Function|setAttribute\(\"style")


class PagesCase(unittest.TestCase):
    """All have one daemon, whose boards they leave as they are."""

    world = None

    def connect(self):
        url = urllib.parse.urlsplit(self.world.url)
        return http.client.HTTPConnection(url.hostname, url.port, timeout=30)

    def ask(self, method, path, role="public", **headers):
        """Status, headers and body of an answer on the network."""
        connection = self.connect()
        try:
            connection.request(method, path, headers=self.headers(role, headers))
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def headers(self, role, more=()):
        token = self.world.tokens[role]
        own = {key.replace("_", "-"): value for key, value in dict(more).items()}
        return {**own, **({"Authorization": f"Bearer {token}"} if token else {})}


def setUpModule():
    PagesCase.world = World()
    unittest.addModuleCleanup(PagesCase.world.close)
    PagesCase.world.start()


class Files(PagesCase):
    def test_each_file_is_served_as_what_it_is(self):
        addresses = [(path, FILES / "index.html") for path in PAGES]
        addresses += [(f"/web/{file.name}", file) for file in FILES.iterdir()
                      if file.name != "index.html"]
        self.assertGreater(len(addresses), 15)
        for path, file in addresses:
            status, headers, body = self.ask("GET", path)
            self.assertEqual((status, body), (200, file.read_bytes()), path)
            self.assertEqual(headers["Content-Type"], TYPES[file.suffix])
            self.assertEqual(self.ask("GET", path, If_None_Match=headers["ETag"])[::2], (304, b""))
            self.assertEqual(self.ask("HEAD", path)[::2], (200, b""))
            self.check_headers(headers)

    def test_three_js_is_served_as_modules_that_find_each_other(self):
        names = {"three", "three_geometry", "three_gltf_loader", "three_orbit_controls"}
        for name in names:
            status, headers, body = self.ask("GET", f"/web/{name}.js")
            self.assertEqual((status, headers["Content-Type"]), (200, TYPES[".js"]))
            found = re.findall(r"^(?:import .*|\}) from '([^']*)';$", body.decode(), re.MULTILINE)
            self.assertEqual(bool(found), name != "three")
            self.assertTrue(all(one[:2] == "./" and one[2:-3] in names for one in found), found)
            self.assertNotRegex(body.decode(), r"\beval\(|new Function\(|innerHTML")
            self.check_headers(headers)

    def test_files_are_sent_compressed_to_whoever_takes_that(self):
        for path in ("/", "/web/three.js", "/web/icon.svg"):
            plain = self.ask("GET", path)
            self.assertIsNone(plain[1]["Content-Encoding"])
            self.assertEqual(plain[1]["Vary"], "Accept-Encoding")
            for words in ("gzip", "br, deflate , GZIP;q=0.5", "gzip, br"):
                status, headers, body = self.ask("GET", path, Accept_Encoding=words)
                self.assertEqual((status, headers["Content-Encoding"]), (200, "gzip"), words)
                self.assertEqual(int(headers["Content-Length"]), len(body))
                self.assertLess(len(body), len(plain[2]))
                self.assertEqual(gzip.decompress(body), plain[2])
                self.assertNotEqual(headers["ETag"], plain[1]["ETag"])
                self.assertEqual(self.ask("GET", path, Accept_Encoding=words,
                                          If_None_Match=headers["ETag"])[::2], (304, b""))
            for words in ("br", "gzip;q=0", "gzip; q=0.0", "xgzip", "identity"):
                status, headers, body = self.ask("GET", path, Accept_Encoding=words)
                self.assertEqual((status, headers["Content-Encoding"]), (200, None), words)
                self.assertEqual(body, plain[2])
            self.assertEqual(self.ask("HEAD", path, Accept_Encoding="gzip")[::2], (200, b""))

    def check_headers(self, headers):
        policy = dict(part.strip().split(" ", 1)
                      for part in headers["Content-Security-Policy"].split(";"))
        self.assertEqual(policy["default-src"], "'none'")
        for key in ("script-src", "style-src", "img-src", "connect-src"):
            self.assertEqual(policy[key], "'self'")
        for key in ("base-uri", "form-action", "frame-ancestors", "trusted-types"):
            self.assertEqual(policy[key], "'none'")
        self.assertEqual(policy["require-trusted-types-for"], "'script'")
        self.assertEqual(headers["X-Content-Type-Options"], "nosniff")
        self.assertEqual(headers["Referrer-Policy"], "no-referrer")
        self.assertEqual(headers["Cross-Origin-Resource-Policy"], "same-origin")

    def test_there_is_nothing_else(self):
        for path in ("/web/", "/web/../server.json", "/web/%2e%2e/%2e%2e/etc/passwd", "/web/files.h",
                     "/web/mainxjs", "/index.html", "/boards", "/web//main.js", "/web/main.js/",
                     "/web/main.js%00.svg"):
            status, headers, body = self.ask("GET", path)
            self.assertIn(status, (400, 404), path)
            self.assertEqual(headers["Content-Type"], "application/json", body)
        # A browser is shown a page that says so, but for addresses of the API.
        for path in ("/boards", "/web/", "/docs/9.9/none.html"):
            status, headers, body = self.ask("GET", path, Accept="text/html,*/*")
            self.assertEqual((status, body), (404, (FILES / "index.html").read_bytes()), path)
            self.check_headers(headers)
        for path in ("/v1/", "/v1/nothing", "/metrics/x"):
            kind = self.ask("GET", path, Accept="text/html")[1]["Content-Type"]
            self.assertEqual(kind.startswith("text/html"), path == "/metrics/x", path)
        self.assertEqual(self.ask("POST", "/boards", Accept="text/html")[0], 404)
        self.assertEqual(self.ask("POST", "/board")[0], 405)
        self.assertEqual(self.ask("OPTIONS", "/board")[1]["Allow"], "GET, HEAD, OPTIONS")

    def test_pages_are_no_addresses_of_the_api(self):
        paths = {one["path"] for one in self.world.get("/v1/addresses")["addresses"]}
        self.assertFalse(paths & set(PAGES))

    def test_answers_of_the_api_are_not_taken_for_pages(self):
        for path in ("/v1/health", f"/v1/leaderboard?track={TRACK}", "/v1/nothing"):
            self.assertEqual(self.ask("GET", path)[1]["X-Content-Type-Options"], "nosniff")

    def test_no_script_or_style_is_inline_and_no_text_becomes_markup(self):
        page = (FILES / "index.html").read_text(encoding="utf-8")
        self.assertNotRegex(page, r"<script(?![^>]* src=)|<style|\son\w+=|\sstyle=|javascript:")
        for file in FILES.iterdir():
            text = file.read_text(encoding="utf-8")
            self.assertNotRegex(text, PARSERS, file.name)
            foreign = [address for address in re.findall(r"(?:https?:)?//[\w.-]+\.\w+", text)
                       if address != "http://www.w3.org"]
            self.assertEqual(foreign, [], file.name)

    @unittest.skipUnless(shutil.which("node"), "there is no node here to read the scripts")
    def test_the_scripts_are_scripts_and_import_what_there_is(self):
        with tempfile.TemporaryDirectory() as folder:
            for file in FILES.glob("*.js"):
                copy = pathlib.Path(folder, file.stem + ".mjs")
                shutil.copy(file, copy)
                done = subprocess.run(["node", "--check", copy], capture_output=True, text=True,
                                      timeout=60, check=False)
                self.assertEqual(done.returncode, 0, f"{file.name}: {done.stderr}")
        for file in FILES.glob("*.js"):
            text = file.read_text(encoding="utf-8")
            for names, other in re.findall(r"import \{([^}]*)\}\s+from \"\./([\w.]+)\"", text):
                exported = (FILES / other).read_text(encoding="utf-8")
                for name in names.split(","):
                    its_own = name.split(" as ")[0].strip()
                    self.assertRegex(exported, rf"export (async )?(function|class|const) {its_own}\b",
                                     f"{file.name} imports {name} of {other}")


class Elsewhere(PagesCase):
    def test_a_badge_tells_a_rank_and_escapes_names(self):
        for team, words in (("Neon Tendons", "rank 1 of 5"), (MARKUP, "rank 3 of 5"),
                            (SCRIPT, "rank 5 of 5")):
            query = urllib.parse.urlencode({"track": TRACK, "team": team})
            status, headers, body = self.ask("GET", f"/v1/leaderboard/badge?{query}")
            self.assertEqual((status, headers["Content-Type"]), (200, "image/svg+xml"))
            self.assertEqual(headers["Content-Security-Policy"], "default-src 'none'; sandbox")
            drawing = xml.etree.ElementTree.fromstring(body)
            self.assertTrue(drawing.findtext("{*}title").startswith(f"{team}, "))
            texts = [element.text for element in drawing.findall(".//{*}text")]
            self.assertEqual(texts, [TRACK, words])
            tags = {element.tag.split("}")[1] for element in drawing.iter()}
            self.assertEqual(tags, {"svg", "title", "rect", "path", "g", "text"})
        status, _, body = self.ask("GET", f"/v1/leaderboard/badge?track={TRACK}&team=nobody")
        self.assertEqual((status, json.loads(body)["error"]["code"]), (404, "not_found"))
        self.assertEqual(self.ask("GET", f"/v1/leaderboard/badge?track={TRACK}")[0], 400)

    def test_a_feed_has_an_entry_for_each_row(self):
        status, headers, body = self.ask("GET", f"/v1/leaderboard/feed?track={TRACK}")
        self.assertEqual((status, headers["Content-Type"]), (200, "application/atom+xml"))
        feed = xml.etree.ElementTree.fromstring(body)
        titles = [entry.findtext("{*}title") for entry in feed.findall(".//{*}entry")]
        self.assertEqual(titles[0], "Neon Tendons: rank 1")
        self.assertIn(f"{MARKUP}: rank 3", titles)
        ids = [element.text for element in feed.findall(".//{*}id")]
        self.assertEqual(len(ids), len(set(ids)))
        updated = [element.text for element in feed.findall(".//{*}updated")]
        self.assertEqual(updated[0], max(updated[1:]))
        for moment in updated:
            self.assertRegex(moment, r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")
        self.assertEqual(self.ask("GET", "/v1/leaderboard/feed?track=elbow")[0], 200)

    def test_other_origins_read_boards_that_everybody_sees_and_nothing_else(self):
        def allowed(path, role="public"):
            return self.ask("GET", path, role, Origin="https://example.org")[1][
                "Access-Control-Allow-Origin"]
        for path in ("/v1/leaderboard", "/v1/leaderboard/statistics"):
            self.assertEqual(allowed(f"{path}?track={TRACK}"), "*")
            self.assertIsNone(allowed(f"{path}?track={TRACK}", "participant"))
        for path in ("/v1/health", "/v1/whoami", "/v1/queue", "/v1/submissions", "/"):
            for role in ("public", "participant"):
                self.assertIsNone(allowed(path, role), path)


class Queue(PagesCase):
    def follow(self, role):
        """The answer to a request for the queue's events, to be read; it ends with the test."""
        connection = self.connect()
        self.addCleanup(connection.close)
        connection.request("GET", "/v1/queue/events", headers=self.headers(role))
        return connection.getresponse()

    def next_event(self, answer):
        lines = []
        with contextlib.suppress(http.client.IncompleteRead):
            while (line := answer.readline()) not in (b"\n", b""):
                lines.append(line.decode().rstrip("\n"))
        if not lines:
            return None
        self.assertEqual(lines[0], "event: queue")
        return json.loads(lines[1].removeprefix("data: "))

    def test_events_tell_what_changes(self):
        answer = self.follow("participant")
        self.assertEqual((answer.status, answer.headers["Content-Type"]), (200, "text/event-stream"))
        self.assertIsNone(answer.headers["Content-Length"])
        self.assertEqual(self.next_event(answer)["submissions"], [])
        made = self.world.submit("Neon Tendons", "slow", episodes=10)
        other = self.world.submit("Flexors United", "slow", episodes=10)
        states, done = [], []
        for _ in range(60):
            event = self.next_event(answer)
            seen = [entry["submission"] for entry in event["submissions"]]
            self.assertNotIn(other, seen)
            if made not in seen:
                if states:
                    break
                continue
            states.append(event["submissions"][0]["state"])
            done.append(event["submissions"][0]["episodes"]["done"])
        self.assertIn("running", states)
        self.assertEqual(done, sorted(done))
        self.world.ended(made)

    def test_each_sees_their_own(self):
        made = self.world.submit("Neon Tendons", "slow", episodes=20)
        other = self.world.submit("Flexors United", "slow", episodes=20)
        def seen(role):
            return {entry["submission"] for entry in
                    json.loads(self.ask("GET", "/v1/queue", role)[2])["submissions"]}
        self.assertEqual(seen("participant"), {made})
        self.assertEqual(seen("organiser"), {made, other})
        self.assertEqual(self.ask("GET", "/v1/queue")[0], 401)
        self.assertEqual(self.ask("GET", "/v1/queue/events")[0], 401)
        self.assertEqual(self.ask("GET", "/v1/queue/events?x=1", "organiser")[0], 400)
        self.assertEqual(self.ask("HEAD", "/v1/queue/events", "organiser")[::2], (200, b""))
        for one in (made, other):
            self.world.post(f"/v1/submissions/{one}/cancel", {})

    def test_who_may_not_look_on_any_longer_is_shown_nothing_more(self):
        token = self.world.post("/v1/tokens", {"role": "participant", "label": "test",
                                               "team": "Neon Tendons"})
        self.world.tokens["leaving"] = token["token"]
        answer = self.follow("leaving")
        self.assertEqual(self.next_event(answer)["total"], 0)
        self.world.post(f"/v1/tokens/{token['id']}/revoke", {})
        self.assertIsNone(self.next_event(answer))
        self.assertEqual(answer.read(), b"")


class HostileTexts(unittest.TestCase):
    """Whatever participants write is a text in every format that others read."""

    @classmethod
    def setUpClass(cls):
        cls.world = World(block=40)
        cls.addClassCleanup(cls.world.close)
        cls.world.start(teams=1)
        cls.made = [cls.world.submit(text, f"skill-{place}-1-9-60", name=text)
                    for place, text in enumerate(NAMES.values())]
        for made in cls.made:
            cls.world.ended(made)

    def board(self, form=""):
        url = urllib.parse.urlsplit(self.world.url)
        connection = http.client.HTTPConnection(url.hostname, url.port, timeout=30)
        try:
            connection.request("GET", f"/v1/leaderboard{form}track={TRACK}")
            answer = connection.getresponse()
            self.assertEqual(answer.status, 200)
            return answer.read()
        finally:
            connection.close()

    def test_names_are_told_as_they_are(self):
        rows = json.loads(self.board("?"))["rows"]
        names = {(row["team"], row["name"]) for row in rows}
        for text in NAMES.values():
            self.assertIn((text, text), names)

    def test_a_feed_and_a_badge_hold_them_as_texts(self):
        feed = self.board("/feed?")
        titles = [entry.findtext("{*}title") for entry in
                  xml.etree.ElementTree.fromstring(feed).findall(".//{*}entry")]
        for text in NAMES.values():
            self.assertEqual(len([one for one in titles if one.startswith(f"{text}: rank ")]), 1,
                             text)
            badge = self.board(f"/badge?team={urllib.parse.quote(text)}&")
            drawing = xml.etree.ElementTree.fromstring(badge)
            self.assertTrue(drawing.findtext("{*}title").startswith(f"{text}, "), badge)
            self.assertEqual({element.tag.split("}")[1] for element in drawing.iter()},
                             {"svg", "title", "rect", "path", "g", "text"})

    def test_no_cell_of_an_export_is_a_formula(self):
        folder = self.world.root / "csv"
        subprocess.run([self.world.programs / "myograde", "store", "export", folder, "--format", "csv"],
                       env=self.world.environment, check=True, timeout=60, capture_output=True)
        cells = set()
        for file in folder.glob("*.csv"):
            with open(file, encoding="utf-8", newline="") as lines:
                cells |= {cell for row in csv.reader(lines) for cell in row}
        dangerous = [cell for cell in cells if cell[:1] in set("=+-@\t\r\n")
                     and not re.fullmatch(r"-?\d+(\.\d+)?(e[-+]?\d+)?", cell)]
        self.assertEqual(dangerous, [])
        for text in NAMES.values():
            self.assertIn(f"'{text}" if text[0] in "=+-@" else text, cells)

    def test_what_is_no_name_is_refused_in_a_sentence_without_it(self):
        for what, text in OTHERS.items():
            with self.assertRaises(ApiError, msg=what) as caught:
                self.world.submit(text, "ok")
            self.check_error(caught.exception, 400)

    def test_file_names_are_quoted_in_errors(self):
        for what, text in (NAMES | OTHERS).items():
            for path in (f"../{text}".replace("\0", "0"), f"{text}/../../x".replace("\0", "0")):
                archive = submission.tar([submission.entry(path, b"x")])
                with self.assertRaises(ApiError, msg=what) as caught:
                    self.world.post("/v1/artefacts", archive, "application/x-tar")
                self.check_error(caught.exception, 400)

    def check_error(self, error, status):
        message = error.answer["error"]["message"]
        self.assertEqual(error.status, status, message)
        self.assertLess(len(message), 2000)
        unseen = [one for one in message if unicodedata.category(one) in ("Cc", "Cf", "Zl", "Zp")]
        self.assertEqual(unseen, [], message)

    def test_output_is_told_to_the_character(self):
        made = {}
        for text in [text[:200] for text in (NAMES | OTHERS).values()]:
            made[text] = self.world.submit("Neon Tendons", f"says-{text.encode().hex()}",
                                           name="speaker", seeds=[5000])
        for text, submission_id in made.items():
            self.world.ended(submission_id)
            result = self.world.get(f"/v1/submissions/{submission_id}/result?episodes=1")
            self.assertEqual(result["output"][0]["stdout_tail"], text)
            self.assertEqual(result["episode_rows"][0]["fault"]["detail"], text)


class ManyReaders(unittest.TestCase):
    """Those who follow the queue hold nobody up: they give way to others, as idle connections do."""

    def test_followers_give_way_and_leave_no_trace(self):
        with World(clients=24) as world:
            world.start(teams=1)
            url = urllib.parse.urlsplit(world.url)
            head = {"Authorization": f"Bearer {world.tokens['participant']}"}
            answers = []  # each has its connection
            for _ in range(40):
                connection = http.client.HTTPConnection(url.hostname, url.port, timeout=30)
                connection.request("GET", "/v1/queue/events", headers=head)
                answers.append(connection.getresponse())
                self.assertEqual(answers[-1].status, 200)
                # Whoever asks anything else is answered.
                self.assertEqual(world.get("/v1/live"), {"live": True})
            def opened():
                return len(list(pathlib.Path(f"/proc/{world.pid}/fd").iterdir()))
            many = opened()
            for answer in answers:
                answer.close()
            wait_until(opened, 30, "connections stay", fits=lambda count: count <= many - 15)
            self.assertEqual(world.stop(), 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
