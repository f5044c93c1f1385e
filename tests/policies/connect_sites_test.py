"""What leaderboards elsewhere show, the check of their order, and Codabench's scoring program."""

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
from myograde.connect import codabench, settings
from myograde.connect.settings import Settings
from myograde.connect.verdict import check, columns_of
from support.submission import played_by_stand_in as manifest


class Manual(WithBoth):
    def test_the_file_on_the_page_can_be_read(self):
        (text,) = re.findall(r"^```json\n(.*?)^```$", (SOURCE / "configs/EVALAI.md").read_text(), re.MULTILINE | re.DOTALL)
        (self.folder / "page.json").write_text(text)
        page = Settings(str(self.folder / "page.json"))
        self.assertEqual((page.evalai.challenge, list(page.phases)), (2222, ["4001", "4002"]))
        aggregate = {"success_rate": 0.9, "effort": 0.1, "time_s": None, "distance_m": 25.0, "spread": {
            "success_rate": {"low": 0.85, "high": 0.95}, "time_s": {}, "distance_m": {"low": 24.0, "high": 28.0}}}
        first, second = (columns_of(page.phases[pk], aggregate, {"score": 90.5})["test"] for pk in page.phases)
        self.assertEqual({label: round(number, 9) for label, number in first.items()},
                         {"Score": 90.5, "Success": 0.9, "Success error": 0.05, "Effort": 0.1})
        self.assertEqual(second, {"Score": 90.5, "Distance": 25.0, "Distance error": 2.0})
        with self.assertRaisesRegex(WrongUse, 'phases, 4002: a column shows "distance_m", but there are score, success_rate'):
            columns_of(page.phases["4002"], {"success_rate": 0.9, "spread": {}}, {"score": 90.5})
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
