"""Replays in a headless Chromium: what is drawn, steered, said and freed, at three widths. The daemon
serves the pages; trajectories and models are made here (trajectories.py) and given to the browser in
its place.

MYOGRADE_TEST_PICTURES: a folder for screenshots (none: they are not kept)."""

import time
import unittest

import trajectories
from browser_test import WIDTHS, BrowserCase
from support.browser import AnsweredPage
from world import MARKUP, SCRIPT

A, B, GONE, SECRET, BROKEN, DAMAGED, HOSTILE, OTHER = (letter * 64 for letter in "ab0123cd")
READY = "document.getElementById('main')?.dataset.ready === 'yes'"


def error(code, message):
    return {"error": {"code": code, "message": message}}


class ReplayPage(AnsweredPage):
    """A tab that is answered here when it asks for trajectories and models."""

    def __init__(self, browser, **more):
        super().__init__(browser, ("*/trajectory", "*/v1/models/*"), {
            f"/v1/logs/{A}/trajectory": [(200, {}, trajectories.walk())],
            f"/v1/logs/{B}/trajectory": [(200, {}, trajectories.walk(6.0, "time"))],
            f"/v1/logs/{HOSTILE}/trajectory": [(200, {}, trajectories.walk(
                1.0, SCRIPT, [{"time_s": 0.1, "kind": MARKUP, "text": MARKUP, "value": 1,
                               "unit": SCRIPT}], track=MARKUP, muscles=[MARKUP, SCRIPT],
                series=[{"name": "a", "title": MARKUP, "unit": SCRIPT},
                        {"name": "b", "title": "\u202eb", "unit": ""},
                        {"name": "c", "title": "c", "unit": "", "labels": [MARKUP] * 4}]))],
            f"/v1/logs/{DAMAGED}/trajectory": [(200, {}, trajectories.walk()[:9000])],
            f"/v1/logs/{OTHER}/trajectory": [(200, {}, trajectories.walk(model="f" * 16))],
            f"/v1/logs/{SECRET}/trajectory": [
                (409, {}, error("withheld", "The phase withholds logs until it is published."))],
            f"/v1/logs/{BROKEN}/trajectory": [
                (409, {}, error("no_picture", "The log is damaged at byte 17."))],
            "/v1/models/locomotion.glb": [(200, {}, trajectories.glb())],
        }, **more)


class ReplayCase(BrowserCase):
    teams = 0

    def page(self, role="public", still=True, **more):
        page = ReplayPage(self.browser, **more)
        self.addCleanup(page.close)
        page.call("Emulation.setEmulatedMedia", features=[
            {"name": "prefers-color-scheme", "value": "dark" if more.get("dark") else "light"},
            {"name": "prefers-reduced-motion", "value": "reduce" if still else "no-preference"}])
        return page

    def press(self, page, key, **more):
        codes = {" ": 32, "Home": 36, "End": 35, "ArrowLeft": 37, "ArrowRight": 39}
        for kind in ("keyDown", "keyUp"):
            page.call("Input.dispatchKeyEvent", type=kind, key=key,
                      windowsVirtualKeyCode=codes.get(key, ord(key[0].upper())),
                      **({"text": key} if len(key) == 1 and kind == "keyDown" else {}), **more)

    def time_of(self, page):
        return float(page.evaluate("document.querySelector('.timebar input').value"))

    def picture(self, page):
        """The view as it is seen, as bytes of a PNG."""
        box = page.evaluate("(() => { const r = document.querySelector('.canvas')"
                            ".getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })()")
        clip = dict(zip(("x", "y", "width", "height"), box), scale=0.5)
        return page.call("Page.captureScreenshot", clip=clip)["data"]

    def settled(self, page):
        """Waits until what was asked for is drawn."""
        page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame("
                      "() => requestAnimationFrame(done))))")

    def notice(self, page, path):
        """What the page says that can't show a replay."""
        page.call("Page.navigate", url=self.world.url + path)
        page.wait("!!document.querySelector('[role=alert], .notice')")
        return page.evaluate("document.querySelector('[role=alert], .notice').innerText")


