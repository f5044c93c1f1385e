"""The web pages in a headless Chromium: at three widths, in light and dark, as each role; by keyboard,
with axe-core, with texts that are markup, on paper, and with an upload.

MYOGRADE_TEST_PICTURES: a folder for screenshots of every page (none: they are not kept)."""

import json
import os
import pathlib
import tempfile
import unittest
import urllib.parse

from support.browser import Browser, Page
from support.hostile_texts import NAMES, OTHERS
from support.submission import PROGRAM, entry, tar
from world import MARKUP, SCRIPT, TRACK, World

AXE = pathlib.Path(os.environ["MYOGRADE_TEST_AXE"]).read_text(encoding="utf-8")
PICTURES = os.environ.get("MYOGRADE_TEST_PICTURES")
WIDTHS = (390, 820, 1280)
LIVE = "!!document.querySelector('.live.on')"
TEAM = "Neon Tendons"


def pages(world):
    """Each page by name: its address, and what is true of it when it is there."""
    shown = "document.getElementById('main')?.dataset.ready === 'yes'"
    best, failed = world.submissions["Flexors United"], world.submissions["Antagonists"]
    return {"boards": ("/", shown), "board": (f"/board?track={TRACK}", shown),
            "queue": ("/queue", LIVE), "submission": (f"/submission?id={best}", shown),
            "failed": (f"/submission?id={failed}", shown), "teams": ("/team", shown),
            "team": (f"/team?name={TEAM.replace(' ', '+')}", shown), "submit": ("/submit", shown),
            "sign-in": ("/sign-in", shown)}


def choose(page, selector, *files):
    """Chooses files for an input."""
    root = page.call("DOM.getDocument")["root"]["nodeId"]
    node = page.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
    page.call("DOM.setFileInputFiles", nodeId=node, files=[str(file) for file in files])


class BrowserCase(unittest.TestCase):
    settings = {}  # of the World
    teams = 6      # that have played

    @classmethod
    def setUpClass(cls):
        cls.world = World(**cls.settings)
        cls.addClassCleanup(cls.world.close)
        cls.prepare(cls.world)
        cls.world.start(cls.teams)
        cls.browser = Browser()
        cls.addClassCleanup(cls.browser.close)

    @classmethod
    def prepare(cls, world):
        """What is to be done before the daemon starts."""

    def page(self, role="public", **more):
        """A tab whose reader has a role."""
        page = Page(self.browser, **more)
        self.addCleanup(page.close)
        if self.world.tokens[role]:
            page.open(self.world.url + "/sign-in")
            page.evaluate("sessionStorage.setItem('myograde.token', "
                          f"{json.dumps(self.world.tokens[role])})")
        return page

    def open(self, page, path, *ready):
        page.open(self.world.url + path, *ready)

    def check_quiet(self, page):
        """Nothing went wrong, and nothing was asked of anybody else."""
        foreign = [url for url in page.requests if not url.startswith((self.world.url, "data:"))
                   and url != "about:blank"]
        self.assertEqual(foreign, [])
        self.assertEqual(page.problems, [])

    def check_accessible(self, page, name):
        page.call("Page.setBypassCSP", enabled=True)
        page.evaluate(AXE + ";0")
        found = page.evaluate("axe.run().then((all) => ({passes: all.passes.length, violations: "
                              "all.violations.map((one) => [one.id, one.nodes.map((node) => "
                              "node.html.slice(0, 200) + node.failureSummary)])}))")
        self.assertGreater(found["passes"], 10)
        self.assertEqual(found["violations"], [], name)

    def check_page(self, page, name, label):
        self.assertLessEqual(page.evaluate("document.documentElement.scrollWidth - innerWidth"), 0,
                             f"{label} is wider than the screen")
        self.check_accessible(page, label)
        if PICTURES:
            page.screenshot(pathlib.Path(PICTURES, f"{label}.png"))


