"""Random kills for some minutes, compared with the board of an undisturbed daemon.

Two daemons get the same submissions of several teams: one is left alone; the other one's
daemon, runners and simulators are killed or stopped at random. In the end both must
have the same rows, the same hashes and the same board.

usage: soak.py MINUTES [SEED]   (with the environment of CMakeLists.txt; root or not)
"""

import os
import random
import signal
import sqlite3
import sys
import time

from support.daemon import Daemon
from support import proc
from system import BIN, POLICIES, SOURCE, track_config

TRACK = "soak"
# A bridge lives in the participant's sandbox, so its death is a crash and part of the result.
# disturbed_test.py kills one; here that would rightly change the result.
KINDS = ("myograde-runner", "myograde-sim", "myograded", "stop-runner", "stop-sim")


class Host(Daemon):
    """A separate daemon, with patience for many faults. Not started yet."""

    def __init__(self, slots):
        super().__init__(BIN, SOURCE, "soak")
        self.add_track(TRACK, track_config(
            "locomotion", seeds={"first": 400, "count": 8}, episodes_per_lease=2,
            budgets={"startup_s": 120}))
        # Kills come faster here than faults ever do: the highest number of retries that can be
        # configured.
        self.configure(slots=slots, scheduler={"heartbeat_s": 4, "retry_delay_s": 0.1,
                                               "max_retries": 100, "self_test_every_s": 5})
        self.change_config("sandbox/sim.json", silence_s=10)

    def submit(self, policy, team):
        return self.ask("submit", POLICIES / policy, "--track", TRACK, "--team",
                       team)["submission"]

    def results(self, submissions):
        """Rows, hashes and the board, without what depends on clocks and load."""
        found = {}
        for submission in submissions:
            result = self.ask("show", submission, "--episodes")
            rows = [(row["index"], row["outcome"], row["digest"], row["steps"], row["metrics"])
                    for row in result["episode_rows"]]
            found[submission] = {"rows": rows, "state": result["state"],
                                 "hash": result["hashes"]["results"],
                                 "not_repeatable": result["not_repeatable"]}
        board = self.ask("leaderboard", "--track", TRACK)["rows"]
        found["board"] = [(row["rank"], row["team"], row["submission"], row["aggregate"])
                          for row in board]
        return found

    def wait_all(self, submissions, limit_s):
        deadline = time.monotonic() + limit_s
        open_ = set(submissions)
        while open_:
            for submission in sorted(open_):
                state = self.ask("status", submission)["state"]
                if state not in ("queued", "running"):
                    open_.discard(submission)
            if time.monotonic() > deadline:
                raise AssertionError(f"submissions {sorted(open_)} have not ended")
            time.sleep(0.5)


def submissions_of(host, rounds):
    """The same ones in the same order on every host."""
    made = []
    for number in range(rounds):
        policy = ("zero", "random", "scripted-locomotion")[number % 3]
        # A team's policy has one ranked evaluation, so later rounds belong to other teams.
        made.append(host.submit(policy, f"team {number % 4}.{number // 12}, {policy}"))
    return made


def disturb(host, chance):
    """Makes one random disturbance; returns its name."""
    kind = chance.choice(KINDS)
    if kind == "myograded":
        host.restart(chance.choice((signal.SIGKILL, signal.SIGTERM)))
        return kind
    name = kind.replace("stop-", "myograde-")
    # The kernel keeps 15 characters of a name.
    found = [pid for pid, told in proc.below(host.pid) if told == name[:15]]
    if not found:
        return None
    try:
        os.kill(chance.choice(found),
                signal.SIGSTOP if kind.startswith("stop-") else signal.SIGKILL)
    except ProcessLookupError:
        return None
    return kind


def soak(minutes, seed, rounds=6):
    chance = random.Random(seed)
    blows = {}
    calm, shaken = Host(slots=1), Host(slots=2)
    try:
        calm.start()
        shaken.start()
        expected_ids = submissions_of(calm, rounds)
        calm.wait_all(expected_ids, 1800)
        expected = calm.results(expected_ids)
        calm.stop()
        end = time.monotonic() + minutes * 60
        turns = 0
        while time.monotonic() < end:
            turns += 1
            if turns > 1:  # a separate store for each round
                shaken.close()
                shaken = Host(slots=2)
                shaken.start()
            ids = submissions_of(shaken, rounds)
            states = {}
            while time.monotonic() < end + 600:
                time.sleep(chance.uniform(0.2, 2.5))
                blow = disturb(shaken, chance)
                blows[blow] = blows.get(blow, 0) + 1
                states = {i: shaken.ask("status", i)["state"] for i in ids}
                if not any(state in ("queued", "running") for state in states.values()):
                    break
                if time.monotonic() > end:
                    break  # undisturbed from here on
            shaken.wait_all(ids, 1800)
            found = shaken.results(ids)
            if found != expected:
                for key, value in expected.items():
                    if found[key] != value:
                        print(f"{key}: expected {value}\nfound {found[key]}", file=sys.stderr)
                raise AssertionError("the disturbed results are not the undisturbed ones")
            with sqlite3.connect(shaken.data / "store.db") as store:
                faults, tries = store.execute(
                    "SELECT sum(faults), sum(attempt) FROM block").fetchone()
            store.close()
            print(f"turn {turns}: {len(ids)} submissions equal; {tries} leases started, "
                  f"{faults} taken back; blows so far: {blows}", flush=True)
        return blows
    finally:
        for host in (calm, shaken):
            host.close()


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    seed = int(sys.argv[2]) if len(sys.argv) == 3 else int(time.time())
    print(f"seed {seed}", flush=True)
    soak(float(sys.argv[1]), seed)
    print("the board is the undisturbed one")


if __name__ == "__main__":
    main()