class Looks(ReplayCase):
    def test_a_moment_is_in_the_address_and_keys_need_no_click(self):
        page = self.page()
        self.open(page, f"/replay?log={A}#t=1.5&camera=90,10,2")
        self.assertAlmostEqual(self.time_of(page), 1.5)
        self.press(page, "ArrowRight")
        page.wait("/^#t=1.52&camera=90,10,[.0-9]+$/.test(location.hash)")
        for key in ("l", "End", " "):
            self.press(page, key)
        # At its end it begins anew.
        page.wait("document.querySelector('.controls .main').textContent === 'Pause' && "
                  "Number(document.querySelector('.timebar input').value) < 1")
        self.press(page, " ")
        self.assertEqual(page.evaluate("document.querySelector('.controls .main').textContent"), "Play")

    def test_it_fits_and_is_accessible(self):
        for width in WIDTHS:
            for dark in (False, True):
                page = self.page(width=width, dark=dark)
                for name, path in (("one", f"/replay?log={A}"), ("two", f"/replay?log={A}&log={B}")):
                    with self.subTest(f"{name} {width} {dark}"):
                        self.open(page, path)
                        page.evaluate("document.querySelectorAll('details').forEach((one) => {"
                                      "one.open = true; })")
                        self.settled(page)
                        self.check_page(
                            page, name, f"replay-{name}-{width}-{'dark' if dark else 'light'}")
                        page.call("Page.setBypassCSP", enabled=False)
                self.check_quiet(page)

    def test_what_is_drawn_changes_with_time_and_choices(self):
        page = self.page()
        self.open(page, f"/replay?log={A}")
        seen = set()
        for change in ("", "slider.value = 3.24", "choose(1)", "choose(2)", "look('top')", "look('close-up')"):
            page.evaluate("(() => { const slider = document.querySelector('.timebar input');"
                          "const choose = (place) => document.querySelectorAll("
                          "'.controls input[type=checkbox]')[place].click();"
                          "const look = (name) => { const all = document.querySelectorAll("
                          "'.controls select')[1]; all.value = name;"
                          f"all.dispatchEvent(new Event('change')); }}; {change};"
                          "slider.dispatchEvent(new Event('input')); })()")
            self.settled(page)
            seen.add(self.picture(page))
        self.assertEqual(len(seen), 6)
        page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        self.assertIn("triangles", page.evaluate("document.querySelector('details.more:last-of-type')"
                                                 ".innerText"))
        self.check_quiet(page)

    def test_the_view_is_turned_by_keys_and_mouse_while_it_stands(self):
        page = self.page()
        self.open(page, f"/replay?log={A}&log={B}")
        page.evaluate("document.querySelector('.canvas').focus()")
        self.settled(page)
        first = self.picture(page)
        seen = {first}
        x, y = page.evaluate("(() => { const r = document.querySelector('.canvas')"
                             ".getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2];"
                             " })()")
        def drag():
            for kind, at in (("mousePressed", x), ("mouseMoved", x + 60), ("mouseReleased", x + 60)):
                page.call("Input.dispatchMouseEvent", type=kind, x=at, y=y, button="left", buttons=1,
                          clickCount=1)
        for act in (lambda: self.press(page, "d"), lambda: self.press(page, "w"),
                    lambda: self.press(page, "+"), drag,
                    lambda: page.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y,
                                      deltaX=0, deltaY=-200)):
            act()
            self.settled(page)
            seen.add(self.picture(page))
        self.assertEqual(len(seen), 6)
        self.press(page, "0")
        self.settled(page)
        self.assertEqual(self.picture(page), first)
        self.check_quiet(page)

    def test_what_a_frame_costs(self):
        page = self.page()
        self.open(page, f"/replay?log={A}")
        took = page.evaluate(
            "Promise.all(['replay_view', 'replay_file'].map((name) => import(`/web/${name}.js`)))"
            ".then(async ([drawing, file]) => {"
            f"const get = (path) => fetch(path).then((one) => one.arrayBuffer());"
            f"const episode = file.readTrajectory(await get('/v1/logs/{A}/trajectory'));"
            "const host = document.querySelector('.canvas');"
            "const model = await drawing.readModel(await get('/v1/models/locomotion.glb'));"
            "const view = new drawing.View(host, episode, model, {dark: false, strong: 1});"
            "for (let i = 0; i < 200; i += 1) view.place(i / 50);"
            "const begin = performance.now();"
            "for (let i = 0; i < 1000; i += 1) view.place(i * 0.008);"
            "const all = (performance.now() - begin) / 1000; view.dispose(); return all; })")
        self.assertLess(took, 4.0, "ms for a frame of two bodies")


