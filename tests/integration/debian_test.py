"""The packages in a bare Debian 12 with a kernel, control groups and systemd of its own: lintian, installed,
graded, watched, upgraded, removed and purged. Takes the packages in MYOGRADE_TEST_PACKAGES, or else builds them; and the bare system from the
archive MYOGRADE_TEST_BASE, or else from Debian's archive."""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
sys.path.insert(0, str(SOURCE / "tests"))

from support import machine
from support.certificates import make_certificate

HERE = pathlib.Path(__file__).resolve().parent
TOOLS = ("lintian", "dpkg-shlibdeps", "dpkg-deb")
FETCHED = ("mujoco-2.2.2", "myosuite-2.8.4")
# An emulated processor takes some ten minutes; the rest is for busy hosts.
BOOTED_S = 3000


@unittest.skipUnless(os.geteuid() == 0, "only root can make a Debian")
@unittest.skipUnless(all(map(shutil.which, TOOLS)) and not machine.lacking(),
                     f"needs {', '.join(TOOLS + machine.TOOLS)}")
@unittest.skipUnless(CACHE == pathlib.Path("/var/cache/myograde"), "the packages look in /var/cache/myograde")
class Debian(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="myograde-debian-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.folder.chmod(0o755)
        given = os.environ.get("MYOGRADE_TEST_PACKAGES")
        cls.packages = pathlib.Path(given) if given else cls.folder / "packages"
        if not given:
            machine.run("./dev", "package", cls.packages, cwd=SOURCE, timeout=1800)

    def test_lintian_is_content(self):
        told = subprocess.run(["lintian", "--allow-root", "--fail-on", "error,warning",
                               *self.packages.glob("*.deb")], capture_output=True, text=True, timeout=600)
        self.assertEqual((told.returncode, told.stdout), (0, ""))

    def test_installed_graded_upgraded_and_purged(self):
        bare = machine.Machine(self.folder, os.environ.get("MYOGRADE_TEST_BASE"))
        home = bare.root / "root"
        (home / "packages").mkdir()
        for package in self.packages.glob("*.deb"):
            shutil.copy(package, home / "packages")
        make_certificate(home)
        bare.inside("apt-get", "update", "-q")
        bare.trust()
        bare.inside("sh", "-c", "apt-get install -y -q --no-install-recommends adduser procps /root/packages/*.deb")
        bare.trust()
        for name in FETCHED:  # kept by myograde-setup, which compares them
            shutil.copytree(CACHE / name, bare.root / "var/cache/myograde" / name)
        bare.inside("myograde-setup", "--no-check")
        bare.inside("python3", "-c", "import myograde; myograde.Policy; myograde.serve")
        # The machine installs them itself; what they need and myograde-setup got is there.
        bare.inside("sh", "-c", "apt-get remove -y -q 'myograde-*' libmyograde-policy-dev python3-myograde && "
                    "rm -rf /var/lib/myograde")
        script = (HERE / "debian_trial.sh").read_text()
        told, console = bare.boot(script, BOOTED_S)
        if os.environ.get("MYOGRADE_TEST_TOLD"):
            pathlib.Path(os.environ["MYOGRADE_TEST_TOLD"]).write_text(told)
        ends = dict(re.findall(r"^step (\w+): (\d+)$", told, re.M))
        wanted = re.findall(r"; step (\w+)$|^step (\w+)$", script, re.M)
        names = [first or second for first, second in wanted]
        self.assertGreater(len(names), 40)
        bad = [name for name in names if ends.get(name) != "0"]
        self.assertEqual(bad, [], f"{told[-12000:]}\n{console[-1500:]}")
        self.assertIn("cgroup2fs", told)
        self.assertEqual(told.count("successes           4 of 4"), 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
