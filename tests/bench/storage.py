"""Time of the daemon's start, of submit and of leaderboard in stores of many episode rows.

A store is filled by copying the rows of one real evaluation in SQL, under new teams and numbers:
what is measured is the daemon that opens it afterwards."""

import os
import sqlite3
import statistics
import time

from support.store_copies import copy_submission

EPISODES = 100
TEAMS = 200
REPETITIONS = 15


def fill(path, rows):
    """Copies evaluation 1 until the store has so many episode rows."""
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA synchronous = OFF")
        have = database.execute("SELECT max(id) FROM submission").fetchone()[0]
        for number in range(have + 1, rows // EPISODES + 1):
            copy_submission(database, 1, number, (number - 1) % TEAMS + 1)
    database.close()


def timed(grader, repetitions, *words):
    """The first time by itself (the board is made then), and the median of the others."""
    seconds = []
    for repetition in range(repetitions + 1):
        arguments = [str(word).replace("NUMBER", str(repetition)) for word in words]
        start = time.monotonic()
        grader.ask(*arguments)
        seconds.append(time.monotonic() - start)
    return {"first": seconds[0], "median": statistics.median(seconds[1:]),
            "min": min(seconds[1:]), "max": max(seconds[1:])}


def measure(grader, policy, counts):
    """`counts`: numbers of episode rows, rising. The time of the program's own start, which is in
    every figure, is told beside them."""
    grader.add_track("tiny", {
        "extends": "bench-manipulation", "seeds": {"first": 0, "count": EPISODES},
        "episodes_per_lease": EPISODES, "profiles": {"paper": {"rules": {"max_steps": 1}}}})
    grader.choose_data("store")
    with grader.running_with(slots=1):
        grader.ask("submit", policy, "--track", "tiny", "--team", "Team 1", "--wait")
    sizes = []
    for count in counts:
        path = grader.data / "store.db"
        fill(path, count)
        os.sync()  # or the kernel would write what was filled in while commands are timed
        begin = time.monotonic()
        with grader.running_with(slots=1):
            started = time.monotonic() - begin
            board = timed(grader, REPETITIONS, "leaderboard", "--track", "tiny")
            submit = timed(grader, REPETITIONS, "submit", policy, "--track", "tiny", "--team",
                           "Newcomer NUMBER", "--episodes", "1")
        sizes.append({"episode_rows": count, "start_s": started, "leaderboard_s": board,
                      "submit_s": submit, "acts": 2 * count // EPISODES,
                      "bytes_per_row": path.stat().st_size / count})
    starts = []
    for _ in range(REPETITIONS):
        start = time.monotonic()
        grader.cli("--version")
        starts.append(time.monotonic() - start)
    return {"program_start_s": statistics.median(starts), "sizes": sizes}
