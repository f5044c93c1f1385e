"""The bench of a cluster on a small one: it plays everything whatever fails, repeats itself, and what
a challenge costs follows from the rates of a bench."""

import importlib.util
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import challenge_cost  # noqa: E402
import cluster  # noqa: E402

# What is tested does not hang on the disk, whose waits are most of a run.
if os.access("/dev/shm", os.W_OK):
    tempfile.tempdir = "/dev/shm"
BUILD = pathlib.Path(os.environ["MYOGRADE_TEST_BUILD"])
BENCH = {"cores": 2, "tracks": {
    "manipulation": {"evaluation_all": 2000, "lease_start": {"warm_s": {"median": 0.5}}},
    "locomotion": {"evaluation_all": 1000, "lease_start": {"warm_s": {"median": 1.0}}}}}


class Cluster(unittest.TestCase):
    def test_all_is_played_though_nodes_die_and_the_same_again_with_the_same_seed(self):
        first = cluster.run(BUILD, nodes=200, leases=1000, teams=7, turn_s=5, seed=3)
        self.assertEqual(first["states"], {"done": 10})
        self.assertGreater(first["lost"], 0)
        self.assertGreater(first["starts"], 1000)
        self.assertGreater(first["store_bytes"], first["store_filled_bytes"])
        again = cluster.run(BUILD, nodes=200, leases=1000, teams=7, turn_s=5, seed=3)
        for key in ("starts", "lost", "silent", "faulty", "simulated_s"):
            self.assertEqual(first[key], again[key], key)
        other = cluster.run(BUILD, nodes=200, leases=1000, teams=7, turn_s=5, seed=4)
        self.assertNotEqual([first[key] for key in ("starts", "lost", "silent", "simulated_s")],
                            [other[key] for key in ("starts", "lost", "silent", "simulated_s")])

    def test_wrong_use(self):
        program = BUILD / "tests/myograde_cluster_bench"
        with tempfile.TemporaryDirectory() as folder:
            for words in ([], ["--nodes", "0"], ["--nodes"], ["--mistake", "1"],
                          ["--lease-episodes", "101"]):
                done = subprocess.run([program, *([cluster.CONFIGS, folder] if words else []), *words],
                                      capture_output=True, text=True, timeout=60, check=False)
                self.assertEqual(done.returncode, 2, words)
                self.assertRegex(done.stderr, "^error: ")

    @unittest.skipUnless(importlib.util.find_spec("matplotlib"), "matplotlib is not installed")
    def test_plots(self):
        spread = {"median": 0.1, "min": 0.05, "p99": 0.2, "max": 0.3}
        row = {"nodes": 10, "turns": 100, "wall_s": 5.0, "store_wall_s": 2.0, "leases_per_s": 40.0,
               "peak_bytes": 10**8, "filled_bytes": 10**7,
               "views_s": dict.fromkeys(("running", "health", "queue_of", "outlook_of"), spread)}
        with tempfile.TemporaryDirectory() as folder:
            cluster.draw({"by_nodes": [row, dict(row, nodes=100)]}, folder)
            drawn = sorted(path.name for path in pathlib.Path(folder).iterdir())
            self.assertEqual(drawn, ["cluster_memory.svg", "cluster_rate.svg", "cluster_turn.svg",
                                     "cluster_views.svg"])
            for name in drawn:
                root = xml.etree.ElementTree.parse(pathlib.Path(folder) / name).getroot()
                self.assertTrue(root.tag.endswith("svg"))


class Cost(unittest.TestCase):
    def test_it_follows_from_rate_and_start(self):
        options = challenge_cost.parse(["x", "--submissions", "36", "--machines", "2", "--vcpus", "5",
                                        "--steps", "locomotion=500"])
        found = challenge_cost.costs(BENCH, options)
        arm = found["manipulation"]
        self.assertEqual(arm["lease_s"], 0.5 + 10 * 1000 / 1000)
        self.assertEqual(arm["leases"], 360)
        self.assertAlmostEqual(arm["vcpu_hours"], 360 * 10.5 / 3600)
        self.assertAlmostEqual(arm["hours"], 360 * 10.5 / 10 / 3600)
        self.assertAlmostEqual(arm["leases_per_s"], 10 / 10.5)
        self.assertEqual(found["locomotion"]["lease_s"], 1 + 10 * 500 / 500)

    def test_wrong_use(self):
        for words in (["x", "--steps", "arm=3"], ["x", "--steps", "locomotion=0"],
                      ["x", "--machines", "0"], []):
            with self.assertRaises(SystemExit), open(os.devnull, "w", encoding="utf-8") as null:
                stderr, sys.stderr = sys.stderr, null
                try:
                    challenge_cost.parse(words)
                finally:
                    sys.stderr = stderr

    def test_the_recorded_result_has_what_it_needs(self):
        done = subprocess.run([sys.executable, "-B", HERE / "challenge_cost.py",
                               HERE.parent / "result.json", "--json"], capture_output=True, text=True,
                              timeout=60, check=True)
        self.assertEqual(set(json.loads(done.stdout)), {"manipulation", "locomotion"})


if __name__ == "__main__":
    unittest.main()
