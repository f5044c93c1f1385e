"""The numbers behind figures, which need no matplotlib: means, intervals, what is withheld or was
not measured. usage: numbers_test.py SOURCE_DIR"""

import json
import pathlib
import subprocess
import sys
import unittest

SOURCE = pathlib.Path(sys.argv[1]).resolve()
PROGRAM = SOURCE / "server/figures"
sys.path.insert(0, str(PROGRAM))

import answers  # pylint: disable=wrong-import-position
import estimates  # pylint: disable=wrong-import-position
import evaluation  # pylint: disable=wrong-import-position
import phase_report  # pylint: disable=wrong-import-position
import plain  # pylint: disable=wrong-import-position
import plots  # pylint: disable=wrong-import-position
import submission_report  # pylint: disable=wrong-import-position
from order import Refused  # pylint: disable=wrong-import-position


class Estimates(unittest.TestCase):
    def test_a_mean_has_the_interval_of_the_normal_distribution(self):
        found = estimates.mean([1, 2, 3, 4])
        self.assertEqual((found["mean"], found["count"]), (2.5, 4))
        # 1.96 standard errors of sqrt(5/3)/2
        self.assertAlmostEqual(found["high"] - found["mean"], 1.2651511, 6)
        self.assertEqual(estimates.mean([7]), {"mean": 7, "low": None, "high": None, "count": 1})
        self.assertEqual(estimates.mean([])["mean"], None)

    def test_a_share_has_wilsons_interval(self):
        found = estimates.share(8, 10)  # as in Wilson's paper and every package of statistics
        self.assertAlmostEqual(found["low"], 0.4901625, 6)
        self.assertAlmostEqual(found["high"], 0.9433178, 6)
        for whole in range(1, 200):
            self.assertEqual(estimates.share(0, whole)["low"], 0)
            self.assertEqual(estimates.share(whole, whole)["high"], 1)
        self.assertGreater(estimates.share(0, 5)["high"], 0.3)
        self.assertEqual(estimates.share(0, 0)["share"], None)

    def test_quantiles_lie_between_the_nearest_values(self):
        self.assertEqual(estimates.spread([4, 1, 3, 2])["quartiles"], [1.75, 2.5, 3.25])
        self.assertEqual(estimates.quantile([], 0.5), None)

    def test_a_histogram_has_every_value_once(self):
        found = estimates.histogram([0, 0.5, 1, 1], ["a", "b", "a", "a"])
        self.assertEqual({kind: sum(counts) for kind, counts in found["counts"].items()},
                         {"a": 3, "b": 1})
        self.assertEqual(found["counts"]["a"][-1], 2)  # the largest is in the last bin
        self.assertEqual(sum(estimates.histogram([3, 3], ["a", "a"])["counts"]["a"]), 2)

    def test_a_curve_falls_by_one_episode_after_each_end(self):
        curve = estimates.reached([1, 2, 2], 4)
        self.assertEqual(curve["at"], [0, 1, 2])
        self.assertEqual(curve["share"], [1, 0.75, 0.25])
        self.assertLessEqual(len(estimates.reached(range(10000), 10000)["at"]),
                             estimates.MOST_STEPS)


