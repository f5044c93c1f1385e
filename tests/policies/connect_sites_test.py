"""What leaderboards elsewhere show: packed scores, the check of their order, and Codabench's scoring program."""

import io
import json
import pathlib
import re
import shutil
import subprocess
import sys
import time
import unittest
import unittest.mock

from connect_support import COLUMNS, LONG_S, SOURCE, WithBoth
from myograde.client import WrongUse
from myograde.connect import codabench, mapping, settings
from myograde.connect.check import check
from myograde.connect.settings import Settings
from support.submission import played_by_stand_in as manifest

TIERED = {"line_successes": 90, "line_episodes": 100, "bands": "time", "band_factor": 1.1, "ties": "time"}
DISTANCE = {"time_from_m": 20, "distance_band": 0}


def result(successes=0, time_s=None, effort=None, distance_m=None, **more):
    return {"episodes": 100, "successes": successes, "success_rate": successes / 100, "time_s": time_s,
            "effort": effort, "distance_m": distance_m, "spread": {}, **more}


class Scores(unittest.TestCase):
    def assert_falls(self, rules, results, openers=()):
        scores = [mapping.score(rules, one, openers) for one in results]
        self.assertEqual(scores, sorted(set(scores), reverse=True))

    def test_tiers(self):
        below = [result(89, 3.0, 0.1), result(89, 3.1, 0.01), result(89, 3.1, 0.02), result(89, None, 0.02),
                 result(12, 9.9, 0.5), result(0, 10, 0.5), result(0, 10, None)]
        self.assert_falls(TIERED, [result(90, 2.19, 0.01), result(99, 2.0, 0.02), result(100, 2.2, 0.03),
                                   result(90, 2.21, 0.01), result(90, 9.0, 0.01), *below], [2.0])
        # A result that is not on the board, and in none of its bands, has its own.
        self.assertLess(mapping.score(TIERED, result(90, 2.2, 0.01)), mapping.score(TIERED, result(90, 2.0, 0.03)))
        self.assert_falls({**TIERED, "ties": "acceptance"}, [result(50), result(49)])
        by_success = {**TIERED, "bands": "success"}
        self.assert_falls(by_success, [result(91, 1, 0.01), result(100, 1, 0.02), result(90, 1, 0.001)], [1.0])

    def test_distances(self):
        self.assert_falls(DISTANCE, [result(distance_m=43.5, time_s=30), result(distance_m=20.5, time_s=10),
                                     result(distance_m=20.5, time_s=11), result(distance_m=19.0, time_s=1)])
        self.assertEqual(mapping.score(DISTANCE, result(distance_m=3, time_s=1)),
                         mapping.score(DISTANCE, result(distance_m=3, time_s=2)))
        self.assert_falls({**DISTANCE, "distance_band": 0.05}, [
            result(distance_m=39, time_s=20), result(distance_m=40, time_s=30), result(distance_m=30, time_s=1),
            result(distance_m=19.5, time_s=1)], [1 / 40])
        steps = {"qualify_m": 20, "means": "steps"}
        self.assert_falls(steps, [result(distance_m=20, pain_over_steps=of, effort_over_steps=effort)
                                  for of, effort in ((0.1, 0.5), (0.2, 0.1), (0.2, 0.2))] + [result(distance_m=19)])

    def test_boards_without_rules_go_by_the_mean_score(self):
        results = [{"score": score, "effort": effort} for score, effort in ((1, 0.5), (0.87, 0.1), (0.87, 0.2), (0, 0.1))]
        self.assert_falls(None, results)
        self.assertEqual(mapping.openers_of({"rules": None, "rows": [{"band": 1, "aggregate": results[0]}]}), [])

    def test_bands_are_those_of_the_board(self):
        times = [1.0, 1.7, 1.9, 2.0, 2.3, 2.6, 3.0, 3.4, 20.0, 2000.0]
        self.assert_falls(TIERED, [result(90, time_s, 0.1) for time_s in times], [2.0, 3.0])
        rows = [{"band": band, "aggregate": result(90, time_s)} for band, time_s in (
            (1, 2.2), (1, 2.0), (2, 2.21), (3, 9), (None, 1))] + [{"band": 0, "aggregate": result(20, 0.5)}]
        self.assertEqual(mapping.openers_of({"rules": TIERED, "rows": rows}), [2.0, 2.21, 9])
        physiological = {"qualify_m": 20, "means": "steps"}
        self.assertEqual(mapping.openers_of({"rules": physiological, "rows": [
            {"band": 1, "aggregate": result(distance_m=30)}]}), [])

    def test_columns_that_no_result_has(self):
        with self.assertRaisesRegex(WrongUse, 'shows "speed", but there are score, distance_m, effort,'):
            mapping.value("speed", result(), {})
        self.assertIsNone(mapping.value("effort", result(), {}))


