"""Leases on a real Slurm cluster of three virtual nodes: the same Merkle roots as on the daemon's own
host, whatever fails on the way."""

import contextlib
import json
import pathlib
import subprocess
import unittest

from support import slurm
from support.waiting import wait_until
from system import BIN, HERE, POLICIES, SystemTest, track_config

WAIT_S = 240
# A lease of two episodes of 2 s; with the patient policy it takes about ten.
TRACKS = {"short": track_config("elbow", seeds={"first": 50, "count": 6}, episodes_per_lease=2,
                                budgets={"startup_s": 60, "startup_wall_s": 120})}


class OnSlurm(SystemTest):
    """A daemon whose leases run on a cluster."""

    tracks = TRACKS
    slurm_options = {}  # of the daemon

    @classmethod
    def setUpClass(cls):
        if lacking := slurm.missing():
            raise unittest.SkipTest(lacking)
        super().setUpClass()
        cls.cluster = slurm.Slurm()
        cls.addClassCleanup(cls.cluster.close)
        cls.cluster.start()
        cls.environment.update(SLURM_CONF=str(cls.cluster.config),
                               PATH=cls.cluster.environment["PATH"])
        cls.commands = slurm.Wrapped(cls.root / "slurm")
        cls.daemon.configure(
            executor="slurm",
            slurm={"node_dir": str(cls.root / "node"),
                   "slurm_bin_dir": str(cls.commands.folder), "most_jobs": 6, "memory_mib": 1024,
                   **cls.slurm_options},
            scheduler={"retry_delay_s": 0.2, "heartbeat_s": 10})
        cls.roots = {}
        cls.teams = 0
        cls.before_start()
        cls.start_daemon()

    @classmethod
    def before_start(cls):
        """For what a class adds to the configs."""

    # --- policies ---

    def patient(self, pause_ms=40):
        return self.python_policy(f"patient-{pause_ms}", ["patient_policy.py", str(pause_ms)],
                                  HERE / "patient_policy.py")

    def local_root(self, policy):
        """The Merkle root of the same submission on this host, without a daemon."""
        if policy not in self.roots:
            local = self.ask("local", policy, "--track", "short", "--slots", 2)
            self.roots[policy] = local["merkle_root"]
        return self.roots[policy]

    def submit(self, policy):
        # A team's policy has one ranked evaluation.
        type(self).teams += 1
        return self.ask("submit", policy, "--track", "short", "--team",
                        f"team {self.teams}")["submission"]

    # --- waiting ---

    def wait(self, what, condition, seconds=WAIT_S):
        try:
            return wait_until(what, seconds, "it stays", condition, every_s=0.2)
        except AssertionError as error:
            raise AssertionError(f"{error}; {self.daemon.state()}") from None

    def running(self):
        """The id and node of a job that plays."""
        def look():
            plays = self.node_programs(self.cluster.processes_of(None), b"myograde-runner")
            return [(job, node) for job, state, node in self.cluster.jobs()
                    if state == "RUNNING" and plays]
        return self.wait(look, bool)[0]

    def check_done(self, submission, policy, returned=None, attempts=None):
        """It is done, with the same root as a local run, and no fault was counted."""
        status = self.wait(lambda: self.ask("status", submission),
                           lambda found: found["state"] not in ("queued", "running"))
        self.assertEqual(status["state"], "done", (status, self.daemon.state()))
        self.assertEqual([block["faults"] for block in status["blocks"]], [0] * 3)
        if attempts is not None:
            self.assertEqual([block["attempt"] for block in status["blocks"]], [attempts] * 3)
        if returned is not None:
            more = sum(block["attempt"] for block in status["blocks"]) - 3
            self.assertGreaterEqual(more, returned)
        shown = self.ask("show", submission, "--episodes")
        self.assertEqual(shown["merkle_root"], self.local_root(policy))
        self.assertEqual([row["index"] for row in shown["episode_rows"]], list(range(6)))

    def check_empty(self):
        """Nothing of any lease is left: no job, no process, no folder."""
        self.wait(self.cluster.jobs, lambda jobs: not jobs, 60)
        self.wait(lambda: self.node_programs(self.cluster.processes_of(None)),
                  lambda found: not found, 60)
        self.wait(lambda: list((self.data / "work").iterdir()), lambda left: not left, 60)

    @staticmethod
    def node_programs(pids, name=b"myograde-node"):
        found = []
        for pid in pids:
            with contextlib.suppress(OSError):
                if name in pathlib.Path(f"/proc/{pid}/cmdline").read_bytes():
                    found.append(pid)
        return found


class Cluster(OnSlurm):
    """Short: in CI."""

    def test_a_submission_is_played_on_nodes_with_the_same_root(self):
        policy = POLICIES / "random"
        submission = self.submit(policy)
        self.check_done(submission, policy)
        self.assertTrue(self.ask("episode", "replay", submission)["equal"], "its logs came back too")
        self.check_empty()

    def test_a_copy_of_the_data_folder_touches_nothing_until_it_is_adopted(self):
        policy = self.patient()
        submission = self.submit(policy)
        self.running()
        copy = self.root / "copy"
        subprocess.run(["cp", "-a", self.data, copy], check=True)
        for name in ("lock", "myograde.sock"):
            (copy / name).unlink(missing_ok=True)
        environment = {**self.environment, "MYOGRADE_DATA": str(copy)}

        def ask_copy(*words):
            return subprocess.run([BIN / words[0], *words[1:]], env=environment, text=True,
                                  capture_output=True, timeout=60, check=False)

        def start_copy(what):
            log = open(self.root / "copy.log", "ab")
            self.addCleanup(log.close)
            process = subprocess.Popen([BIN / "myograded"], env=environment, stdout=log, stderr=log)
            self.addCleanup(process.kill)
            said = self.wait(lambda: ask_copy("myograde", "status").stdout,
                             lambda text: what in text, 60)
            return process, said

        process, said = start_copy("is a copy of the data folder")
        self.assertIn(str(self.data), said)
        self.check_done(submission, policy, attempts=1)
        self.assertIn("another daemon", ask_copy("myograde", "serve", "--adopt").stderr)
        process.terminate()
        process.wait(60)
        self.assertEqual(ask_copy("myograde", "serve", "--adopt").returncode, 0)
        process, said = start_copy(") is ok")
        self.wait(lambda: json.loads(ask_copy("myograde", "status", str(submission), "--json").stdout),
                  lambda found: found["state"] == "done")
        process.terminate()
        process.wait(60)
        self.assertEqual(self.ask("status", submission)["state"], "done")

    def test_a_cancelled_submission_leaves_nothing(self):
        submission = self.submit(self.patient())
        self.running()
        status = self.ask("cancel", submission, "--reason", "a mistake")
        self.assertEqual(status["state"], "cancelled")
        self.check_empty()


if __name__ == "__main__":
    unittest.main(verbosity=2)
