"""The whole system as users see it: real daemon, sandboxes, models, policies."""

import gzip
import json
import os
import shutil
import signal
import subprocess
import unittest

from support.client import Connection
from support.waiting import wait_until
from system import BIN, POLICIES, SystemTest, track_config

TRACKS = ("manipulation", "locomotion", "elbow")


def identities(rows):
    """A result without what depends on the host's clock."""
    return [(row["index"], row["outcome"], row["digest"], row["steps"]) for row in rows]


class GradeAndRank(SystemTest):
    tracks = {f"short-{track}": track_config(track) for track in TRACKS}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.start_daemon()

    def submit(self, policy, track, team):
        return self.ask("submit", POLICIES / policy, "--track", track, "--team", team, "--wait")

    def rows(self, submission):
        return self.ask("show", submission, "--episodes")["episode_rows"]

    def test_policies_are_graded_ranked_and_repeated(self):
        for track in TRACKS:
            with self.subTest(track=track):
                config = f"short-{track}"
                random = self.submit("random", config, "Random")["submission"]
                scripted = self.submit(f"scripted-{track}", config, "Scripted")["submission"]
                rows = self.rows(random)
                self.assertEqual([row["index"] for row in rows], [0, 1, 2])
                self.assertEqual(len({row["digest"] for row in rows}), 3, "episodes must differ")
                self.assertNotEqual(identities(rows), identities(self.rows(scripted)))
                self.check_details(track, rows)
                board = self.ask("leaderboard", "--track", config)
                ranks = {row["team"]: row["rank"] for row in board["rows"]}
                self.assertEqual(sorted(ranks.values()), list(range(1, len(ranks) + 1)))
                self.assertIn("Random", ranks)
                again = self.ask("rerun", random, "--episodes", "1..1", "--wait")
                self.assertEqual(again["comparison"]["equal"], 3, "a lease is run again whole")

    def check_details(self, track, rows):
        for row in rows:
            facts, details = row["facts"], row["details"]
            for joint, (low, high, *limits) in details["joint_ranges"].items():
                self.assertTrue(low <= high and limits[0] < limits[1], joint)
            if track == "locomotion":
                self.assertAlmostEqual(sum(details["pain_by_joint"].values()) / 12,
                                       facts["pain_sum"], delta=1e-5)
                self.assertEqual(details["fall_y"] is None, row["end"] != "fell")
            if track == "manipulation":
                # The reset's frame counts as a contact, but is no step.
                if details["first_contact_time"] is not None:
                    self.assertGreater(facts["frames_arm"], 0)
                self.assertEqual(details["peak_force_time"] is None, facts["peak_force"] == 0)

    def test_the_warm_up_tells_controllers_apart(self):
        gentle = self.root / "gentle"
        shutil.copytree(POLICIES / "scripted-elbow", gentle)
        (gentle / "policy.json").write_text(json.dumps({
            "name": "gentle", "command": ["./scripted-elbow", "--stiffness", "10"]}))
        for team, policy in (("Chance", "random"), ("Script", "scripted-elbow"), ("Gentle", gentle)):
            self.submit(policy, "elbow", team)
        board = self.ask("leaderboard", "--track", "elbow")
        self.assertEqual([column["name"] for column in board["columns"]], ["time_s", "effort"])
        rows = {row["team"]: row["aggregate"] for row in board["rows"]}
        self.assertEqual([row["team"] for row in board["rows"]], ["Gentle", "Script", "Chance"])
        self.assertGreaterEqual(rows["Script"]["successes"], 95)
        self.assertGreaterEqual(rows["Gentle"]["successes"], 95)
        self.assertLessEqual(rows["Chance"]["successes"], 5)
        self.assertLess(rows["Script"]["time_s"], rows["Gentle"]["time_s"])
        self.assertLess(rows["Gentle"]["effort"], rows["Script"]["effort"])
        shown = self.run_cli("leaderboard", "--track", "elbow").stdout
        self.assertIn("time s", shown)
        self.assertNotIn("distance", shown)

    def test_a_python_policy_is_graded(self):
        result = self.submit("python-example", "short-locomotion", "Python")
        self.assertEqual(result["state"], "done")

    def test_local_gives_the_same_episodes_as_the_daemon(self):
        submission = self.submit("zero", "short-manipulation", "Zero")["submission"]
        local = self.ask("local", POLICIES / "zero", "--track", "short-manipulation")
        rows = self.rows(submission)
        self.assertEqual(identities(local["episodes"]), identities(rows))
        self.assertEqual([row["details"] for row in local["episodes"]],
                         [row["details"] for row in rows])

    def test_fewer_episodes_are_practice(self):
        result = self.ask("submit", POLICIES / "zero", "--track", "short-locomotion",
                          "--team", "Practice", "--episodes", "1", "--wait")
        self.assertFalse(result["ranked"])
        board = self.ask("leaderboard", "--track", "short-locomotion")
        self.assertNotIn("Practice", [row["team"] for row in board["rows"]])


    def fetch(self, path, coding=None):
        connection = Connection(self.daemon.socket_path)
        connection.request("GET", path, headers={"Accept-Encoding": coding} if coding else {})
        response = connection.getresponse()
        body = response.read()
        connection.close()
        return response.status, response.headers, body

    def made(self, path, coding=None):
        """The answer once it is made."""
        status, headers, body = wait_until(lambda: self.fetch(path, coding), 120,
                                           f"{path} is not made",
                                           fits=lambda answer: answer[0] != 202)
        self.assertEqual(status, 200, body[:200])
        return headers, body

    def simulated(self, *words):
        """A file that the simulator writes without a daemon."""
        file = self.root / "made"
        subprocess.run([BIN / "myograde-sim", *(file if word == "FILE" else word for word in words),
                        os.environ["MYOGRADE_CACHE"]], check=True, stdout=subprocess.DEVNULL, timeout=120)
        return file.read_bytes()

    def test_names_in_messages_are_harmless(self):
        missing = self.root / "no\x1b[31m\x07\u009b\u202e"
        for words, status in ((("myograde-sim", "--compile-models", missing), 1),
                              (("myograded", "--data", missing, "--adopt"), 4)):
            done = subprocess.run([BIN / words[0], *words[1:]], env=self.environment, timeout=120,
                                  capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, status, done.stderr)
            self.assertIn("no?[31m?", done.stderr)
            self.assertTrue(done.stderr.rstrip("\n").isprintable(), ascii(done.stderr))

    def test_episodes_can_be_looked_at(self):
        submission = self.submit("random", "short-locomotion", "Seen")["submission"]
        log = self.rows(submission)[1]["log"]["sha256"]
        path = f"/v1/logs/{log}/trajectory"
        headers, packed = self.made(path, "br, gzip")
        self.assertEqual(headers["Content-Encoding"], "gzip")
        file = self.data / "logs" / f"{log}.lcmlog.zst"
        expected = self.simulated("--trajectory", file, "FILE")
        self.assertEqual(gzip.decompress(packed), expected)
        headers, plain = self.made(path)
        self.assertEqual(plain, expected)
        self.assertNotIn("Content-Encoding", headers)
        self.assertEqual(self.made(path, "zstd;q=1, gzip")[0]["Content-Encoding"], "zstd")
        connection = Connection(self.daemon.socket_path)
        connection.request("GET", path, headers={"If-None-Match": headers["ETag"]})
        self.assertEqual(connection.getresponse().status, 304)
        connection.close()
        headers, model = self.made("/v1/models/locomotion.glb", "gzip")
        self.assertEqual(gzip.decompress(model),
                         self.simulated("--model-file", "locomotion", "FILE"))
        self.assertEqual(self.fetch("/v1/models/swimming.glb")[0], 404)
        self.assertEqual(self.fetch(f"/v1/logs/{'0' * 64}/trajectory")[0], 404)

    def test_an_episode_that_plays_otherwise_is_not_shown(self):
        submission = self.submit("random", "short-elbow", "Altered")["submission"]
        log = self.rows(submission)[0]["log"]["sha256"]
        file = self.data / "logs" / f"{log}.lcmlog.zst"
        file.write_bytes(file.read_bytes()[:-20])
        for what in ("trajectory", "picture.png"):
            status, _, body = wait_until(
                lambda: self.fetch(f"/v1/logs/{log}/{what}"), 120, f"{what} is not refused",
                fits=lambda answer: answer[0] != 202)
            self.assertEqual((status, json.loads(body)["error"]["code"]), (409, "no_picture"), body)


