"""Runtimes: made, listed, used, replaced and removed by the real programs, from tiny wheels."""

import base64
import contextlib
import hashlib
import io
import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from unittest import mock

from support.schemas import validate
from system import BIN, SOURCE, SystemTest, track_config

sys.path.insert(0, str(SOURCE / "server/runtime/make"))
import requirements  # pylint: disable=wrong-import-position
import worker  # pylint: disable=wrong-import-position

TRACK = "runtimes"
PLAYER = """import greet
import myograde

class Greeter(myograde.Policy):
    def start(self):
        print(greet.WORD, flush=True)

    def act(self, observation):
        return [0.0] * self.welcome.action_size

myograde.serve(Greeter())
"""


def wheel(folder, version, says):
    """A wheel of the package `greet`, whose WORD is `says`; its path."""
    files = {"greet/__init__.py": f"WORD = {says!r}\n",
             f"greet-{version}.dist-info/METADATA":
                 f"Metadata-Version: 2.1\nName: greet\nVersion: {version}\n",
             f"greet-{version}.dist-info/WHEEL":
                 "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"}
    record = "".join(
        f"{name},sha256={base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).decode().rstrip('=')},"
        f"{len(text)}\n" for name, text in files.items())
    files[f"greet-{version}.dist-info/RECORD"] = (
        record + f"greet-{version}.dist-info/RECORD,,\n")
    path = folder / f"greet-{version}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(zipfile.ZipInfo(name, (2024, 1, 1, 0, 0, 0)), text)
    return path


