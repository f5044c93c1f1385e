"""Stores of other versions in the real daemon: a newer one is refused and the way back named, one from before
the first release is refused by name, and the drill of OPERATIONS.md can be typed."""

import os
import re
import shutil
import signal
import sqlite3
import subprocess
import unittest

from daemon_test import BIN, SOURCE, DaemonCase

DRILL = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def schema_of(path):
    with sqlite3.connect(path) as db:
        version = db.execute("PRAGMA user_version").fetchone()[0]
    db.close()
    return version


class Upgrade(DaemonCase):
    def setUp(self):
        super().setUp()
        self.newest = self.get("/v1/health")["schema"]
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        self.store = self.data / "store.db"

    def fails_with(self, *words):
        """It does not start, as status 4 and in one sentence."""
        process = self.daemon.launch()
        self.assertEqual(process.wait(60), 4, self.daemon.log()[-2000:])
        said = [line for line in self.daemon.log().splitlines() if "myograded: error:" in line][-1]
        for word in words:
            self.assertIn(word, said)

    def test_a_newer_store_is_refused_and_the_copy_named(self):
        shutil.copy(self.store, self.data / f"store.db.schema-{self.newest}")
        with sqlite3.connect(self.store) as db:
            db.execute(f"PRAGMA user_version = {self.newest + 1}")
        db.close()
        self.fails_with(f"has schema {self.newest + 1}, this program knows up to {self.newest}",
                        f"restore the copy from before the upgrade, {self.store}.schema-{self.newest}")

    def test_a_store_from_before_the_first_release_is_refused_by_name(self):
        with sqlite3.connect(self.store) as db:
            db.execute("PRAGMA application_id = 0")
            db.execute("PRAGMA user_version = 11")
        db.close()
        self.fails_with(f"{self.store}: is a store of schema 11 from before the first release",
                        "give --data a new folder")

    def test_the_drill_can_be_typed(self):
        page = (SOURCE / "server/daemon/OPERATIONS.md").read_text(encoding="utf-8")
        before, after, back = DRILL.findall(page[page.index("### The drill"):])
        work = self.folder / "work"
        work.mkdir()
        environment = {**self.daemon.environment, "PATH": f"{BIN}:{os.environ['PATH']}"}

        def bash(text):
            done = subprocess.run(["bash", "-e", "-c", text], cwd=work, env=environment, text=True,
                                  capture_output=True, timeout=300, stdin=subprocess.DEVNULL)
            self.assertEqual(done.returncode, 0, f"{text}\n{done.stdout}{done.stderr}")

        copy = self.data / f"store.db.schema-{self.newest}"
        shutil.copy(self.store, copy)  # as an upgrade keeps it
        self.start()
        bash(before)
        self.assertEqual(schema_of(work / "before-upgrade.db"), self.newest)
        bash(after)
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        bash(back)
        self.assertEqual(self.store.read_bytes(), copy.read_bytes())
        self.assertEqual(schema_of(self.data / "store.db.newer"), self.newest)
        self.start()


if __name__ == "__main__":
    unittest.main(verbosity=2)
