"""A daemon with boards worth looking at, and readers of each role."""

import json
import os
import pathlib

from support import submission
from support.daemon import Daemon
from support.waiting import wait_until

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
TRACK = "demo-manipulation"
EPISODES = 40
MARKUP = "<img src=x onerror=alert(1)>"
SCRIPT = "<script>alert(2)</script>"
FINAL = ("done", "failed", "cancelled", "grader_error")
# How the stand-in plays each team's policy (fake_runner.py).
MODES = {"Neon Tendons": "skill-36-36-12-40", "Sarcomere Club": "skill-35-35-14-35",
         "Flexors United": "skill-31-31-20-50", MARKUP: "skill-33-33-9-60",
         SCRIPT: "skill-4-4-22-80", "Antagonists": "crash"}


class World(Daemon):
    """The daemon. `tokens` has a token of each role, the participant's for the team "Neon Tendons";
    `submissions` has each team's, and `url` is its address on the network."""

    def __init__(self, clients=256, block=10):
        super().__init__(BIN, SOURCE, "web")
        self.use_stand_in_runner()
        self.change_config(f"tracks/{TRACK}.json", episodes_per_lease=block,
                           seeds={"first": 0, "count": EPISODES},
                           practice_seeds={"first": 1000, "count": EPISODES})
        self.configure(slots=2, http={
            "requests_per_s": 1e6, "burst": 1e6, "clients": clients, "address_clients": clients,
            "peer_clients": min(clients, 128), "organiser_clients": min(clients // 4, 16),
            "listen": {"address": "127.0.0.1", "port": 0}})
        self.tokens = {"public": None}
        self.submissions = {}

    @property
    def url(self):
        return (self.data / "listen").read_text(encoding="utf-8").strip()

    def start(self, teams=len(MODES)):
        """Starts it and has so many of the teams play."""
        health = super().start()
        self.submissions = {team: self.submit(team, mode)
                            for team, mode in list(MODES.items())[:teams]}
        for made in self.submissions.values():
            self.ended(made)
        team = next(iter(MODES))
        if team not in self.submissions:
            self.post("/v1/teams", {"team": team})
        for role, more in (("participant", {"team": team}), ("organiser", {}), ("operator", {})):
            made = self.post("/v1/tokens", {"role": role, "label": "test", **more})
            self.tokens[role] = made["token"]
        return health

    def submit(self, team, mode, name=None, **more):
        """The number of a new submission."""
        manifest = json.dumps({"name": name or f"{mode} of {team}"[:60],
                               "command": ["./policy", mode], "runtimes": []}).encode()
        archive = submission.tar([submission.entry("policy.json", manifest, mode=0o755),
                                  submission.entry("policy", submission.PROGRAM, mode=0o755)])
        artefact = self.post("/v1/artefacts", archive, "application/x-tar")["artefact"]
        return self.post("/v1/submissions", {"artefact": artefact, "team": team, "track": TRACK,
                                             **more})["submission"]

    def ended(self, made):
        return wait_until(lambda: self.get(f"/v1/submissions/{made}"), 60, "it does not end",
                          fits=lambda status: status["state"] in FINAL)
