"""The verb cluster, and what status shows of leases on a cluster.
usage: cluster_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import CliCase, Handler, STATUS, myograde  # pylint: disable=wrong-import-position

NODE = {"node": "n1", "state": "proved", "reason": None, "drained_at": None, "drained_by": None,
        "processor": "AMD \x1b[2JEPYC", "running": 2, "done": 31, "faults": 1}
DRAINED = {**NODE, "node": "n2", "state": "drained", "reason": "a fan is broken",
           "drained_at": "2026-01-01T00:00:00.000Z", "drained_by": "uid 0"}
NODES = {"cluster": True, "message": None, "nodes": [NODE, DRAINED], "unreadable": []}
BLOCK = {"block": 41, "first": 0, "last": 9, "state": "running", "slot": 3, "attempt": 2, "faults": 0,
         "episode": 4, "step": 7, "host": "n1", "process": 0, "running_wall_s": 21.4,
         "silent_wall_s": 0.2, "job": "77_1", "begun": True,
         "attempts": [{"attempt": 1, "node": "n9", "job": "76_1",
                       "began_at": "2026-01-01T00:00:00.000Z",
                       "ended_at": "2026-01-01T00:01:00.000Z", "cpu_s": 61.2, "energy_j": 1234.4,
                       "how": "returned"}]}
WAITING = {**BLOCK, "block": 42, "host": None, "job": "77_2", "begun": False, "attempts": [],
           "running_wall_s": 3.0}
HEALTH = {"status": "ok", "version": "1", "api": 1, "slots": 64, "running": 2, "pending_blocks": 5,
          "pid": 1, "message": None, "unreadable": [],
          "leases": [{**BLOCK, "lease": 41, "evaluation": 9, "submission": 7, "node": "n1", "cpu_s": 20.5},
                     {**WAITING, "lease": 42, "evaluation": 9, "submission": 7, "node": None, "cpu_s": 0}]}


class ClusterTest(CliCase):
    def heard(self):
        return [(command, path, json.loads(body or b"null"))
                for command, path, body in Handler.heard]

    def test_every_part_has_help_with_an_example(self):
        for part in ("nodes", "drain", "admit"):
            done = myograde("cluster", part, "--help")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn(f"Example:\n  myograde cluster {part}", done.stdout)
            self.assertIn("--json", done.stdout)

    def test_wrong_use(self):
        self.refused(2, "no verb given", "cluster")
        self.refused(2, 'did you mean "cluster drain"?', "cluster", "drian", "n1")
        self.refused(2, "--reason", "cluster", "drain", "n1")
        self.refused(2, "", "cluster", "admit")
        for bad in ("", "../n1", "-n", "n 1", "n/1", "a" * 256):
            self.refused(2, "not a node's name", "cluster", "admit", "--", bad)

    def test_what_is_asked_and_answered(self):
        socket = self.serve({
            "GET /v1/nodes": (200, NODES),
            "POST /v1/nodes/n2.site_a-1": (200, {"node": "n2.site_a-1", "state": "drained"}),
            "POST /v1/nodes/n1": (200, {"node": "n1", "state": "admitted"})})
        at = ("--socket", socket)
        self.checked("cluster-nodes", "cluster", "nodes", *at)
        self.checked("cluster-node", "cluster", "drain", "n2.site_a-1", "--reason", "hot", *at)
        self.checked("cluster-node", "cluster", "admit", "n1", *at)
        self.assertEqual(self.heard(), [
            ("GET", "/v1/nodes", None),
            ("POST", "/v1/nodes/n2.site_a-1", {"state": "drained", "reason": "hot"}),
            ("POST", "/v1/nodes/n1", {"state": "admitted"})])

    def test_text_for_people(self):
        socket = self.serve({
            "GET /v1/nodes": (200, [{**NODES, "message": "sbatch does not answer"},
                                    {**NODES, "nodes": []}, {**NODES, "cluster": False}]),
            "POST /v1/nodes/n1": (200, {"node": "n1", "state": "drained"})})
        at = ("--socket", socket)
        listed = myograde("cluster", "nodes", *at).stdout
        self.assertNotIn("\x1b", listed)
        self.assertIn("sbatch does not answer", listed)
        self.assertRegex(listed, r"(?m)^n1 +proved +2 +31 +1 ")
        self.assertRegex(listed, r"(?m)^n2 +drained .*a fan is broken +uid 0$")
        self.assertIn("No node has had a lease", myograde("cluster", "nodes", *at).stdout)
        self.assertIn("run on the daemon's host", myograde("cluster", "nodes", *at).stdout)
        drained = myograde("cluster", "drain", "n1", "--reason", "hot", *at).stdout
        self.assertIn("Node n1 gets no more leases", drained)

    def test_a_daemon_without_a_cluster(self):
        socket = self.serve({"POST /v1/nodes/n1": (409, {"error": {
            "code": "no_cluster", "message": "leases run on this host, so there are no nodes"}})})
        self.refused(2, "leases run on this host", "cluster", "admit", "n1", "--socket", socket)

    def test_status_shows_node_and_job(self):
        socket = self.serve({
            "GET /v1/health": (200, HEALTH),
            "GET /v1/submissions": (200, {"submissions": [], "unreadable": []}),
            "GET /v1/submissions/7": (200, {**STATUS, "state": "running",
                                            "blocks": [BLOCK, WAITING]})})
        at = ("--socket", socket)
        self.checked("status", "status", *at)
        self.checked("status", "status", "7", *at)
        host = myograde("status", *at).stdout
        self.assertIn("Jobs: 1 running, 1 waiting for a node", host)
        self.assertRegex(host, r"(?m)^n1 +77_1 +7 +41 ")
        self.assertRegex(host, r"(?m)^waits +77_2 +7 +42 ")
        one = myograde("status", "7", *at).stdout
        self.assertRegex(one, r"(?m)^ *41 +0\.\.9 +running +n1 +77_1 ")
        self.assertRegex(one, r"(?m)^ *42 +0\.\.9 +waits for a node +- +77_2 ")
        self.assertRegex(one, r"(?m)^ *41 +1 +n9 +76_1 .* 1234 J +returned$")

    def test_status_of_a_host_is_as_it_was(self):
        block = {**BLOCK, "job": None, "attempts": [
            {"attempt": 1, "node": None, "job": None, "began_at": "2026-01-01T00:00:00.000Z",
             "ended_at": "2026-01-01T00:01:00.000Z", "cpu_s": 61.2, "energy_j": None, "how": "done"}]}
        socket = self.serve({"GET /v1/submissions/7": (200, {**STATUS, "blocks": [block]})})
        shown = myograde("status", "7", "--socket", socket).stdout
        self.assertRegex(shown, r"(?m)^block +episodes +state +host +slot ")
        self.assertNotIn("Attempts", shown)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
