"""`myograde doctor` on this host as it is, and as it would be with parts of it missing.
usage: doctor_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

from support.schemas import validate

BIN_DIR, SOURCE_DIR = sys.argv[1:3]
NEEDED = {"configs", "kernel", "processor", "programs", "bubblewrap", "user_namespaces", "seccomp",
          "policy_sandbox", "simulator_sandbox", "mujoco", "models"}


class DoctorTest(unittest.TestCase):
    found = None  # the checks of this host as it is: to compile all models takes seconds

    def setUp(self):
        self.temp = tempfile.mkdtemp(prefix="doctor-")
        self.addCleanup(shutil.rmtree, self.temp)

    def doctor(self, *args, prefix=(), **env):
        command = [*prefix, f"{BIN_DIR}/myograde", "doctor", *args, "--data", self.temp]
        return subprocess.run(command, capture_output=True, text=True, timeout=400, check=False,
                              stdin=subprocess.DEVNULL,
                              env={**os.environ, "MYOGRADE_CONFIG_DIR": f"{SOURCE_DIR}/configs",
                                   "TMPDIR": self.temp, **env})

    def checks(self, status, *args, prefix=(), **env):
        """The checks of a run that has this exit status, by name."""
        done = self.doctor("--json", *args, prefix=prefix, **env)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        value = json.loads(done.stdout)
        validate(value, "doctor")
        self.assertEqual(status == 4, value["state"] == "missing")
        for check in value["checks"]:
            poor = check["state"] != "ok"
            self.assertTrue(check["found"], check)
            self.assertEqual((bool(check["costs"]), bool(check["todo"])), (poor, poor), check)
        by_name = {check["name"]: check for check in value["checks"]}
        self.assertEqual(len(by_name), len(value["checks"]))
        return by_name

    def of_this_host(self):
        if DoctorTest.found is None:
            DoctorTest.found = self.checks(0)
            self.assertEqual(os.listdir(self.temp), [])
        return DoctorTest.found

    def states(self, checks, *names):
        return [checks[name]["state"] for name in names]

    def test_this_host_can_grade(self):
        checks = self.of_this_host()
        self.assertLessEqual(NEEDED, set(checks))
        self.assertEqual({checks[name]["state"] for name in NEEDED}, {"ok"})

    def test_figures_are_spoken_of(self):
        check = self.of_this_host()["figures"]
        if check["state"] == "ok":
            self.assertRegex(check["found"], r"^matplotlib [0-9.]+ draws figures and reports$")
        else:
            self.assertEqual((check["state"], check["todo"]), ("degraded", "apt-get install python3-matplotlib"))

    def test_pictures_and_films_are_spoken_of(self):
        check = self.of_this_host()["pictures"]
        if check["state"] == "ok":
            self.assertRegex(check["found"], "libOSMesa.so.8 draws, and .*ffmpeg encodes films")
        else:
            self.assertRegex(check["todo"], "^apt-get install( libosmesa6)?( ffmpeg)?$")

    def test_text_is_a_table_without_colour_and_the_path_does_not_matter(self):
        done = self.doctor(PATH="")
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertNotIn("\x1b", done.stdout)
        for name in ("bubblewrap", "python", "policy_sandbox"):
            self.assertRegex(done.stdout, rf"(?m)^{name} +ok ")

    def test_an_empty_cache_lacks_the_models_but_not_the_sandbox(self):
        empty = f"{self.temp}/cache"
        os.mkdir(empty)
        checks = self.checks(4, MYOGRADE_CACHE=empty)
        self.assertEqual(self.states(checks, "mujoco", "models"), ["missing", "missing"])
        for name in ("mujoco", "models"):
            self.assertIn(empty, checks[name]["found"])
            self.assertIn("./dev setup", checks[name]["todo"])
        self.assertEqual(self.states(checks, "policy_sandbox", "user_namespaces", "seccomp"),
                         ["ok", "ok", "ok"])
        self.assertEqual(os.listdir(empty), [])

    def cache_of_links(self, without):
        """A cache folder in which only what begins as `without` is missing."""
        cache = f"{self.temp}/cache"
        os.makedirs(cache)
        for name in os.listdir(os.environ["MYOGRADE_CACHE"]):
            if not name.startswith(without):
                os.symlink(f"{os.environ['MYOGRADE_CACHE']}/{name}", f"{cache}/{name}")
        return cache

    def test_a_changed_model_file_is_found(self):
        cache = self.cache_of_links(without="myosuite-")
        assets = "myosuite-2.8.4/myosuite/envs/myo/assets"
        shutil.copytree(f"{os.environ['MYOGRADE_CACHE']}/myosuite-2.8.4/myosuite",
                        f"{cache}/myosuite-2.8.4/myosuite")
        changed = f"{cache}/{assets}/arm/myoarm_bionic_bimanual.xml"
        with open(changed, "a", encoding="utf-8") as file:
            file.write(" ")
        checks = self.checks(4, MYOGRADE_CACHE=cache)
        self.assertEqual(checks["models"]["state"], "missing")
        self.assertIn(changed, checks["models"]["found"])

    def test_without_bubblewrap_and_without_a_compiled_model(self):
        hidden = "mount --bind /dev/null /usr/bin/bwrap && exec \"$@\""
        own = ["unshare", "-m"] if os.geteuid() == 0 else ["unshare", "-rm"]
        cache = self.cache_of_links(without="models")
        shutil.copytree(f"{os.environ['MYOGRADE_CACHE']}/models", f"{cache}/models")
        missing = next(name for name in os.listdir(f"{cache}/models") if name.startswith("elbow-"))
        os.remove(f"{cache}/models/{missing}")
        checks = self.checks(4, prefix=(*own, "sh", "-c", hidden, "sh"), MYOGRADE_CACHE=cache)
        self.assertEqual(self.states(checks, "bubblewrap", "policy_sandbox", "simulator_sandbox"),
                         ["missing"] * 3)
        self.assertIn("package bubblewrap", checks["bubblewrap"]["todo"])
        self.assertEqual(checks["models"]["state"], "degraded")
        self.assertRegex(checks["models"]["found"], f"lacks {missing}$")

    def test_without_the_programs_and_with_broken_configs(self):
        os.mkdir(f"{self.temp}/bin")
        checks = self.checks(4, MYOGRADE_BIN_DIR=f"{self.temp}/bin")
        self.assertIn("myograde-bridge", checks["programs"]["found"])
        self.assertEqual(self.states(checks, "programs", "models", "bubblewrap"),
                         ["missing", "missing", "ok"])
        checks = self.checks(4, "--configs", f"{self.temp}/nowhere")
        self.assertIn("nowhere", checks["configs"]["found"])
        self.assertEqual(self.states(checks, "configs", "policy_sandbox", "models"),
                         ["missing", "missing", "ok"])

    @unittest.skipUnless(os.geteuid() == 0, "only root can become another user")
    def test_an_ordinary_user_hears_what_is_lost(self):
        os.chmod(self.temp, 0o777)
        nobody = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups")
        for path in (BIN_DIR, SOURCE_DIR):
            seen = subprocess.run([*nobody, "ls", path], capture_output=True, check=False)
            if seen.returncode != 0:
                self.skipTest(f"user 65534 can't enter {path}, so it has no MyoGrade to ask")
        checks = self.checks(0, prefix=nobody)
        self.assertEqual(checks["slot_users"]["state"], "degraded")
        self.assertEqual(self.states(checks, "policy_sandbox", "simulator_sandbox"), ["ok", "ok"])

    def test_both_sandboxes_are_printed(self):
        done = self.doctor("--sandbox", "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        value = json.loads(done.stdout)
        validate(value, "doctor")
        policy, simulator = value["policy"], value["simulator"]
        self.assertEqual(policy["process_1"], "/myograde/myograde-bridge")
        self.assertEqual(policy["command"][-1], "COMMAND")
        self.assertEqual(simulator["network"], "none")
        self.assertIn("ptrace", policy["system_calls"]["denied"])
        self.assertIn("ptrace", simulator["system_calls"]["denied"])
        allowed = simulator["system_calls"]["allowed_once_loaded"]
        self.assertIn("read", allowed)
        self.assertFalse({"openat", "execve", "clone", "socket"} & set(allowed))
        writable = [m["target"] for m in policy["mounts"] if m["kind"] == "writable"]
        self.assertEqual(sorted(writable), ["/dev/shm", "/tmp"])
        self.assertNotIn("writable", [m["kind"] for m in simulator["mounts"]])
        for sandbox in (policy, simulator):
            self.assertEqual(sandbox["capabilities"], [])
            self.assertEqual(set(sandbox["namespaces"]),
                             {"user", "pid", "ipc", "uts", "mount", "net", "cgroup"})
        if os.geteuid() == 0:
            self.assertGreater(policy["uid"], 0)
            self.assertGreater(simulator["uid"], 0)
            self.assertNotEqual(policy["uid"], simulator["uid"])

    def test_both_sandboxes_are_told_as_text(self):
        done = self.doctor("--sandbox")
        self.assertEqual(done.returncode, 0, done.stderr)
        for words in ("The policy's sandbox", "The simulator's sandbox", "myograde-bridge",
                      "ptrace", "/dev/shm", "limits in total", "allowed_once_loaded"):
            self.assertIn(words, done.stdout)
        self.assertNotIn("\x1b", done.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