class Evaluations(unittest.TestCase):
    def test_courses_add_up_to_all_episodes(self):
        found = evaluation.courses(answers.result(7))
        self.assertEqual([row["course"] for row in found],
                         ["flat", "hilly", "rough", "stairs", "mixed"])
        self.assertEqual(sum(row["episodes"] for row in found), 40)

    def test_details_are_read_from_the_rows_that_have_them(self):
        result = answers.result(7)
        heights = [row["details"]["obstacle_heights"]["hilly"] or 0
                   for row in result["episode_rows"]]
        self.assertEqual(evaluation.obstacles(result), {"hilly": max(heights)})
        knee = evaluation.joints(result)[0]
        self.assertEqual((knee["joint"], knee["least"], knee["limit_high"]), ("knee", -0.439, 1.2))
        self.assertEqual([one["joint"] for one in evaluation.joint_pain(result)], ["knee", "ankle"])
        self.assertAlmostEqual(evaluation.joint_pain(result)[0]["mean"], 0.02)
        self.assertEqual(evaluation.moments(result)[0]["moment"], "fall")
        self.assertEqual(evaluation.missing(result), [])

    def test_old_rows_say_in_words_what_they_lack(self):
        old = answers.result(7, detailed=False)
        self.assertRegex(evaluation.missing(old)[0], "^All episodes were played by a grader from before")
        old["episode_rows"][0]["details"] = answers.details(0, 5)
        self.assertRegex(evaluation.missing(old)[0], "^39 of 40 episodes were played by a grader from before")
        for row in old["episode_rows"][1:4]:
            row.update(outcome="crash", steps=0)
        self.assertEqual(evaluation.missing(old), [
            "3 of 40 episodes ended before the first step, so details such as joint ranges are missing.",
            "36 of 40 episodes were played by a grader from before details were measured, so details such as "
            "joint ranges are missing."])
        self.assertEqual(evaluation.joints(answers.result(7, detailed=False)), [])

    def test_phantoms_count_in_the_official_rate_and_nowhere_else(self):
        result = answers.result(7)
        rows = result["episode_rows"]
        successes = sum(row["outcome"] == "success" for row in rows)
        for number in (9, 19, 29):
            # As configs of form 1 name it, and as those of today do.
            rows[number].update(outcome="failure", reason="handover" if number == 9 else "phantom", end="phantom",
                                metrics={**rows[number]["metrics"], "time_s": 99999, "success": 0})
        successes = sum(row["outcome"] == "success" for row in rows)
        found = evaluation.headline(result)
        self.assertEqual((found["played"]["part"], found["played"]["whole"]), (successes, 37))
        self.assertEqual(found["success"]["whole"], 40)
        times = next(one for one in evaluation.distributions(result) if one["name"] == "time_s")
        self.assertEqual((times["count"], times["most"] < 99999), (37, True))
        self.assertEqual(evaluation.survival(result)["episodes"], 37)
        self.assertEqual(sum(evaluation.endings(result).values()), 40)
        text = json.dumps(submission_report.verdict(submission_report.numbers_of(result), result), default=str)
        self.assertIn(f"{successes} of 37 played; the other 3 episodes", text)
        self.assertIsNone(evaluation.headline(answers.result(7))["played"])

    def test_forces_of_like_names_are_told_apart(self):
        result = answers.result(7)
        result.update(official_figures=True, metrics=[
            *answers.METRICS, answers.metric("peak_force_n", "peak force", "N", 1, "neither"),
            answers.metric("max_touch_n", "peak touch", "N", 1, "neither")])
        text = json.dumps(submission_report.verdict(submission_report.numbers_of(result), result), default=str)
        for words in ("not official", 'calls it \\"peak force\\"', "is the peak touch"):
            self.assertIn(words, text)

    def test_hostile_shapes_of_details_are_left_out(self):
        result = answers.result(7)
        for row, details in zip(result["episode_rows"], (
                [], "x", 7, {"joint_ranges": {"knee": [1, 2]}}, {"obstacle_heights": {"hilly": "x"}},
                {"pain_by_joint": {"knee": True}}, {"joint_ranges": [1]})):
            row["details"] = details
        submission_report.numbers_of(result)

    def test_what_is_withheld_is_a_sentence(self):
        hidden = answers.withheld(7)
        for make in (evaluation.distributions, evaluation.courses, evaluation.survival):
            with self.assertRaisesRegex(Refused, "withholds"):
                make(hidden)
        numbers = submission_report.numbers_of(hidden)
        self.assertIn("The phase withholds", numbers["missing"][0])
        self.assertEqual(numbers["headline"]["success"]["share"], None)

    def test_details_that_are_withheld_with_logs_are_not_called_old(self):
        hidden = {**answers.result(7, detailed=False), "withheld": ["logs"]}
        self.assertEqual(evaluation.missing(hidden), [
            "The phase withholds these parts until it is published: logs."])
        for result, words in ((hidden, "withholds"), (answers.result(7, detailed=False), "before")):
            with self.assertRaisesRegex(Refused, words):
                plots.made({"make": "plot", "kind": "joints", "format": None, "results": [result]})

    def test_an_evaluation_without_episodes_is_a_sentence(self):
        empty = {**answers.result(7), "episode_rows": [], "aggregate": None}
        for make in (evaluation.distributions, evaluation.courses, evaluation.survival):
            with self.assertRaisesRegex(Refused, "no episode yet"):
                make(empty)
        self.assertEqual(submission_report.numbers_of(empty)["distributions"], [])

    def test_courses_of_a_track_without_any_are_a_sentence(self):
        result = answers.result(7)
        for row in result["episode_rows"]:
            row["facts"] = {}
        with self.assertRaisesRegex(Refused, "not on courses of several kinds"):
            evaluation.courses(result)

    def test_survival_counts_failures_alone(self):
        result = answers.result(7)
        curves = evaluation.survival(result)
        successes = result["aggregate"]["successes"]
        self.assertEqual(curves["failed"], 40 - successes)
        self.assertEqual(curves["curves"]["distance_m"]["share"][-1], successes / 40)


