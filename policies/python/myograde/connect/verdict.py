"""How a submission ended here, as it is to be shown elsewhere."""

from __future__ import annotations

import urllib.parse
from types import SimpleNamespace
from typing import Any, Optional

from ..client import FINAL_STATES, Client
from . import mapping

Json = dict[str, Any]
MAX_OUTPUT = 64 << 10


def marked(status: Json, mark: str) -> Optional[Json]:
    """The act by which a mark of a submission is in force."""
    acts = [act for act in status["marks"] if act["mark"] == mark]
    return acts[-1] if acts and acts[-1]["set"] else None


def board_of(client: Client, target: SimpleNamespace, board: str = "main") -> Json:
    named = {"phase": target.phase, "track": target.track, "profile": target.profile, "board": board}
    return client.ask("/v1/leaderboard?" + urllib.parse.urlencode({key: of for key, of in named.items() if of}))


def counting_evaluation(client: Client, status: Json) -> int:
    """The evaluation that counts: that of the latest rejudge in force, else the original one."""
    counts, seen = status["evaluation"], set()
    for evaluation in status["evaluations"]:
        rejudge = evaluation["rejudge"]
        if rejudge and rejudge not in seen and evaluation["state"] in ("done", "failed"):
            seen.add(rejudge)  # the first of its repetitions counts
            about = client.ask(f"/v1/rejudges/{rejudge}")
            if about["state"] == "applied" and about["purpose"] == "rules":
                counts = evaluation["evaluation"]
    return counts


def columns_of(client: Client, target: SimpleNamespace, aggregate: Json) -> dict[str, dict[str, float]]:
    """What each split's leaderboard shows; a number that the result does not have is left out."""
    made: dict[str, dict[str, float]] = {}
    for split, columns in target.splits.items():
        scores = {of: mapping.score(board_of(client, target, board)["rules"], aggregate, target.band_openers)
                  for of, board in mapping.boards_of(columns).items()}
        numbers = {label: mapping.value(of, aggregate, scores) for label, of in columns.items()}
        made[split] = {label: number for label, number in numbers.items() if number is not None}
    return made


def _shown(client: Client, name: Optional[str]) -> Json:
    """What teams see of their own evaluations."""
    for challenge in client.ask("/v1/challenges")["challenges"] if name else []:
        for phase in challenge["phases"]:
            if phase["phase"] == name and not (phase["published"] or phase["revealed"]):
                return phase["show"]
    return dict.fromkeys(("aggregate", "outcomes", "metrics", "output"), True)


def judge(client: Client, target: SimpleNamespace, number: int, page: str) -> Optional[SimpleNamespace]:
    """None while it has not ended. `status` is finished, failed or cancelled; `columns` are by split and label;
    `show` has the parts of results that the phase shows its teams; `stderr` begins with the reason if it is not
    finished; `result` is that of the evaluation that counts."""
    status = client.status(number)
    if status["state"] not in FINAL_STATES:
        return None
    result = client.ask(f"/v1/evaluations/{counting_evaluation(client, status)}")
    team = client.ask(f"/v1/teams/{urllib.parse.quote(status['team'], safe='')}")
    show = _shown(client, status["phase"])
    kind = {"done": "finished", "cancelled": "cancelled"}.get(result["state"], "failed")
    why = result["reason"] or ""
    for mark in ("hidden", "disqualified"):
        if act := marked(status, mark):
            kind, why = "cancelled", f"{mark} by the organisers: {act['reason'] or 'no reason given'}"
    if team["banned"]:
        reasons = [act["reason"] for act in team["events"] if act["event"] == "banned"]
        kind, why = "cancelled", f"the organisers have banned the team: {reasons[-1] or 'no reason given'}"
    lines = [f"MyoGrade's submission {number} is {kind} ({result['state']}): {result['episodes']['done']} of "
             f"{result['episodes']['total']} episodes were played.", page, why]
    if show["outcomes"]:
        lines.append(", ".join(f"{outcome}: {count}" for outcome, count in sorted(result["outcomes"].items())))
    streams = {stream: "".join(
        f"\nepisodes {lease['first']} to {lease['last']}:\n{lease[f'{stream}_tail']}"
        for lease in (result["output"] if show["output"] else []) if lease[f"{stream}_tail"])[:MAX_OUTPUT]
        for stream in ("stdout", "stderr")}
    return SimpleNamespace(
        status=kind, columns=columns_of(client, target, result["aggregate"]) if kind == "finished" else {}, show=show,
        stdout="\n".join(filter(None, lines)) + streams["stdout"], stderr=why + streams["stderr"], result=result)