class Manual(WithBoth):
    def test_the_file_on_the_page_can_be_read(self):
        (text,) = re.findall(r"^```json\n(.*?)^```$", (SOURCE / "configs/EVALAI.md").read_text(), re.MULTILINE | re.DOTALL)
        value = json.loads(text)
        (self.folder / "page.json").write_text(text)
        page = Settings(str(self.folder / "page.json"))
        self.assertEqual((page.evalai.challenge, list(page.phases)), (2222, ["4001", "4002"]))
        metrics = {**result(effort=0.1, time_s=1.0), "spread": {"success_rate": {}, "time_s": {}, "distance_m": {}}}
        for phase in value["phases"].values():
            for of in phase["splits"]["test"].values():
                mapping.value(of, metrics, {"score": 1})
        text = (SOURCE / "configs/EVALAI.md").read_text()
        for shape in (settings.FILE, settings.EVALAI, settings.MYOGRADE, settings.PHASE):
            for key in shape:
                self.assertRegex(text, rf"`(evalai\.|myograde\.)?{key}`|`{key}\.|\"{key}\"")

class Checks(WithBoth):
    def test_it_says_where_the_order_differs_and_how_to_mend_it(self):
        made = self.start()
        for pk, (mode, name) in enumerate({"skill-10-0-10-1": "second", "skill-9-0-10-3": "third"}.items()):
            self.evalai.submit((60 + pk, name), 3001, manifest(mode, name), "agent.tar")
        self.turn_until(made, self.all_over)
        printed = io.StringIO()
        with unittest.mock.patch("sys.stdout", printed):
            status = check(self.settings())
        self.assertEqual((status, printed.getvalue()), (0, "Leaderboards elsewhere would have the order of the boards here.\n"))
        # Equal here but for the acceptance, which no score tells.
        for pk, name in enumerate(("earlier", "newer")):
            self.evalai.submit((70 + pk, name), 3001, manifest("skill-4-0-10-1", name), "agent.tar")
            self.turn_until(made, self.all_over)
        self.evalai.splits[3001]["test"] = {"labels": ["Score"], "default_order_by": "Score"}
        self.evalai.splits[3002]["test"] = {"labels": list(COLUMNS), "default_order_by": "Time"}
        printed = io.StringIO()
        with unittest.mock.patch("sys.stdout", printed):
            self.assertEqual(check(self.settings()), 1)
        self.assertIn("here 'earlier' stands above 'newer', there below, as their scores are equal", printed.getvalue())
        self.assertRegex(printed.getvalue(), "phase 3001, split test: no leaderboard .* has the labels Score, Success")
        self.assertRegex(printed.getvalue(), "phase 3002, split test: EvalAI sorts by what shows 'time_s'")
        self.assertEqual([team for team, _ in self.evalai.leaderboard(3001, "test")][-2:], ["newer", "earlier"])


