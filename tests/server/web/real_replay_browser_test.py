"""Episodes of every kind of scene in a headless Chromium, from the policy to the pixels.

MYOGRADE_TEST_PICTURES: a folder for screenshots (none: they are not kept)."""

import os
import pathlib
import unittest

from browser_test import PICTURES
from replay_browser_test import READY
from support.browser import Browser, Page
from support.daemon import Daemon
from world import BIN, SOURCE

POLICIES = pathlib.Path(os.environ["MYOGRADE_TEST_POLICIES"])
# Each with one policy of two.
TRACKS = {"elbow": "scripted-elbow", "locomotion": "scripted-locomotion", "manipulation": "scripted-manipulation",
          "chasetag": "zero"}


class RealEpisodes(unittest.TestCase):
    """They are graded, played again by the daemon, and drawn with the model's own shapes."""

    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(BIN, SOURCE, "replays", references=TRACKS)
        cls.addClassCleanup(cls.daemon.close)
        for track in TRACKS:
            cls.daemon.add_track(f"short-{track}", {
                "extends": track, "seeds": {"first": 7000, "count": 1}, "episodes_per_lease": 1})
        cls.daemon.configure(http={"listen": {"address": "127.0.0.1", "port": 0}})
        cls.daemon.start()
        cls.url = (cls.daemon.data / "listen").read_text(encoding="utf-8").strip()
        cls.daemon.post("/v1/teams", {"team": "Walkers"})
        cls.token = cls.daemon.post("/v1/tokens", {"role": "participant", "label": "test",
                                                   "team": "Walkers"})["token"]
        cls.browser = Browser()
        cls.addClassCleanup(cls.browser.close)

    def episode(self, track, policy):
        """The number of a submission and the hash of its only log."""
        made = self.daemon.ask("submit", POLICIES / policy, "--track", f"short-{track}", "--team",
                               "Walkers", "--wait")["submission"]
        row, = self.daemon.ask("show", made, "--episodes")["episode_rows"]
        return made, row["log"]["sha256"]

    def test_every_track_is_played_and_drawn(self):
        for track, policy in TRACKS.items():
            with self.subTest(track):
                made, log = self.episode(track, policy)
                other, second = self.episode(track, "random")
                page = Page(self.browser)
                self.addCleanup(page.close)
                page.open(self.url + "/sign-in")
                page.evaluate(f"sessionStorage.setItem('myograde.token', '{self.token}')")
                page.call("Page.navigate",
                          url=f"{self.url}/replay?log={log}&of={made}&log={second}&of={other}")
                page.wait(READY, 200)
                self.assertEqual(page.problems, [])
                self.assertEqual(page.evaluate("document.querySelectorAll('.canvas canvas').length"), 2)
                self.assertEqual(page.evaluate("document.querySelectorAll('.notice').length"), 0)
                self.assertIn("Walkers", page.text())
                self.assertGreater(page.evaluate("document.querySelectorAll('.graph').length"), 3)
                self.assertEqual(page.evaluate("document.querySelectorAll('.course-map').length"),
                                 2 if track == "locomotion" else 0)
                self.assertIn("Names", page.text())
                page.evaluate("document.querySelectorAll('details').forEach((one) => {"
                              "one.open = true; })")
                page.wait("Number(document.querySelector('[data-triangles]')?.dataset.triangles)"
                          " > 50000", 60)
                self.assertGreater(page.evaluate(
                    "Number(document.querySelector('.timebar input').value)"), 0)
                if PICTURES:
                    os.makedirs(PICTURES, exist_ok=True)
                    page.screenshot(pathlib.Path(PICTURES, f"real-{track}.png"))

    def test_who_may_not_have_the_log_sees_no_replay(self):
        _, log = self.episode("elbow", "zero")
        page = Page(self.browser)
        self.addCleanup(page.close)
        page.call("Page.navigate", url=f"{self.url}/replay?log={log}")
        page.wait("!!document.querySelector('[role=alert]')")
        self.assertEqual(page.evaluate("document.querySelectorAll('canvas').length"), 0)
        self.assertIn("Sign in", page.text())


if __name__ == "__main__":
    unittest.main(verbosity=2)
