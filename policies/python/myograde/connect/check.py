"""Says before the first submission what would go wrong, and where a packed score sorts otherwise than the board."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from ..client import Client
from . import mapping, verdict
from .evalai import Evalai
from .settings import Settings


def check(settings: Settings) -> int:
    """1 if there is anything to say."""
    client, said, where, there = settings.client(), [], settings.evalai, []
    if where:
        evalai = Evalai(where.server, lambda: settings.secret(where.token_file))
        there = evalai.ask("GET", f"challenges/{where.challenge}/challenge_phase_split") or []
    for pk, target in settings.phases.items():
        for split, columns in target.splits.items():
            place = f"phase {pk}, split {split}"
            schemas = [known["leaderboard_schema"] for known in there if str(known["challenge_phase"]) == pk]
            sorts = [columns.get(schema["default_order_by"], "") for schema in schemas if set(columns) <= set(schema["labels"])]
            if where and not sorts:
                said.append(f"{place}: no leaderboard of this phase on EvalAI has the labels {', '.join(columns)}")
            elif where and not any(of.startswith("score") for of in sorts):
                said.append(f"{place}: EvalAI sorts by what shows {sorts[0]!r} (default_order_by), which is no score")
            for of, board in mapping.boards_of(columns).items():
                found = differences(client, target, verdict.board_of(client, target, board))
                said += [f"{place}, {of}: {sentence}" for sentence in found]
    print("\n".join(said) or "Leaderboards elsewhere would have the order of the boards here.")
    return 1 if said else 0


def differences(client: Client, target: SimpleNamespace, board: dict[str, Any]) -> list[str]:
    """Where EvalAI would have another order: by the score, where it is equal the newest first, and of each team
    the first."""
    entries = []
    for known in client.submissions(phase=target.phase, track=target.track, profile=board["profile"], state="done"):
        status = client.status(known["submission"])
        result = client.ask(f"/v1/evaluations/{verdict.counting_evaluation(client, status)}")
        off = [mark for mark in ("hidden", "disqualified", "baseline") if verdict.marked(status, mark)]
        if known["ranked"] and not off and result["hashes"]["config"] == board["config"]:
            points = mapping.score(board["rules"], result["aggregate"], target.band_openers)
            entries.append((points, known["submission"], known["team"]))
    there: dict[str, float] = {}
    for points, _, team in sorted(entries, reverse=True):
        there.setdefault(team, points)
    order, here = list(there), [row["team"] for row in board["rows"] if row["team"] in there and not row["baseline"]]
    said = [f"here {above!r} stands above {below!r}, there below"
            + (", as their scores are equal and the newer one comes first" if there[above] == there[below] else "")
            for above, below in zip(here, here[1:]) if order.index(above) > order.index(below)]
    openers = mapping.openers_of(board["rules"], board["rows"])
    if any("equal" not in sentence for sentence in said) and openers != sorted(target.band_openers):
        said.append(f'"band_openers": {openers} has the bands of this board as it is now')
    return said
