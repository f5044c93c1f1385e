"""A daemon with stand-in runners, two teams and a caller of each role, and a door to it over plain
HTTP on this host for programs that can't speak to a Unix socket."""

import contextlib
import os
import pathlib
import select
import socket
import socketserver
import threading

from support import submission
from support.daemon import Daemon
from support.waiting import wait_until

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
TRACK = "demo-manipulation"
ROLES = ("participant", "organiser", "operator")
PIECE = 65536  # bytes


class Door(socketserver.ThreadingMixIn, socketserver.TCPServer):
    """Hands each TCP connection on to a Unix socket, byte by byte."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, path):
        self.path = str(path)
        super().__init__(("127.0.0.1", 0), Passage)

    def handle_error(self, request, client_address):
        pass  # a client or the daemon hung up

    @property
    def url(self):
        return f"http://127.0.0.1:{self.server_address[1]}"


class Passage(socketserver.BaseRequestHandler):
    def handle(self):
        with socket.socket(socket.AF_UNIX) as daemon:
            daemon.connect(self.server.path)
            other = {self.request: daemon, daemon: self.request}
            while True:
                for end in select.select(list(other), [], [])[0]:
                    piece = end.recv(PIECE)
                    if not piece:
                        return
                    other[end].sendall(piece)


@contextlib.contextmanager
def door(path):
    """A Door to the socket at `path` that is served until the end of the `with`."""
    server = Door(path)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()


class World(Daemon):
    """The daemon. `tokens` has a token of each role, the participant's for the team alpha;
    `submissions` are of alpha and beta."""

    def __init__(self):
        super().__init__(BIN, SOURCE, "openapi")
        self.use_stand_in_runner()
        # Whoever asks this much is a test.
        self.configure(slots=2, http={"requests_per_s": 1e6, "burst": 1e6})
        for path in (self.configs / "tracks").glob("*.json"):
            if path.stem != TRACK:
                path.unlink()
        self.tokens = {}
        self.submissions = []

    def start(self):
        """Starts it and fills it."""
        health = super().start()
        for team in ("alpha", "beta"):
            self.post("/v1/teams", {"team": team})
            self.submissions.append(self.submit(team))
        for role in ROLES:
            more = {"team": "alpha"} if role == "participant" else {}
            made = self.post("/v1/tokens", {"role": role, "label": "test", **more})
            self.tokens[role] = made["token"]
        return health

    def upload(self, name):
        archive = submission.played_by_stand_in("ok", name)
        return self.post("/v1/artefacts", archive, "application/x-tar")["artefact"]

    def submit(self, team, **more):
        """The number of a submission that has ended."""
        made = self.post("/v1/submissions", {"artefact": self.upload(team), "team": team,
                                             "track": TRACK, **more})["submission"]
        wait_until(lambda: self.get(f"/v1/submissions/{made}"), 60, "it does not end",
                   fits=lambda status: status["state"] == "done")
        return made

    def restart_plain(self):
        """Stops and starts it, with what it has."""
        self.stop()
        return super().start()
