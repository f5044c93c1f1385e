"""Leases on nodes that share no folder with the daemon: all that they need, and all that they record,
travels by HTTPS, with a token for one lease."""

import json
import socket
import ssl
import unittest
import urllib.error
import urllib.request

import slurm_test
from support.certificates import make_certificate
from system import POLICIES


class Https(slurm_test.OnSlurm):
    @classmethod
    def before_start(cls):
        cls.certificate, key = make_certificate(cls.root)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        cls.url = f"https://127.0.0.1:{port}"
        cls.daemon.configure(
            http={"listen": {"address": "127.0.0.1", "port": port,
                             "certificate": str(cls.certificate), "key": str(key)}},
            slurm={"shared_dir": "", "url": cls.url, "ca_file": str(cls.certificate)})

    def check_empty(self):
        self.wait(self.cluster.jobs, lambda jobs: not jobs, 60)
        self.wait(lambda: list((self.data / "cluster/leases").glob("*")), lambda left: not left, 60)

    def answer_of(self, address, token):
        request = urllib.request.Request(self.url + address)
        if token:
            request.add_header("Authorization", f"Bearer {token}")
        context = ssl.create_default_context(cafile=self.certificate)
        try:
            with urllib.request.urlopen(request, context=context, timeout=20) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read()

    def running_name(self):
        def look():
            return [path.parent.name for path in (self.data / "cluster/leases").glob("*/records")]
        return self.wait(look, bool)[0]

    def test_a_submission_is_played_with_the_same_root_and_its_logs_come_back(self):
        policy = POLICIES / "random"
        submission = self.submit(policy)
        self.check_done(submission, policy)
        self.assertTrue(self.ask("replay", submission)["equal"])
        self.check_empty()

    def test_a_lease_is_nobody_elses(self):
        submission = self.submit(self.patient(150))
        name = self.running_name()
        for token in ("", "0" * 64):
            status, body = self.answer_of(f"/v1/leases/{name}/order", token)
            self.assertIn(status, (401, 404), body)
            self.assertNotIn(b"seed", body)
            self.assertIn("error", json.loads(body))
        self.ask("cancel", submission, "--reason", "it was seen")
        self.check_empty()


class Untrusted(Https):
    """Nodes that do not trust the certificate at the daemon's address."""

    @classmethod
    def before_start(cls):
        super().before_start()
        other = cls.root / "other"
        other.mkdir()
        cls.wrong, _ = make_certificate(other)
        # The doctor needs more of Slurm's commands than the daemon.
        cls.daemon.configure(slurm={"ca_file": str(cls.wrong), "slurm_bin_dir": ""})

    def say(self, *words):
        return self.daemon.run_verb(*words, text=True).stdout

    test_a_submission_is_played_with_the_same_root_and_its_logs_come_back = None
    test_a_lease_is_nobody_elses = None

    def test_the_reason_is_named_wherever_people_look(self):
        self.assertNotIn(" error ", self.daemon.log(), "a start is no error")
        done = self.daemon.run_verb("doctor", "--cluster", "--json", text=True)
        self.assertEqual(done.returncode, 4, done.stderr)
        check = next(c for c in json.loads(done.stdout)["checks"] if c["name"] == "cluster_address")
        self.assertEqual(check["state"], "missing")
        self.assertIn("certificate", check["found"])
        submission = self.submit(POLICIES / "random")
        why = "does not trust the TLS certificate"
        self.wait(lambda: self.say("status", submission), lambda text: why in text)
        # Three bad ends of each of three nodes.
        self.wait(lambda: self.ask("status"), lambda found: found["daemon"]["status"] == "paused")
        nodes = self.say("cluster", "nodes")
        self.assertIn(why, nodes)
        self.assertIn("all nodes of the cluster are drained", nodes)
        self.assertIn("all nodes of the cluster are drained", self.say("status"))
        self.daemon.configure(slurm={"ca_file": str(self.certificate)})
        self.daemon.stop()
        self.start_daemon()
        for node in ("n1", "n2", "n3"):
            self.ask("cluster", "admit", node)
        self.check_done(submission, POLICIES / "random")


if __name__ == "__main__":
    unittest.main(verbosity=2)
