"""In a headless Chromium: a challenge's home, its boards, a submission's head and a team's places, with phases that are
open, frozen and still to come, at three widths."""

import datetime
import json
import struct
import unittest
import zlib

from browser_test import TEAM, WIDTHS, BrowserCase
from world import MARKUP, MODES, TRACK

TEXT = f"""Hand a **box** over, {MARKUP} with [rules](/docs) and a [trap](javascript:alert).

<script>alert(3)</script>

1. one
"""


def png(width, height):
    """A picture of one colour."""
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data
                + struct.pack(">I", zlib.crc32(kind + data)))
    rows = (b"\0" + b"\x1f\x6f\xeb" * width) * height
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def moment(days):
    at = datetime.datetime.now(datetime.timezone.utc) + datetime.timedelta(days=days)
    return at.strftime("%Y-%m-%dT%H:%M:%SZ")


def phase(name, title, first, **keys):
    return {"name": name, "title": title, "track": TRACK, "profile": "paper",
            "seeds": {"first": first, "count": 40}, **keys}


class Home(BrowserCase):
    teams = 0

    @classmethod
    def prepare(cls, world):
        folder = world.configs / "challenges"
        phases = [phase("warm-up", "Warm-up: hand a box over", 20000, opens_at=moment(-9), closes_at=moment(9)),
                  phase("frozen", "A frozen round", 30000, opens_at=moment(-9), freeze_at=moment(-1),
                        closes_at=moment(3)),
                  phase("final", "The final", 40000, opens_at=moment(9))]
        (folder / "cup.json").write_text(json.dumps({"form": 1, "title": "A cup", "phases": phases}),
                                         encoding="utf-8")
        (folder / "cup.md").write_text(TEXT, encoding="utf-8")
        (folder / "cup.png").write_bytes(png(300, 80))

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        world = cls.world
        for team in list(MODES)[1:]:
            world.post("/v1/teams", {"team": team})
        cls.made = {team: world.submit(team, mode, phase="warm-up") for team, mode in MODES.items()}
        cls.secret = world.submit("Flexors United", MODES["Flexors United"], phase="frozen")
        for made in (*cls.made.values(), cls.secret):
            world.ended(made)

    def texts(self, page, selector):
        return page.evaluate(f"[...document.querySelectorAll({json.dumps(selector)})].map((one) => one.textContent)")

    def test_pages_fit_and_are_accessible(self):
        for width in WIDTHS:
            page = self.page("participant", width=width)
            for name, path in (("home", "/"), ("phase", "/board?phase=warm-up"), ("places", "/team?name=Neon+Tendons"),
                               ("head", f"/submission?id={self.made[TEAM]}")):
                with self.subTest(f"{name} {width}"):
                    self.open(page, path)
                    self.check_page(page, name, f"{name}-{width}")
            self.check_quiet(page)

    def test_the_first_page_tells_of_the_challenge(self):
        page = self.page()
        self.open(page, "/")
        self.assertEqual(self.texts(page, "h1"), ["A cup"])
        page.wait("document.querySelector('.logo').naturalWidth === 300")
        self.assertEqual(page.evaluate("document.querySelector('.logo').alt"), "Logo of A cup")
        self.assertEqual(self.texts(page, ".host-text strong"), ["box"])
        self.assertEqual(page.evaluate("[...document.querySelectorAll('.host-text a')].map((one) => "
                                       "one.getAttribute('href'))"), ["/docs"])
        self.assertEqual(page.evaluate("document.querySelectorAll('.host-text script, .host-text img').length"), 0)
        self.assertEqual(self.texts(page, ".cards .card h3")[:3],
                         ["Warm-up: hand a box over", "A frozen round", "The final"])
        self.assertEqual(self.texts(page, ".timeline li a"),
                         ["Warm-up: hand a box over", "A frozen round", "The final"])
        self.assertRegex(self.texts(page, ".counts")[0], "^[56] teams ranked, [78] submissions$")
        self.assertRegex(self.texts(page, ".coming")[0], "“A frozen round” closes in [23] days")
        page.evaluate("document.querySelector('.button.main').click()")
        page.wait("location.pathname + location.search === '/sign-in?to=%2Fsubmit'")

    def test_what_a_frozen_board_hides_is_nowhere(self):
        for role in ("public", "participant"):
            page = self.page(role)
            for path in ("/", "/board?phase=frozen", "/team?name=Flexors+United"):
                self.open(page, path)
                if "frozen" in path:
                    self.assertIn("Nobody is ranked on this board yet", page.text())
            self.assertEqual(self.texts(page, "tbody th"), ["Warm-up: hand a box over"])
        page = self.page("organiser")
        self.open(page, "/team?name=Flexors+United")
        self.assertIn("A frozen round", self.texts(page, "tbody th"))

    def test_a_board_has_bands_and_can_be_sorted_and_filtered(self):
        page = self.page("participant")
        self.open(page, "/board?phase=warm-up")
        self.assertRegex(self.texts(page, ".band")[0], "^Band 1, within 10 % of the fastest, .* s: effort decides$")
        self.assertEqual(self.texts(page, ".band")[-1], "Success rates below 90 %: successes decide")
        self.assertRegex(self.texts(page, ".when")[0], r"open.*closes .* \(.*\)")
        self.assertEqual(self.texts(page, "tr.mine th a")[0], TEAM)
        first = "document.querySelector('.board tbody tr:not(.band) th').textContent"
        page.evaluate("document.querySelector('[data-order=effort]').click()")
        self.assertTrue(page.evaluate(first).startswith("Sarcomere Club"))
        self.assertEqual(self.texts(page, ".band"), [])
        self.assertEqual(page.evaluate("document.querySelector('[aria-sort]').getAttribute('aria-sort')"), "ascending")
        page.evaluate("const box = document.querySelector('.filter'); box.value = 'flexors'; "
                      "box.dispatchEvent(new Event('input'))")
        self.assertEqual(len(self.texts(page, ".board tbody tr:not(.page-only)")), 1)

    def test_a_board_becomes_current_by_itself(self):
        page = self.page()
        self.open(page, "/board?phase=warm-up")
        self.world.ended(self.world.submit("Antagonists", "skill-30-30-9-60", name="late", phase="warm-up"))
        page.wait("[...document.querySelectorAll('.policy')].some((one) => one.textContent === 'late')", 60)

    def test_a_submission_begins_with_its_place_or_its_fault(self):
        page = self.page("organiser")
        self.open(page, f"/submission?id={self.made['Sarcomere Club']}")
        page.wait("document.querySelector('.standing')?.hidden === false")
        self.assertRegex(self.texts(page, ".standing")[0], r"^Rank 2 of \d; Neon Tendons is a band above")
        self.open(page, f"/submission?id={self.made['Antagonists']}")
        self.assertIn("40 of 40 episodes ended by a fault", self.texts(page, ".fault-first")[0])
        page.evaluate("document.querySelector('.fault-first button').click()")
        page.wait("location.hash === '#episode-0'")
        self.assertEqual(self.texts(page, ".row-head"), ["0", "10", "20", "30"])

    def test_two_submissions_are_compared_episode_by_episode(self):
        page = self.page("organiser", width=375)
        self.open(page, f"/submission?id={self.made['Sarcomere Club']}")
        page.evaluate("document.querySelector('.compare').open = true")
        page.wait("!!document.getElementById('compared-with')")
        page.evaluate(f"document.getElementById('compared-with').value = {self.made[TEAM]}")
        page.evaluate("document.querySelector('.compare form').requestSubmit()")
        page.wait("!!document.querySelector('.compare tbody')")
        rows = {row[0]: row[1:] for row in page.evaluate(
            "[...document.querySelectorAll('.compare tbody tr')].map((row) => "
            "[...row.children].map((cell) => cell.textContent))")}
        # One success of forty less: Student's interval is 0.025 by 2.0227 times 0.025.
        self.assertEqual(rows["Success"][:6], ["40", "−0.03", "−0.08 to +0.03", "0", "1", "39"])
        self.assertEqual(rows["Effort"][3:6], ["40", "0", "0"])
        self.check_page(page, "comparison", "comparison-375")
        # To a participant the API shows no other team's.
        page = self.page("participant")
        self.open(page, f"/submission?id={self.made[TEAM]}")
        page.evaluate("document.querySelector('.compare').open = true")
        page.wait("document.querySelector('.compare').innerText.includes('You may see no other submission')")


if __name__ == "__main__":
    unittest.main(verbosity=2)
