"""What the whole-system tests share: the programs, temporary configs, a daemon."""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
POLICIES = pathlib.Path(os.environ["MYOGRADE_TEST_POLICIES"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
DEADLINE_S = 1800


def track_config(base, **changes):
    """A config that extends `base`: three episodes in one lease, short budgets."""
    config = {
        "extends": base,
        "seeds": {"first": 7000, "count": 3},
        "episodes_per_lease": 3,
        "budgets": {"startup_s": 20, "startup_wall_s": 100, "step_s": 0.2, "overtime_s": 0.5, "wall_factor": 4},
    }
    config.update(changes)
    return config


class SystemTest(unittest.TestCase):
    """A temporary data folder and config folder for each class."""

    tracks = {}
    user = None  # an ordinary one, as whom root starts the daemon; None: as whoever tests

    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-system-"))
        cls.data = cls.root / "data"
        shutil.copytree(SOURCE / "configs", cls.root / "configs")
        cls.own_users()
        for name, config in cls.tracks.items():
            path = cls.root / "configs" / "tracks" / f"{name}.json"
            path.write_text(json.dumps(config))
        cls.environment = dict(os.environ, MYOGRADE_DATA=str(cls.data),
                               MYOGRADE_CONFIG_DIR=str(cls.root / "configs"))
        cls.daemon = None
        if cls.user is not None:
            cls.root.chmod(0o755)
            cls.data.mkdir()
            os.chown(cls.data, cls.user, cls.user)

    @classmethod
    def own_users(cls):
        """Users of its own for the slots: limits on processes count by user, and other daemons may
        be at work on this host."""
        path = cls.root / "configs" / "server.json"
        config = json.loads(path.read_text())
        config["uid_base"] = 100000 + os.getpid() % 100000 * 8192
        path.write_text(json.dumps(config))

    @classmethod
    def tearDownClass(cls):
        cls.stop_daemon()
        shutil.rmtree(cls.root, ignore_errors=True)

    @classmethod
    def start_daemon(cls):
        become = [] if cls.user is None else [
            "setpriv", f"--reuid={cls.user}", f"--regid={cls.user}", "--clear-groups"]
        with open(cls.root / "daemon.log", "ab") as log:
            cls.daemon = subprocess.Popen([*become, BIN / "myograde", "serve"],
                                          env=cls.environment, stdout=log, stderr=log, stdin=subprocess.DEVNULL)
        deadline = time.monotonic() + 30
        while cls.run_cli("status", check=False).returncode != 0:
            if cls.daemon.poll() is not None or time.monotonic() > deadline:
                raise AssertionError((cls.root / "daemon.log").read_text())
            time.sleep(0.1)

    @classmethod
    def stop_daemon(cls, number=signal.SIGTERM):
        if cls.daemon is None:
            return None
        cls.daemon.send_signal(number)
        status = cls.daemon.wait(timeout=30)
        cls.daemon = None
        return status

    @classmethod
    def run_cli(cls, *words, check=True):
        result = subprocess.run([BIN / "myograde", *map(str, words)], env=cls.environment,
                                capture_output=True, text=True, timeout=DEADLINE_S,
                                stdin=subprocess.DEVNULL)
        if check and result.returncode != 0:
            said = result.stdout + result.stderr
            if cls.daemon is not None and cls.daemon.poll() is not None:
                log = (cls.root / "daemon.log").read_text(errors="replace")[-4000:]
                said += f"the daemon has ended as {cls.daemon.returncode}; its log:\n{log}"
            raise AssertionError(f"{words}: exit {result.returncode}\n{said}")
        return result

    @classmethod
    def ask(cls, *words, check=True):
        """The JSON that a verb prints."""
        return json.loads(cls.run_cli(*words, "--json", check=check).stdout)

    def misbehaving(self, mode):
        """A submission folder of misbehaving_policy.py in a mode."""
        folder = self.root / f"misbehaving-{mode}"
        if not folder.exists():
            shutil.copytree(POLICIES / "kit-python", folder)
            shutil.copy(SOURCE / "tests/integration/misbehaving_policy.py", folder)
            (folder / "policy.json").write_text(json.dumps({
                "name": f"misbehaving-{mode}",
                "command": ["/usr/bin/python3", "misbehaving_policy.py", mode],
                "runtimes": ["python"],
            }))
        return folder
