"""The search for the baselines' parameters, for some steps: it goes on where it was, and what it
found is played and drawn. Runs with docker/training.txt (environments.sh)."""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
TRAINING = SOURCE / "policies/training"
sys.path.insert(0, str(TRAINING))
import screen  # noqa: E402
LIBRARY = os.environ["MYOGRADE_TEST_CONTROLLERS"]
DEADLINE_S = 240


def run(script, *words, python=sys.executable, status=0):
    """What a script of the training prints."""
    done = subprocess.run([python, "-B", TRAINING / script, *map(str, words)], text=True,
                          timeout=DEADLINE_S, capture_output=True, check=False)
    if done.returncode != status:
        raise AssertionError(f"{script}: exit status {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout if status == 0 else done.stderr


class Training(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="myograde-training-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def search(self, generations):
        """The lines of its log."""
        run("search.py", self.folder / "search", "--library", LIBRARY, "--generations", generations,
            "--population", 4, "--seeds", 1, "--seconds", 0.1, "--test-every", 1,
            "--test-seeds", 1)
        log = (self.folder / "search/progress.jsonl").read_text()
        return [json.loads(line) for line in log.splitlines()]

    def test_a_search_goes_on_where_it_was(self):
        first = self.search(1)
        self.assertEqual([line["episodes"] for line in first], [4])
        lines = self.search(2)
        self.assertEqual(lines[0], first[0])
        self.assertEqual([line["generation"] for line in lines], [1, 2])
        self.assertEqual(lines[1]["episodes"], 8)
        best = json.loads((self.folder / "search/best.json").read_text())
        kept = self.folder / "kept.json"
        said = run("evaluate.py", self.folder / "search/best.json", "--library", LIBRARY,
                   "--episodes", 2, "--seconds", 0.1, "--write", kept, "--command", "a test")
        figure = json.loads(said.splitlines()[0])
        self.assertEqual(figure["episodes"], 2)
        content = json.loads(kept.read_text())
        self.assertEqual((content["figure"], content["command"]), (figure, "a test"))
        self.assertEqual(content["parameters"].keys(), best["parameters"].keys())
        said = run("search.py", self.folder / "search", "--library", LIBRARY, "--controller",
                   "reacher", status=1)
        self.assertIn("other parameters than the reacher has now", said.splitlines()[-1])

    def test_the_shipped_parameters_are_all_there(self):
        for controller, file, profile in (("walker", "locomotion.json", "as-graded"),
                                          ("reacher", "manipulation.json", "paper"),
                                          ("juggler", "baoding.json", "official"),
                                          ("carrier", "relocation.json", "official"),
                                          ("tagger", "chasetag.json", "official")):
            shipped = SOURCE / "policies/baseline/parameters" / file
            written = self.folder / file
            run("evaluate.py", shipped, "--library", LIBRARY, "--controller", controller,
                "--profile", profile, "--episodes", 1, "--seconds", 0.05, "--write", written)
            content = json.loads(written.read_text())
            self.assertEqual(content["parameters"], json.loads(shipped.read_text())["parameters"])
            self.assertEqual(content["figure"]["profile"], profile)

    def test_turns_of_a_die_are_searched_and_chosen(self):
        words = ("turns.py", self.folder / "turns", "--library", LIBRARY, "--batch", 4)
        said = run(*words, "--write", self.folder / "none.json", status=1)
        self.assertIn("no turn has reached a goal yet", said.splitlines()[-1])
        first = run(*words, "--seconds", 0.1)
        self.assertIn("4 trials", first)
        said = run(*words, "--seconds", 0.1, "--turns", 1, "--write", self.folder / "some.json")
        self.assertIn("8 trials", said)
        self.assertIn("1 turns with 8 dice each", said)
        for file in (self.folder / "some.json",
                     SOURCE / "policies/baseline/parameters/reorientation.json"):
            kept = self.folder / "kept.json"
            run("evaluate.py", file, "--library", LIBRARY, "--controller", "turner", "--episodes", 1,
                "--seconds", 0.05, "--write", kept)
            turns = json.loads(kept.read_text())["turns"]
            self.assertEqual(turns, json.loads(file.read_text())["turns"])
            self.assertTrue(turns)

    def test_falls_are_counted_by_their_way_and_by_course(self):
        shipped = SOURCE / "policies/baseline/parameters/locomotion.json"
        said = run("evaluate.py", shipped, "--library", LIBRARY, "--episodes", 2, "--seconds", 5,
                   "--set", "knee_stance_stiffness=20", "hip_limit=10",
                   "--config", SOURCE / "configs/tracks/locomotion.json")
        figure = json.loads(said.splitlines()[0])
        self.assertEqual(figure["ends"], {"fell": 2})
        self.assertLessEqual(figure["falls"].keys(), {"forwards", "backwards", "left", "right"})
        self.assertEqual(sum(figure["falls"].values()), 2)
        self.assertEqual(sum(sum(ways.values()) for ways in figure["falls_by_course"].values()), 2)

    def test_a_search_takes_points_from_a_walker_that_falls_sideways(self):
        weak = self.folder / "weak.json"
        shipped = SOURCE / "policies/baseline/parameters/locomotion.json"
        numbers = json.loads(shipped.read_text())["parameters"]
        weak.write_text(json.dumps({"parameters": {**numbers, "roll_stiffness": 0}}))
        run("search.py", self.folder / "walk", "--library", LIBRARY, "--from", weak,
            "--sigma", 0.1, "--generations", 1, "--population", 4, "--seeds", 1, "--seconds", 5,
            "--sideways", 1000, "--config", SOURCE / "configs/tracks/locomotion.json",
            "--test-every", 1, "--test-seeds", 1)
        mean = json.loads((self.folder / "walk/progress.jsonl").read_text())["mean"]
        sideways = (mean["ends"].get("off-track", 0) + mean["falls"].get("left", 0) +
                    mean["falls"].get("right", 0))
        self.assertGreater(sideways, 0)
        self.assertAlmostEqual(mean["score"], -1000 * sideways / 4, delta=50)

    def test_a_track_that_is_none_is_refused_in_a_sentence(self):
        track = self.folder / "track.json"
        shipped = (SOURCE / "configs/tracks/locomotion.json").read_text()
        track.write_text(shipped.replace('["flat", "hilly"', '["flat", "flat", "hilly"'))
        for script, first in (("search.py", self.folder / "never"),
                              ("evaluate.py",
                               SOURCE / "policies/baseline/parameters/locomotion.json")):
            said = run(script, first, "--library", LIBRARY, "--config", track, status=1)
            self.assertIn('"kinds" has "flat" twice', said.splitlines()[-1])
            self.assertNotIn("Traceback", said)
            said = run(script, first, "--library", LIBRARY, "--profile", "none", status=1)
            self.assertIn("none", said.splitlines()[-1])
            self.assertNotIn("Traceback", said)

    def test_a_screen_finds_what_each_parameter_does(self):
        signs = screen.design(16, 9)
        np.testing.assert_array_equal(signs.T @ signs, 16 * np.eye(9))
        np.testing.assert_array_equal(signs.sum(axis=0), np.zeros(9))
        steps = np.array([0.5, -2, 0, 0, 1, 0, 3, 0, -1])
        noise = np.random.default_rng(3).normal(0, 0.1, 16)
        found = screen.effects(signs, 7 + signs @ steps + noise)
        np.testing.assert_allclose(found.steps, steps, atol=0.15)
        self.assertTrue(0.01 < found.error < 0.06, found.error)

    def test_a_screen_prints_a_row_for_each_parameter(self):
        shipped = SOURCE / "policies/baseline/parameters/locomotion.json"
        words = ("screen.py", shipped, "--library", LIBRARY, "--runs", 4, "--seeds", 1,
                 "--seconds", 0.05)
        lines = run(*words, "--only", "speed|pitch").splitlines()
        self.assertEqual(json.loads(lines[0])["fell_sideways"], 0)
        self.assertEqual({tuple(line.split("\t")[:2]) for line in lines[2:]},
                         {("speed", "+0.0525"), ("pitch", "+0.0175")})
        said = run(*words, "--only", "speed|pitch|roll_left", status=1)
        self.assertEqual(said.splitlines()[-1],
                         "--only: 3 parameters match; 4 runs tell about 1 to 2.")
        said = run(*words[:-4], "--runs", 3, status=1)
        self.assertIn("--runs 3: has to be a power of two", said.splitlines()[-1])

    def test_obstacles_begin_near_the_start(self):
        track = self.folder / "obstacles.json"
        run("obstacles.py", track)
        said = run("evaluate.py", SOURCE / "policies/baseline/parameters/locomotion.json",
                   "--library", LIBRARY, "--episodes", 1, "--seconds", 0.05, "--config", track)
        self.assertEqual(json.loads(said.splitlines()[0])["ends"], {"time": 1})
        rules = json.loads(track.read_text())["profiles"]["paper"]["rules"]
        self.assertEqual(rules["course"]["difficulty"][:2], [0, 0.125])

    def test_some_numbers_of_the_arm_are_searched_and_the_others_stay(self):
        shipped = SOURCE / "policies/baseline/parameters/manipulation.json"
        run("search.py", self.folder / "arm", "--library", LIBRARY, "--controller", "reacher",
            "--only", "closed_.*", "--from", shipped, "--generations", 1, "--population", 4,
            "--seeds", 1, "--seconds", 0.05, "--test-every", 1, "--test-seeds", 1)
        best = json.loads((self.folder / "arm/best.json").read_text())["parameters"]
        before = json.loads(shipped.read_text())["parameters"]
        changed = {name for name in best if abs(best[name] - before[name]) > 1e-9}
        self.assertTrue(changed)
        self.assertEqual({name.split("_")[0] for name in changed}, {"closed"})

    @unittest.skipIf(subprocess.run(["/usr/bin/python3", "-c", "import matplotlib"],
                                    capture_output=True, check=False).returncode,
                     "Debian's python3-matplotlib is not installed")
    def test_a_search_is_drawn(self):
        self.search(2)
        picture = self.folder / "search.svg"
        run("plot.py", picture, self.folder / "search", python="/usr/bin/python3")
        self.assertIn("<svg", picture.read_text())


if __name__ == "__main__":
    unittest.main()