class Codabench(WithBoth):
    """The scoring program as a compute worker runs it, of a bundle that is made as configs/EVALAI.md says."""

    def setUp(self):
        super().setUp()
        package = pathlib.Path(codabench.__file__).parent.parent
        shutil.copytree(package / "connect/bundle", self.folder / "bundle")
        shutil.copytree(package, self.folder / "site/myograde", ignore=shutil.ignore_patterns("__pycache__", "*.so"))
        # What a submission has in /app/program, beside a command of its own.
        (self.folder / "program").mkdir()
        (self.folder / "program/myograde.py").write_text("raise SystemExit('a submission runs')")
        (self.folder / "data").mkdir()
        token = self.daemon.post("/v1/tokens", {"role": "organiser", "label": "Codabench"})["token"]
        (self.folder / "data/token").write_text(token)
        (self.folder / "data/connect.json").write_text(json.dumps({
            "myograde": {"server": str(self.daemon.socket_path), "token_file": "token"}, "teams": {"9": "known"},
            "phases": {name: {"phase": name, "splits": {"main": COLUMNS}} for name in ("warm-up", "final")}}))

    def run_program(self, worker, phase, *files):
        """(what it did, its scores, its report) with what a compute worker has unpacked."""
        work = self.folder / f"run{time.monotonic_ns()}"
        for name in ("input/res", "input/ref", "output"):
            (work / name).mkdir(parents=True)
        (work / "input/ref/phase").write_bytes((self.folder / "bundle" / phase / "phase").read_bytes())
        for name, content in (("metadata", b"exitCode: 0\n"), *files):
            (work / "input/res" / name).write_bytes(content)
        mounts = work / "mountinfo"
        mounts.write_text(f"9 8 0:1 /codabench/{worker}/input /app/input rw - ext4 /dev/sda rw\n")
        (work / "data").symlink_to(self.folder / "data")
        (entrypoint,) = re.findall("^ENTRYPOINT (.*)$", (SOURCE / "configs/EVALAI.md").read_text(), re.MULTILINE)
        words = json.loads(entrypoint)[2].replace("/app/", f"{work}/").split()
        self.assertEqual(words[:4], ["exec", "python3", "-I", "-m"])
        script = (f"import pathlib, runpy, sys\nsys.path.insert(0, {str(self.folder / 'site')!r})\n"
                  "import myograde.connect.codabench as codabench\n"
                  f"codabench.MOUNTS = pathlib.Path({str(mounts)!r})\n"
                  f"runpy.run_module({words[4]!r}, run_name='__main__', alter_sys=True)")
        done = subprocess.run([sys.executable, "-I", "-B", "-c", script, *words[5:]], cwd=self.folder / "program",
                              capture_output=True, text=True, timeout=LONG_S, env={"PATH": ""})
        scores, report = work / "output/scores.json", work / "output/detailed_results.html"
        return (done, json.loads(scores.read_text()) if scores.exists() else None,
                report.read_text() if report.exists() else "")

    def test_a_submission_is_graded_once_for_its_user(self):
        files = [("policy.json", b'{"name": "walker", "command": ["./policy", "ok"]}'), ("policy", b"#!/bin/sh\n")]
        done, scores, report = self.run_program("uPK-5_sID-70__x1", "warm-up", *files)
        self.assertEqual(done.returncode, 0, done.stderr)
        (known,) = self.here("Codabench user 5", "warm-up")
        self.assertEqual(set(scores), set(re.findall(r"key: (\w+), index", (
            self.folder / "bundle/competition.yaml").read_text())))
        self.assertEqual(scores["success"], self.client.show(known["submission"])["aggregate"]["success_rate"])
        self.assertIn("<td>episode 9", report)
        for worker in ("uPK-5_sID-70__x2", "uPK-5_sID-71__x3"):  # delivered again, and submitted again
            self.assertEqual(self.run_program(worker, "warm-up", *files)[1], scores)
        self.assertEqual(len(self.here("Codabench user 5")), 1)

    def test_what_has_no_result_fails_there(self):
        said = "<script>alert(1)</script>"
        done, scores, report = self.run_program("uPK-9_sID-80__x1", "final", (
            "agent.tar", manifest(f"says-{said.encode().hex()}", "crashes")))
        self.assertEqual((done.returncode, scores), (1, None))
        self.assertEqual([known["state"] for known in self.here("known", "final")], ["failed"])
        self.assertNotIn("<script>", report)
        self.assertIn("&lt;script&gt;", report)
        for worker, files, words in (("elsewhere", [], "a compute worker of Codabench"),
                                     ("uPK-9_sID-81__x1", [("results.csv", b"1,2\n")], "results.csv: is not a program")):
            done, scores, report = self.run_program(worker, "final", *files)
            self.assertEqual((done.returncode, scores, report), (2, None, ""))
            self.assertRegex(done.stderr, f"^myograde.connect: error: .*{words}")


if __name__ == "__main__":
    unittest.main()