class Runtimes(SystemTest):
    tracks = {TRACK: track_config("elbow", seeds={"first": 7000, "count": 4}, episodes_per_lease=1)}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.dir = cls.root / "runtimes"
        cls.wheels = cls.root / "wheels"
        cls.wheels.mkdir()
        cls.daemon.configure(runtimes_dir=str(cls.dir))
        cls.start_daemon()

    def setUp(self):
        for old in self.wheels.iterdir():
            old.unlink()

    def add(self, *words, requirements, wheels=True):
        """The exit status, what was printed, and the complaint of myograde runtime add."""
        path = self.root / "requirements.txt"
        path.write_text(requirements, encoding="utf-8")
        command = [BIN / "myograde", "runtime", "add", *words[:1], path, *words[1:]]
        if wheels:
            command += ["--wheels", self.wheels]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True,
                              timeout=120, check=False)
        return done.returncode, done.stdout, done.stderr

    def pinned(self, version, says):
        """Requirements of a new wheel."""
        path = wheel(self.wheels, version, says)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        return f"greet=={version} --hash=sha256:{digest}\n"

    def offered(self):
        """The runtimes by name, as this host lists them."""
        answer = self.ask("runtime", "list")
        validate(answer, "runtimes")
        return {entry["runtime"]: entry for entry in answer["runtimes"] if not entry["former"]}

    def policy(self, name, runtimes):
        """A policy that prints the word of `greet`."""
        folder = self.python_policy(name, ["policy.py"])
        (folder / "policy.py").write_text(PLAYER, encoding="utf-8")
        manifest = json.loads((folder / "policy.json").read_text())
        (folder / "policy.json").write_text(json.dumps({**manifest, "runtimes": runtimes}))
        return folder

    def submit(self, folder):
        return self.ask("submit", folder, "--track", TRACK, "--team", "greeters")["submission"]

    def result(self, submission):
        """The evaluation of a submission, when it has ended."""
        end = time.monotonic() + 300
        while time.monotonic() < end:
            if self.ask("status", str(submission))["state"] in ("done", "failed", "grader_error"):
                return self.ask("show", str(submission))
            time.sleep(0.5)
        self.fail("no end in time")

    def test_a_runtime_is_what_a_policy_was_played_with(self):
        status, printed, complaint = self.add("greet", "--json",
                                              requirements=self.pinned("1.0", "one"))
        self.assertEqual(status, 0, complaint)
        made = json.loads(printed)
        validate(made, "runtime")
        self.assertEqual(self.offered()["greet"]["digest"], made["digest"])
        self.assertEqual([p["name"] for p in made["packages"]], ["greet"])
        folder = pathlib.Path(made["folder"])
        self.assertEqual((self.dir / "greet").resolve(), folder.resolve())
        for path in [folder, *folder.rglob("*")]:
            self.assertEqual(path.lstat().st_mode & 0o222, 0, path)
            self.assertEqual(path.owner(), pathlib.Path(self.root).owner())

        submission = self.submit(self.policy("greeter", ["greet", "python"]))
        # It is replaced while it is in use: all leases have the one that they began with.
        status, _, complaint = self.add("greet", "--replace",
                                        requirements=self.pinned("2.0", "two"))
        self.assertEqual(status, 0, complaint)
        shown = self.result(submission)
        self.assertEqual(shown["state"], "done", shown)
        self.assertEqual(shown["grader"]["runtimes"]["greet"], made["digest"])
        words = [line for entry in shown["output"] for line in entry["stdout_tail"].split()]
        self.assertEqual(set(words), {"one"})
        receipt = self.root / "receipt.json"
        self.run_cli("proof", "receipt", str(submission), "-o", receipt)
        self.assertIn(made["digest"], receipt.read_text(encoding="utf-8"))

        former = [entry for entry in self.ask("runtime", "list")["runtimes"] if entry["former"]]
        self.assertEqual([entry["digest"] for entry in former], [made["digest"]])
        again = self.result(self.submit(self.policy("greeter2", ["greet", "python"])))
        self.assertNotEqual(again["grader"]["runtimes"]["greet"], made["digest"])

        self.ask("runtime", "remove", "greet")
        self.assertNotIn("greet", self.offered())
        self.assertEqual(list(self.dir.glob("greet*")), [])
        refused = self.run_cli("submit", self.policy("greeter3", ["greet", "python"]), "--track",
                               TRACK, "--team", "greeters", check=False)
        self.assertEqual(refused.returncode, 2)
        self.assertIn('the runtime "greet", which this server does not have; it has python',
                      refused.stderr)

    def test_a_folder_of_an_earlier_release_gets_its_versions_own(self):
        status, printed, complaint = self.add("old", "--json", requirements=self.pinned("1.0", "one"))
        self.assertEqual(status, 0, complaint)
        made = json.loads(printed)
        (self.dir / "old").unlink()
        os.rename(made["folder"], self.dir / "old")
        self.assertEqual(self.offered()["old"]["folder"], str(self.dir / "old"))
        status, _, complaint = self.add("old", "--replace", requirements=self.pinned("2.0", "two"))
        self.assertEqual(status, 0, complaint)
        listed = [entry for entry in self.ask("runtime", "list")["runtimes"]
                  if entry["runtime"] == "old"]
        self.assertEqual([entry["former"] for entry in listed], [False, True])
        self.assertEqual((listed[1]["digest"], listed[1]["folder"]),
                         (made["digest"], made["folder"]))
        for path, says in ((self.dir / "old", "two"), (pathlib.Path(made["folder"]), "one")):
            self.assertIn(says, (path / "greet/__init__.py").read_text(encoding="utf-8"))
        self.ask("runtime", "remove", "old", "--former")
        self.assertEqual(self.offered()["old"]["digest"], listed[0]["digest"])
        self.assertFalse(os.path.lexists(made["folder"]))
        self.ask("runtime", "remove", "old")
        self.assertEqual(list(self.dir.glob("old*")), [])

    def test_pins_are_found_and_written(self):
        self.pinned("1.0", "one")
        status, _, complaint = self.add("loose", requirements="greet\n")
        self.assertEqual(status, 2)
        self.assertIn("--lock", complaint)
        status, _, complaint = self.add("loose", "--lock", requirements="greet\n")
        self.assertEqual(status, 0, complaint)
        lock = (self.root / "requirements.lock.txt").read_text(encoding="utf-8")
        self.assertRegex(lock, r"greet==1\.0 --hash=sha256:[0-9a-f]{64}\n")
        first = self.offered()["loose"]["digest"]
        status, _, complaint = self.add("loose", "--replace", requirements=lock)
        self.assertEqual(status, 0, complaint)
        self.assertEqual(len(first), 64)
        self.run_cli("runtime", "remove", "loose")

    def test_what_debian_provides_is_not_pinned(self):
        def entry(name, *needs, requested=False):
            return {"metadata": {"name": name, "requires_dist": list(needs)}, "requested": requested}

        report = [entry("stable_baselines3", "torch>=1.11", "numpy<2", requested=True),
                  entry("torch", "nvidia-cublas-cu12==12.1; platform_system == 'Linux'", "sympy"),
                  entry("nvidia-cublas-cu12"), entry("sympy"), entry("numpy")]

        def names(provided):
            return [item["metadata"]["name"] for item in requirements._needed(report, provided)]

        self.assertEqual(names({"torch"}), ["numpy", "stable_baselines3"])
        self.assertEqual(len(names(set())), len(report))
        report[1]["requested"] = True
        self.assertEqual(len(names({"torch"})), len(report), "the file names it")

    def test_progress_is_told_without_a_terminal(self):
        with mock.patch.object(worker, "TELL_EVERY", 0.6), tempfile.TemporaryDirectory() as folder, \
                contextlib.redirect_stderr(io.StringIO()) as told:
            os.chmod(folder, 0o755)
            worker.Worker(pathlib.Path(folder) / "work", 60, 1 << 20).run(["sleep", "2"], "sleeping")
        self.assertIn("sleeping: 0 MB so far", told.getvalue())

    def test_mistakes_leave_nothing(self):
        good = self.pinned("1.0", "one")
        # Name, requirements, exit status, part of the complaint.
        cases = [("../up", good, 2, "can't be the name of a runtime"),
                 ("a/b", good, 2, "can't be the name of a runtime"),
                 ("bad", good.replace("sha256:", "sha256:" + "0" * 64)[:-65] + "\n", 4, "HASH"),
                 ("bad", "greet==9 --hash=sha256:" + "0" * 64, 4, "greet==9"),
                 ("bad", "--index-url https://example.org\n" + good, 2, "is an option of pip"),
                 ("bad", "-e .\n", 2, "is an option of pip"),
                 ("bad", "greet @ file:///etc/passwd\n", 2, "is not pinned"),
                 ("bad", "\n", 2, "names no package")]
        for name, requirements, wanted, words in cases:
            with self.subTest(requirements=requirements, name=name):
                status, printed, complaint = self.add(name, requirements=requirements)
                self.assertEqual(status, wanted, complaint)
                self.assertIn(words, complaint)
                self.assertEqual(printed, "")
                self.assertNotIn("bad", self.offered())
        evil = "\x1b[31m\x07\u009b\u202e\n"
        for words, begin in (((), "greet"), (("--lock",), "-e ")):
            status, _, complaint = self.add("bad", *words, requirements=begin + evil)
            self.assertEqual(status, 2)
            self.assertIn("?[31m???", complaint)
            self.assertTrue(complaint.rstrip("\n").isprintable(), ascii(complaint))
        status, _, complaint = self.add("bad", "--python", "/root/python", requirements=good)
        self.assertEqual(status, 2)
        self.assertIn("submit an image", complaint)
        status, _, complaint = self.add("bad", "--most-bytes", "10", requirements=good)
        self.assertEqual(status, 2)
        self.assertIn("--most-bytes", complaint)
        self.assertEqual(list(self.dir.glob(".part-*")), [])

    def test_a_kill_leaves_nothing(self):
        requirements = self.root / "kill.txt"
        requirements.write_text(self.pinned("1.0", "one"), encoding="utf-8")
        for wait in (0.3, 1.0, 2.0):
            with subprocess.Popen([BIN / "myograde", "runtime", "add", "killed", requirements,
                                   "--wheels", self.wheels, "--replace"], env=self.environment,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as adding:
                time.sleep(wait)
                os.kill(adding.pid, signal.SIGKILL)
            offered = self.offered().get("killed")
            if offered is not None:
                self.assertTrue((pathlib.Path(offered["folder"]) / "greet/__init__.py").exists())
        status, _, complaint = self.add("killed", "--replace",
                                        requirements=requirements.read_text(encoding="utf-8"))
        self.assertEqual(status, 0, complaint)
        self.assertEqual(list(self.dir.glob(".part-*")), [])
        self.run_cli("runtime", "remove", "killed")
