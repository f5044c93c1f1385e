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


if __name__ == "__main__":
    unittest.main(verbosity=2)