class Steering(ReplayCase):
    def test_keys(self):
        page = self.page()
        self.open(page, f"/replay?log={A}")
        page.evaluate("document.querySelector('.canvas').focus()")
        self.press(page, "ArrowRight")
        self.assertAlmostEqual(self.time_of(page), 0.02)
        self.press(page, "ArrowRight", modifiers=8)
        self.assertAlmostEqual(self.time_of(page), 0.52)
        self.press(page, "ArrowLeft")
        self.assertAlmostEqual(self.time_of(page), 0.5)
        self.press(page, "End")
        self.assertEqual(self.time_of(page), 8)
        self.assertEqual(page.evaluate("document.querySelector('.timebar input')"
                                       ".getAttribute('aria-valuetext')"), "8.00 s")
        self.press(page, "Home")
        self.assertEqual(self.time_of(page), 0)
        self.press(page, " ")
        page.wait("Number(document.querySelector('.timebar input').value) > 0.1")
        self.assertEqual(page.evaluate("document.querySelector('button.main').textContent"), "Pause")
        self.press(page, " ")
        page.wait("document.querySelector('button.main').textContent === 'Play'")
        self.press(page, "<")
        self.assertEqual(page.evaluate("document.querySelector('.controls select').value"), "0.5")
        self.press(page, "m")
        self.assertFalse(page.evaluate("document.querySelectorAll('.controls input[type=checkbox]')[1]"
                                       ".checked"))
        before = self.time_of(page)
        page.evaluate("document.querySelector('.controls select').focus()")
        self.press(page, "ArrowRight")
        self.assertEqual(self.time_of(page), before)
        page.evaluate("document.querySelector('.skip').focus()")
        self.press(page, "ArrowRight")
        self.assertGreater(self.time_of(page), before)
        self.check_quiet(page)

    def test_events_and_graphs_choose_the_time(self):
        page = self.page()
        self.open(page, f"/replay?log={A}&log={B}")
        self.assertEqual(page.evaluate("document.querySelectorAll('.events tbody tr').length"), 6)
        page.evaluate("[...document.querySelectorAll('.events button')].find((one) => "
                      "one.textContent === '3.20 s').click()")
        self.assertEqual(self.time_of(page), 3.2)
        self.settled(page)
        self.assertEqual(page.evaluate("document.querySelector('.graph:not(:has(.course-map)) .now').innerText")
                         .split(), ["3.84", "m", "3.84", "m"])
        self.assertIn("peak force", page.evaluate("document.querySelector('.events tr.now')"
                                                  ".innerText"))
        page.evaluate("document.querySelector('.graph > svg').scrollIntoView()")
        box = page.evaluate("(() => { const r = document.querySelector('.graph > svg')"
                            ".getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })()")
        for kind in ("mousePressed", "mouseReleased"):
            page.call("Input.dispatchMouseEvent", type=kind, x=box[0] + box[2] / 2,
                      y=box[1] + box[3] / 2, button="left", clickCount=1)
        self.assertAlmostEqual(self.time_of(page), 8 * (180 - 42) / (360 - 48), delta=0.1)

    def test_the_course_is_seen_from_above_and_the_view_is_saved(self):
        page = self.page()
        self.open(page, f"/replay?log={A}#t=4")
        self.settled(page)
        place = "['cx', 'cy'].map((name) => Number(document.querySelector('.course-map .place').getAttribute(name)))"
        x, y = page.evaluate(place)
        self.press(page, "End")
        self.settled(page)
        self.assertGreater(page.evaluate(place)[0], x + 50)
        self.assertTrue(0 < y < 42, y)
        self.assertTrue(page.evaluate("!!document.querySelector('[aria-label$=\"9.6 m from the start\"]')"))
        page.evaluate("HTMLAnchorElement.prototype.click = function () { window.saved = this.download; }")
        page.evaluate("document.querySelector('[title^=\"Saves what\"]').click()")
        page.wait("window.saved === 'locomotion-episode-37-8.00s.png'")
        self.check_quiet(page)

    def test_it_plays_at_once_unless_less_motion_is_asked_for(self):
        page = self.page(still=False)
        self.open(page, f"/replay?log={A}")
        page.wait("Number(document.querySelector('.timebar input').value) > 0.2")
        page = self.page()
        self.open(page, f"/replay?log={A}")
        time.sleep(0.3)
        self.assertEqual(self.time_of(page), 0)


