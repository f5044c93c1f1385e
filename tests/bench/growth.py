"""What an episode costs the daemon as evaluations, teams and queues grow.

Leases are played by the tests' stand-in for the runner, which needs no time for physics, so what is
measured is the daemon: the processor time of its process, all of its threads, from before a
submission is accepted until its evaluation has ended, divided by the episodes played."""

import json
import pathlib
import sqlite3
import statistics
import subprocess
import time

from grader import Grader
from processes import cpu_seconds
from support import client, proc
from support.submission import played_by_stand_in

EPISODES_PER_LEASE = 10
TEAM_EPISODES = 10  # of each submission when teams are counted
DEADLINE_S = 600
# Nothing that is measured here may be refused.
QUOTA = {name: 1_000_000 for name in (
    "official_per_day", "official_total", "practice_per_day", "practice_total", "failed_per_day",
    "failed_total", "waiting")}


def spread(values):
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


class Stage(Grader):
    """A grader whose runner is the stand-in."""

    def __init__(self, build, source):
        super().__init__(pathlib.Path(build) / "bin", source)
        self.use_stand_in_runner()
        self.made = 0  # artefacts

    def track(self, episodes):
        name = f"growth-{episodes}"
        self.add_track(name, {
            "extends": "manipulation", "episodes_per_lease": min(EPISODES_PER_LEASE, episodes),
            "seeds": {"first": 0, "count": episodes}})
        return name

    def with_slots(self, slots):
        """Runs the daemon on an empty store."""
        self.choose_data(f"data-{time.monotonic_ns()}")
        return self.running_with(slots=slots, quota=QUOTA)

    @staticmethod
    def send(connection, path, body):
        status, text = client.exchange(connection, "POST", path, body)
        if status not in (200, 201):
            raise RuntimeError(f"POST {path}: {status} {text.decode()[:300]}")
        return json.loads(text)

    def upload(self, connection):
        """A policy like no other, so that its evaluation is official."""
        self.made += 1
        policy = played_by_stand_in("ok", f"noop-{self.made}")
        return self.send(connection, "/v1/artefacts", policy)["artefact"]

    def submit(self, connection, artefact, track, team):
        return self.send(connection, "/v1/submissions",
                         {"artefact": artefact, "team": team, "track": track})

    def wait(self):
        """Until nothing waits or runs. Looks into the store, which costs the daemon nothing."""
        deadline = time.monotonic() + DEADLINE_S
        database = sqlite3.connect(self.data / "store.db", timeout=30)
        try:
            database.execute("PRAGMA query_only = ON")
            query = "SELECT count(*) FROM evaluation WHERE finished_at IS NULL"
            while database.execute(query).fetchone()[0] != 0:
                if time.monotonic() > deadline:
                    raise RuntimeError("growth: the leases were not played within "
                                       f"{DEADLINE_S} s\n" + self.state())
                time.sleep(0.02)
            states = database.execute("SELECT state, count(*) FROM evaluation GROUP BY state")
            if any(state != "done" for state, _ in states):
                raise RuntimeError("growth: an evaluation was not done\n" + self.state())
            return [row[0] * row[1] for row in database.execute(
                "SELECT p.page_count, s.page_size FROM pragma_page_count AS p, "
                "pragma_page_size AS s")][0]
        finally:
            database.close()

    def cost(self, track, teams, submissions):
        """Processor seconds of the daemon for so many submissions by so many teams."""
        connection = client.Connection(self.socket_path)
        try:
            artefacts = [self.upload(connection) for _ in range(submissions)]
            before = cpu_seconds(self.pid)
            for place, artefact in enumerate(artefacts):
                self.submit(connection, artefact, track, f"Team {place % teams + 1}")
        finally:
            connection.close()
        store_bytes = self.wait()
        # What follows an evaluation's end on other threads belongs to it.
        time.sleep(0.05)
        return cpu_seconds(self.pid) - before, store_bytes


def by_episodes(stage, counts, slots, repetitions):
    rows = []
    least = stage.track(counts[0])
    for episodes in counts:
        track = stage.track(episodes)
        costs = []
        with stage.with_slots(slots):
            _, start_bytes = stage.cost(least, 1, 1)  # warm-up
            for _ in range(repetitions if episodes < 1000 else min(2, repetitions)):
                seconds, store_bytes = stage.cost(track, 1, 1)
                costs.append(seconds / episodes)
            row = {"episodes": episodes, "daemon_cpu_s_per_episode": spread(costs),
                   "daemon_bytes": proc.memory_bytes(stage.pid)}
        if rows:
            # Without what an evaluation costs by itself, however short it is.
            first = rows[0]["daemon_cpu_s_per_episode"]["median"] * counts[0]
            row["daemon_cpu_s_per_further_episode"] = spread(
                [(cost * episodes - first) / (episodes - counts[0]) for cost in costs])
        if episodes >= 100:  # fewer fit into pages that were there
            row["store_bytes_per_episode"] = (store_bytes - start_bytes) / (len(costs) * episodes)
        rows.append(row)
    return rows


def by_teams(stage, counts, slots, repetitions, submissions):
    rows = []
    track = stage.track(TEAM_EPISODES)
    for teams in counts:
        costs = []
        for _ in range(repetitions):
            with stage.with_slots(slots):
                seconds, _ = stage.cost(track, teams, submissions)
                costs.append(seconds / (submissions * TEAM_EPISODES))
                memory = proc.memory_bytes(stage.pid)
        rows.append({"teams": teams, "daemon_cpu_s_per_episode": spread(costs),
                     "daemon_bytes": memory})
    return rows


def measure(build, source, slots, quick, say):
    """The `growth` of the bench's JSON."""
    build = pathlib.Path(build)
    say("growth: the scheduler's decisions")
    done = subprocess.run([str(build / "tests/myograde_scheduler_bench"),
                           *(["--quick"] if quick else [])],
                          capture_output=True, text=True, timeout=600)
    if done.returncode != 0:
        raise RuntimeError(f"scheduler_bench: exit {done.returncode}: {done.stderr}")
    repetitions = 2 if quick else 5
    with Stage(build, source) as stage:
        counts = (1, 10, 100) if quick else (1, 10, 100, 1000, 10_000)
        say("growth: the daemon's time for evaluations of " + ", ".join(map(str, counts))
            + " episodes")
        episodes = by_episodes(stage, counts, slots, repetitions)
        teams = (1, 20) if quick else (1, 10, 50, 200)
        say("growth: the daemon's time for " + ", ".join(map(str, teams)) + " teams")
        return {"scheduler": json.loads(done.stdout), "by_episodes": episodes,
                "by_teams": by_teams(stage, teams, slots, 1 if quick else 2, max(teams))}
