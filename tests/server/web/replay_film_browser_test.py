"""Films that a headless Chromium records of a replay, and what is drawn beside the bodies."""

import unittest

import trajectories
from replay_browser_test import A, ReplayCase

SHORT, AIMED, FIELD = (letter * 64 for letter in "ef4")


class FilmCase(ReplayCase):
    def page(self, role="public", still=True, **more):
        page = super().page(role, still, **more)
        page.answers |= {
            f"/v1/logs/{SHORT}/trajectory": [(200, {}, trajectories.walk(1.0, "time"))],
            f"/v1/logs/{AIMED}/trajectory": [(200, {}, trajectories.walk(terrain=None, bodies=[
                {"name": "root"}, {"name": "root", "target": True}]))],
            f"/v1/logs/{FIELD}/trajectory": [(200, {}, trajectories.walk(terrain={
                "rows": trajectories.ROWS, "columns": trajectories.COLUMNS, "low": [-6, -6], "high": [6, 6]}))]}
        return page


class Films(FilmCase):
    def test_a_film_is_recorded_and_saved(self):
        page = self.page()
        self.open(page, f"/replay?log={SHORT}#t=0.5")
        page.evaluate("""URL.createObjectURL = (blob) => { window.film = blob; return "about:blank"; };
          HTMLAnchorElement.prototype.click = function () { window.film.arrayBuffer().then((data) => {
            window.saved = [this.download, data.byteLength, [...new Uint8Array(data, 0, 4)]]; }); }""")
        start = "document.querySelector('[title$=\"as a film\"]').click()"
        page.evaluate(start)
        page.wait("document.querySelector('.film progress').value > 0.1")
        self.assertEqual(page.evaluate("document.activeElement.textContent"), "Cancel")
        self.assertEqual(page.evaluate("[...document.querySelectorAll('.view canvas')].map((one) => "
                                       "[one.width, one.height])"), [[1280, 720]])
        self.press(page, "Home")  # steers nothing now
        self.assertGreater(self.time_of(page), 0.1)
        page.wait("!!window.saved")
        name, size, first = page.evaluate("window.saved")
        self.assertEqual((name, first), ("locomotion-episode-37.webm", [0x1A, 0x45, 0xDF, 0xA3]))
        self.assertGreater(size, 5000)
        page.wait("document.querySelector('.film').hidden")
        self.assertAlmostEqual(self.time_of(page), 0.5)
        self.assertNotEqual(page.evaluate("document.querySelector('.view canvas').height"), 720)
        page.evaluate("window.saved = null")
        page.evaluate(start)
        page.evaluate("document.querySelector('.film button').click()")
        page.wait("document.querySelector('.film').hidden && !document.querySelector('.controls [inert]')")
        self.assertIsNone(page.evaluate("window.saved"))
        self.check_quiet(page)

    def test_no_film_is_offered_where_none_can_be_recorded(self):
        page = self.page()
        page.call("Page.addScriptToEvaluateOnNewDocument", source="delete window.MediaRecorder;")
        self.open(page, f"/replay?log={SHORT}")
        self.assertNotIn("↓ Film", page.text())
        self.assertIn("↓ Picture", page.text())


class Drawn(FilmCase):
    def test_targets_metres_and_names_are_drawn(self):
        page = self.page()
        self.open(page, "/")
        for log, drawn in ((A, ["0 m", "5 m", "10 m", "root → arm", "root"]), (AIMED, ["root → root", "root", "target"]),
                           (FIELD, ["root → arm", "root"])):
            found = page.evaluate(
                "Promise.all(['replay_view', 'replay_file'].map((name) => import(`/web/${name}.js`)))"
                ".then(async ([drawing, file]) => { const drawn = [];"
                "CanvasRenderingContext2D.prototype.fillText = (text) => drawn.push(text);"
                "const get = (path) => fetch(path).then((one) => one.arrayBuffer());"
                f"const episode = file.readTrajectory(await get('/v1/logs/{log}/trajectory'));"
                "const model = await drawing.readModel(await get('/v1/models/locomotion.glb'));"
                "const view = new drawing.View(document.querySelector('main'), episode, model, "
                "{dark: false, strong: 1}); view.showNames(true); view.place(0);"
                "view.scene.traverse((one) => { if (one.isMesh && one.material.opacity < 1) drawn.push('target'); });"
                "view.dispose(); return drawn; })")
            self.assertEqual(found, drawn)
        self.check_quiet(page)


if __name__ == "__main__":
    unittest.main(verbosity=2)
