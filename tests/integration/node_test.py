"""Leases that myograde-node plays for a cluster: the same records as the runner alone gives, once,
and an end in time whatever happens to the daemon, the folder between them or the job."""

import contextlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

from support.waiting import wait_until
from system import BIN, POLICIES, SOURCE, track_config

ROOT = os.geteuid() == 0
UID_BASE = 500000 + os.getpid() % 10000 * 8192 if ROOT else -1
CACHE = pathlib.Path(os.environ["MYOGRADE_CACHE"])
SECOND = 75
TMPFS_BYTES = 16 << 20
# Of a host and its load, not of the lease.
LOAD = {"policy_cpu_s", "simulator_cpu_s", "wall_s", "peak_memory_bytes", "cpu_s"}


def without_load(value):
    if isinstance(value, dict):
        return {key: without_load(entry) for key, entry in value.items()
                if key not in LOAD and "wall" not in key and "cpu" not in key}
    return [without_load(entry) for entry in value] if isinstance(value, list) else value


def records(lines):
    """All records but those of progress."""
    return [without_load(record) for record in map(json.loads, lines)
            if record["type"] != "progress"]


class Attempt:
    """A folder of the spool, and what the same lease needs for the runner alone."""

    def __init__(self, world, number, folder, track, episodes, spool=None):
        self.spool = spool or world.spool
        self.name = f"{number}-1-{number:016x}"
        self.folder = self.spool / "leases" / self.name
        self.work = world.root / f"work-{number}"
        self.work.mkdir()
        world.run_checked([world.tool, self.spool, self.name, "first", folder, track, episodes,
                           CACHE, UID_BASE, self.work])

    def lines(self):
        with contextlib.suppress(FileNotFoundError):
            return (self.folder / "records").read_text().splitlines()
        return []

    def end(self):
        with contextlib.suppress(FileNotFoundError):
            return json.loads((self.folder / "end.json").read_text())
        return None


