"""What participants build outside of this tree: on the installed C++ kit, in another language, and
from the folders that "myograde new" writes."""

import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import tarfile
import tempfile
import unittest

from system import BIN, SOURCE, SystemTest, track_config

BUILD = BIN.parent
# A project that only looks for the package.
SEEKER = ("cmake_minimum_required(VERSION 3.18)\nproject(seeker LANGUAGES NONE)\n"
          "find_package(myograde-policy {version} REQUIRED)\n")
# Ninja is installed for this project, make need not be.
TOOLS = {"CMAKE_GENERATOR": "Ninja",
         **({"CMAKE_CXX_COMPILER_LAUNCHER": "ccache", "CMAKE_C_COMPILER_LAUNCHER": "ccache"}
            if shutil.which("ccache") else {})}


def install_kit(root):
    """A prefix with the kit, moved after it was installed."""
    installed, prefix = root / "installed", root / "moved" / "prefix"
    subprocess.run(["cmake", "--install", BUILD, "--component", "policy-kit", "--prefix",
                    installed], check=True, stdout=subprocess.DEVNULL)
    prefix.parent.mkdir()
    installed.rename(prefix)
    return prefix


def run(*words, **options):
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True,
                          timeout=300, stdin=subprocess.DEVNULL, **options)
    if done.returncode != 0:
        raise AssertionError(f"{words}: exit {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


class Package(unittest.TestCase):
    """The kit as an installed package."""

    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-package-"))
        cls.addClassCleanup(shutil.rmtree, cls.root, ignore_errors=True)
        cls.prefix = install_kit(cls.root)
        cls.environment = {**os.environ, **TOOLS, "CMAKE_PREFIX_PATH": str(cls.prefix),
                           "PKG_CONFIG_PATH": str(cls.prefix / "lib/pkgconfig")}

    def seek(self, version, **environment):
        folder = pathlib.Path(tempfile.mkdtemp(dir=self.root))
        (folder / "CMakeLists.txt").write_text(SEEKER.format(version=version))
        done = subprocess.run(["cmake", "-S", folder, "-B", folder / "build"], text=True,
                              capture_output=True, timeout=120,
                              env={**self.environment, **environment})
        return done.returncode, " ".join(done.stderr.split())

    def test_only_the_fitting_version_is_taken(self):
        self.assertEqual(self.seek("1.0"), (0, ""))
        for version in ("0.1", "1.1", "2.0"):
            self.assertEqual(self.seek(version)[0], 1)

    def test_without_lcm_the_package_says_what_to_install(self):
        status, told = self.seek("1.0", PKG_CONFIG_PATH="", PKG_CONFIG_LIBDIR=str(self.root))
        self.assertEqual(status, 1)
        self.assertIn("apt-get install liblcm-dev", told)

    def test_nothing_in_it_tells_where_it_was_built(self):
        for path in self.prefix.rglob("*"):
            if path.suffix in (".cmake", ".pc", ".h", ".hpp"):
                text = path.read_text()
                for place in (self.root / "installed", BUILD, SOURCE):
                    self.assertNotIn(f"{place}/", text, path)

    def test_its_headers_need_the_standard_library_and_lcm_only(self):
        headers = sorted((self.prefix / "include/myograde").iterdir())
        self.assertEqual(len(headers), 14)
        for header in headers:
            for name in re.findall(r'#include [<"]([^">]+)[">]', header.read_text()):
                self.assertRegex(name, r"^(myograde/\w+\.hpp|lcm/lcm_coretypes\.h|\w+)$", header)

    def test_pkg_config_knows_it_too(self):
        source = self.root / "still.cc"
        page = (SOURCE / "policies/cpp/README.md").read_text()
        source.write_text(re.search(r"^```cpp\n(.*?)^```$", page, re.M | re.S)[1])
        flags = shlex.split(run("pkg-config", "--cflags", "--libs", "myograde-policy",
                                env=self.environment))
        program = self.root / "still"
        run("g++", "-std=c++20", "-Wall", "-Wextra", "-Werror", source, "-o", program, *flags)
        done = subprocess.run([program], capture_output=True, text=True, timeout=60,
                              env={"PATH": os.environ["PATH"]})
        self.assertEqual(done.returncode, 1)
        self.assertIn("set MYOGRADE_LCM_URL", done.stderr)
        file = run("pkg-config", "--variable=lcmfile", "myograde-policy", env=self.environment)
        self.assertEqual(pathlib.Path(file.strip()).read_bytes(),
                         (SOURCE / "protocol/policy/myograde.lcm").read_bytes())


class Participants(SystemTest):
    """Programs on the package, graded."""

    tracks = {"short-elbow": track_config("elbow"), "short-leg": track_config("locomotion"),
              "short-arm": track_config("manipulation"),
              "tiny-arm": track_config("manipulation", rules={"max_steps": 40},
                                       seeds={"first": 7000, "count": 2})}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.prefix = install_kit(cls.root)
        # A whole installation has the programs beside the kit; these are those of the build.
        (cls.prefix / "bin").mkdir()
        (cls.prefix / "bin/myograde").symlink_to(BIN / "myograde")
        cls.daemon.environment.update(
            TOOLS, PATH=f"{cls.prefix / 'bin'}:{os.environ['PATH']}",
            MYOGRADE_SERVER="", XDG_CONFIG_HOME=str(cls.root))

    def typed_page(self):
        """Types the commands of policies/cpp/README.md in what looks like a checkout after ./dev
        build; the submission that they make."""
        work = self.root / "checkout"
        (work / "build").mkdir(parents=True)
        (work / "build/release").symlink_to(BUILD)
        (work / "policies").symlink_to(SOURCE / "policies")
        page = (SOURCE / "policies/cpp/README.md").read_text()
        script = "".join(re.findall(r"^```sh\n(.*?)^```$", page, re.M | re.S))
        run("bash", "-e", "-c", script, cwd=work, env={**self.environment, "HOME": str(self.root)})
        return work / "hold-elbow/submission"

    def example_in_c(self):
        folder = self.root / "example-c"
        shutil.copytree(SOURCE / "policies/c/example", folder)
        environment = {**self.environment, "CMAKE_PREFIX_PATH": str(self.prefix)}
        for words in (("-B", "build"), ("--build", "build"),
                      ("--install", "build", "--prefix", "submission")):
            run("cmake", *words, cwd=folder, env=environment)
        return folder / "submission"

    def packed(self, folder, name):
        archive = self.root / f"{name}.tar.gz"
        with tarfile.open(archive, "w:gz") as tar:
            tar.add(folder, ".")
        return archive

    def test_the_examples_in_both_languages_hold_the_elbow_and_agree_to_the_bit(self):
        archives = {"cpp": self.packed(self.typed_page(), "cpp"),
                    "c": self.packed(self.example_in_c(), "c")}
        results = {language: self.ask("local", archive, "--track", "short-elbow")
                   for language, archive in archives.items()}
        for language, result in results.items():
            self.assertEqual(result["outcomes"], {"success": 3}, language)
            self.assertEqual(result["hashes"]["results"], results["cpp"]["hashes"]["results"])
        other = self.run_cli("local", archives["cpp"], "--track", "short-leg",
                             "--episodes", "1", "--json", check=False)
        self.assertIn("this policy is for tracks of an elbow, and not for locomotion",
                      json.dumps(json.loads(other.stdout)["output"]))

    def started(self, language, track):
        """What `new` tells of the starter that it writes, in whose folder a person now types."""
        return self.ask("new", f"my-{language}", "--lang", language, "--track", track,
                        "--output", self.root / f"my-{language}")

    def typed(self, told, command, *words):
        return run(*shlex.split(command), *words, cwd=told["folder"],
                   env={**os.environ, **self.environment})

    def play_with_numpy(self, told):
        """As its README says for servers without the runtime torch-cpu."""
        manifest = pathlib.Path(told["folder"], "submission/policy.json")
        text = manifest.read_text()
        self.assertIn('"runtimes": ["torch-cpu"]', text)
        manifest.write_text(text.replace("torch-cpu", "python"))

    def follow(self, language):
        """Types the commands of a starter's README in order, to the result of its submission."""
        told = self.started(language, "short-elbow")
        if language == "torch":
            self.play_with_numpy(told)
        first, local, submit = told["commands"]
        self.typed(told, first)
        played = json.loads(self.typed(told, local, "--json"))
        self.assertEqual(played["outcomes"], {"failure": 1}, played)
        printed = played["output"][0]["stderr_tail"]
        self.assertIn("observation: pose_err from 2, size 1, unit rad\n", printed)
        self.assertIn("action: muscles from 0, size 6, unit 1\n", printed)
        answer = json.loads(self.typed(told, submit, "--json"))
        self.assertEqual(answer["state"], "done")
        self.assertEqual(answer["name"], f"my-{language}")
        self.assertEqual(answer["episodes"]["failure"], 3)
        submission = pathlib.Path(told["folder"], "." if language == "python" else "submission")
        return submission, answer["result"]

    def test_starters_are_built_tried_and_submitted_by_their_readme_and_play_every_track(self):
        self.start_daemon()
        self.addCleanup(self.stop_daemon)
        for language in ("cpp", "python", "torch"):
            with self.subTest(language=language):
                submission, graded = self.follow(language)
                here = self.ask("local", submission, "--track", "short-elbow")
                self.assertEqual(here["merkle_root"], graded["merkle_root"])
                for track in ("short-leg", "short-arm"):
                    played = self.ask("local", submission, "--track", track, "--episodes", "1")
                    self.assertEqual(played["outcomes"], {"failure": 1}, played)

    def looking(self, extra):
        """A policy that is started to expect extra observations, or none, and asks for what it
        expects."""
        folder = self.python_policy(f"looks-{extra}", ["extra_policy.py", *["extra"] * extra],
                                    SOURCE / "tests/integration/extra_policy.py")
        manifest = json.loads((folder / "policy.json").read_text())
        (folder / "policy.json").write_text(json.dumps({**manifest, "extra_observations": extra}))
        return folder

    def test_extra_observations_are_shown_where_they_are_allowed_and_change_no_result(self):
        official = ("--track", "tiny-arm", "--profile", "myosuite")
        played = {extra: self.ask("local", self.looking(extra), *official)
                  for extra in (False, True)}
        for result in played.values():
            self.assertEqual(result["outcomes"], {"failure": 2}, result["output"])
        self.assertEqual(played[True]["merkle_root"], played[False]["merkle_root"])
        refusal = 'which the profile "paper" of track "tiny-arm" does not allow'
        for command in (("local",), ("submit", "--team", "lookers")):
            if command[0] == "submit":
                self.start_daemon()
                self.addCleanup(self.stop_daemon)
            refused = self.run_cli(command[0], self.looking(True), "--track", "tiny-arm",
                                   *command[1:], check=False)
            self.assertEqual(refused.returncode, 2, refused.stderr)
            self.assertIn(refusal, refused.stderr)
        graded = self.ask("submit", self.looking(True), *official, "--team", "lookers", "--wait")
        self.assertEqual(graded["episodes"]["failure"], 2, graded)
        self.assertEqual(graded["result"]["merkle_root"], played[False]["merkle_root"])
