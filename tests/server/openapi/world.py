"""A daemon with stand-in runners, two teams and a caller of each role, that listens to plain HTTP on
this host as well."""

import datetime
import json
import os
import pathlib

from support import submission
from support.daemon import Daemon
from support.waiting import wait_until

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
TRACK, PROFILE = "demo-manipulation", "paper"
ROLES = ("participant", "organiser", "operator")


def moment(days):
    """UTC, so many days from now."""
    at = datetime.datetime.now(datetime.timezone.utc) + datetime.timedelta(days)
    return at.strftime("%Y-%m-%dT%H:%M:%SZ")


OPENED = moment(-1)
# A phase that is open and withholds what it can, and one that is over; both have hidden seeds.
CHALLENGE = {"form": 1, "title": "A cup", "phases": [
    {"name": "final", "title": "Final", "track": TRACK, "profile": PROFILE,
     "seeds": {"committed": 6}, "opens_at": OPENED, "freeze_at": OPENED, "closes_at": moment(9),
     "entry": "chosen",
     "show": {"aggregate": False, "outcomes": False, "metrics": False, "logs": False,
              "output": False}},
    {"name": "past", "title": "Past", "track": TRACK, "profile": PROFILE,
     "seeds": {"committed": 6}, "opens_at": moment(-9), "closes_at": moment(-2)}]}


class World(Daemon):
    """The daemon. `tokens` has a token of each role, the participant's for the team alpha;
    `submissions` are of alpha and beta, and `url` is its address on the network."""

    def __init__(self, challenge=None):
        super().__init__(BIN, SOURCE, "openapi")
        if challenge is not None:
            (self.configs / "challenges/cup.json").write_text(json.dumps(challenge))
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
