"""The daemon under a service manager: sockets that it is handed, and that it tells when it is ready and for as
long as its loop turns."""

import http.client
import os
import signal
import socket
import subprocess
import time
import unittest

from daemon_test import DaemonCase
from support import client

TIMEOUT_S = 60
# Handed over as systemd does: numbered from 3 on, for the process that is started.
START = """{move}
export LISTEN_PID=$$ LISTEN_FDS={count}
exec "$@"
"""


class ServiceManager(DaemonCase):
    def setUp(self):
        super().setUp()
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        self.notified = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.addCleanup(self.notified.close)
        self.notified.bind(str(self.folder / "notify"))
        self.notified.settimeout(TIMEOUT_S)
        self.unix = socket.socket(socket.AF_UNIX)
        self.unix.bind(str(self.folder / "handed"))
        self.tcp = socket.create_server(("127.0.0.1", 0))
        for handed in (self.unix, self.tcp):
            self.addCleanup(handed.close)
            handed.listen(64)

    def launch(self, *handed, **environment):
        """Starts the daemon with these sockets."""
        # Lifted first, so that none is overwritten before it has been moved.
        lifted = [os.dup(x.fileno()) for x in handed]
        move = "\n".join(f"exec {3 + i}<&{20 + i} {20 + i}<&-" for i in range(len(handed)))
        lift = "\n".join(f"exec {20 + i}<&{fd} {fd}<&-" for i, fd in enumerate(lifted))
        script = START.format(move=f"{lift}\n{move}", count=len(handed))
        with open(self.folder / "daemon.log", "ab") as log:
            process = subprocess.Popen(
                ["bash", "-c", script, "bash", *self.daemon.command], pass_fds=lifted, stdout=log, stderr=log,
                stdin=subprocess.DEVNULL,
                env={**self.daemon.environment, "NOTIFY_SOCKET": str(self.folder / "notify"), **environment})
        for fd in lifted:
            os.close(fd)
        self.addCleanup(process.wait, TIMEOUT_S)
        self.addCleanup(process.kill)
        return process

    def heard(self):
        return self.notified.recv(100).decode()

    def test_it_serves_on_what_it_is_handed_and_tells_of_its_life(self):
        self.configure(http={"listen": {"address": "127.0.0.1", "port": 1}})
        process = self.launch(self.unix, self.tcp, WATCHDOG_USEC="400000")
        self.assertEqual(self.heard(), "READY=1")
        self.assertEqual(client.call(self.folder / "handed", "GET", "/v1/live")[0], 200)
        port = self.tcp.getsockname()[1]
        network = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_S)
        self.addCleanup(network.close)
        network.request("GET", "/v1/live")
        self.assertEqual(network.getresponse().status, 200)
        self.assertEqual((self.data / "listen").read_text(), f"http://127.0.0.1:{port}\n")
        # Idle or not, it tells so at least twice in the watchdog's time.
        began = time.monotonic()
        for _ in range(6):
            self.assertEqual(self.heard(), "WATCHDOG=1")
        self.assertLess(time.monotonic() - began, 6 * 0.4)
        process.send_signal(signal.SIGTERM)
        last = self.heard()
        while last == "WATCHDOG=1":
            last = self.heard()
        self.assertEqual(last, "STOPPING=1")
        self.assertEqual(process.wait(TIMEOUT_S), 0)

    def test_without_a_watchdog_it_is_silent(self):
        self.launch(self.unix)
        self.assertEqual(self.heard(), "READY=1")
        self.notified.settimeout(1)
        with self.assertRaises(TimeoutError):
            self.heard()

    def fails_with(self, words, *handed):
        self.assertEqual(self.launch(*handed).wait(TIMEOUT_S), 4)
        said = [line for line in self.daemon.log().splitlines() if "myograded: error:" in line][-1]
        self.assertIn(words, said)

    def test_a_port_without_a_config_is_a_mistake(self):
        self.fails_with('server.json has no "listen"', self.unix, self.tcp)

    def test_a_port_for_everybody_needs_a_certificate(self):
        self.configure(http={"listen": {"address": "127.0.0.1", "port": 0}})
        with socket.create_server(("0.0.0.0", 0)) as everybody:
            self.fails_with("but \"listen\" in server.json is for this host only", self.unix, everybody)

    def test_two_sockets_of_a_kind_are_a_mistake(self):
        self.fails_with("at most one listening stream socket of Unix and one of TCP", self.tcp, self.tcp)


if __name__ == "__main__":
    unittest.main()