class Misbehave(SystemTest):
    """Each kind of misbehaviour costs only its own episode and is explained in one sentence."""

    tracks = {"short": track_config("locomotion"),
              "impatient": track_config("locomotion", budgets={"startup_s": 1})}

    EXPECTED = {
        "exits": ("crash", "status 7"),
        "aborts": ("crash", "SIGABRT"),
        "sleeps": ("step_timeout", ""),
        "spins": ("step_timeout", ""),
        "short": ("protocol", "54"),
        "none": ("protocol", "must have 55"),
        "long": ("protocol", "must have 55"),
        "nan": ("protocol", "finite"),
        "infinite": ("protocol", "finite"),
        "wrong-step": ("protocol", "step"),
    }

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.start_daemon()

    def test_every_mistake_has_its_outcome(self):
        for mode, (outcome, words) in self.EXPECTED.items():
            with self.subTest(mode=mode):
                result = self.ask("submit", self.misbehaving(mode), "--track", "short",
                                  "--team", mode, "--wait")
                self.assertEqual(result["state"], "done")
                rows = self.ask("show", result["submission"], "--episodes")["episode_rows"]
                self.assertEqual([row["outcome"] for row in rows], ["failure", outcome, "failure"])
                self.assertEqual(rows[1]["fault"]["step"], 3)
                self.assertIn(words, rows[1]["fault"]["detail"])

    def test_a_policy_that_never_shows_up_has_no_score(self):
        result = self.run_cli("submit", self.misbehaving("silent"), "--track", "impatient",
                              "--team", "silent", "--wait", "--json", check=False)
        self.assertEqual(result.returncode, 1)
        self.assertIn("init_timeout", result.stdout)

    def test_others_are_not_touched(self):
        alone = self.ask("local", POLICIES / "zero", "--track", "short")
        self.ask("submit", self.misbehaving("spins"), "--track", "short", "--team", "noise")
        beside = self.ask("submit", POLICIES / "zero", "--track", "short", "--team", "honest",
                          "--wait")
        rows = self.ask("show", beside["submission"], "--episodes")["episode_rows"]
        self.assertEqual(identities(rows), identities(alone["episodes"]))