class Looks(BrowserCase):
    def test_every_page_fits_and_is_accessible(self):
        for width in WIDTHS:
            for dark in (False, True):
                page = self.page("organiser", width=width, dark=dark)
                for name, (path, ready) in pages(self.world).items():
                    with self.subTest(f"{name} {width} {'dark' if dark else 'light'}"):
                        self.open(page, path, ready)
                        self.check_page(page, name, f"{name}-{width}-{'dark' if dark else 'light'}")
                self.check_quiet(page)

    def test_each_role_sees_what_the_api_shows_it(self):
        own, other = self.world.submissions[TEAM], self.world.submissions["Flexors United"]
        for role, may in (("public", ()), ("participant", (own,)), ("organiser", (own, other)),
                          ("operator", (own, other))):
            page = self.page(role)
            self.open(page, f"/board?track={TRACK}")
            self.assertIn("Flexors United", page.text())
            for submission in (own, other):
                self.open(page, f"/submission?id={submission}")
                shown = page.evaluate("document.querySelectorAll('.cell[data-index]').length")
                self.assertEqual(shown, 40 if submission in may else 0, (role, submission))
            self.open(page, "/team?name=Flexors+United")
            self.assertEqual("Ledger" in page.text(), other in may, role)

    def test_a_token_is_typed_in_and_leaves_with_the_tab(self):
        page = self.page()
        self.open(page, "/sign-in?to=%2Fteam")
        page.evaluate("document.getElementById('token').value = 'myo_wrong'")
        page.evaluate("document.querySelector('main form').requestSubmit()")
        page.wait("document.querySelector('.problem').textContent.length > 5")
        page.evaluate("document.getElementById('token').value = "
                      f"{json.dumps(self.world.tokens['participant'])}")
        page.evaluate("document.querySelector('main form').requestSubmit()")
        page.wait("location.pathname === '/team' && document.querySelector('h1')?.textContent === "
                  f"{json.dumps(TEAM)}")
        self.assertEqual(page.evaluate("[localStorage.length, document.cookie]"), [0, ""])
        page.evaluate("document.querySelector('#who button').click()")
        page.wait("location.pathname === '/' && !sessionStorage.length")
        for to in ("https://example.org/", "//example.org/x", "javascript:alert(1)", "/.//example.org/x",
                   "/%2e//example.org/x"):
            self.open(page, f"/sign-in?to={to}")
            page.evaluate("document.getElementById('token').value = "
                          f"{json.dumps(self.world.tokens['participant'])}")
            page.evaluate("document.querySelector('main form').requestSubmit()")
            page.wait("location.pathname !== '/sign-in'")
            self.assertTrue(page.evaluate("location.href").startswith(self.world.url), to)

    def test_details_are_shown_where_they_were_measured(self):
        page = self.page("participant")
        self.open(page, f"/submission?id={self.world.submissions[TEAM]}")
        captions = page.evaluate("[...document.querySelectorAll('figcaption')].map((one) => "
                                 "one.textContent)")
        self.assertIn("Joint angles and their limits (°)", captions)
        self.assertIn("When it happened (s of simulated time)", captions)
        self.assertIn("first contact: 40, median 0.30 s; handover: 36, median 1.50 s", page.text())
        made = self.world.submit(TEAM, "old")
        self.world.ended(made)
        self.open(page, f"/submission?id={made}")
        self.assertIn("Time (s)", page.text())
        self.assertNotIn("Joint angles", page.text())
        self.assertNotIn("When it happened", page.text())
        self.check_quiet(page)

    def test_the_focus_and_the_chosen_episode_stay_while_episodes_end(self):
        made = self.world.submit(TEAM, "slow", episodes=40)
        page = self.page("participant")
        self.open(page, f"/submission?id={made}")
        page.wait("document.querySelectorAll('.cell[data-index]').length > 2", 60)
        page.evaluate("document.querySelector('.cell[data-index]').focus()")
        page.evaluate("document.activeElement.click()")
        index = page.evaluate("document.activeElement.dataset.index")
        before = page.evaluate("document.querySelectorAll('.cell[data-index]').length")
        page.wait(f"document.querySelectorAll('.cell[data-index]').length > {before}", 60)
        self.assertEqual(page.evaluate("[document.activeElement.dataset.index, document.querySelector("
                                       "'.details h3').textContent.split(':')[0]]"),
                         [index, f"Episode {index}"])
        self.world.ended(made)

    def test_pages_print_what_they_show(self):
        page = self.page("organiser", width=820)
        for name, (path, ready) in pages(self.world).items():
            self.open(page, path, ready)
            page.call("Emulation.setEmulatedMedia", media="print")
            self.assertEqual(page.evaluate("[...document.querySelectorAll('nav, form, button:not("
                                           ".cell)')].filter((one) => one.checkVisibility()).length"),
                             0, name)
            self.assertTrue(page.evaluate("document.querySelector('h1').checkVisibility()"))
            if PICTURES:
                page.screenshot(pathlib.Path(PICTURES, f"{name}-print.png"))
            page.call("Emulation.setEmulatedMedia", media="")

    def test_the_keyboard_reaches_everything(self):
        page = self.page("organiser")
        self.open(page, f"/submission?id={self.world.submissions['Antagonists']}")
        def press(key):
            for kind in ("keyDown", "keyUp"):
                page.call("Input.dispatchKeyEvent", type=kind, key=key, code=key,
                          windowsVirtualKeyCode={"Tab": 9, "Enter": 13, "ArrowRight": 39,
                                                 "End": 35}[key],
                          **({"text": "\r"} if key == "Enter" and kind == "keyDown" else {}))
        press("Tab")
        self.assertEqual(page.evaluate("document.activeElement.className"), "skip")
        for _ in range(30):
            press("Tab")
            if page.evaluate("document.activeElement.dataset.index") == "0":
                break
        press("ArrowRight")
        press("Enter")
        page.wait("document.querySelector('.details h3')?.textContent.startsWith('Episode 1:')")
        press("End")
        self.assertEqual(page.evaluate("document.activeElement.dataset.index"), "39")
        press("Tab")
        self.assertIsNone(page.evaluate("document.activeElement.dataset.index"))


