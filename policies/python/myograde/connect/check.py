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
        there = Evalai(settings).ask("GET", f"challenges/{where.challenge}/challenge_phase_split") or []
    for pk, target in settings.phases.items():
        schemas = [known["leaderboard_schema"] for known in there if str(known["challenge_phase"]) == pk]
        for split, columns in target.splits.items():
            place = f"phase {pk}, split {split}"
            sorts = [columns.get(schema["default_order_by"], "") for schema in schemas
                     if set(columns) <= set(schema["labels"])]
            if where and not sorts:
                said.append(f"{place}: no leaderboard of this phase on EvalAI has the labels {', '.join(columns)}")
            elif where and not any(of.startswith("score") for of in sorts):
                said.append(f"{place}: EvalAI sorts by what shows {sorts[0]!r} (default_order_by), which is no score")
        for of, board in verdict.boards_of(client, target).items():
            said += [f"phase {pk}, {of}: {sentence}" for sentence in differences(client, target, board)]
    print("\n".join(said) or "Leaderboards elsewhere would have the order of the boards here.")
    return 1 if said else 0


def differences(client: Client, target: SimpleNamespace, board: dict[str, Any]) -> list[str]:
    """Where EvalAI would have another order: by the score, where it is equal the newest first, and of each team
    the first."""
    best: dict[str, tuple[float, int]] = {}
    openers = mapping.openers_of(board)
    for known in client.submissions(phase=target.phase, track=target.track, profile=board["profile"], state="done"):
        status = client.status(known["submission"])
        result = verdict.counting_result(client, status)
        if known["ranked"] and not verdict.marks_of(status) and result["hashes"]["config"] == board["config"]:
            entry = mapping.score(board["rules"], result["aggregate"], openers), known["submission"]
            best[known["team"]] = max(entry, best.get(known["team"], entry))
    here = [row["team"] for row in board["rows"] if row["team"] in best and not row["baseline"]]
    return [f"here {above!r} stands above {below!r}, there below"
            + (", as their scores are equal and the newer one comes first" if best[above][0] == best[below][0] else "")
            for above, below in zip(here, here[1:]) if best[above] < best[below]]