class Comparing(ReplayCase):
    def row(self, log, seed=5):
        return {"index": 37, "seed": seed, "log": log and {"sha256": log}}

    def test_others_are_offered_beside_it_the_leader_first(self):
        page = self.page()
        names = {7: "Walkers", 8: SCRIPT, 9: MARKUP}
        rows = {7: self.row(A), 8: self.row(B, seed=6), 9: self.row(B)}
        given = {"/v1/leaderboard": {"rows": [{"submission": 9, "rank": 1},
                                              {"submission": 7, "rank": 2}]}}
        for number, team in names.items():
            given[f"/v1/submissions/{number}"] = {
                "submission": number, "team": team, "name": "walker", "track": "locomotion",
                "profile": "paper", "phase": None, "episodes": {"done": 100}}
            given[f"/v1/submissions/{number}/result"] = {
                "episode_rows": [rows[number]], "hashes": {"seeds": f"list of {number}"}}
        given["/v1/submissions"] = {"submissions": [given[f"/v1/submissions/{one}"]
                                                    for one in (9, 8, 7)]}
        page.answers |= {path: [(200, {}, body)] for path, body in given.items()}
        page.take("*/trajectory", "*/v1/models/*", "*/v1/submissions*", "*/v1/leaderboard*")
        self.open(page, f"/replay?log={A}&of=7")
        self.assertIn("Walkers: walker", page.text())
        page.evaluate("document.querySelector('.compare').open = true")
        page.wait("document.querySelectorAll('#other option').length === 2")
        self.assertEqual(page.evaluate("[...document.querySelectorAll('#other option')].map((one) => "
                                       "one.textContent)"),
                         [f"1. {MARKUP}: walker", f"{SCRIPT}: walker"])
        page.evaluate("document.getElementById('other').value = 8")
        page.evaluate("document.querySelector('.compare form').requestSubmit()")
        page.wait("document.querySelector('.compare .problem').textContent.includes("
                  "'has not played')")
        page.evaluate("document.getElementById('other').value = 9")
        page.evaluate("document.querySelector('.compare form').requestSubmit()")
        page.wait(f"location.search.includes('{B}') && {READY}")
        self.assertIn(MARKUP, page.text())
        self.assertEqual(page.evaluate("document.querySelectorAll('.canvas canvas').length"), 2)
        self.check_quiet(page)


