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
import http.client
import io
import json
import multiprocessing
import os
import pathlib
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tarfile
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = pathlib.Path(os.environ.get("MYOGRADE_TEST_SOURCE", HERE.parents[2]))
TRACK = "demo-manipulation"
BOARD_EVERY = 4  # submissions of a client between two looks at the board


class Connection(http.client.HTTPConnection):
    def __init__(self, path):
        super().__init__("myograde", timeout=120)
        self.path = path

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(120)
        self.sock.connect(self.path)


def archive(number):
    """A policy that does nothing, unlike every other by its name."""
    files = {"policy.json": json.dumps({"name": f"noop-{number}", "command": ["./policy", "ok"],
                                        "runtimes": []}).encode(),
             "policy": b"#!/bin/sh\nexec sleep 1000\n"}
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as tar:
        for path, content in files.items():
            info = tarfile.TarInfo(path)
            info.size = len(content)
            info.mode = 0o755
            tar.addfile(info, io.BytesIO(content))
    return out.getvalue()


def client(path, numbers, teams, results):
    """One client on one connection; what it was told goes to `results`."""
    connection = Connection(path)
    times = {"upload": [], "submit": [], "leaderboard": []}
    accepted, errors = [], []

    def call(kind, method, address, body=None):
        begin = time.monotonic()
        connection.request(method, address, body)
        answer = connection.getresponse()
        text = answer.read()
        times[kind].append((time.monotonic() - begin) * 1000)
        if answer.status not in (200, 201):
            errors.append(text.decode()[:200])
            return None
        return json.loads(text)

    try:
        for place, number in enumerate(numbers):
            team = f"team {number % teams}"
            artefact = call("upload", "POST", "/v1/artefacts", archive(number))
            if artefact is None:
                continue
            body = json.dumps({"artefact": artefact["artefact"], "team": team, "track": TRACK})
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


class Daemon:
    def __init__(self, options):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="myograde-load-"))
        self.data = self.folder / "data"
        self.socket = str(self.data / "myograde.sock")
        configs = self.folder / "configs"
        shutil.copytree(SOURCE / "configs", configs)
        server = json.loads((configs / "server.json").read_text())
        server["slots"] = options.slots
        server["uid_base"] = 100000 + os.getpid() % 100000 * 2048
        (configs / "server.json").write_text(json.dumps(server))
        environment = dict(os.environ)
        if options.runner == "fake":
            runner = self.folder / "bin" / "myograde-runner"
            runner.parent.mkdir()
            shutil.copy(SOURCE / "tests/server/daemon/fake_runner.py", runner)
            runner.chmod(0o755)
            environment["MYOGRADE_BIN_DIR"] = str(runner.parent)
        cache = os.environ.get("MYOGRADE_CACHE", str(self.folder / "cache"))
        with open(self.folder / "log", "wb") as log:
            self.process = subprocess.Popen(
                [pathlib.Path(os.environ["MYOGRADE_TEST_BIN"]) / "myograded", "--data", self.data,
                 "--configs", configs, "--cache", cache], stderr=log, env=environment)
        for _ in range(600):
            try:
                self.get("/v1/health")
                return
            except OSError:
                if self.process.poll() is not None:
                    sys.exit((self.folder / "log").read_text())
                time.sleep(0.05)
        sys.exit("the daemon does not answer")

    def get(self, path):
        connection = Connection(self.socket)
        try:
            connection.request("GET", path)
            return json.loads(connection.getresponse().read())
        finally:
            connection.close()

    def memory_mib(self):
        for line in pathlib.Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return round(int(line.split()[1]) / 1024, 1)
        return None

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(timeout=60)

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
                    ("SELECT count(*) FROM (SELECT 1 FROM lease GROUP BY evaluation "
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
    daemon = Daemon(options)
    try:
        results = multiprocessing.Queue()
        clients = [multiprocessing.Process(
            target=client, args=(daemon.socket, range(i, options.submissions, options.clients),
                                 options.teams, results)) for i in range(options.clients)]
        memory = [daemon.memory_mib()]
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
            memory.append(daemon.memory_mib())
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
        health = daemon.get("/v1/health")
        daemon.stop()
        wrong = daemon.check(accepted)
        if len(told) != len(clients):
            wrong.append(f"{len(clients) - len(told)} clients died")
        return {"submissions": options.submissions, "teams": options.teams,
                "clients": options.clients, "runner": options.runner,
                "accepted": len(accepted), "took_wall_s": round(took, 1),
                "submissions_per_wall_s": round(len(accepted) / took, 1),
                **{kind: summary(values) for kind, values in times.items()},
                "memory_mib": {"first": memory[0], "middle": memory[len(memory) // 2],
                               "last": memory[-1], "largest": max(memory)},
                "waiting_leases": health["pending_leases"],
                "errors": len(errors), "first_error": errors[0] if errors else None,
                "wrong": wrong}
    finally:
        if daemon.process.poll() is None:
            daemon.process.kill()
            daemon.process.wait()
        shutil.rmtree(daemon.folder, ignore_errors=True)


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
