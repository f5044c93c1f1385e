"""What cmake --install puts into a prefix runs from there, without the build or the sources."""

import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

BUILD = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"]).parent
PROGRAMS = {"myograde", "myograded", "myograde-runner", "myograde-sim", "myograde-bridge", "myograde-node",
            "myograde-render", "myograde-unpack"}


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-install-"))
        cls.root.chmod(0o755)  # the sandboxes' users read the programs
        cls.prefix = cls.root / "prefix"
        subprocess.run(["cmake", "--install", BUILD, "--prefix", cls.prefix], check=True,
                       stdout=subprocess.DEVNULL)
        cls.share = cls.prefix / "share/myograde"
        cls.environment = {key: value for key, value in os.environ.items()
                           if key not in ("MYOGRADE_BIN_DIR", "MYOGRADE_CONFIG_DIR")}

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.root, ignore_errors=True)

    def ask(self, *words):
        done = subprocess.run([self.prefix / "bin/myograde", *map(str, words), "--json"],
                              env=self.environment, cwd="/", capture_output=True, text=True,
                              timeout=300, stdin=subprocess.DEVNULL)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return json.loads(done.stdout)

    def test_programs_configs_schemas_kits_and_message_types_are_there(self):
        self.assertEqual({path.name for path in (self.prefix / "bin").iterdir()}, PROGRAMS)
        for name in ("configs/server.json", "configs/tracks/elbow.json", "configs/sandbox/sim.json",
                     "configs/schema/show.json", "openapi.json", "figures/__main__.py",
                     "configs/reference/manipulation.lcmlog.zst",
                     "policies/kit-python/myograde/policy/kit.py",
                     "adapters/template-2024/__main__.py", "policies/scripted-elbow/policy.json",
                     "lcm/myograde.lcm", "lcm/myograde_log.lcm",
                     "policies/starter/cpp/policy.cc", "policies/starter/python/policy.py"):
            self.assertTrue((self.share / name).is_file(), name)

    def test_a_starter_is_written_and_played(self):
        told = self.ask("new", "first", "--lang", "python", "-o", self.root / "first")
        result = self.ask("local", told["folder"], "--track", told["track"], "--episodes", "1")
        self.assertEqual(result["outcomes"], {"failure": 1})

    def test_a_policy_is_graded_by_what_is_installed(self):
        tracks = [track["track"] for track in self.ask("spec")["tracks"]]
        self.assertEqual(tracks, sorted(path.stem for path in
                                        (self.share / "configs/tracks").glob("*.json")))
        result = self.ask("local", self.share / "policies/scripted-elbow", "--track", "elbow",
                          "--episodes", "3")
        self.assertEqual(result["state"], "done")
        self.assertEqual(result["aggregate"]["successes"], 3)

    @unittest.skipUnless(os.geteuid() == 0 and os.environ["MYOGRADE_CACHE"] == "/var/cache/myograde",
                         "needs root, and the cache of the system")
    def test_a_user_without_models_plays_and_draws_with_the_systems(self):
        home = self.root / "home"
        home.mkdir()
        shutil.chown(home, "nobody")
        script = (f"{self.prefix}/bin/myograde local {self.share}/policies/scripted-elbow --track elbow "
                  f"--episodes 1 --logs logs && {self.prefix}/bin/myograde episode render logs/* -o end.png")
        done = subprocess.run(
            ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups", "sh", "-c", script], cwd=home,
            env={"HOME": str(home), "PATH": "/usr/bin:/bin"}, capture_output=True, text=True,
            timeout=300, stdin=subprocess.DEVNULL)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertTrue((home / "end.png").read_bytes().startswith(b"\x89PNG"))

    def test_the_simulator_is_the_one_that_was_built(self):
        self.assertEqual((self.prefix / "bin/myograde-sim").read_bytes(),
                         (BUILD / "bin/myograde-sim").read_bytes())


if __name__ == "__main__":
    unittest.main(verbosity=2)
