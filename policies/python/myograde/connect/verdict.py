"""How a submission ended here, as it is to be shown elsewhere."""

from __future__ import annotations

import urllib.parse
from types import SimpleNamespace
from typing import Any, Optional

from ..client import FINAL_STATES, Client
from . import mapping

Json = dict[str, Any]
MAX_OUTPUT = 64 << 10


def marks_of(status: Json) -> dict[str, Json]:
    """The marks in force of a submission, and the act by which each is."""
    return {mark: act for mark, act in {act["mark"]: act for act in status["marks"]}.items() if act["set"]}


def boards_of(client: Client, target: SimpleNamespace) -> dict[str, Json]:
    """The boards whose scores are shown, by what the columns say: `score` or `score.BOARD`."""
    shown = {of for columns in target.splits.values() for of in columns.values() if of.split(".")[0] == "score"}
    named = {key: of for key in ("phase", "track", "profile") if (of := getattr(target, key))}
    return {of: client.ask("/v1/leaderboard?" + urllib.parse.urlencode(
        {**named, "board": of.partition(".")[2] or "main"})) for of in sorted(shown)}


def counting_result(client: Client, status: Json) -> Json:
    """The result that counts: that of the latest rejudge in force, else the original one."""
    counts = {None: status["evaluation"]}
    for evaluation in status["evaluations"]:
        number = evaluation["rejudge"]
        if number and number not in counts and evaluation["state"] in ("done", "failed"):
            rejudge = client.ask(f"/v1/rejudges/{number}")
            if rejudge["state"] == "applied" and rejudge["purpose"] == "rules":
                counts[number] = evaluation["evaluation"]  # the first of its repetitions
    return client.ask(f"/v1/evaluations/{[*counts.values()][-1]}")


def columns_of(client: Client, target: SimpleNamespace, aggregate: Json) -> dict[str, dict[str, float]]:
    """What each split's leaderboard shows; a number that the result does not have is left out."""
    scores = {of: mapping.score(board["rules"], aggregate, mapping.openers_of(board))
              for of, board in boards_of(client, target).items()}
    return {split: {label: number for label, of in columns.items()
                    if (number := mapping.value(of, aggregate, scores)) is not None}
            for split, columns in target.splits.items()}


def judge(client: Client, target: SimpleNamespace, number: int, page: str) -> Optional[SimpleNamespace]:
    """None while it has not ended. `status` is finished, failed or cancelled; `columns` are by split and label;
    `show` has the parts of results that the phase shows its teams; `stderr` begins with the reason if it is not
    finished; `result` is that of the evaluation that counts."""
    status = client.status(number)
    if status["state"] not in FINAL_STATES:
        return None
    result = counting_result(client, status)
    team = client.ask(f"/v1/teams/{urllib.parse.quote(status['team'], safe='')}")
    withheld = [phase for phase in client.phases()
                if phase["phase"] == status["phase"] and not (phase["published"] or phase["revealed"])]
    show = {part: not withheld or withheld[0][f"show.{part}"] for part in ("aggregate", "outcomes", "output")}
    kind, why = {"done": "finished", "cancelled": "cancelled"}.get(result["state"], "failed"), result["reason"] or ""
    acts = {f"{mark} by the organisers": act for mark, act in marks_of(status).items() if mark != "baseline"}
    if team["banned"]:
        acts["the organisers have banned the team"] = [act for act in team["events"] if act["event"] == "banned"][-1]
    for what, act in acts.items():
        kind, why = "cancelled", f"{what}: {act['reason'] or 'no reason given'}"
    lines = [f"MyoGrade's submission {number} is {kind} ({result['state']}): {result['episodes']['done']} of "
             f"{result['episodes']['total']} episodes were played.", page, why]
    if show["outcomes"]:
        lines.append(", ".join(f"{outcome}: {count}" for outcome, count in sorted(result["outcomes"].items())))
    stdout, stderr = ("".join(
        f"\nepisodes {lease['first']} to {lease['last']}:\n{lease[tail]}"
        for lease in result["output"] if show["output"] and lease[tail])[:MAX_OUTPUT]
        for tail in ("stdout_tail", "stderr_tail"))
    return SimpleNamespace(
        status=kind, columns=columns_of(client, target, result["aggregate"]) if kind == "finished" else {}, show=show,
        stdout="\n".join(filter(None, lines)) + stdout, stderr=why + stderr, result=result)
