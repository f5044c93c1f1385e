"""The suite must be able to fail: tests its verdicts on results and hosts with something wrong."""

import contextlib
import copy
import os
import pathlib
import signal
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import archives  # noqa: E402  (needs the folder above)
import hidden  # noqa: E402
import judge  # noqa: E402
import suite as suites  # noqa: E402
from host import Host  # noqa: E402
from table import SCORED, Variant, each  # noqa: E402

SOURCE = pathlib.Path(__file__).resolve().parents[2]

ROW = {"index": 0, "seed": 914207635518432, "outcome": "failure", "reason": "fell", "steps": 90,
       "clipped": 0, "digest": "ab", "fault": None, "wall_s": 1.0, "policy_cpu_s": 0.2,
       "attempt": 1, "metrics": {"time_s": 0.4}}
RESULT = {"submission": 1, "episode_rows": [ROW], "aggregate": {}, "hashes": {"results": "cd"},
          "not_repeatable": [],
          "output": [{"stdout_tail": "", "stderr_tail": "RT mount EPERM\nRT count 3\n",
                      "stdout_truncated": False, "stderr_truncated": False,
                      "policy_cpu_s": 0.5}]}
STATUS = {"state": "done", "reason": None, "blocks": [{"faults": 0, "attempt": 1, "detail": None}]}
FAULT = {"outcome": "step_timeout", "limit": "step_s", "limit_value": 0.2, "value": 0.9, "step": 3,
         "detail": "step 3 took 0.9 s"}


class Judge(unittest.TestCase):
    def setUp(self):
        self.result, self.status = copy.deepcopy(RESULT), copy.deepcopy(STATUS)
        self.row, self.output = self.result["episode_rows"][0], self.result["output"][0]

    def mistakes(self, missing=(), **expected):
        return judge.mistakes(Variant(**expected), self.status, self.result, None, set(missing))

    def blamed(self, words, missing=(), **expected):
        found = self.mistakes(missing, **expected)
        self.assertTrue(any(words in text for text in found), f"{words!r} is not in {found}")

    def fault(self, **changes):
        self.row.update(outcome="step_timeout", steps=3, fault={**FAULT, **changes})
        self.status["state"] = "failed"

    def test_what_is_as_expected_is_fine(self):
        self.assertEqual(self.mistakes(denied=("mount",), reports={"count": "3"},
                                       at_most={"count": 3}, cpu_s=0.4), [])
        self.fault()
        self.assertEqual(self.mistakes(expect=("step_timeout",), limit="step_s", steps=3,
                                       detail="0.9"), [])

    def test_another_outcome(self):
        self.blamed("expected crash", expect=("crash",))
        self.row["outcome"] = "grader_error"
        self.blamed("grader_error")

    def test_a_host_that_lacks_something_may_give_another_outcome(self):
        self.fault()
        lacking = {"cgroup_memory": ("step_timeout",)}
        self.assertEqual(self.mistakes(("cgroup_memory",), expect=("memory_limit",),
                                       lacking=lacking), [])
        self.blamed("expected memory_limit", expect=("memory_limit",), lacking=lacking)

    def test_evidence_that_is_missing_or_wrong(self):
        expected = {"expect": ("step_timeout",)}
        self.fault(limit="")
        self.blamed("names no limit", **expected)
        self.fault(detail="")
        self.blamed("without evidence", **expected)
        self.fault()
        self.blamed("expected \"tasks\"", limit="tasks", **expected)
        self.blamed("does not say", detail="SIGSEGV", **expected)
        self.blamed("expected 4", steps=4, **expected)
        self.row["wall_s"] = 9.0
        self.blamed("to end it", wall_s=6, **expected)

    def test_what_was_never_tried_is_not_refused(self):
        self.blamed("bpf was never tried", denied=("mount", "bpf"))
        self.output["stderr_tail"] = "RT mount allowed\n"
        self.blamed("mount: allowed", denied=("mount",))
        self.blamed("expected 0", reports={"count": "0"})
        self.blamed("at most 2", at_most={"count": 2})
        self.output["stderr_tail"] = "RT mount EPERM\nRT mount allowed\n"
        self.blamed("mount: allowed", denied=("mount",))

    def test_output_that_spoils_a_terminal_or_is_too_long(self):
        self.output["stdout_tail"] = "\x1b[2J"
        self.blamed("control characters in stdout")
        self.output["stdout_tail"] = "x" * 5000
        self.blamed("5000 bytes of stdout")
        self.blamed("not marked as truncated", truncated=("stderr",))
        self.blamed("of CPU time were counted", cpu_s=2)

    def test_a_fault_of_the_grader_shows_though_the_replay_was_fine(self):
        self.status["blocks"][0].update(faults=1, attempt=2, detail="the simulator ended")
        self.blamed("the grader's fault: the simulator ended")
        self.status = copy.deepcopy(STATUS)
        self.result["not_repeatable"] = [{"index": 0, "differs": ["digest"]}]
        self.blamed("played twice")

    def test_seeds_and_numbers(self):
        self.output["stdout_tail"] = f"it is {self.row['seed']}"
        self.blamed("a seed of the track is known", check="no_seed")
        self.row["metrics"]["time_s"] = float("nan")
        self.blamed("time_s is nan", check="finite", args=("denormal",))

    def test_an_honest_result_is_compared_to_the_last_bit(self):
        same = judge.identity(RESULT)
        self.row["wall_s"] = 7.0
        self.assertEqual(judge.identity(self.result), same)
        self.row["digest"] = "ac"
        self.assertNotEqual(judge.identity(self.result), same)


