"""In a headless Chromium: the episode that an organiser makes public, on the first page and in /replay, without a
token, and that no other one can be seen so."""

import json
import unittest

from real_replay_browser_test import POLICIES
from replay_browser_test import READY
from support.browser import Browser, Page
from support.daemon import Daemon
from world import BIN, MARKUP, SOURCE


class PublicReplay(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(BIN, SOURCE, "public-replays")
        cls.addClassCleanup(cls.daemon.close)
        phases = [{"name": name, "title": f"The {name} <b>", "track": "elbow", "profile": "hold",
                   "seeds": {"first": first, "count": 2}, "public_replay": name == "open"}
                  for name, first in (("closed", 61000), ("open", 62000))]
        (cls.daemon.configs / "challenges/cup.json").write_text(
            json.dumps({"form": 1, "title": "A cup", "phases": phases}), encoding="utf-8")
        cls.daemon.configure(http={"listen": {"address": "127.0.0.1", "port": 0}})
        cls.daemon.start()
        cls.url = (cls.daemon.data / "listen").read_text(encoding="utf-8").strip()
        cls.daemon.post("/v1/teams", {"team": MARKUP})
        cls.made = {phase: cls.daemon.ask("submit", POLICIES / "scripted-elbow", "--phase", phase, "--team",
                                          MARKUP, "--wait")["submission"] for phase in ("closed", "open")}
        cls.browser = Browser()
        cls.addClassCleanup(cls.browser.close)

    def page(self, still=False, **more):
        page = Page(self.browser, **more)
        self.addCleanup(page.close)
        page.call("Emulation.setEmulatedMedia", features=[
            {"name": "prefers-reduced-motion", "value": "reduce" if still else "no-preference"}])
        return page

    def log_of(self, phase, index=0):
        return self.daemon.ask("show", self.made[phase], "--episodes")["episode_rows"][index]["log"]["sha256"]

    def test_the_first_page_shows_it_in_motion(self):
        page = self.page()
        page.open(self.url + "/")
        page.wait("document.querySelector('.home-replay')?.dataset.drawn === 'yes'", 100)
        self.assertEqual(page.evaluate("document.querySelectorAll('.home-replay canvas').length"), 2)
        self.assertIn(f"{MARKUP}, the leader, in episode", page.text())
        page.evaluate("document.querySelector('.home-replay button').click()")
        self.assertEqual(page.evaluate("document.querySelector('.home-replay button').textContent"), "Play")
        self.assertEqual(page.problems, [])
        page.evaluate("document.querySelector('.home-replay a.button').click()")
        page.wait("location.pathname === '/replay' && " + READY, 100)
        self.assertIn(f"Replay: {MARKUP}, elbow", page.text())
        self.assertEqual(page.evaluate("document.querySelectorAll('.canvas canvas').length"), 1)
        self.assertEqual(page.problems, [])

    def test_a_picture_stands_for_it_where_less_motion_is_asked_for(self):
        page = self.page(still=True)
        page.open(self.url + "/")
        page.wait("document.querySelector('.home-replay .frame p') === null", 100)
        self.assertEqual(page.evaluate("document.querySelectorAll('.home-replay button').length"), 1)
        self.assertTrue(page.evaluate("document.querySelector('.home-replay button').hidden"))
        self.assertEqual([url for url in page.requests if "trajectory" in url or "models" in url], [])

    def test_a_picture_stands_for_it_without_webgl(self):
        page = self.page()
        page.call("Page.addScriptToEvaluateOnNewDocument", source="HTMLCanvasElement.prototype.getContext = "
                  "((own) => function (kind, ...more) { return kind === 'webgl2' ? null : own.call(this, kind, "
                  "...more); })(HTMLCanvasElement.prototype.getContext);")
        page.open(self.url + "/")
        page.wait("document.querySelector('.home-replay')?.dataset.drawn === 'no'", 100)
        self.assertFalse(page.evaluate("document.querySelector('.home-replay .picture').hidden"))

    def test_other_episodes_need_a_token(self):
        public, = self.daemon.get("/v1/replays")["replays"]
        self.assertEqual((public["phase"], public["submission"]), ("open", self.made["open"]))
        for log in (self.log_of("closed"), self.log_of("open", 1 - public["episode"])):
            page = self.page()
            page.call("Page.navigate", url=f"{self.url}/replay?log={log}")
            page.wait("!!document.querySelector('[role=alert]')")
            self.assertIn("Sign in", page.text())
            self.assertEqual(page.evaluate("document.querySelectorAll('canvas').length"), 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
