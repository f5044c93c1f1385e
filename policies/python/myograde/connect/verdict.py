"""What leaderboards elsewhere show of a submission here, and where they would have another order than the boards."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Mapping, Optional

from ..client import Client, ServerError, WrongUse, numbers_of, packed_score
from .evalai import Evalai
from .settings import Settings

Json = dict[str, Any]


def boards_of(client: Client, target: SimpleNamespace) -> dict[str, Json]:
    """The boards whose scores are shown, by what the columns say: `score` or `score.BOARD`. WrongUse if the server has
    no such phase, track, profile or board."""
    shown = {of for columns in target.splits.values() for of in columns.values() if of.split(".")[0] == "score"}
    try:
        return {of: client.board(phase=target.phase, track=target.track, profile=target.profile,
                                 board=of.partition(".")[2] or "main") for of in sorted({"score", *shown})}
    except ServerError as error:
        if error.status != 400:
            raise
        raise WrongUse(f"{target.where}: {error}") from error


def columns_of(target: SimpleNamespace, aggregate: Json, scores: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """What each split's leaderboard shows. A number that the result does not have is left out."""
    known = {**numbers_of(aggregate), **scores}
    for of in (of for columns in target.splits.values() for of in columns.values()):
        if of not in known:
            raise WrongUse(f'{target.where}: a column shows "{of}", but there are {", ".join(sorted(known))}')
    return {split: {label: known[of] for label, of in columns.items() if known[of] is not None}
            for split, columns in target.splits.items()}


def judge(client: Client, target: SimpleNamespace, number: int, page: str) -> Optional[Json]:
    """How it ended (Client.ending()), with its `columns` by split and label, a `stdout` that begins with its words and
    its page, and a `stderr` that begins with the reason; None while it has not ended."""
    ended = client.ending(number)
    if ended is None:
        return None
    words, columns = ended["words"], {}
    if ended["kind"] == "finished":
        aggregate = ended["result"]["aggregate"]
        scores = {of: packed_score(board, aggregate) for of, board in boards_of(client, target).items()}
        columns = columns_of(target, aggregate, scores)
    return {**ended, "columns": columns, "stderr": ended["why"] + ended["stderr"],
            "stdout": "\n".join(filter(None, [words[0], page, *words[1:]])) + ended["stdout"]}


def check(settings: Settings) -> int:
    """Says before the first submission what would go wrong; 1 if there is anything to say."""
    client, said, where = settings.client(), [], settings.evalai
    there = Evalai(settings).ask("GET", f"challenges/{where.challenge}/challenge_phase_split") or [] if where else []
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
        for of, board in boards_of(client, target).items():
            for above, below, equal in client.out_of_order(board):
                why = ", as their scores are equal and the newer one comes first" if equal else ""
                said.append(f"phase {pk}, {of}: here {above!r} stands above {below!r}, there below{why}")
    print("\n".join(said) or "Leaderboards elsewhere would have the order of the boards here.")
    return 1 if said else 0
