"""The command line tool's messages: one clear sentence with what to do, in participants' words.
usage: cli_messages_test.py BIN_DIR SOURCE_DIR"""
import fcntl
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import time
import unittest

from cli_test import (BIN_DIR, COUNTS, HASHES, LONG_BOARD, RESULT, SOURCE_DIR, STATUS, CliCase,
                      myograde)
from support.submission import played_by_stand_in


class MessagesTest(CliCase):
    def test_numbers_that_are_none(self):
        for verb in ("show", "status", "cancel", "rerun", "hide", "unhide", "baseline"):
            for bad in ("abc", "0", "1.5", "9" * 30):
                self.refused(2, f'"{bad}" is no submission\'s number', verb, bad)
        self.refused(2, "no episode's number", "log", "7", "--episode", "abc", "-o", "x")
        self.assertLess(len(myograde("show", "x" * 5000).stderr), 200)

    def test_mistyped_words(self):
        self.refused(2, 'did you mean "submit"?', "sbmit", "x", "--track", "t")
        self.refused(2, 'did you mean "seeds commit"?', "seeds", "comit")
        self.refused(2, 'did you mean "--episodes"?', "show", "7", "--epsodes")
        self.refused(2, 'there is no verb "paint"; "myograde --help" lists them', "paint")
        self.refused(2, "what to do is missing")

    def test_a_closed_folder_has_a_remedy(self):
        folder = self.path("closed")
        os.mkdir(folder)
        os.chmod(self.temp, 0o755)
        self.path("closed/myograde.sock", "")
        os.chmod(folder, 0)
        self.addCleanup(os.chmod, folder, 0o700)
        program = shutil.copy(f"{BIN_DIR}/myograde", self.path("myograde"))
        other = {"user": 65534, "group": 65534, "extra_groups": []} if os.geteuid() == 0 else {}
        done = subprocess.run([program, "status", "--data", folder], capture_output=True, text=True,
                              timeout=60, stdin=subprocess.DEVNULL, check=False, **other)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn(f"{folder} is open to", done.stderr)
        self.assertIn("run this as", done.stderr)

    def test_cancel_says_what_it_costs(self):
        for charged, words in (("official", "It stays charged to the team's quota"),
                               (None, "Nothing of the team's quota is used up")):
            socket = self.serve({"POST /v1/submissions/7/cancel": (200, {
                **STATUS, "episodes": {**COUNTS, "success": 1}, "cancel": {
                    "killed": 1, "still_ending": 0, "took_wall_s": 0.03, "charged": charged}})})
            done = myograde("cancel", "7", "--socket", socket)
            self.assertIn(words, done.stdout)
            self.assertIn("it keeps 2/2 episodes, 1 success", done.stdout)
            self.assertNotIn("lease", done.stdout)
            os.remove(socket)

    def test_results_are_aligned_and_short(self):
        socket = self.serve({"GET /v1/submissions/7/result": (
            200, {**RESULT, "hashes": HASHES, "merkle_root": "9" * 64})})
        short = myograde("show", "7", "--socket", socket).stdout
        columns = {line.index(value) for line in short.splitlines() for name, value in (
            ("failures by reason", "1 time"), ("successes  ", "1 of 2"), ("artefact", "0123"))
            if name in line}
        self.assertEqual(len(columns), 1, short)
        self.assertNotRegex(short, "[0-9a-f]{13}")
        full = myograde("show", "7", "--full-hashes", "--socket", socket).stdout
        self.assertIn(HASHES["artefact"], full)
        self.assertIn("9" * 64, full)

    def test_a_board_tells_its_order(self):
        socket = self.serve({"GET /v1/leaderboard?track=locomotion&board=main": (200, LONG_BOARD)})
        done = myograde("leaderboard", "--track", "locomotion", "--socket", socket)
        self.assertIn("  By mean distance. By mean", done.stdout)
        self.assertIn("1 evaluation under an earlier config of this track is not on it",
                      done.stdout)

    def test_participants_hear_of_blocks_of_episodes(self):
        for verb in ("submit", "status", "cancel", "leaderboard", "show", "rerun", "local", "spec"):
            self.assertNotRegex(myograde(verb, "--help").stdout, r"\b[Ll]eases?\b")
        text = re.sub(r"[a-z_]*lease_[a-z]+|episodes_per_lease", "",
                      myograde("spec", "--track", "locomotion").stdout)
        self.assertNotIn("lease", text)

    def test_secret_files_are_their_owners_alone(self):
        seeds, secret = self.path("seeds", "an old list\n"), self.path("secret")
        self.path("seeds.part", "somebody waits here\n", 0o666)
        with open(f"{seeds}.part", encoding="utf-8") as waiting:
            done = myograde("seeds", "commit", "--phase", "p", "--secret", secret, "-o", seeds,
                            "--count", "3")
            self.assertEqual(done.returncode, 0, done.stderr)
            waiting.seek(0)
            self.assertEqual(waiting.read(), "somebody waits here\n")
        for path in (seeds, secret):
            self.assertEqual(stat.S_IMODE(os.stat(path).st_mode), 0o600, path)
        self.assertFalse(os.path.exists(f"{seeds}.part"))
        with open(seeds, encoding="utf-8") as file:
            self.assertEqual(len(json.load(file)), 3)

    def test_what_local_took_has_the_packing_in_it(self):
        """Packing opens the archive, and the kernel blocks it there until this process releases its
        lease on the file."""
        os.mkdir(self.path("bin"))
        runner = shutil.copy(f"{SOURCE_DIR}/tests/support/fake_runner.py",
                             self.path("bin/myograde-runner"))
        os.chmod(runner, 0o755)
        archive = self.path("policy.tar")
        with open(archive, "wb") as file:
            file.write(played_by_stand_in("ok"))
        words = ("local", archive, "--track", "manipulation", "--episodes", "2")
        told = json.loads(self.packed_slowly(archive, 2, *words, "--json"))
        self.assertGreaterEqual(told["wall"]["wall_s"], 2)
        told = self.packed_slowly(archive, 2, *words)
        self.assertRegex(told, "took [0-9.]+ s\n$")
        self.assertGreaterEqual(float(told.split()[-2]), 2, told)

    def packed_slowly(self, archive, seconds, *args):
        """What the tool prints if its first read of `archive` takes this long."""
        asked = []
        before = signal.signal(signal.SIGIO, lambda *_: asked.append(True))
        self.addCleanup(signal.signal, signal.SIGIO, before)
        with open(archive, "r+b") as file:
            try:
                fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_WRLCK)
            except OSError as error:
                self.skipTest(f"no leases on files here: {error}")
            tool = subprocess.Popen([f"{BIN_DIR}/myograde", *args], stdout=subprocess.PIPE,
                                    stderr=subprocess.PIPE, text=True, env=dict(
                                        os.environ, MYOGRADE_BIN_DIR=self.path("bin"),
                                        MYOGRADE_CONFIG_DIR=f"{SOURCE_DIR}/configs"))
            deadline = time.monotonic() + 60
            while not asked and tool.poll() is None and time.monotonic() < deadline:
                time.sleep(0.01)
            time.sleep(seconds)
            fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_UNLCK)
        said, complaint = tool.communicate(timeout=60)
        self.assertTrue(asked, complaint)
        self.assertEqual(tool.returncode, 0, complaint)
        return said

    def test_the_daemons_config_errors_are_wrong_use(self):
        shutil.copytree(f"{SOURCE_DIR}/configs", self.path("configs"))
        self.path("configs/server.json", '{"slots": 0}')
        for args in (("--configs", self.path("configs")), ("--colour",)):
            done = subprocess.run([f"{BIN_DIR}/myograded", "--data", self.path("data"), *args],
                                  capture_output=True, text=True, timeout=60, check=False)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertRegex(done.stderr, "^myograded: error: .*\n$")
        self.assertFalse(os.path.exists(self.path("data")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