class Leftovers(unittest.TestCase):
    """A shell with a child stands in for a daemon."""

    def setUp(self):
        self.host = Host(pathlib.Path("/nonexistent"), SOURCE)
        self.addCleanup(self.host.close)
        script = "sleep 60 & echo started; read word; kill $!; wait $!; echo ended; read word"
        self.host.process = subprocess.Popen(["sh", "-c", script], stdin=subprocess.PIPE,
                                            stdout=subprocess.PIPE,
                                            stderr=subprocess.DEVNULL, start_new_session=True)
        self.addCleanup(self.end_group, self.host.pid)
        for stream in (self.host.process.stdin, self.host.process.stdout):
            self.addCleanup(stream.close)
        self.host.process.stdout.readline()

    @staticmethod
    def end_group(group):
        """The child too, which would otherwise hold what this test inherited until it has slept."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)

    def test_processes_and_files_are_seen(self):
        left, spent, _ = self.host.wait_clean(0.3)
        self.assertEqual(len([thing for thing in left if thing.startswith("process")]), 1, left)
        self.assertGreaterEqual(spent, 0.3)
        (self.host.data / "work").mkdir()
        (self.host.data / "work" / "7").mkdir()
        self.assertTrue(any("work/7" in thing for thing in self.host.leftovers()))

    def test_nothing_is_nothing(self):
        self.host.process.stdin.write(b"\n")
        self.host.process.stdin.flush()
        self.assertEqual(self.host.process.stdout.readline(), b"ended\n")
        self.assertEqual(self.host.wait_clean(5)[0], [])


class Tables(unittest.TestCase):
    def test_a_number_names_one_case_and_programs_exist(self):
        cases = suites.all_cases()
        numbers = [case.number for case in cases]
        self.assertEqual(numbers, sorted(set(numbers)))
        programs = {path.name for path in (SOURCE / "tests/redteam/programs").iterdir()}
        used = {case.program for case in cases if hasattr(case, "program")} | {hidden.PROGRAM}
        self.assertEqual(used - programs, set())
        self.assertEqual({name for name in programs if name[0] == "c"} - used, set())

    def test_no_case_allows_a_fault_of_the_grader(self):
        for case in suites.all_cases():
            for variant in getattr(case, "variants", ()):
                allowed = {*variant.expect, *sum(map(tuple, variant.lacking.values()), ())}
                self.assertNotIn("grader_error", allowed)
                self.assertTrue(allowed)

    def test_each_makes_one_variant_of_each(self):
        variants = each(("a b", "c"), expect=SCORED)
        self.assertEqual([variant.args for variant in variants], [("a", "b"), ("c",)])

    def test_a_place_in_braces_is_filled_in(self):
        places = {"{tcp}", "{unix}", "{abstract}", "{canary}", "{data}", "{store}", "{artefacts}",
                  "{sim}", "{source}"}
        used = {arg for case in suites.all_cases() for variant in getattr(case, "variants", ())
                for arg in variant.args if arg.startswith("{")}
        self.assertEqual(used - places, set())

    def test_archives_are_what_their_names_say(self):
        bad = archives.bad()
        self.assertLess(len(bad["bomb.tar.gz"]), archives.BOMB_BYTES // 100)
        self.assertIn(b"../" + archives.ESCAPED.encode(), bad["up.tar"])
        self.assertEqual(len(bad), len({bytes(content) for content in bad.values()}))


if __name__ == "__main__":
    unittest.main(verbosity=2)
