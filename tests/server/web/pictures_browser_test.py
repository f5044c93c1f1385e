"""Pictures of episodes on the page of their submission, and the ways to their replays, in a headless
Chromium. The logs are only named, so the pictures are made here."""

import json
import struct
import time
import unittest
import zlib

from browser_test import TEAM, WIDTHS, BrowserCase
from support.browser import AnsweredPage

PIXEL = "document.querySelector('.pictures canvas').getContext('2d').getImageData(9, 9, 1, 1).data[0]"


def png(red):
    """A picture of one colour, 320 by 180 pixels."""
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data
                + struct.pack(">I", zlib.crc32(kind + data)))
    lines = (b"\0" + bytes([red, 90, 160]) * 320) * 180
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 320, 180, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b""))


def error(code, message):
    return {"error": {"code": code, "message": message}}


class Pictures(BrowserCase):
    teams = 0

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # With equal results, the one that came first leads.
        cls.leader = cls.world.submit("Flexors United", "logged", name="theirs")
        cls.own = cls.world.submit(TEAM, "logged", name="mine")
        for made in (cls.leader, cls.own):
            cls.world.ended(made)
        result = cls.world.get(f"/v1/submissions/{cls.own}/result?episodes=1&summary=1")
        cls.logs = {row["index"]: row["log"]["sha256"] for row in result["episode_rows"]}
        cls.highlights = result["highlights"]

    def page(self, role="participant", answers=None, **more):
        page = AnsweredPage(self.browser, ["*/picture.png"], answers or {}, **more)
        self.addCleanup(page.close)
        page.open(self.world.url + "/sign-in")
        page.evaluate(f"sessionStorage.setItem('myograde.token', "
                      f"{json.dumps(self.world.tokens[role])})")
        return page

    def path_of(self, index):
        return f"/v1/logs/{self.logs[index]}/picture.png"

    def three(self):
        return [self.highlights[place]["index"] for place in ("best", "median", "worst")]

    def test_best_median_and_worst_are_seen_once_they_are_made(self):
        best, median, worst = self.three()
        waits = (202, {"Retry-After": "1", "Content-Type": "application/json"})
        page = self.page(answers={
            self.path_of(best): [(*waits, {"state": "waiting", "place": 3}),
                                 (*waits, {"state": "playing", "place": 0}), (200, {}, png(200))],
            self.path_of(median): [(200, {}, png(40))],
            self.path_of(worst): [(409, {}, error("no_picture", "The log is damaged at byte 17."))]})
        self.open(page, f"/submission?id={self.own}")
        page.wait("document.querySelector('.pictures').innerText.includes('after 3 others')")
        page.wait(f"{PIXEL} === 200")
        self.assertIn("There is no picture: The log is damaged at byte 17.", page.text())
        labels = page.evaluate("[...document.querySelectorAll('.pictures canvas')].map((one) => "
                               "one.getAttribute('aria-label'))")
        self.assertEqual(labels[0], f"A moment of the best episode: Episode {best}, success, "
                                    f"{self.highlights['best']['metrics']['time_s']:.4f} s")
        self.assertEqual([label.split()[4] for label in labels], ["best", "median", "worst"])
        links = page.evaluate("[...document.querySelectorAll('.pictures a')].map((one) => "
                              "one.getAttribute('href'))")
        self.assertEqual(links, [f"/replay?log={self.logs[index]}&of={self.own}"
                                 for index in (best, median, worst)])

    def test_pages_with_pictures_fit_and_are_accessible(self):
        for width in WIDTHS:
            page = self.page(answers={self.path_of(index): [(200, {}, png(60 * place))]
                                      for place, index in enumerate(self.three())}, width=width)
            self.open(page, f"/submission?id={self.own}")
            page.evaluate("document.querySelector('.cell[data-index]').click()")
            page.wait("!!document.querySelector('.details .button.main')")
            self.check_page(page, "pictures", f"pictures-{width}")

    def test_no_picture_is_asked_for_before_it_comes_into_view(self):
        page = self.page(height=80)
        self.open(page, f"/submission?id={self.own}")
        self.assertEqual([url for url in page.requests if url.endswith("picture.png")], [])
        page.evaluate("document.querySelector('.pictures').scrollIntoView()")
        page.wait("document.querySelector('.pictures').innerText.includes('There is no picture')")

    def links_of_the_first_episode(self, role, submission):
        page = self.page(role)
        self.open(page, f"/submission?id={submission}")
        page.evaluate("document.querySelector('.cell[data-index]').click()")
        page.wait("!!document.querySelector('.details .button.main')")
        page.wait("performance.getEntriesByType('resource').filter((one) => "
                  "one.name.includes('/v1/leaderboard')).length === 2")
        time.sleep(1)  # in which nothing more comes
        return page.evaluate("[...document.querySelectorAll('.details .button')].map((one) => "
                             "[one.textContent, one.getAttribute('href')])")

    def test_an_episode_is_compared_with_the_leaders_by_who_may_see_both(self):
        log = self.logs[0]
        replay = ["Replay", f"/replay?log={log}&of={self.own}"]
        both = f"/replay?log={log}&of={self.own}&log={log}&of={self.leader}"
        self.assertEqual(self.links_of_the_first_episode("participant", self.own), [replay])
        self.assertEqual(self.links_of_the_first_episode("organiser", self.own),
                         [replay, ["Compare with the leader", both]])
        self.assertEqual(self.links_of_the_first_episode("organiser", self.leader),
                         [["Replay", f"/replay?log={log}&of={self.leader}"]])


if __name__ == "__main__":
    unittest.main(verbosity=2)
