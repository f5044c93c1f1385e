"""What goes wrong on a cluster, on a real one: a lease counts once, nobody waits for ever, and the
results are the undisturbed ones."""

import os
import signal
import struct
import time
import unittest

import slurm_test
from system import BIN, POLICIES


class Nodes(slurm_test.OnSlurm):
    """Nodes and jobs that end, and come back."""

    def test_a_job_that_is_cancelled_by_hand_is_played_again(self):
        policy = self.patient()
        submission = self.submit(policy)
        job, _ = self.running()
        self.cluster.run("scancel", job)
        self.check_done(submission, policy, returned=1)
        self.check_empty()

    def test_a_node_that_dies_costs_a_retry_elsewhere(self):
        policy = self.patient()
        submission = self.submit(policy)
        _, node = self.running()
        self.cluster.kill_node(node)
        try:
            self.check_done(submission, policy, returned=1)
        finally:
            self.cluster.start_node(node)
        self.check_empty()

    def test_what_goes_on_on_a_lost_node_counts_for_nothing_and_ends(self):
        """Slurm takes the node for dead, but what it started goes on."""
        policy = self.patient(150)
        submission = self.submit(policy)
        job, node = self.running()
        left = [pid for pid in self.cluster.processes_of(node)]
        self.cluster.kill_daemon(node)
        self.assertTrue(left)
        try:
            self.check_done(submission, policy, returned=1)
            self.wait(lambda: [pid for pid in left if os.path.exists(f"/proc/{pid}")],
                      lambda found: not found, 60)
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
                           lambda found: sum(block["faults"] for block in found["blocks"]) > 0
                           or found["state"] not in ("queued", "running"))
        self.assertEqual(sum(block["faults"] for block in status["blocks"]), 1, status)
        self.assertIn("reached its time limit", self.daemon.log())
        self.ask("cancel", submission, "--reason", "it was seen")
        self.check_empty()


class Commands(slurm_test.OnSlurm):
    """Slurm's commands and its controller fail, hang and lose answers; the daemon is killed."""

    def test_srun_fails_and_hangs_for_a_while(self):
        policy = POLICIES / "random"
        for what in ("fail", "hang"):
            with self.subTest(what):
                with self.commands.made_to("srun", what):
                    submission = self.submit(policy)
                    if what == "fail":
                        self.wait(self.daemon.log, lambda log: "the cluster takes no jobs" in log, 60)
                    else:
                        time.sleep(5)
                    self.assertEqual(self.cluster.jobs(), [])
                self.check_done(submission, policy)

    def test_the_controller_is_down_for_a_while(self):
        policy = self.patient()
        first = self.submit(policy)
        self.running()
        self.cluster.stop_controller()
        try:
            second = self.submit(POLICIES / "random")
            self.wait(self.daemon.log, lambda log: "Unable to contact slurm controller" in log, 120)
        finally:
            self.cluster.start_controller()
        self.check_done(first, policy)
        self.check_done(second, POLICIES / "random")
        self.check_empty()

    def test_squeue_and_scancel_that_fail_keep_nobody(self):
        submission = self.submit(self.patient(150))
        self.running()
        with self.commands.made_to("scancel", "fail"), self.commands.made_to("squeue", "fail"):
            self.ask("cancel", submission, "--reason", "a mistake")
            self.wait(lambda: self.node_programs(self.cluster.processes_of(None)),
                      lambda found: not found, 60)
        self.check_empty()

    def test_a_lease_whose_process_is_killed_is_played_again_and_leaves_no_job(self):
        policy = self.patient()
        submission = self.submit(policy)
        self.running()
        process = next(block["process"] for block in self.ask("status", submission)["blocks"]
                       if block["process"])
        os.kill(process, signal.SIGKILL)
        status = self.wait(lambda: self.ask("status", submission),
                           lambda found: found["state"] == "done")
        self.assertEqual(sum(block["faults"] for block in status["blocks"]), 1)
        self.check_empty()

    def test_a_daemon_killed_while_jobs_wait_plays_each_lease_once(self):
        policy = self.patient()
        submissions = [self.submit(policy) for _ in range(2)]
        self.wait(lambda: [job for job in self.cluster.jobs() if job[1] == "PENDING"], bool, 60)
        self.daemon.stop(signal.SIGKILL)
        self.daemon.start()
        for submission in submissions:
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
        self.assertEqual([block["attempt"] for block in status["blocks"]], [1] * 3)


if __name__ == "__main__":
    unittest.main(verbosity=2)