class Node(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-node-test-"))
        cls.addClassCleanup(shutil.rmtree, cls.root, ignore_errors=True)
        cls.root.chmod(0o755)
        cls.spool = cls.root / "spool"
        cls.tool = BIN.parent / "tests/node_order"
        configs = cls.root / "configs"
        shutil.copytree(SOURCE / "configs", configs)
        (configs / "tracks/short.json").write_text(json.dumps(track_config("elbow")))
        (configs / "tracks/patient.json").write_text(json.dumps(
            track_config("elbow", budgets={"startup_s": 600})))
        cls.environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith("SLURM")},
            "MYOGRADE_CONFIG_DIR": str(configs), "MYOGRADE_BIN_DIR": str(BIN)}
        cls.numbers = iter(range(1, 1000))
        cls.policies = {}
        for name, program in (("sleeps", "#!/bin/sh\nexec sleep 1000\n"),
                              ("ends", "#!/bin/sh\necho last words >&2\nexit 7\n")):
            cls.policies[name] = cls.root / name
            cls.policies[name].write_text(program)
            cls.policies[name].chmod(0o755)
        cls.policies["scripted"] = POLICIES / "scripted-elbow"

    @classmethod
    def run_checked(cls, words):
        done = subprocess.run([*map(str, words)], env=cls.environment, capture_output=True,
                              text=True, timeout=300, stdin=subprocess.DEVNULL)
        if done.returncode != 0:
            raise AssertionError(done.stdout + done.stderr)
        return done.stdout

    def attempt(self, policy, episodes=3, spool=None):
        track = "patient" if policy == "sleeps" else "short"
        return Attempt(self, next(self.numbers), self.policies[policy], track, episodes, spool)

    def start(self, attempt, **environment):
        """A node's process on an attempt; it is dead when the test is over."""
        node = subprocess.Popen(
            [BIN / "myograde-node", "--spool", attempt.spool, "--lease", attempt.name,
             "--cache", CACHE, "--node-dir", self.root / "node-dir"],
            env={**self.environment, **environment}, stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True)
        self.addCleanup(node.stderr.close)
        self.addCleanup(node.wait)
        self.addCleanup(node.kill)
        return node

    def play(self, attempt, **environment):
        """Plays it to its end; the exit status and what was said."""
        node = self.start(attempt, **environment)
        _, said = node.communicate(timeout=300)
        return node.returncode, said

    def until_it_plays(self, attempt, node):
        def plays():
            if node.poll() is not None:
                raise AssertionError(node.stderr.read())
            return attempt.lines()
        wait_until(plays, 300, "the node does not play")

    def expect_end(self, node, attempt, within_s, words):
        begin = time.monotonic()
        self.assertEqual(node.wait(timeout=60), 0)
        self.assertLess(time.monotonic() - begin, within_s)
        if attempt.folder.exists():
            self.assertIn(words, attempt.end()["why"])
        self.assertEqual([], [line for line in attempt.lines()
                              if json.loads(line)["type"] == "lease_end"])

    def test_plays_a_lease_as_the_runner_does(self):
        attempt = self.attempt("scripted")
        status, said = self.play(attempt, SLURMD_NODENAME="n1", SLURM_ARRAY_JOB_ID="12",
                                 SLURM_ARRAY_TASK_ID="3", SLURM_RESTART_COUNT="1")
        self.assertEqual(status, 0, said)
        self.assertEqual(attempt.end()["why"], "")
        alone = self.run_checked([BIN / "myograde-runner", attempt.work / "order.json"])
        self.assertEqual(records(attempt.lines()), records(alone.splitlines()))
        episodes = [record for record in records(attempt.lines()) if record["type"] == "episode"]
        self.assertEqual(len(episodes), 3)
        logs = {path.name: path.read_bytes() for path in (attempt.folder / "logs").iterdir()}
        self.assertEqual(logs, {path.name: path.read_bytes()
                                for path in (attempt.work / "logs").iterdir()})
        self.assertEqual(len(logs), 3)

        claim = json.loads((attempt.folder / "claim").read_text())
        self.assertEqual((claim["node"], claim["job"], claim["restart"]), ("n1", "12_3", 1))
        proof = json.loads((attempt.folder / "node.json").read_text())
        order = json.loads((attempt.folder / "order.json").read_text())
        self.assertEqual((proof["grader"], proof["reference"], proof["doctor"], proof["node"]),
                         (order["grader"], "", [], "n1"))
        end = attempt.end()
        self.assertEqual((end["wait_status"], end["why"], end["energy_j"]), (0, "", None))
        self.assertEqual(end["records_bytes"], (attempt.folder / "records").stat().st_size)
        self.assertGreater(end["cpu_s"], 0)
        for path in [attempt.folder, *attempt.folder.rglob("*")]:
            self.assertEqual(path.stat().st_mode & 0o77, 0, path)
        work = self.root / "node-dir/work"
        self.assertEqual([], [*work.iterdir()] if work.exists() else [])

        # What comes second, or again, changes nothing.
        status, said = self.play(attempt)
        self.assertEqual(status, SECOND, said)
        self.assertEqual(attempt.end(), end)

    def test_a_policy_that_fails_fails_as_it_does_everywhere(self):
        attempt = self.attempt("ends")
        status, said = self.play(attempt)
        self.assertEqual(status, 0, said)
        alone = self.run_checked([BIN / "myograde-runner", attempt.work / "order.json"])
        self.assertEqual(records(attempt.lines()), records(alone.splitlines()))
        self.assertEqual(attempt.end()["why"], "")

    def test_two_leases_share_a_node(self):
        attempts = [self.attempt("sleeps") for _ in range(2)]
        nodes = [self.start(attempt) for attempt in attempts]
        for attempt, node in zip(attempts, nodes):
            self.until_it_plays(attempt, node)
        self.assertEqual(len([*(self.root / "node-dir/work").iterdir()]), 2)
        for attempt, node in zip(attempts, nodes):
            (attempt.folder / "stop").touch()
            self.expect_end(node, attempt, 15, "the daemon asked for the lease's end")

    def test_a_new_epoch_ends_it(self):
        attempt = self.attempt("sleeps")
        node = self.start(attempt)
        self.until_it_plays(attempt, node)
        (self.spool / "epoch").write_text("second")
        self.expect_end(node, attempt, 15, "the daemon was started again")

    def test_a_folder_that_is_gone_ends_it(self):
        attempt = self.attempt("sleeps")
        node = self.start(attempt)
        self.until_it_plays(attempt, node)
        shutil.rmtree(attempt.folder)
        self.expect_end(node, attempt, 15, "")
        self.assertFalse(attempt.folder.exists())

    def test_sigterm_ends_it_and_is_told(self):
        attempt = self.attempt("sleeps")
        node = self.start(attempt)
        self.until_it_plays(attempt, node)
        node.send_signal(signal.SIGTERM)
        self.expect_end(node, attempt, 15, "preempted, cancelled or at its time limit")

    def test_a_node_whose_grader_differs_refuses(self):
        attempt = self.attempt("scripted")
        path = attempt.folder / "order.json"
        order = json.loads(path.read_text())
        order["grader"]["simulator"] = "0" * 64
        path.write_text(json.dumps(order))
        status, said = self.play(attempt)
        self.assertEqual(status, 0, said)
        self.assertIn("they differ in simulator", attempt.end()["why"])
        self.assertEqual(attempt.lines(), [])
        self.assertEqual(attempt.end()["records_bytes"], 0)

    def test_a_submission_that_was_changed_on_its_way_is_not_played(self):
        attempt = self.attempt("ends")
        # Unlike every other's, so that the node has not unpacked it yet.
        path = attempt.folder / "order.json"
        order = json.loads(path.read_text())
        digest = order["artefact"]["digest"]
        other = ("0" if digest[0] != "0" else "1") + digest[1:]
        order["artefact"]["digest"] = other
        path.write_text(json.dumps(order))
        shutil.copy(self.spool / f"artefacts/{digest}.tar", self.spool / f"artefacts/{other}.tar")
        status, said = self.play(attempt)
        self.assertEqual(status, 0, said)
        self.assertIn("the submission did not reach the node", attempt.end()["why"])
        self.assertEqual(attempt.lines(), [])
        self.assertFalse((self.root / "node-dir/artefacts" / other).exists())

    @unittest.skipUnless(ROOT, "only root can mount a disk that is full")
    def test_a_full_folder_delays_it_and_loses_nothing(self):
        disk = self.root / "disk"
        disk.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={TMPFS_BYTES}", "tmpfs", disk],
                       check=True)
        self.addCleanup(subprocess.run, ["umount", "-l", disk], check=True)
        filler = disk / "filler"

        def fill():
            with contextlib.suppress(OSError), open(filler, "wb", buffering=0) as file:
                while True:
                    file.write(bytes(4096))

        attempt = self.attempt("scripted", episodes=60, spool=disk / "spool")
        waiting = self.attempt("ends", spool=disk / "spool")
        node = self.start(attempt)
        self.until_it_plays(attempt, node)
        fill()
        other = self.start(waiting)
        time.sleep(10)
        self.assertIsNone(node.poll())
        self.assertIsNone(other.poll())
        self.assertEqual((attempt.end(), waiting.end()), (None, None))
        filler.unlink()
        for one, process in ((attempt, node), (waiting, other)):
            self.assertEqual(process.wait(timeout=300), 0)
            self.assertEqual(one.end()["why"], "")
            alone = self.run_checked([BIN / "myograde-runner", one.work / "order.json"])
            self.assertEqual(records(one.lines()), records(alone.splitlines()))
        self.assertEqual(len([*(attempt.folder / "logs").iterdir()]), 60)

    def test_the_proof_is_made_once_for_a_boot(self):
        words = [BIN / "myograde-node", "--prove", "--cache", CACHE, "--node-dir",
                 self.root / "proved"]
        if ROOT:
            words += ["--uid-base", UID_BASE]
        first = self.run_checked(words)
        begin = time.monotonic()
        self.assertEqual(self.run_checked(words), first)
        again = time.monotonic()
        self.assertEqual(self.run_checked([*words, "--again"]), first)
        self.assertGreater(time.monotonic() - again, again - begin)


if __name__ == "__main__":
    unittest.main()
