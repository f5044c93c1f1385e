"""The Python package's own parts, without a grader: layouts, leg sets, bundles, models."""

import json
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

from support.schemas import validate

import myograde
from myograde import errors, models
from myograde.policy import tracks

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
PACKAGE = pathlib.Path(myograde.__file__).parent


class InFolder(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def told(self, said, verb):
        """What --json printed, which is as its schema says."""
        value = json.loads(said.stdout)
        validate(value, verb)
        return value

    def run_module(self, *words, **variables):
        """python -m myograde."""
        return subprocess.run([sys.executable, "-B", "-m", "myograde", *map(str, words)],
                              capture_output=True, text=True, timeout=120,
                              env={**os.environ, "PYTHONPATH": str(PACKAGE.parent), **variables})


class Kit(unittest.TestCase):
    def test_vectors_are_split_and_joined_by_name(self):
        self.assertEqual(set(tracks()), {"baoding", "chasetag", "elbow", "locomotion", "manipulation",
                                         "relocation", "reorientation"})
        for name in tracks():
            track = myograde.track(name)
            for layout in (track.observation, track.action):
                vector = [random.random() for _ in range(layout.size)]
                parts = layout.split(vector)
                self.assertEqual(layout.join(parts), vector)
                for part in layout.values():
                    self.assertEqual((len(parts[part.name]),), part.shape)
                    self.assertEqual(len(part.entries), part.size)
                    self.assertTrue(part.unit and part.meaning)
        arm = myograde.track("manipulation").observation
        self.assertEqual((arm.size, arm["myohand_qvel"].unit, arm["act"].offset),
                         (222, "rad/s", 153))

    def test_mistakes_are_named(self):
        layout = myograde.track("locomotion").action
        zeros = {"muscles": [0] * 54, "leg_set": [0]}
        for error, words, wrong in (
                (ValueError, "has 3 entries", lambda: layout.split([0, 0, 0])),
                (ValueError, '"leg_set" must have 1 entries, and is missing',
                 lambda: layout.join({"muscles": [0] * 54})),
                (ValueError, "has 2", lambda: layout.join({**zeros, "leg_set": [0, 1]})),
                (ValueError, 'no part "arms"', lambda: layout.join({**zeros, "arms": []})),
                (KeyError, "known: muscles, leg_set", lambda: layout["arms"]),
                (ValueError, "known: baoding", lambda: myograde.track("legs")),
                (ValueError, "known: as-graded", lambda: myograde.leg_sets("none")),
                (ValueError, "known: load", lambda: myograde.Threshold("heat", 1.0, True))):
            with self.assertRaisesRegex(error, words):
                wrong()

    def test_leg_sets_are_sent_as_messages(self):
        for index, leg_set in enumerate(myograde.leg_sets()):
            message = myograde.leg_parameter_set_t.decode(leg_set.message().encode())
            self.assertEqual(message.index, index)
            self.assertEqual(len(message.states), 4)
            for state in message.states:
                self.assertEqual(state.num_thresholds, len(state.thresholds))
                self.assertTrue(0 <= state.knee_target <= 2.0944)
                self.assertTrue(-0.5236 <= state.ankle_target <= 0.5236)
        walking = myograde.leg_sets()[0].message().states[0]
        self.assertEqual([(until.quantity, until.above) for until in walking.thresholds],
                         [(3, 1), (0, 1)])
        self.assertAlmostEqual(walking.thresholds[1].value, 0.25 * myograde.policy.BODY_WEIGHT_N)

    def test_the_package_has_every_message_type(self):
        defined = set()
        for file in ("policy/myograde.lcm", "log/myograde_log.lcm"):
            defined.update(re.findall(r"^struct (\w+)", (SOURCE / "protocol" / file).read_text(),
                                      re.MULTILINE))
        self.assertEqual({name for name in vars(myograde) if name.endswith("_t")}, defined)
        for name in defined:
            self.assertTrue(callable(getattr(myograde, name).decode), name)

    def test_its_version_is_the_projects(self):
        text = (SOURCE / "CMakeLists.txt").read_text()
        self.assertIn(f"project(myograde VERSION {myograde.__version__} ", text)

    def test_nothing_but_serve_needs_lcm(self):
        script = ("import sys; sys.modules['lcm'] = None; import myograde, myograde.client\n"
                  "myograde.serve(myograde.Policy())")
        said = subprocess.run([sys.executable, "-B", "-c", script], capture_output=True, text=True,
                              env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)}, timeout=60)
        self.assertEqual(said.returncode, 1)
        self.assertRegex(said.stderr, r"^error: the package lcm is missing .*policy\.json")