class Texts(BrowserCase):
    def test_names_and_output_are_texts(self):
        page = self.page("organiser")
        made = self.world.submit(MARKUP, "crash", name=SCRIPT)
        self.world.ended(made)
        for path in ("/", f"/board?track={TRACK}", f"/submission?id={made}",
                     "/team", "/team?" + urllib.parse.urlencode({"name": MARKUP})):
            self.open(page, path)
            if "submission" in path:
                page.evaluate("document.querySelector('.cell[data-index]').click()")
            self.assertTrue(MARKUP in page.text() or SCRIPT in page.text(), path)
            self.assertEqual(page.evaluate("document.querySelectorAll('main script, main img, "
                                           "main iframe, main object').length"), 0)
        self.check_quiet(page)

    def test_an_address_is_text_as_well(self):
        page = self.page("organiser")
        for path in ("/board?track=%3Cimg%20src%3Dx%20onerror%3Dalert(1)%3E", "/submission?id=<b>",
                     "/team?name=%3Cscript%3Ealert(1)%3C/script%3E", "/submission?id=999"):
            page.call("Page.navigate", url=self.world.url + path)
            page.wait("!!document.querySelector('[role=alert]')")
            self.assertEqual(page.evaluate("document.querySelectorAll('main img, main script')"
                                           ".length"), 0)
        self.assertFalse([one for one in page.problems if "dialog" in one])

    def test_markup_that_a_script_would_make_is_refused(self):
        page = self.page()
        self.open(page, "/")
        for script in ("document.body.innerHTML = '<img src=x onerror=alert(1)>'",
                       "document.write('<script>alert(1)</script>')"):
            self.assertTrue(page.evaluate(
                f"(() => {{ try {{ {script}; return false; }} catch (e) {{ return true; }} }})()"))
        page.evaluate("document.body.append(Object.assign(document.createElement('div'), "
                      "{id: 'inline'})); document.getElementById('inline')"
                      ".setAttribute('style', 'position: fixed')")
        self.assertEqual(page.evaluate("getComputedStyle(document.getElementById('inline'))"
                                       ".position"), "static")

    def test_characters_that_turn_texts_around_are_shown(self):
        page = self.page()
        self.open(page, "/")
        self.assertEqual(page.evaluate("import('/web/format.js').then((all) => "
                                       "all.visible('a\\u202eb\\u0007\\n\\u200bc'))"),
                         "a⟨U+202E⟩b⟨U+0007⟩\n⟨U+200B⟩c")


class HostileTexts(BrowserCase):
    """Names, output, errors and file names of participants, on every page that shows them."""

    # What pages are made of: no text may add to it.
    TAGS = set("a b bdi button canvas caption code dd details div dl dt figcaption figure form g h1 h2 h3 "
               "h4 input label li main meter ol option p path pre progress rect section select span "
               "summary svg table tbody td text th thead time tr ul line circle nav "
               "polyline datalist".split())

    def check_texts(self, page, path, *texts):
        """The page has these texts, and no element that it does not have without them."""
        shown = page.evaluate("document.querySelector('main').textContent")
        for text in texts:
            wanted = page.evaluate("import('/web/format.js').then((all) => "
                                   f"all.visible({json.dumps(text)}))")
            self.assertIn(wanted, shown, path)
        tags = set(page.evaluate("[...new Set([...document.querySelectorAll('main, main *')].map("
                                 "(one) => one.localName))]"))
        self.assertLessEqual(tags, self.TAGS, path)
        self.assertEqual(page.evaluate("[...document.querySelectorAll('main *')].filter((one) => "
                                       "[...one.attributes].some((two) => two.name.startsWith('on') "
                                       "|| /^\\s*javascript:/i.test(two.value) && "
                                       "two.name === 'href')).length"), 0, path)
        self.assertLessEqual(page.evaluate("document.documentElement.scrollWidth - innerWidth"), 0,
                             f"{path} is wider than the screen")

    def test_names_are_texts(self):
        page = self.page("organiser", width=390)
        for what, text in NAMES.items():
            with self.subTest(what):
                made = self.world.submit(text, "skill-1-1-9-60", name=text)
                self.world.ended(made)
                team = "/team?" + urllib.parse.urlencode({"name": text})
                for path in (f"/submission?id={made}", team):
                    self.open(page, path)
                    self.check_texts(page, path, text)
        for path in (f"/board?track={TRACK}", "/team"):
            self.open(page, path)
            self.check_texts(page, path, *NAMES.values())
        self.check_quiet(page)

    def test_output_and_reasons_are_texts(self):
        page = self.page("organiser", width=390)
        for what, text in (NAMES | OTHERS).items():
            with self.subTest(what):
                made = self.world.submit(TEAM, f"says-{text[:200].encode().hex()}", seeds=[5000],
                                         name="speaker")
                self.world.ended(made)
                path = f"/submission?id={made}"
                self.open(page, path)
                page.evaluate("document.querySelector('.cell[data-index]').click()")
                page.wait("!!document.querySelector('.details .error')")
                page.evaluate("document.querySelectorAll('details').forEach((one) => {"
                              "one.open = true; })")
                self.check_texts(page, path, text[:200])
        self.check_quiet(page)

    def test_file_names_in_errors_are_texts(self):
        page = self.page("participant", width=390)
        with tempfile.TemporaryDirectory() as folder:
            archive = pathlib.Path(folder, "policy.tar")
            for what, text in (NAMES | OTHERS).items():
                with self.subTest(what):
                    archive.write_bytes(tar([entry(f"../{text}".replace("\0", "0"), b"x")]))
                    self.open(page, "/submit")
                    choose(page, "#archive", archive)
                    page.wait("!document.querySelector('button.main').disabled")
                    page.evaluate("document.querySelector('main form').requestSubmit()")
                    page.wait("document.querySelector('.problem').textContent.length > 0")
                    self.check_texts(page, "/submit")
        self.assertFalse([one for one in page.problems if "400" not in one])


