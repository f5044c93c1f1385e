"""What the bench makes of measurements: schema, table and plots, on recorded numbers; and that its
measuring programs say what the schema asks for."""

import importlib.util
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest
import xml.etree.ElementTree

import jsonschema

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE / "others"))
import bench  # noqa: E402
import others  # noqa: E402
import processes  # noqa: E402

SCHEMA = json.loads((HERE.parents[1] / "configs/schema/bench.json").read_text())
RESULT = json.loads((HERE / "result.json").read_text())


def part_schema(*path):
    """A part of the schema, with the definitions that it refers to."""
    part = SCHEMA
    for key in path:
        part = part[key]
    return dict(part, **{"$defs": SCHEMA["$defs"]})


class Result(unittest.TestCase):
    def test_fits_the_schema_and_a_part_that_is_missing_does_not(self):
        jsonschema.validate(RESULT, SCHEMA)
        without = {key: value for key, value in RESULT.items() if key != "growth"}
        with self.assertRaises(jsonschema.ValidationError):
            jsonschema.validate(without, SCHEMA)

    def test_the_table_names_growth_and_logs(self):
        text = bench.table(RESULT)
        self.assertIn("log of an episode, KB", text)
        self.assertIn("queued leases", text)
        self.assertIn("episodes in an evaluation", text)

    def test_the_table_of_one_track_has_no_growth(self):
        text = bench.table(dict(RESULT, store=None, growth=None))
        self.assertNotIn("queued leases", text)

    def test_logs_are_counted_as_they_lie_on_the_disk(self):
        rows = [{"log": {"packed_bytes": 10, "bytes": 99}}, {"log": {"packed_bytes": 30}}, {}]
        self.assertEqual(bench.log_bytes({"episode_rows": rows}), 20)
        self.assertIsNone(bench.log_bytes({"episode_rows": [{}]}))


class Others(unittest.TestCase):
    def figures(self):
        def rates(one, many):
            return {name: {"median": rate, "min": rate, "max": rate}
                    for name, rate in (("one_core", one), ("all_cores", many)) if rate}
        figures = {"myosuite": rates(400, 800), "loop": rates(200, 400),
                   "envpool": {"skipped": "no network here"}, "vector": rates(480, 960),
                   "env": rates(500, 1000),
                   "evaluation": rates(None, 900), "evaluation_python": rates(None, 800)}
        return dict(figures, ratios=others.ratios(figures))

    def test_ratios_are_of_what_both_have(self):
        found = self.figures()["ratios"]
        self.assertEqual(found["env_over_myosuite_one_core"], 1.25)
        self.assertEqual(found["evaluation_over_loop_all_cores"], 2.25)
        self.assertNotIn("evaluation_over_loop_one_core", found)
        self.assertFalse([name for name in found if "envpool" in name])

    def test_the_table_says_why_something_is_skipped(self):
        text = others.table({"tracks": {"locomotion": self.figures()}})
        self.assertIn("skipped: no network here", text)
        self.assertIn("2.40 / 2.40", text)

    def test_cpu_time_is_compared_where_both_have_it(self):
        figures = self.figures()
        self.assertNotIn("by CPU time", others.table({"tracks": {"locomotion": figures}}))
        for what, rates in (("vector", [30, 90]), ("myosuite", [10, 10])):
            figures[what]["one_core"]["cpu"] = others.summary(rates)
        figures["ratios"] = others.ratios(figures)
        self.assertEqual(figures["ratios"]["vector_over_myosuite_one_core_cpu"], 6)
        self.assertIn("by CPU time: MyoSuite, Python 6.00",
                      others.table({"tracks": {"locomotion": figures}}))

    def test_a_ratio_is_the_median_over_turns(self):
        def turns(*rates):
            return others.summary(list(rates))
        self.assertEqual(others.ratio(turns(2, 30, 4), turns(1, 10, 4)), 2)
        self.assertEqual(others.ratio(turns(2, 30, 4), turns(1)), 4)  # one failed later

    def test_a_program_that_fails_is_skipped_with_its_reason(self):
        options = type("Options", (), {"quick": True, "myosuite": "/bin/false", "loop": "",
                                       "envpool": "", "vector": "", "myosuite_why": "",
                                       "loop_why": "no\n  network", "envpool_why": "",
                                       "vector_why": ""})
        said = []
        found = others.in_turns("locomotion", options, 2, said.append)
        self.assertEqual(found["myosuite"], {"skipped": "exit 1"})
        self.assertEqual(found["loop"], {"skipped": "no network"})
        self.assertEqual(found["vector"], {"skipped": "its packages are not installed"})
        self.assertIn("locomotion: environments in Python on 2 cores, 4 turns", said)


class Measuring(unittest.TestCase):
    def test_the_statistics_are_timed(self):
        program = pathlib.Path(os.environ["MYOGRADE_TEST_BUILD"]) / "tests/myograde_statistics_bench"
        said = json.loads(subprocess.run([program, "--quick"], capture_output=True, check=True,
                                         text=True, timeout=120).stdout)
        self.assertEqual([row["tests"] for row in said["by_places"]], [10, 45, 190, 1225])

    def test_the_schedulers_times_fit_the_schema(self):
        program = pathlib.Path(os.environ["MYOGRADE_TEST_BUILD"]) / "tests/myograde_scheduler_bench"
        done = subprocess.run([program, "--quick"], capture_output=True, text=True, timeout=120,
                              check=True)
        said = json.loads(done.stdout)
        jsonschema.validate(said, part_schema("properties", "growth", "properties", "scheduler"))
        self.assertEqual([row["teams"] for row in said["by_teams"]], [1, 200])

    def test_processor_time_is_that_of_the_process(self):
        before = processes.cpu_seconds(os.getpid())
        end = time.process_time() + 0.05
        while time.process_time() < end:
            pass
        self.assertGreaterEqual(processes.cpu_seconds(os.getpid()) - before, 0.045)


@unittest.skipUnless(importlib.util.find_spec("matplotlib"), "matplotlib is not installed")
class Plots(unittest.TestCase):
    def draw(self, result):
        import plots
        with tempfile.TemporaryDirectory() as folder:
            plots.draw(result, folder)
            return {path.name: path.read_bytes() for path in pathlib.Path(folder).iterdir()}

    def test_every_curve_is_an_svg_of_its_own_with_the_same_bytes_each_time(self):
        drawn = self.draw(RESULT)
        self.assertEqual(set(drawn), {f"{name}.svg" for name in (
            "steps_manipulation", "steps_locomotion", "growth_episodes", "growth_teams",
            "growth_scheduler_leases", "growth_scheduler_teams", "growth_memory", "growth_store",
            "growth_store_bytes")})
        for name, content in drawn.items():
            self.assertTrue(xml.etree.ElementTree.fromstring(content).tag.endswith("svg"), name)
        self.assertEqual(drawn, self.draw(RESULT))

    def test_one_track_alone_has_bars_only(self):
        tracks = {"locomotion": RESULT["tracks"]["locomotion"]}
        self.assertEqual(set(self.draw(dict(RESULT, tracks=tracks, store=None, growth=None))),
                         {"steps_locomotion.svg"})


if __name__ == "__main__":
    unittest.main()