class Troubles(ReplayCase):
    def test_each_trouble_is_a_sentence(self):
        page = self.page()
        for path, words in (
                (f"/replay?log={SECRET}", "withholds logs"),
                (f"/replay?log={BROKEN}", "damaged at byte 17"),
                (f"/replay?log={GONE}", "no such log"),
                (f"/replay?log={DAMAGED}", "The replay's file is damaged: "),
                (f"/replay?log={A}&log={DAMAGED}", "The replay's file is damaged: "),
                (f"/replay?log={OTHER}", "another version of the model"),
                ("/replay", "The address names no replay"),
                ("/replay?log=..%2F..%2Fetc", "The address names no replay"),
                (f"/replay?log={A}&of=x", "The address names no replay"),
                ("/replay?" + "&".join([f"log={A}"] * 3), "The address names no replay")):
            with self.subTest(path):
                self.assertIn(words, self.notice(page, path))

    def test_without_webgl_graphs_and_events_are_there(self):
        page = self.page()
        page.call("Page.addScriptToEvaluateOnNewDocument", source=(
            "const real = HTMLCanvasElement.prototype.getContext;"
            "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
            "return kind.startsWith('webgl') ? null : real.call(this, kind, ...more); };"))
        self.open(page, f"/replay?log={A}")
        self.assertIn("can't draw in 3D", page.text())
        self.assertEqual(page.evaluate("document.querySelectorAll('.graph').length"), 5)
        self.assertEqual(page.evaluate("document.querySelectorAll('.canvas').length"), 0)
        page.evaluate("document.querySelectorAll('.controls button')[2].click()")
        self.assertAlmostEqual(self.time_of(page), 0.02)
        self.check_quiet(page)

    def test_a_model_that_is_gone_leaves_graphs(self):
        page = self.page()
        page.answers["/v1/models/locomotion.glb"] = [
            (404, {}, error("not_found", "There is no model of this track."))]
        self.assertIn("no model of this track", self.notice(page, f"/replay?log={A}"))
        self.assertEqual(page.evaluate("document.querySelectorAll('.graph').length"), 5)

    def test_it_tells_how_it_waits(self):
        page = self.page()
        path = f"/v1/logs/{A}/trajectory"
        page.answers[path][:0] = [
            (202, {"Retry-After": "1"}, {"state": "waiting", "place": 2}),
            (503, {"Retry-After": "1"}, error("busy", "Too many wait.")),
            (202, {"Retry-After": "1"}, {"state": "playing", "place": 0})]
        page.call("Page.navigate", url=f"{self.world.url}/replay?log={A}")
        page.wait("document.body?.innerText.includes('2 others come first')")
        page.wait("document.body?.innerText.includes('is played again from its log')")
        page.wait(READY)
        self.assertEqual(len([url for url in page.requests if url.endswith("/trajectory")]), 4)

    def test_texts_of_a_file_are_texts(self):
        page = self.page()
        page.answers[f"/v1/models/{MARKUP}.glb"] = [(200, {}, trajectories.glb())]
        self.open(page, f"/replay?log={HOSTILE}")
        self.assertIn(MARKUP, page.text())
        self.assertIn(SCRIPT, page.text())
        self.assertIn("⟨U+202E⟩b", page.text())
        self.assertEqual(page.evaluate("document.querySelectorAll('main script, main img, main iframe')"
                                       ".length"), 0)
        self.check_quiet(page)

    def test_leaving_frees_what_was_drawn(self):
        page = self.page(still=False)
        self.open(page, f"/replay?log={A}&log={B}")
        freed = page.evaluate(
            "(() => { const all = [...document.querySelectorAll('.canvas canvas')].map((one) => "
            "one.getContext('webgl2')); dispatchEvent(new PageTransitionEvent('pagehide'));"
            "return new Promise((done) => setTimeout(() => done([all.length, all.every((one) => "
            "one.isContextLost()), document.querySelectorAll('.canvas canvas').length]), 300)); })()")
        self.assertEqual(freed, [2, True, 0])
        stopped = self.time_of(page)
        time.sleep(0.3)
        self.assertEqual(self.time_of(page), stopped)
        self.open(page, "/")
        self.check_quiet(page)


if __name__ == "__main__":
    unittest.main(verbosity=2)
