"""What goes wrong on a cluster, on a real one: a lease counts once, nobody waits for ever, and the
results are the undisturbed ones."""

import contextlib
import os
import signal
import struct
import subprocess
import time
import unittest

import slurm_test
from system import BIN, POLICIES


class Nodes(slurm_test.OnSlurm):
    """Nodes and jobs that end, and come back."""

    def test_a_job_that_is_requeued_or_cancelled_by_hand_is_played_again(self):
        policy = self.patient()
        submission = self.submit(policy)
        job, _ = self.running()
        self.cluster.run("scontrol", "update", f"JobId={job}", "Requeue=1")
        self.cluster.run("scontrol", "requeue", job)
        time.sleep(1)
        job, _ = self.running()
        self.cluster.run("scancel", job)
        self.check_done(submission, policy, returned=1)
        self.check_empty()

    def test_a_node_that_dies_costs_a_replay_elsewhere(self):
        policy = self.patient()
        submission = self.submit(policy)
        _, node = self.running()
        self.cluster.kill_node(node)
        try:
            self.check_done(submission, policy, returned=1)
        finally:
            self.cluster.start_node(node)
        self.check_empty()

    def test_a_zombie_of_a_lost_node_counts_for_nothing_and_ends(self):
        """Slurm takes the node for dead, but what it started goes on."""
        policy = self.patient(150)
        submission = self.submit(policy)
        job, node = self.running()
        zombies = [pid for pid in self.cluster.processes_of(node)]
        self.cluster.kill_daemon(node)
        self.assertTrue(zombies)
        try:
            self.check_done(submission, policy, returned=1)
            self.wait(lambda: [pid for pid in zombies if os.path.exists(f"/proc/{pid}")],
                      lambda left: not left, 60)
        finally:
            self.cluster.start_node(node)
        self.check_empty()

    def test_a_job_at_its_time_limit_is_a_fault_that_names_it(self):
        policy = self.patient(550)
        submission = self.submit(policy)
        job, _ = self.running()
        said = self.cluster.run("scontrol", "update", f"JobId={job}", "TimeLimit=1")
        self.assertEqual(said.returncode, 0, said.stderr)
        status = self.wait(lambda: self.ask("status", submission),
                           lambda found: sum(lease["faults"] for lease in found["leases"]) > 0
                           or found["state"] not in ("queued", "running"))
        self.assertEqual(sum(lease["faults"] for lease in status["leases"]), 1, status)
        self.assertIn("reached its time limit", self.daemon.log())
        self.ask("cancel", submission, "--reason", "it was seen")
        self.check_empty()


class Commands(slurm_test.OnSlurm):
    """Slurm's commands and its controller fail, hang and lose answers."""

    def why_waiting(self):
        return self.ask("status")["daemon"]

    def test_sbatch_fails_and_hangs_for_a_while(self):
        policy = POLICIES / "random"
        for what in ("fail", "hang"):
            with self.subTest(what):
                with self.commands.made_to("sbatch", what):
                    submission = self.submit(policy)
                    self.wait(self.daemon.log, lambda log: "the cluster takes no jobs" in log, 60)
                    self.assertEqual(self.cluster.jobs(), [])
                self.check_done(submission, policy)

    def test_an_answer_of_sbatch_that_is_lost_makes_no_second_job(self):
        policy = self.patient()
        with self.commands.made_to("sbatch", "swallow"):
            submission = self.submit(policy)
            self.wait(self.cluster.jobs, bool, 60)
        self.check_done(submission, policy)
        status = self.ask("status", submission)
        self.assertEqual([lease["attempt"] for lease in status["leases"]], [1] * 3)

    def test_the_controller_is_down_for_a_while(self):
        policy = self.patient()
        first = self.submit(policy)
        self.running()
        self.cluster.stop_controller()
        try:
            self.wait(self.daemon.log, lambda log: "the cluster does not answer" in log, 120)
            second = self.submit(POLICIES / "random")
            time.sleep(10)
        finally:
            self.cluster.start_controller()
        self.check_done(first, policy)
        self.check_done(second, POLICIES / "random")
        self.check_empty()

    def test_a_lost_scancel_keeps_nobody(self):
        submission = self.submit(self.patient(150))
        self.running()
        with self.commands.made_to("scancel", "lost"):
            self.ask("cancel", submission, "--reason", "a mistake")
            # The nodes hear of it through the spool.
            self.check_empty()

    def test_a_daemon_killed_between_submitting_and_writing_plays_each_lease_once(self):
        policy = self.patient()
        with self.commands.made_to("sbatch", "swallow"):
            submission = self.submit(policy)
            self.wait(self.cluster.jobs, bool, 60)
            self.daemon.stop(signal.SIGKILL)
        self.daemon.start()
        self.check_done(submission, policy)
        self.check_empty()

    def test_a_daemon_killed_during_play_plays_the_rest_again(self):
        policy = self.patient()
        submission = self.submit(policy)
        self.running()
        self.daemon.stop(signal.SIGKILL)
        self.daemon.start()
        self.check_done(submission, policy, returned=1)
        self.check_empty()