class Survive(SystemTest):
    """Stopping and killing the daemon loses nothing and counts nothing twice."""

    tracks = {"long": track_config("locomotion", seeds={"first": 1, "count": 12},
                                   episodes_per_lease=3)}

    def wait_done(self, submission):
        return wait_until(lambda: self.ask("status", submission), 240, "it does not end",
                          lambda status: status["state"] not in ("queued", "running"), every_s=0.2)

    def test_a_killed_daemon_carries_on(self):
        undisturbed = self.ask("local", POLICIES / "zero", "--track", "long")
        for number in (signal.SIGTERM, signal.SIGKILL):
            with self.subTest(signal=number.name):
                self.start_daemon()
                submission = self.ask("submit", POLICIES / "zero", "--track", "long",
                                      "--team", number.name)["submission"]
                wait_until(lambda: self.ask("status", submission), 120, "it does not get on",
                           lambda status: status["episodes"]["done"] >= 2)
                status = self.stop_daemon(number)
                if number == signal.SIGTERM:
                    self.assertEqual(status, 0)
                self.start_daemon()
                self.assertEqual(self.wait_done(submission)["state"], "done")
                result = self.ask("show", submission, "--episodes")
                self.assertEqual(identities(result["episode_rows"]),
                                 identities(undisturbed["episodes"]))
                self.assertEqual(result["not_repeatable"], [])
                self.stop_daemon()


if __name__ == "__main__":
    unittest.main(verbosity=2)