class Boards(unittest.TestCase):
    def numbers(self):
        results = [answers.result(7), answers.result(9, "beta"), answers.result(11, "base")]
        order = {**answers.board_order(results), "results": [
            *results[:2], {"submission": 11, "error": "There is no submission 11."}]}
        return phase_report.numbers_of(order)

    def test_teams_have_their_values_over_time(self):
        history = self.numbers()["history"]
        self.assertEqual([team["team"] for team in history["teams"]], ["alpha", "beta"])
        self.assertEqual([value is None for value in history["teams"][1]["values"]],
                         [True, True, False])

    def test_records_are_the_best_of_all_submissions(self):
        found = self.numbers()
        best = found["records"]["best"]["distance_m"]
        rows = found["records"]["rows"]
        self.assertEqual(best["value"], max(row["distance_m"] for row in rows))
        self.assertEqual(found["records"]["kinds"], ["hilly"])

    def test_what_the_caller_may_not_see_is_said(self):
        self.assertTrue(any("not shown to who asked" in one for one in self.numbers()["missing"]))

    def test_baselines_have_no_rank(self):
        self.assertEqual([row["rank"] for row in self.numbers()["ranking"]], [1, 2, None])

    def test_a_board_without_rows_is_a_sentence(self):
        order = answers.board_order([answers.result(7)])
        order["moments"] = [{"at": "2026-12-01T00:00:00Z", "rows": []}]
        order["board"]["rows"] = []
        with self.assertRaisesRegex(Refused, "never had a row"):
            plots.made({"make": "plot", "kind": "board", "format": None, **order})
        numbers = phase_report.numbers_of({**order, "results": []})
        self.assertEqual((numbers["ranking"], numbers["history"]), ([], None))


class Texts(unittest.TestCase):
    def test_names_are_short_and_without_what_nobody_sees(self):
        for text in answers.HOSTILE:
            shown = plain.plain(text, 60)
            self.assertLessEqual(len(shown), 60)
            self.assertIsNone(plain.UNSEEN.search(shown))
        self.assertEqual(plain.plain("a\u202eb\nc"), "a⟨U+202E⟩b c")
        self.assertEqual(plain.plain("東京大学", 7), "東京大…")
        self.assertEqual(plain.plain("q" + "\u0301" * 9), "q\u0301\u0301")

    def test_lines_stay_lines(self):
        self.assertEqual(plain.lines("a\r\nb\tc\x00"), "a\nb\tc⟨U+0000⟩")

    def test_numbers_have_their_digits_and_units(self):
        self.assertEqual(plain.number(1234.5, 2), "1,234.50")
        self.assertEqual(plain.number(None), "–")
        self.assertEqual(plain.number(True), "–")
        self.assertEqual(plain.heading(answers.METRICS[0]), "Distance (m)")


class Program(unittest.TestCase):
    """As the command line tool calls it."""

    def ask(self, order):
        done = subprocess.run(["/usr/bin/python3", "-I", "-B", PROGRAM], timeout=60, check=True,
                              input=json.dumps(order).encode(), capture_output=True)
        head, _, file = done.stdout.partition(b"\n")
        return json.loads(head), file

    def test_numbers_alone_need_no_matplotlib(self):
        answer, file = self.ask({"make": "plot", "kind": "survival", "format": None,
                                 "results": [answers.result(7), answers.result(9)]})
        self.assertEqual((answer["bytes"], file), (0, b""))
        self.assertEqual([one["submission"] for one in answer["numbers"]], [7, 9])

    def test_a_refusal_is_the_callers(self):
        answer, _ = self.ask({"make": "plot", "kind": "courses", "format": None,
                              "results": [answers.withheld(7)]})
        self.assertEqual(answer["whose"], "caller")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
