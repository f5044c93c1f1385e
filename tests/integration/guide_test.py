"""Types the participants' guide, every command of it in its order and in one shell, on a machine that
has what ./dev build makes."""

import contextlib
import hashlib
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import unittest

from system import POLICIES, SOURCE, SystemTest

GUIDE = SOURCE / "policies/GUIDE.md"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
BUILT = POLICIES.parent
DEADLINE_S = 400
# Stands for the participant's Python: the package with its environments as the build made them, what
# its environments and the training need, and what a sanitized extension needs.
PYTHON = """#!/bin/sh
exec env PYTHONPATH={packages} LD_PRELOAD={preload} \\
  ASAN_OPTIONS=detect_leaks=0 {clone}/participant/bin/python -B "$@"
"""


def environment_of(name, **variables):
    """The packages of a list in docker/, or None if they can't be had here."""
    packages = SOURCE / f"docker/{name}.txt"
    place = CACHE / f"{name}-{hashlib.sha256(packages.read_bytes()).hexdigest()[:12]}"
    made = subprocess.run([SOURCE / "docker/make_venv.sh", place, packages], capture_output=True,
                          text=True, timeout=600, env={**os.environ, **variables})
    return next(place.glob("lib/python3*/site-packages")) if made.returncode == 0 else None


def has_torch():
    return subprocess.run(["/usr/bin/python3", "-c", "import torch"], capture_output=True,
                          timeout=120).returncode == 0


class Guide(SystemTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # Two episodes, so that a rank takes seconds.
        cls.daemon.change_config("tracks/elbow.json", seeds={"first": 0, "count": 2})
        cls.clone = cls.root / "clone"
        (cls.clone / "build").mkdir(parents=True)
        (cls.clone / "build/release").symlink_to(BUILT)
        for name in ("policies", "protocol", "docker"):
            shutil.copytree(SOURCE / name, cls.clone / name)
        shutil.copy(SOURCE / "LICENSE", cls.clone)

    def participant(self):
        """A program that plays participant/bin/python."""
        training = environment_of("rl", VENV_OPTIONS="--system-site-packages")
        if training is None or not has_torch():
            self.skipTest("no Gymnasium or no PyTorch can be had here")
        program = self.root / "participant-python"
        program.write_text(PYTHON.format(
            packages=f"{BUILT / 'python'}:{training}:/usr/lib/python3/dist-packages",
            preload=f"'{os.environ.get('MYOGRADE_TEST_PRELOAD', '')}'", clone=self.clone))
        program.chmod(0o755)
        return program

    def typed(self):
        """The guide's commands as one script. pip finds here what it would get from PyPI."""
        text = "".join(body for language, body in FENCE.findall(GUIDE.read_text()) if language == "sh")
        self.assertNotIn("$ ", text)
        python = str(self.participant())
        text = text.replace("participant/bin/pip install torch\n", "")
        return text.replace("participant/bin/python ", f"{python} ")

    def test_the_guide_leads_to_a_ranked_submission(self):
        script = self.typed()
        tools = environment_of("wheel-tools")
        if tools is None:
            self.skipTest("no package can be built here")
        environment = {**self.environment, "PYTHONPATH": str(tools), "PIP_NO_INDEX": "1",
                       "PIP_NO_BUILD_ISOLATION": "0", "PIP_NO_DEPS": "1", "MYOGRADE_PURE": "1",
                       "MYOGRADE_SERVER": "", "XDG_CONFIG_HOME": str(self.root / "config")}
        shell = subprocess.Popen(["bash", "-e", "-c", script], cwd=self.clone, env=environment,
                                 text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                 stderr=subprocess.STDOUT, start_new_session=True)
        try:
            said, _ = self.read_to_the_end(shell)
        finally:
            with contextlib.suppress(ProcessLookupError):  # a command failed before its daemon
                os.killpg(shell.pid, signal.SIGTERM)  # its daemon goes on
        self.assertEqual(shell.returncode, 0, said + self.log())
        self.check(said)

    def read_to_the_end(self, shell):
        try:
            return shell.communicate(timeout=DEADLINE_S)
        except subprocess.TimeoutExpired:
            os.killpg(shell.pid, signal.SIGKILL)
            said, _ = shell.communicate()
            self.fail(f"the guide took more than {DEADLINE_S} s:\n{said}{self.log()}")

    def log(self):
        path = self.clone / "own-server.log"
        return path.read_text(errors="replace")[-4000:] if path.exists() else ""

    def check(self, said):
        self.assertIn("weights.npz is written", said)
        self.assertIn("The submission would be accepted and graded", said)
        self.assertTrue((self.clone / "holder/submission/weights.npz").is_file())
        graded = json.loads((self.clone / "graded.json").read_text())
        self.assertTrue(graded["ranked"])
        self.assertEqual(graded["state"], "done")
        self.assertEqual(sum(graded["outcomes"].values()), 2)
        self.assertLessEqual(set(graded["outcomes"]), {"success", "failure"})
        home = json.loads((self.clone / "home.json").read_text())
        self.assertEqual(home["merkle_root"], graded["merkle_root"])
        self.assertRegex(said, r"(?m)^ +1 +Team Blue ")

    def test_sections_are_numbered_and_pages_point_to_the_guide(self):
        text = GUIDE.read_text()
        numbers = [int(number) for number in re.findall(r"^## (\d+)\. ", text, re.MULTILINE)]
        self.assertEqual(numbers, list(range(1, len(numbers) + 1)))
        for page in ("README.md", "policies/README.md"):
            self.assertIn("GUIDE.md", (SOURCE / page).read_text(), page)


class Install(unittest.TestCase):
    """The guide's first two sections as a reader types them: no variables but HOME and PATH, and pip as
    it is, which gets what it builds with from PyPI."""

    def test_the_first_commands_give_environments(self):
        text = GUIDE.read_text()
        first = text[text.index("## 1."):text.index("## 3.")]
        script = "".join(body for language, body in FENCE.findall(first) if language == "sh")
        clone = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory())) / "clone"
        shutil.copytree(SOURCE, clone, ignore=shutil.ignore_patterns(".git", "build", "__pycache__"))
        (clone / "build").mkdir()
        (clone / "build/release").symlink_to(BUILT)
        done = subprocess.run(["bash", "-e", "-c", script], cwd=clone, text=True, timeout=1700,
                              stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT,
                              env={name: os.environ[name] for name in ("HOME", "PATH")})
        if done.returncode and re.search("Could not find a version|Temporary failure", done.stdout):
            self.skipTest("PyPI can't be reached")
        self.assertEqual(done.returncode, 0, done.stdout[-8000:])
        self.assertRegex(done.stdout, r"(?m)^ended by \w+ after \d+ steps$")
