"""Submissions of fixed bytes on a cluster whose nodes and daemon are killed again and again: the
Merkle roots that every other place gives."""

import json
import signal
import threading
import time
import unittest

import slurm_test
from proof_test import GOLDEN, TRACKS, short_config

PLAY_S = 1200
PAUSE_S = 4


class Killed(slurm_test.OnSlurm):
    references = TRACKS
    tracks = {f"golden-{track}": short_config(track, episodes_per_lease=2) for track in TRACKS}
    slurm_options = {"queue_wait_s": 600}

    def golden(self, track):
        return self.python_policy(f"golden-{track}", ["player.py"], GOLDEN / "player.py",
                                  GOLDEN / track / "actions.gz")

    def kill_nodes(self, stop, killed):
        """One node after the other, each up again after a few seconds."""
        turn = 0
        while not stop.wait(PAUSE_S):
            node = self.cluster.nodes[turn % len(self.cluster.nodes)]
            turn += 1
            self.cluster.kill_node(node)
            killed.append(node)
            time.sleep(PAUSE_S)
            self.cluster.start_node(node)
            # Slurm has to see it before the next one goes.
            if stop.wait(5 * PAUSE_S):
                return

    def test_the_roots_are_those_of_every_other_place(self):
        recorded = json.loads((GOLDEN / "merkle_roots.json").read_text())
        submissions = {track: self.ask("submit", self.golden(track), "--track", f"golden-{track}",
                                       "--team", "golden")["submission"] for track in TRACKS}
        stop, killed = threading.Event(), []
        killer = threading.Thread(target=self.kill_nodes, args=(stop, killed))
        killer.start()
        daemons = 0
        try:
            deadline = time.monotonic() + PLAY_S
            while time.monotonic() < deadline:
                states = [self.ask("status", id)["state"] for id in submissions.values()]
                if all(state not in ("queued", "running") for state in states):
                    break
                if daemons < 3 and len(killed) > 2 * daemons:
                    self.daemon.stop(signal.SIGKILL)
                    self.daemon.start()
                    daemons += 1
                time.sleep(1)
        finally:
            stop.set()
            killer.join()
        self.assertGreater(daemons, 0)
        self.assertGreater(len(killed), 0)
        for track, submission in submissions.items():
            self.assertEqual(self.ask("show", submission)["merkle_root"], recorded[track], track)
        self.check_empty()


if __name__ == "__main__":
    unittest.main(verbosity=2)
