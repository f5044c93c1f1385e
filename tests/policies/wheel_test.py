"""The wheel, as ./dev wheel makes it, in the hands of somebody who has nothing else."""

import hashlib
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
BUILD = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"]).parent
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
UNAVAILABLE = 77


def make(source, out, umask=0o022):
    """Builds the wheel from the sources in a folder, and has it checked with Debian's Python."""
    said = subprocess.run([source / "policies/python/wheel.sh", "--pure", out, "3.11"], capture_output=True,
                          text=True, timeout=600, umask=umask,
                          env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"})
    if said.returncode == UNAVAILABLE:
        print(said.stdout)
        sys.exit(UNAVAILABLE)
    assert said.returncode == 0, said.stdout + said.stderr
    return next(out.glob("*.whl"))


class Wheel(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.wheel = make(SOURCE, cls.folder / "wheels")

    def test_it_works_in_a_fresh_environment_without_a_compiler(self):
        environment = self.folder / "venv"
        subprocess.run(["/usr/bin/python3", "-m", "venv", environment], check=True, timeout=120)
        subprocess.run([environment / "bin/pip", "install", "-q", "--no-index",
                        "--disable-pip-version-check", self.wheel], check=True, timeout=120,
                       env={"PATH": "/nonexistent"})

        def python(*words):
            return subprocess.run([environment / "bin/python", *map(str, words)], check=True,
                                  capture_output=True, text=True, timeout=60, cwd=self.folder,
                                  env={"PATH": "/nonexistent"}).stdout
        submission = self.folder / "still"
        submission.mkdir()
        python("-m", "myograde", "bundle", submission)
        # The kit of a checkout is the same.
        difference = subprocess.run(["diff", "-r", submission / "myograde",
                                     BUILD / "policies/kit-python/myograde"], capture_output=True,
                                    text=True)
        self.assertEqual(difference.stdout + difference.stderr, "")
        self.assertEqual(python("-c", "import myograde.client, importlib.resources as resources\n"
                                "print(resources.files('myograde').joinpath('py.typed').is_file(),"
                                " myograde.track('locomotion').observation.size)"), "True 365\n")
        self.assertIn("get-models", python("-m", "myograde", "--help"))
        about = next(environment.glob("lib/*/site-packages/myograde-*.dist-info"))
        licence = about / "licenses/LICENSE"
        self.assertEqual(licence.read_text(), (SOURCE / "LICENSE").read_text())

    def test_the_same_sources_give_the_same_bytes(self):
        copy = self.folder / "elsewhere"
        for name in ("policies/python", "protocol/policy", "protocol/log", "docker"):
            shutil.copytree(SOURCE / name, copy / name, copy_function=shutil.copyfile)
        shutil.copyfile(SOURCE / "LICENSE", copy / "LICENSE")
        for script in ("policies/python/wheel.sh", "docker/make_venv.sh"):
            (copy / script).chmod(0o700)
        other = make(copy, self.folder / "again", umask=0o077)
        self.assertEqual(other.name, self.wheel.name)
        self.assertEqual(other.read_bytes(), self.wheel.read_bytes())


class WithoutACompiler(unittest.TestCase):
    """pip in a checkout, as the guide types it, on a machine that has no compiler."""

    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        make(SOURCE, cls.folder / "wheels")  # gets the tools
        packages = SOURCE / "docker/wheel-tools.txt"
        name = f"wheel-tools-{hashlib.sha256(packages.read_bytes()).hexdigest()[:12]}"
        cls.tools = next((CACHE / name).glob("lib/python3*/site-packages"))
        programs = cls.folder / "programs"
        programs.mkdir()
        for program in ("cmake", "ninja"):
            (programs / program).symlink_to(shutil.which(program))
        cls.environment = {"PATH": str(programs), "PYTHONPATH": str(cls.tools), "PIP_NO_INDEX": "1",
                           "PIP_NO_BUILD_ISOLATION": "0", "HOME": str(cls.folder)}

    def install(self, what):
        place = self.folder / "venv"
        if not place.exists():
            subprocess.run(["/usr/bin/python3", "-m", "venv", place], check=True, timeout=120)
        return subprocess.run([place / "bin/pip", "install", "--disable-pip-version-check", what],
                              capture_output=True, text=True, timeout=200, cwd=SOURCE,
                              env=self.environment)

    def test_asking_for_the_environments_fails_with_the_reason(self):
        said = self.install("./policies/python[gym]")
        self.assertEqual(said.returncode, 1, said.stdout)
        self.assertIn("can't be built here: there is no C++ compiler", said.stdout + said.stderr)

    def test_the_kit_alone_is_installed_and_knows_why_there_are_no_environments(self):
        said = self.install("./policies/python")
        self.assertEqual(said.returncode, 0, said.stdout + said.stderr)
        script = ("import myograde, myograde.client, myograde.envs\n"
                  "try:\n    myograde.envs.seeds('elbow')\n"
                  "except myograde.errors.MyogradeError as error:\n    print(error)")
        told = subprocess.run([self.folder / "venv/bin/python", "-c", script], capture_output=True,
                              text=True, timeout=60, cwd=self.folder,
                              env={"PATH": "/nonexistent"})
        self.assertIn("there is no C++ compiler", told.stdout, told.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
