"""The packages in a bare Debian 12 whose systemd is booted in a container: installed, started by their
units, graded, upgraded over a running daemon, removed and purged, with nothing left."""

import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
BUILD = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"]).parent
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
TOOLS = ("mmdebstrap", "systemd-nspawn", "lintian", "dpkg-shlibdeps")
FETCHED = ("mujoco-2.2.2", "myosuite-2.8.4")
# Started by the container's systemd, which it switches off at its end.
TRIAL = """[Unit]
After=network.target
[Service]
Type=oneshot
StandardOutput=file:/root/trial.log
StandardError=inherit
Environment=HOME=/root DEBIAN_FRONTEND=noninteractive
ExecStart=/bin/bash /root/trial.sh
ExecStopPost=/bin/systemctl poweroff --no-block
[Install]
WantedBy=multi-user.target
"""
SCRIPT = """
step() { echo "step $1: $?"; }
systemctl enable --now myograded.socket myograded.service; step start
timeout 120 myograde submit /usr/lib/myograde/policies/scripted-elbow --track elbow --team First --wait; step grade
myograde leaderboard --track elbow --json > /root/board.json; step board
before=$(systemctl show -p MainPID myograded.service)
cd /root/packages
apt-get install -y -q --reinstall ./myograde-client_*.deb ./myograde-server_*.deb
step upgrade
[ "$before" != "$(systemctl show -p MainPID myograded.service)" ]; step restarted
myograde leaderboard --track elbow --json | cmp - /root/board.json; step same_board
systemctl stop myograded.service && myograde status; step activated
journalctl -u myograded --no-pager
apt-get remove -y -q myograde-server; step remove
[ -e /var/lib/myograde/store.db ] && [ -e /etc/myograde/server.json ]; step kept
apt-get purge -y -q myograde-server myograde-client libmyograde-policy-dev python3-myograde; step purge
! find / -xdev -name '*myograde*' -not -path '/root/*' -not -path '/var/log/*' -not -path '/proc/*' | grep .; step clean
! getent group myograde; step no_group
"""
STEPS = ("start", "grade", "board", "upgrade", "restarted", "same_board", "activated", "remove", "kept",
         "purge", "clean", "no_group")


def run(*words, timeout=900, **options):
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=timeout,
                          stdin=subprocess.DEVNULL, **options)
    if done.returncode != 0:
        raise AssertionError(f"{words}: exit {done.returncode}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


@unittest.skipUnless(os.geteuid() == 0, "only root can boot a container")
@unittest.skipUnless(all(map(shutil.which, TOOLS)), f"needs {', '.join(TOOLS)}")
@unittest.skipUnless(CACHE == pathlib.Path("/var/cache/myograde"), "the packages look in /var/cache/myograde")
class Debian(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="myograde-debian-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.folder.chmod(0o755)
        cls.packages = cls.folder / "packages"
        run("./dev", "package", cls.packages, cwd=SOURCE, timeout=1800)

    def container(self, *words):
        return run("systemd-nspawn", "--register=no", "--keep-unit", "--quiet", "--resolv-conf=copy-host",
                   "-D", self.root, "--console=pipe", *words)

    def test_lintian_is_content(self):
        told = subprocess.run(["lintian", "--allow-root", "--fail-on", "error,warning",
                               *self.packages.glob("*.deb")], capture_output=True, text=True, timeout=600)
        self.assertEqual((told.returncode, told.stdout), (0, ""))

    def test_installed_graded_upgraded_and_purged(self):
        self.root = self.folder / "root"
        run("mmdebstrap", "--variant=minbase", "--include=systemd-sysv,ca-certificates", "bookworm", self.root)
        shutil.copytree(self.packages, self.root / "root/packages")
        # What reaches the registry from here does from there.
        shutil.copy("/etc/ssl/certs/ca-certificates.crt", self.root / "etc/ssl/certs/ca-certificates.crt")
        if os.path.exists("/etc/pip.conf"):
            shutil.copy("/etc/pip.conf", self.root / "etc/pip.conf")
        self.container("sh", "-c", "apt-get install -y -q --no-install-recommends /root/packages/*.deb")
        shutil.copy("/etc/ssl/certs/ca-certificates.crt", self.root / "etc/ssl/certs/ca-certificates.crt")
        for name in FETCHED:  # kept by myograde-setup, which compares them
            shutil.copytree(CACHE / name, self.root / "var/cache/myograde" / name)
        self.container("myograde-setup", "--no-check")
        self.container("systemd-analyze", "verify", "myograded.service", "myograded.socket")
        self.container("python3", "-c", "import myograde; myograde.Policy; myograde.serve")
        (self.root / "root/trial.sh").write_text(SCRIPT)
        unit = self.root / "etc/systemd/system/trial.service"
        unit.write_text(TRIAL)
        wants = unit.parent / "multi-user.target.wants"
        wants.mkdir(exist_ok=True)
        (wants / unit.name).symlink_to("../trial.service")
        booted = subprocess.run(["systemd-nspawn", "--register=no", "--keep-unit", "--resolv-conf=off",
                                 "--capability=CAP_NET_ADMIN", "-D", self.root, "--boot", "--console=pipe"], capture_output=True, text=True,
                                timeout=900, stdin=subprocess.DEVNULL)
        log = self.root / "root/trial.log"
        if not log.exists():
            self.skipTest(f"systemd can't be booted here: {booted.stderr[-300:]}")
        text = log.read_text()
        for step in STEPS:
            self.assertIn(f"step {step}: 0\n", text, text)
        self.assertIn("successes           100 of 100", text)


if __name__ == "__main__":
    unittest.main(verbosity=2)
