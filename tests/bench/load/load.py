#!/usr/bin/env python3
"""Puts a daemon under load and prints what it took, as JSON.

Starts the real daemon on a temporary data folder and lets CLIENTS processes at once upload
policies that do nothing, submit them for TEAMS teams, and read the leaderboard, over the real
socket; runners are played by fake_runner.py unless --runner real. Every submission is an artefact
of its own, so each is official. Afterwards the store is compared with what the clients were told.

    MYOGRADE_TEST_BIN=build/release/bin tests/bench/load/load.py --submissions 10000 --teams 200

Times are wall-clock milliseconds as a client sees them; on a busy host they say more about the
host. Exit status 1 if the store and the clients disagree."""

import argparse
import json
import multiprocessing
import os
import pathlib
import sqlite3
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))
from support import daemon, proc  # noqa: E402  (needs the folder above)
from support.client import Connection, exchange  # noqa: E402
from support.submission import played_by_stand_in  # noqa: E402

SOURCE = pathlib.Path(os.environ.get("MYOGRADE_TEST_SOURCE", HERE.parents[2]))
TRACK = "demo-manipulation"
ANSWER_S = 120
BOARD_EVERY = 4  # submissions of a client between two looks at the board


def policy(number):
    """One that does nothing, unlike every other by its name."""
    return played_by_stand_in("ok", f"noop-{number}", b"#!/bin/sh\nexec sleep 1000\n")


def client(path, numbers, teams, results):
    """One client on one connection; what it was told goes to `results`."""
    connection = Connection(path, ANSWER_S)
    times = {"upload": [], "submit": [], "leaderboard": []}
    accepted, errors = [], []

    def call(kind, method, address, body=None):
        begin = time.monotonic()
        status, text = exchange(connection, method, address, body)
        times[kind].append((time.monotonic() - begin) * 1000)
        if status not in (200, 201):
            errors.append(text.decode()[:200])
            return None
        return json.loads(text)

    try:
        for place, number in enumerate(numbers):
            team = f"team {number % teams}"
            artefact = call("upload", "POST", "/v1/artefacts", policy(number))
            if artefact is None:
                continue
            body = {"artefact": artefact["artefact"], "team": team, "track": TRACK}
            answer = call("submit", "POST", "/v1/submissions", body)
            if answer is not None:
                accepted.append((answer["submission"], team))
            if place % BOARD_EVERY == 0:
                call("leaderboard", "GET", f"/v1/leaderboard?track={TRACK}")
    except OSError as error:
        errors.append(f"the connection broke: {error}")
    results.put((times, accepted, errors))


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def summary(values):
    if not values:
        return None
    return {"count": len(values), "p50_wall_ms": round(percentile(values, 0.5), 2),
            "p90_wall_ms": round(percentile(values, 0.9), 2),
            "p99_wall_ms": round(percentile(values, 0.99), 2),
            "max_wall_ms": round(max(values), 2)}


class Daemon(daemon.Daemon):
    """The daemon under load, which can be compared with what its clients were told."""

    def __init__(self, options):
        super().__init__(os.environ["MYOGRADE_TEST_BIN"], SOURCE, "load")
        self.configure(slots=options.slots)
        self.command = [self.programs / "myograded"]
        if options.runner == "fake":
            self.use_stand_in_runner()
        self.environment.setdefault("MYOGRADE_CACHE", str(self.root / "cache"))

    def memory_mib(self):
        return round(proc.memory_bytes(self.pid) / 2**20, 1)

    def check(self, accepted):
        """What the store has against what the clients were told, as a list of complaints."""
        wrong = []
        with sqlite3.connect(self.data / "store.db") as db:
            rows = dict(db.execute("SELECT s.id, t.name FROM submission AS s "
                                   "JOIN team AS t ON t.id = s.team_id"))
            if rows != dict(accepted):
                wrong.append(f"{len(rows)} submissions are in the store, the clients were told of "
                             f"{len(accepted)}")
            if len(dict(accepted)) != len(accepted):
                wrong.append("an acceptance number was given twice")
            for query, what in (
                    ("SELECT count(*) FROM submission WHERE id NOT IN "
                     "(SELECT submission FROM evaluation WHERE kind = 'original')",
                     "submissions without an evaluation"),
                    ("SELECT count(*) FROM (SELECT 1 FROM block GROUP BY evaluation "
                     "HAVING count(*) != 3)", "evaluations without their three leases"),
                    ("SELECT count(*) FROM (SELECT 1 FROM episode AS p JOIN evaluation AS e ON "
                     "e.id = p.evaluation LEFT JOIN ledger AS l ON l.submission = e.submission "
                     "AND l.entry = 'charge' GROUP BY e.id HAVING count(DISTINCT l.id) != 1)",
                     "evaluations with episodes that are not charged once"),
                    ("SELECT count(*) FROM ledger WHERE submission NOT IN (SELECT e.submission "
                     "FROM episode AS p JOIN evaluation AS e ON e.id = p.evaluation)",
                     "charges without an episode"),
                    ("SELECT count(*) FROM evaluation AS e WHERE state = 'done' AND NOT EXISTS "
                     "(SELECT 1 FROM standing WHERE evaluation = e.id)",
                     "finished evaluations that boards do not know")):
                count = db.execute(query).fetchone()[0]
                if count:
                    wrong.append(f"{count} {what}")
        return wrong


def run(options):
    with Daemon(options) as loaded:
        loaded.start()
        results = multiprocessing.Queue()
        clients = [multiprocessing.Process(
            target=client, args=(loaded.socket_path, range(i, options.submissions, options.clients),
                                 options.teams, results)) for i in range(options.clients)]
        memory = [loaded.memory_mib()]
        begin = time.monotonic()
        for process in clients:
            process.start()
        told = []
        while len(told) < len(clients):
            try:
                told.append(results.get(timeout=2))
            except multiprocessing.queues.Empty:
                if not any(process.is_alive() for process in clients) and results.empty():
                    break
            memory.append(loaded.memory_mib())
        took = time.monotonic() - begin
        for process in clients:
            process.join(timeout=10)
        times = {kind: [] for kind in ("upload", "submit", "leaderboard")}
        accepted, errors = [], []
        for part, ids, failures in told:
            for kind, values in part.items():
                times[kind] += values
            accepted += ids
            errors += failures
        health = loaded.get("/v1/health")
        loaded.stop()
        wrong = loaded.check(accepted)
        if len(told) != len(clients):
            wrong.append(f"{len(clients) - len(told)} clients died")
        return {"submissions": options.submissions, "teams": options.teams,
                "clients": options.clients, "runner": options.runner,
                "accepted": len(accepted), "took_wall_s": round(took, 1),
                "submissions_per_wall_s": round(len(accepted) / took, 1),
                **{kind: summary(values) for kind, values in times.items()},
                "memory_mib": {"first": memory[0], "middle": memory[len(memory) // 2],
                               "last": memory[-1], "largest": max(memory)},
                "waiting_leases": health["pending_blocks"],
                "errors": len(errors), "first_error": errors[0] if errors else None,
                "wrong": wrong}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--submissions", type=int, default=10000)
    parser.add_argument("--teams", type=int, default=200)
    parser.add_argument("--clients", type=int, default=64)
    parser.add_argument("--slots", type=int, default=2)
    parser.add_argument("--runner", choices=("fake", "real"), default="fake")
    report = run(parser.parse_args())
    print(json.dumps(report, indent=2))
    return 1 if report["wrong"] or report["errors"] else 0


if __name__ == "__main__":
    sys.exit(main())
