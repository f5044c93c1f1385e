"""Shared by the whole-system tests: the programs, temporary configs, a daemon."""

import json
import os
import pathlib
import shutil
import signal
import unittest

from support.daemon import REFERENCES, Daemon

HERE = pathlib.Path(__file__).resolve().parent
BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
POLICIES = pathlib.Path(os.environ["MYOGRADE_TEST_POLICIES"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])


def track_config(base, **changes):
    """A config that extends `base`: three episodes in one lease, short budgets."""
    config = {
        "extends": base,
        "seeds": {"first": 7000, "count": 3},
        "episodes_per_lease": 3,
        "budgets": {"startup_s": 20, "startup_wall_s": 100, "step_s": 0.2, "overtime_s": 0.5,
                    "wall_factor": 4},
    }
    config.update(changes)
    return config


class SystemTest(unittest.TestCase):
    """A daemon for each class, unless the class does not start it."""

    tracks = {}
    references = REFERENCES
    user = None  # an ordinary user, as whom root starts the daemon; None: as the caller

    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(BIN, SOURCE, "system", cls.user, cls.references)
        cls.addClassCleanup(cls.daemon.close)
        cls.root, cls.data = cls.daemon.root, cls.daemon.data
        cls.environment = cls.daemon.environment
        for name, config in cls.tracks.items():
            cls.daemon.add_track(name, config)

    @classmethod
    def start_daemon(cls):
        cls.daemon.start()

    @classmethod
    def stop_daemon(cls, number=signal.SIGTERM):
        return cls.daemon.stop(number)

    @classmethod
    def run_cli(cls, *words, check=True):
        return cls.daemon.cli(*words, check=check)

    @classmethod
    def ask(cls, *words, check=True):
        """The JSON that a verb prints."""
        return cls.daemon.ask(*words, check=check)

    def python_policy(self, name, words, *files, kit="kit-python"):
        """A submission folder of a kit and copies of `files`, created once per name; Python is
        started with `words`."""
        folder = self.root / name
        if not folder.exists():
            shutil.copytree(POLICIES / kit, folder)
            for file in files:
                shutil.copy(file, folder)
            (folder / "policy.json").write_text(json.dumps({
                "name": name, "command": ["/usr/bin/python3", *words], "runtimes": ["python"]}))
        return folder

    def misbehaving(self, mode):
        """A submission folder of misbehaving_policy.py in a mode."""
        return self.python_policy(f"misbehaving-{mode}", ["misbehaving_policy.py", mode],
                                  HERE / "misbehaving_policy.py")
