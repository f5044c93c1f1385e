"""A daemon with stand-in runners, two teams and a caller of each role, that listens to plain HTTP on
this host as well."""

import os
import pathlib

from support import submission
from support.daemon import Daemon
from support.waiting import wait_until

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
TRACK = "demo-manipulation"
ROLES = ("participant", "organiser", "operator")


class World(Daemon):
    """The daemon. `tokens` has a token of each role, the participant's for the team alpha;
    `submissions` are of alpha and beta, and `url` is its address on the network."""

    def __init__(self):
        super().__init__(BIN, SOURCE, "openapi")
        self.use_stand_in_runner()
        # Whoever asks this much is a test.
        self.configure(slots=2, http={
            "requests_per_s": 1e6, "burst": 1e6,
            "listen": {"address": "127.0.0.1", "port": 0}})
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

    @property
    def url(self):
        return (self.data / "listen").read_text(encoding="utf-8").strip()

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
