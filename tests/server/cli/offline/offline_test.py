"""The verbs that need no daemon: what they reject before anything runs, and what they print.
usage: offline_test.py BIN_DIR SOURCE_DIR"""
import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import BIN_DIR, SOURCE_DIR, CliCase, myograde  # pylint: disable=wrong-import-position
from support.submission import played_by_stand_in  # pylint: disable=wrong-import-position


class OfflineTest(CliCase):
    def test_bad_submissions_are_told_before_anything_runs(self):
        local = ("local", "--track", "manipulation")
        self.refused(2, "No such file", *local, self.path("missing"))
        self.refused(2, "is not a program", *local, self.path("data", "x"))
        self.path("folder/readme", "x")
        self.refused(2, "no policy.json", *local, self.path("folder"))
        self.path("folder/policy.json", '{"name": "a", "command": ["./gone"]}')
        self.refused(2, "does not exist", *local, self.path("folder"))
        self.path("folder/policy.json",
                  '{"name": "a", "command": ["/bin/true"], "runtimes": ["r"]}')
        self.refused(2, "asks for the runtime", *local, self.path("folder"))

    def test_bad_configs_name_the_file_and_the_key(self):
        shutil.copytree(f"{SOURCE_DIR}/configs", self.path("configs"))
        track = self.path("configs/tracks/manipulation.json")
        with open(track, encoding="utf-8") as file:
            good = json.load(file)
        bad = {**good, "budgets": {**good["budgets"], "step_s": 0}}
        self.path("configs/tracks/manipulation.json", json.dumps(bad))
        spec = ("spec", "--track", "manipulation", "--configs", self.path("configs"))
        self.refused(2, "step_s", *spec)
        self.path("configs/tracks/manipulation.json", json.dumps({**good, "speed": 1}))
        self.refused(2, "speed", *spec)
        self.path("configs/tracks/manipulation.json", "{")
        self.refused(2, "manipulation.json", *spec)

    def test_spec_keeps_its_schema_and_the_paper_s_sizes(self):
        for track, sizes in (("manipulation", (222, 80, 31)), ("locomotion", (365, 55, 0))):
            spec = self.checked("spec", "spec", "--track", track)
            self.assertFalse(spec["extra_observation"]["allowed"])
            for vector, size in zip(("observation", "action", "extra_observation"), sizes):
                self.assertEqual(spec[vector]["size"], size)
                self.assertEqual(sum(p["size"] for p in spec[vector]["parts"]), size)
        self.assertGreaterEqual(len(self.checked("spec", "spec")["tracks"]), 2)
        official = myograde("spec", "--track", "manipulation", "--profile", "myosuite").stdout
        self.assertIn("Extra observation", official)
        self.assertIn("MPL_ori_err", official)
        shown = myograde("spec", "--track", "locomotion").stdout
        self.assertNotIn("Extra observation", shown)
        self.assertIn("Observation", shown)
        for name in ("0 default", "1 stairs-up", "2 stairs-down", "3 slopes", "4 standing"):
            self.assertIn(name, shown)
        self.assertNotIn("stiffness\":", shown)

    def test_a_release_is_whole_and_signed_or_it_is_said_what_is_wrong(self):
        private, public, other = (self.path(name) for name in ("release.key", "release.pem", "other.pem"))
        folder = self.path("release")
        self.path("release/server.deb", "the server")
        self.path("release/python/kit.whl", "the kit")
        key = self.checked("release-key", "proof", "release", "key", private, "-o", public)
        self.assertIn("PUBLIC KEY", key["key"])
        self.assertEqual(os.stat(private).st_mode & 0o777, 0o600)
        self.assertEqual(self.checked("release-key", "proof", "release", "key", private, "-o", public), key)
        sign = ("proof", "release", "sign", folder, "--key", private, "--name", "7.0")
        self.assertEqual(self.checked("release-sign", *sign)["files"], 2)
        verify = ("proof", "release", "verify", folder, "--key", public)
        whole = self.checked("release-verify", *verify)
        self.assertEqual((whole["valid"], whole["name"], whole["files"]), (True, "7.0", 2))
        self.assertEqual(self.checked("release-sign", *sign)["files"], 2)  # signing again signs the same
        for command in (("openssl", "pkeyutl", "-verify", "-rawin", "-pubin", "-inkey", public, "-in",
                         "SHA256SUMS", "-sigfile", "SHA256SUMS.sig"),
                        ("sha256sum", "--check", "--strict", "--quiet", "SHA256SUMS")):
            subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)

        def wrong(*args):
            done = myograde(*args, "--json")
            self.assertEqual(done.returncode, 1, done.stderr)
            told = json.loads(done.stdout)
            self.assertFalse(told["valid"])
            return told["wrong"]

        self.path("release/server.deb", "the servex")
        self.path("release/more", "more")
        os.remove(self.path("release/python/kit.whl"))
        self.assertEqual(wrong(*verify), ["python/kit.whl is missing",
                                          "server.deb is not the file that was signed",
                                          "more is not a file of the release"])
        os.symlink("server.deb", self.path("release/python/kit.whl"))
        self.assertIn("python/kit.whl can't be read or is not a regular file", wrong(*verify))
        self.refused(2, "is not a regular file", *sign)
        unsigned = ["SHA256SUMS was not signed with this key"]
        self.checked("release-key", "proof", "release", "key", self.path("other.key"), "-o", other)
        self.assertEqual(wrong("proof", "release", "verify", folder, "--key", other), unsigned)
        with open(self.path("release/SHA256SUMS"), "a", encoding="utf-8") as sums:
            sums.write("0" * 64 + "  more\n")
        self.assertEqual(wrong(*verify), unsigned)
        os.remove(self.path("release/SHA256SUMS.sig"))
        self.refused(2, "SHA256SUMS.sig", *verify)
        self.refused(2, "none.key", "proof", "release", "sign", folder, "--key", self.path("none.key"))
        self.refused(2, "holds no Ed25519 private key", "proof", "release", "sign", folder, "--key", public)
        self.refused(2, "printable", "proof", "release", "sign", folder, "--key", private, "--name", "a\nb")
        self.assertFalse(os.path.exists(self.path("none.key")))

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


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
