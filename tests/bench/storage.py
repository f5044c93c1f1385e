"""Time of submit and leaderboard in stores of many episode rows.

A store is filled by copying the rows of one real evaluation in SQL, under new teams and numbers:
what is measured is the daemon that opens it afterwards."""

import os
import sqlite3
import statistics
import time

EPISODES = 100
TEAMS = 200
REPETITIONS = 15


def columns(database, table):
    return [row[1] for row in database.execute(f"PRAGMA table_info({table})")]


def copy_rows(database, table, where, changes):
    """Inserts the rows of `where` again, columns replaced by SQL expressions."""
    names = columns(database, table)
    values = ", ".join(changes.get(name, name) for name in names)
    database.execute(
        f"INSERT INTO {table} ({', '.join(names)}) SELECT {values} FROM {table} WHERE {where}")


def fill(path, rows):
    """Copies evaluation 1 until the store has so many episode rows."""
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA synchronous = OFF")
        have = database.execute("SELECT max(id) FROM submission").fetchone()[0]
        for number in range(have + 1, rows // EPISODES + 1):
            team = (number - 1) % TEAMS + 1
            artefact = f"{number:064x}"
            copy_rows(database, "team",
                      f"id = 1 AND NOT EXISTS (SELECT 1 FROM team WHERE id = {team})",
                      {"id": str(team), "name": f"'Team {team}'"})
            copy_rows(database, "artefact", "hash = (SELECT artefact FROM submission WHERE id = 1)",
                      {"hash": f"'{artefact}'"})
            copy_rows(database, "submission", "id = 1",
                      {"id": str(number), "team_id": str(team), "artefact": f"'{artefact}'"})
            copy_rows(database, "evaluation", "id = 1",
                      {"id": str(number), "submission": str(number)})
            copy_rows(database, "standing", "evaluation = 1", {"evaluation": str(number)})
            copy_rows(database, "lease", "evaluation = 1",
                      {"id": f"id + {number - 1} * 1000", "evaluation": str(number)})
            copy_rows(database, "episode", "evaluation = 1",
                      {"evaluation": str(number), "lease": f"lease + {number - 1} * 1000"})
            copy_rows(database, "episode_details", "evaluation = 1",
                      {"id": "NULL", "evaluation": str(number)})
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
        with grader.running_with(slots=1):
            board = timed(grader, REPETITIONS, "leaderboard", "--track", "tiny")
            submit = timed(grader, REPETITIONS, "submit", policy, "--track", "tiny", "--team",
                           "Newcomer NUMBER", "--episodes", "1")
        sizes.append({"episode_rows": count, "leaderboard_s": board, "submit_s": submit,
                      "bytes_per_row": path.stat().st_size / count})
    starts = []
    for _ in range(REPETITIONS):
        start = time.monotonic()
        grader.cli("--version")
        starts.append(time.monotonic() - start)
    return {"program_start_s": statistics.median(starts), "sizes": sizes}