class Uploads(BrowserCase):
    def hand_in(self, page):
        page.wait("!document.querySelector('button.main').disabled")
        page.evaluate(f"document.getElementById('target').value = [...document.querySelectorAll("
                      f"'#target option')].find((one) => one.textContent === '{TRACK}, practice')"
                      ".value; document.getElementById('target').dispatchEvent(new Event('change'))")
        page.evaluate("document.getElementById('count').value = 4")
        page.evaluate("document.querySelector('main form').requestSubmit()")
        page.wait("!!document.querySelector('.card.good a') || "
                  "document.querySelector('.problem').textContent.length > 0")
        return page.text()

    def test_a_folder_is_packed_and_an_archive_sent_as_it_is(self):
        page = self.page("participant")
        with tempfile.TemporaryDirectory() as folder:
            policy = pathlib.Path(folder, "walker")
            deep = policy / ("d" * 90) / ("e" * 90)
            deep.mkdir(parents=True)
            (policy / "policy.json").write_text(json.dumps(
                {"name": "from a browser", "command": ["./policy", "ok"], "runtimes": []}))
            (policy / "policy").write_bytes(PROGRAM)
            (deep / "größe.txt").write_text("x" * 1000)
            self.open(page, "/submit")
            choose(page, "#archive", policy / "policy")
            self.assertIn("It is submitted", self.hand_in(page))
            single = self.world.get("/v1/submissions?limit=1")["submissions"][0]
            self.assertEqual(single["name"], "policy")
            self.world.post(f"/v1/submissions/{single['submission']}/cancel", {})
            self.open(page, "/submit")
            page.wait("document.querySelector('.limits-left').textContent.includes('left today')")
            choose(page, "#folder", policy)
            self.assertIn("It is submitted", self.hand_in(page))
            self.open(page, "/submit")
            choose(page, "#archive", deep / "größe.txt")
            page.wait("document.querySelector('.problem').textContent.includes('policy.json')")
            archive = pathlib.Path(folder, "broken.tar")
            archive.write_bytes(b"junk" * 1000)
            choose(page, "#archive", archive)
            self.assertIn("archive", self.hand_in(page))
        newest = self.world.get("/v1/submissions?limit=1")["submissions"][0]
        self.assertEqual((newest["name"], newest["team"]), ("from a browser", TEAM))
        self.assertEqual(self.world.ended(newest["submission"])["state"], "done")

    def test_the_queue_is_shown_as_it_changes(self):
        page = self.page("participant")
        self.open(page, "/queue", LIVE)
        self.assertIn("Nothing of yours", page.text())
        made = self.world.submit(TEAM, "slow", episodes=20)
        page.wait("document.querySelector('progress')?.value > 0")
        self.world.post(f"/v1/submissions/{made}/cancel", {})
        page.wait("document.querySelector('main').innerText.includes('Nothing of yours')")
        streams = [url for url in page.requests if url.endswith("/v1/queue/events")]
        self.assertEqual(len(streams), 1)
        self.check_quiet(page)


if __name__ == "__main__":
    unittest.main(verbosity=2)
