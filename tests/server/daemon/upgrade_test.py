"""Stores and configs of earlier versions in the real daemon: the boards stay, a copy is kept, the drill
of OPERATIONS.md can be typed, a full disk changes nothing, and a newer store is refused."""

import os
import re
import shutil
import signal
import sqlite3
import subprocess
import unittest

from daemon_test import BIN, SOURCE, DaemonCase

OLD = SOURCE / "tests/server/store/old"
DRILL = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NEWEST = max(int(path.stem.split("_v")[1])
             for path in (SOURCE / "server/store").glob("schema_v*.sql"))


def store_of(version, path):
    with sqlite3.connect(path) as db:
        db.executescript((OLD / f"v{version}.sql").read_text())
    db.close()


def schema_of(path):
    with sqlite3.connect(path) as db:
        version = db.execute("PRAGMA user_version").fetchone()[0]
    db.close()
    return version


class Upgrade(DaemonCase):
    def setUp(self):
        self.mounted = False
        super().setUp()
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        self.store = self.data / "store.db"

    def take(self, version):
        """Puts a store of this version into the data folder."""
        for path in self.data.glob("store.db*"):
            path.unlink()
        store_of(version, self.store)

    def board(self):
        """Places, teams and numbers of the fixture's board, by its config, as it is in the store."""
        with sqlite3.connect(self.store) as db:
            config = db.execute("SELECT config FROM submission WHERE id = 1").fetchone()[0]
            track = db.execute("SELECT track FROM submission WHERE id = 1").fetchone()[0]
        db.close()
        body = self.get(f"/v1/leaderboard?track={track}&config={config}")
        return [(row["rank"], row["team"], row["submission"]) for row in body["rows"]]

    def expected(self, version):
        lines = (OLD / f"v{version}.board").read_text().splitlines()
        return [line.split(" ")[1] for line in lines if "{" in line]

    def fails_with(self, *words):
        """It does not start, as status 4 and in one sentence."""
        process = self.daemon.launch()
        self.assertEqual(process.wait(60), 4, self.daemon.log()[-2000:])
        said = [line for line in self.daemon.log().splitlines() if "myograded: error:" in line][-1]
        for word in words:
            self.assertIn(word, said)

    def test_every_version_starts_with_its_boards_and_a_copy(self):
        for version in range(1, NEWEST):
            with self.subTest(version=version):
                self.take(version)
                self.start()
                board = self.board()
                self.assertEqual([team for _, team, _ in board], self.expected(version))
                self.assertEqual(self.stop(signal.SIGTERM), 0)
                self.assertEqual(schema_of(self.store), NEWEST)
                self.assertEqual(schema_of(self.data / f"store.db.schema-{version}"), version)
                self.assertIn(f"the store had schema {version} and now has {NEWEST}",
                              self.daemon.log())

    def test_a_newer_store_is_refused_and_the_copy_named(self):
        self.take(NEWEST - 1)
        self.start()
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        with sqlite3.connect(self.store) as db:
            db.execute(f"PRAGMA user_version = {NEWEST + 1}")
        db.close()
        self.fails_with(f"has schema {NEWEST + 1}, this program knows up to {NEWEST}",
                        f"restore the copy from before the upgrade, {self.store}.schema-{NEWEST - 1}")

    def test_configs_of_the_first_version_start(self):
        shipped = self.configs / "server.json"
        uid_base = self.daemon.uid_base
        shutil.copy(SOURCE / "tests/server/config/old/server-1.json", shipped)
        self.daemon.change_config("server.json", uid_base=uid_base, slots=1)
        self.take(1)
        self.start()
        self.assertEqual(self.get("/v1/health")["status"], "ok")

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

        self.take(NEWEST - 1)
        copy = self.folder / "kept.db"
        shutil.copy(self.store, copy)
        self.start()
        bash(before)
        self.assertEqual(schema_of(work / "before-upgrade.db"), NEWEST)
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        for path in self.data.glob("store.db*"):
            path.unlink()
        shutil.copy(copy, self.store)
        self.start()
        bash(after)
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        bash(back)
        self.assertEqual(schema_of(self.store), NEWEST - 1)
        self.assertEqual(schema_of(self.data / "store.db.newer"), NEWEST)
        self.start()

    @unittest.skipUnless(os.geteuid() == 0, "only root can mount a small disk")
    def test_without_room_for_the_copy_nothing_changes(self):
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m,mode=0700", "small",
                               str(self.data)], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            self.skipTest(f"no disk can be mounted here: {done.stderr.strip()}")
        self.addCleanup(subprocess.run, ["umount", "--lazy", str(self.data)], check=False)
        self.configure(artefacts={"disk_reserve_bytes": 1})
        store_of(NEWEST - 1, self.store)
        ballast = self.data / "ballast"
        with open(ballast, "wb", buffering=0) as file:
            for size in (1 << 16, 4096):
                while os.statvfs(self.data).f_bavail * 4096 > 200 * 1024 + size:
                    file.write(b"x" * size)
        self.fails_with("the disk is full; make room", "without it the store stays as it is")
        self.assertEqual(schema_of(self.store), NEWEST - 1)
        ballast.unlink()
        self.start()
        self.assertTrue((self.data / f"store.db.schema-{NEWEST - 1}").exists())


if __name__ == "__main__":
    unittest.main(verbosity=2)
