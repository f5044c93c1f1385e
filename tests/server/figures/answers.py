"""Answers of the API as figures are drawn from, with the same numbers at each call, and names of
hostile participants."""

import random

HOSTILE = ("<script>alert(1)</script>", "</svg><b onload=x>", "$\\frac{1}{0}$", "]]><x/>",
           "a\u202eb\u200bc\x07\x00d", "=cmd|' /C calc'!A0", "&lt;i&gt; \"quoted\" 'too'",
           "東京大学 🦿 שלום", "x" * 5000, "q" + "\u0301" * 200, "%s {0} \\n", "\ud800broken")


def metric(name, title, unit, digits, better="less"):
    return {"name": name, "title": title, "unit": unit, "digits": digits, "better": better}


METRICS = [metric("distance_m", "distance", "m", 4, "more"), metric("time_s", "time", "s", 4),
           metric("effort", "effort", "", 6), metric("pain", "pain", "", 6)]
JOINTS = ("knee", "ankle")


def details(index, distance):
    return {"obstacle_heights": {"hilly": distance / 100 if index % 5 == 1 else None,
                                 "rough": None, "stairs": None},
            "pain_by_joint": {"knee": 2.0, "ankle": 1.0},
            "joint_ranges": {joint: [-0.4 - index / 1000, 0.6, -0.8, 1.2] for joint in JOINTS},
            "fall_time": distance, "fall_y": None, "speed_mean": 1.0}


def row(index, draws, detailed):
    distance = min(100.0, draws.gammavariate(2, 20))
    done = distance == 100.0
    outcome = "crash" if index == 3 else "success" if done else "failure"
    return {"index": index, "seed": 1000 + index, "outcome": outcome,
            "reason": "fell" if outcome == "failure" else "",
            "metrics": {"success": int(outcome == "success"), "distance_m": distance,
                        "time_s": distance / 1.25, "effort": draws.random() / 10,
                        "pain": draws.random() / 50},
            "steps": 100, "sim_time_s": distance / 1.25, "facts": {"course": index % 5},
            "fault": {"detail": f"it said {HOSTILE[0]}"} if index == 3 else None,
            "details": details(index, distance) if detailed else None}


def result(submission, team="alpha", name="walker", episodes=40, detailed=True):
    """An evaluation with rows."""
    draws = random.Random(submission)
    rows = [row(index, draws, detailed) for index in range(episodes)]
    successes = sum(one["outcome"] == "success" for one in rows)
    means = {one["name"]: sum(each["metrics"][one["name"]] for each in rows) / episodes
             for one in METRICS}
    return {"evaluation": submission + 2, "submission": submission, "team": team, "name": name,
            "track": "short-leg", "track_kind": "locomotion", "profile": "paper", "phase": "final",
            "ranked": True, "state": "done", "reason": None, "metrics": METRICS,
            "official_figures": False, "hashes": {"artefact": "a" * 64}, "merkle_root": "f" * 64,
            "grader": {"version": "0.1.0", "simulator": "1" * 64},
            "accepted_at": "2026-12-01T12:00:00.000Z", "finished_at": "2026-12-01T12:40:00.000Z",
            "aggregate": {"episodes": episodes, "successes": successes,
                          "success_rate": successes / episodes, **means,
                          "spread": {key: {"deviation": 1, "low": value * 0.9, "high": value * 1.1}
                                     for key, value in means.items()}},
            "episode_rows": rows}


def withheld(submission):
    """What a team sees of its own while the phase withholds outcomes, metrics and logs."""
    whole = result(submission)
    rows = [{**one, "outcome": None, "reason": None, "seed": None, "metrics": {}, "steps": None,
             "sim_time_s": None, "facts": None, "fault": None, "details": None}
            for one in whole["episode_rows"]]
    return {**whole, "aggregate": None, "episode_rows": rows, "merkle_root": None,
            "withheld": ["aggregate", "outcomes", "metrics", "logs", "seeds"]}


def board_row(rank, of):
    return {"rank": rank, "rank_by_rules": rank, "baseline": rank is None, "team": of["team"],
            "submission": of["submission"], "evaluation": of["evaluation"], "name": of["name"],
            "aggregate": of["aggregate"], "build": "b" * 12, "other_build": False}


def board_order(results):
    """An order with the board of `results`, the last of which is a baseline."""
    ranked = [*enumerate(results[:-1], 1), (None, results[-1])]
    rows = [board_row(rank, one) for rank, one in ranked]
    interval = {"value": 20.0, "low": 18.0, "high": 22.0, "method": "normal"}
    statistics = {"criteria": [METRICS[0]],
                  "statistics": {"level": 0.05, "tests": 1, "places": 10},
                  "rows": [{"submission": one["submission"], "group": 1, "participant_faults": 1,
                            "intervals": {"distance_m": interval},
                            "above": {"p_adjusted": 0.00003, "decided": True} if place else None}
                           for place, one in enumerate(results[:-1])]}
    board = {"track": "short-leg", "profile": "paper", "phase": "final", "board": "main",
             "config": "c" * 64, "episodes": 40, "complete": True, "frozen_at": None,
             "columns": METRICS, "order": "By mean distance.", "rows": rows,
             "builds": [{"build": "b" * 12, "rows": len(rows)}]}
    moments = [{"at": "2026-12-01T00:00:00Z", "rows": []},
               {"at": "2026-12-02T00:00:00Z", "rows": rows[:1]},
               {"at": "2026-12-03T00:00:00Z", "rows": rows}]
    return {"board": board, "statistics": statistics, "moments": moments}


def paired(first, second):
    """As the command line tool computes it."""
    found = []
    for one in METRICS:
        differences = [a["metrics"][one["name"]] - b["metrics"][one["name"]]
                       for a, b in zip(first["episode_rows"], second["episode_rows"])]
        found.append({**one, "differences": differences, "difference": 1.0, "low": 0.5, "high": 1.5,
                      "p": 0.01, "pairs": len(differences), "differing": len(differences),
                      "method": "monte-carlo"})
    return {"pairs": len(first["episode_rows"]), "metrics": found}


def receipt():
    return {"receipt": {"format": 1, "name": HOSTILE[0]},
            "signature": {"algorithm": "ed25519", "value": "00"}}