class Bundle(InFolder):
    def test_a_bundle_has_what_a_policy_imports_and_no_client(self):
        said = self.run_module("bundle", self.folder, "--json")
        self.assertEqual(said.returncode, 0, said.stderr)
        told = self.told(said, "bundle")
        kit = self.folder / "myograde"
        self.assertEqual((told["folder"], told["replaced"]), (str(kit), False))
        files = {path.relative_to(kit).as_posix() for path in kit.rglob("*") if path.is_file()}
        self.assertEqual(len(files), told["files"])
        self.assertLessEqual({"__init__.py", "py.typed", "policy/kit.py", "policy/tracks.json",
                              "welcome_t.py"}, files)
        self.assertFalse([name for name in files if "client" in name or "models" in name])
        self.assertEqual([path.name for path in self.folder.iterdir()], ["myograde"])
        imported = subprocess.run(["/usr/bin/python3", "-B", "-c", "import myograde; "
                                   "print(myograde.__file__, myograde.track('elbow').action.size)"],
                                  cwd=self.folder, capture_output=True, text=True, timeout=60,
                                  env={"PATH": "/usr/bin:/bin"})
        self.assertEqual(imported.stdout, f"{kit}/__init__.py 6\n", imported.stderr)

    def test_an_older_kit_is_replaced_and_nothing_else(self):
        kit = self.folder / "myograde"
        (self.folder / "policy.json").write_text("{}")
        kit.mkdir()
        (kit / "action_t.py").write_text("old")
        (kit / "gone.py").write_text("old")
        said = self.run_module("bundle", self.folder)
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertIn("was replaced", said.stdout)
        self.assertNotIn("policy.json", said.stdout)
        self.assertFalse((kit / "gone.py").exists())
        shutil.rmtree(kit)
        kit.mkdir()
        (kit / "mine.py").write_text("mine")
        said = self.run_module("bundle", self.folder)
        self.assertEqual((said.returncode, said.stdout), (2, ""))
        self.assertRegex(said.stderr, "is not a kit; move or rename")
        self.assertEqual((kit / "mine.py").read_text(), "mine")

    def test_a_folder_that_is_not_there_is_an_error(self):
        said = self.run_module("bundle", self.folder / "none")
        self.assertEqual(said.returncode, 2)
        self.assertRegex(said.stderr, r"^myograde: error: .*none: there is no such folder.*\n$")