@unittest.skipIf(os.geteuid() != 0, "only root can make disks")
class Disks(slurm_test.OnSlurm):
    """A shared folder on a disk of its own that fills, hangs and goes away."""

    @classmethod
    def before_start(cls):
        image = cls.root / "disk"
        subprocess.run(["truncate", "-s", "64M", image], check=True)
        subprocess.run(["mkfs.ext4", "-q", image], check=True)
        made = subprocess.run(["mount", "-o", "loop", image, cls.shared], capture_output=True,
                              text=True, check=False)
        if made.returncode != 0:
            raise unittest.SkipTest(f"this host can't mount a disk: {made.stderr.strip()}")
        cls.addClassCleanup(subprocess.run, ["umount", "-l", cls.shared], check=False)

    @staticmethod
    def fill(path):
        """To the last block: what was set aside for a write comes back when it has been made."""
        with open(path, "wb", buffering=0) as file:
            for size in (1 << 20, 4096, 4096, 4096):
                with contextlib.suppress(OSError):
                    while True:
                        file.write(bytes(size))
                with contextlib.suppress(OSError):
                    os.fsync(file.fileno())

    def test_a_full_folder_is_said_and_costs_no_fault(self):
        policy = self.patient()
        first = self.submit(policy)
        self.running()
        filler = self.shared / "filler"
        self.fill(filler)
        try:
            second = self.submit(POLICIES / "random")
            self.wait(self.daemon.log, lambda log: "No space left" in log, 120)
        finally:
            filler.unlink()
        self.check_done(first, policy)
        self.check_done(second, POLICIES / "random")
        self.check_empty()

    def test_a_folder_that_hangs_stops_neither_the_daemon_nor_a_result(self):
        policy = self.patient()
        first = self.submit(policy)
        self.running()
        subprocess.run(["fsfreeze", "-f", self.shared], check=True)
        try:
            self.submit(POLICIES / "random")
            begin = time.monotonic()
            self.ask("status")
            self.assertLess(time.monotonic() - begin, 10, "the daemon answers")
            self.wait(self.daemon.log, lambda log: "does not answer" in log, 90)
        finally:
            subprocess.run(["fsfreeze", "-u", self.shared], check=True)
        self.check_done(first, policy)
        self.check_empty()

    def test_a_spool_that_is_gone_for_a_while_is_taken_up_again(self):
        policy = self.patient()
        submission = self.submit(policy)
        self.running()
        spool = next(self.shared.glob("myograde-*"))
        away = self.shared / "away"
        spool.rename(away)
        time.sleep(5)
        away.rename(spool)
        self.check_done(submission, policy)
        self.check_empty()


class Clocks(slurm_test.OnSlurm):
    """A node whose clock is days off: no time of a node's is compared with the daemon's."""

    @classmethod
    def before_start(cls):
        calendar = cls.root / "calendar"
        calendar.write_bytes(struct.pack("=q", 90000))
        programs = cls.root / "node-bin"
        programs.mkdir()
        wrapper = programs / "myograde-node"
        wrapper.write_text(
            "#!/bin/sh\n"
            f"export LD_PRELOAD={os.environ['MYOGRADE_TEST_SHIFT']}"
            f" MYOGRADE_TEST_CALENDAR={calendar} ASAN_OPTIONS=verify_asan_link_order=0\n"
            f"exec {BIN}/myograde-node \"$@\"\n")
        wrapper.chmod(0o755)
        cls.daemon.configure(slurm={"bin_dir": str(programs)})

    def test_the_result_is_the_same(self):
        policy = POLICIES / "random"
        submission = self.submit(policy)
        self.check_done(submission, policy)
        status = self.ask("status", submission)
        self.assertEqual([lease["attempt"] for lease in status["leases"]], [1] * 3)


if __name__ == "__main__":
    unittest.main(verbosity=2)