class Models(InFolder):
    """Downloads come from the wheels that the cache of the tests has, or fail."""

    offline = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": "/nonexistent"}
    nearby = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(CACHE / "wheels")}

    def get(self, *words, **variables):
        return self.run_module("get-models", "--cache", self.folder / "cache", *words, **variables)

    def only(self, name, sha256=None):
        """A list of one of the packages."""
        package = next(package for package in models.read_list() if package.name == name)
        file = self.folder / f"{name}.txt"
        file.write_text(f"{name}=={package.version} --hash=sha256:{sha256 or package.sha256}\n")
        return file

    def tree(self, folder):
        return {path.relative_to(folder).as_posix(): path.stat().st_size
                for path in folder.rglob("*") if path.is_file()}

    def test_the_cache_is_filled_as_the_graders_is_and_then_left_alone(self):
        said = self.get("--json", **self.nearby)
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertEqual(self.told(said, "get-models")["fetched"], ["mujoco", "myosuite"])
        for name in ("mujoco-2.2.2", "myosuite-2.8.4"):
            self.assertEqual(self.tree(self.folder / "cache" / name), self.tree(CACHE / name))
        before = (self.folder / "cache/mujoco-2.2.2").stat().st_mtime_ns
        said = self.get(**self.offline)
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertIn("Everything is already there", said.stdout)
        self.assertEqual((self.folder / "cache/mujoco-2.2.2").stat().st_mtime_ns, before)
        # What was deleted comes from the wheel that was kept, without a network.
        shutil.rmtree(self.folder / "cache/mujoco-2.2.2")
        said = self.get("--json", **self.offline)
        self.assertEqual(self.told(said, "get-models")["fetched"], ["mujoco"])
        self.assertEqual(sorted(path.name for path in (self.folder / "cache").iterdir()),
                         ["mujoco-2.2.2", "myosuite-2.8.4", "wheels"])

    def test_without_a_network_nothing_is_left_half_done(self):
        said = self.get(**self.offline)
        self.assertEqual(said.returncode, 4)
        self.assertRegex(said.stderr, "^myograde: error: pip could not download mujoco 2.2.2.*network")
        self.assertIn("No matching distribution", said.stderr)
        self.assertEqual([path.name for path in (self.folder / "cache").iterdir()], ["wheels"])

    def test_what_is_not_the_pinned_package_is_not_taken(self):
        wheels = self.folder / "cache/wheels"
        wheels.mkdir(parents=True)
        kept = next((CACHE / "wheels").glob("mujoco-*"))
        (wheels / kept.name).write_bytes(kept.read_bytes()[:-1])
        environment = unittest.mock.patch.dict(os.environ, self.nearby)
        with environment, self.assertRaisesRegex(errors.MyogradeError, "SHA-256 differs"):
            models.get_models(self.folder / "cache", pinned_list=self.only("mujoco", "0" * 64))
        self.assertFalse((self.folder / "cache/mujoco-2.2.2").exists())
        # A damaged one that was kept is got again.
        with environment:
            got = models.get_models(self.folder / "cache", pinned_list=self.only("mujoco"))
        self.assertEqual(got.fetched, ["mujoco"])
        self.assertEqual((wheels / kept.name).read_bytes(), kept.read_bytes())

    def test_the_systems_cache_serves_who_has_no_models(self):
        system = self.folder / "system"
        (system / models.MODELS).mkdir(parents=True)
        variables = {"HOME": str(self.folder), "XDG_CACHE_HOME": "", "MYOGRADE_CACHE": ""}
        with unittest.mock.patch.dict(os.environ, variables), \
                unittest.mock.patch("os.geteuid", return_value=1000), \
                unittest.mock.patch.object(models, "SYSTEM_CACHE", system):
            self.assertEqual(models.default_cache(), system)
            own = self.folder / ".cache/myograde"
            (own / models.MODELS).mkdir(parents=True)
            self.assertEqual(models.default_cache(), own)

    def test_two_at_once_do_not_disturb_each_other(self):
        command = [sys.executable, "-B", str(PACKAGE / "models.py"), str(self.folder / "cache"),
                   str(self.only("mujoco"))]
        both = [subprocess.Popen(command, env={**os.environ, **self.nearby}) for _ in range(2)]
        self.assertEqual([process.wait(60) for process in both], [0, 0])
        self.assertEqual(self.tree(self.folder / "cache/mujoco-2.2.2"),
                         self.tree(CACHE / "mujoco-2.2.2"))

    def test_a_cache_that_cant_be_made_is_an_error(self):
        (self.folder / "cache").write_text("in the way")
        said = self.get(**self.offline)
        self.assertEqual(said.returncode, 2)
        self.assertRegex(said.stderr, "can't be used as the cache folder .*--cache")


if __name__ == "__main__":
    unittest.main(verbosity=2)
