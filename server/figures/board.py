"""The numbers of a board that figures and reports show, from the API's answers. Nothing is drawn
here."""

from estimates import is_number
from evaluation import courses, joints, obstacles, rows_of, value_of
from order import Refused
from plain import plain

SUCCESS = {"name": "success_rate", "title": "success", "unit": "", "better": "more", "digits": 3}


def title_of(board):
    """"final, board main", or without a phase "TRACK, rules PROFILE, board main"."""
    what = board["phase"] if board.get("phase") else f"{board['track']}, rules {board['profile']}"
    return f"{plain(what, 60)}, board {plain(board['board'], 32)}"


def criterion_of(statistics, board):
    """What ranks first."""
    criteria = statistics.get("criteria") or []
    return criteria[0] if criteria else (board.get("columns") or [SUCCESS])[0]


def number_of(row, metric):
    value = (row.get("aggregate") or {}).get(metric["name"])
    return value if is_number(value) else None


def history(board, statistics, moments):
    """How the first number of each team that is on the board came to be: its value at each moment
    at which something changed, None where the team had no row. The order is the board's."""
    criterion = criterion_of(statistics, board)
    teams = {}
    for place, moment in enumerate(moments):
        for row in moment["rows"]:
            if row.get("baseline"):
                continue
            values = teams.setdefault(row["team"], [None] * len(moments))
            values[place] = number_of(row, criterion)
    if not any(value is not None for values in teams.values() for value in values):
        raise Refused(f"the board of {title_of(board)} has never had a row, so there is nothing to "
                      "draw")
    order = {row["team"]: place for place, row in enumerate(board.get("rows") or [])}
    ranked = sorted(teams, key=lambda team: (order.get(team, len(order)), team))
    return {"criterion": criterion, "moments": [moment["at"] for moment in moments],
            "teams": [{"team": plain(team, 60), "values": teams[team]} for team in ranked]}


def ranking(board, statistics):
    """The rows of the board with the intervals and tests of its statistics."""
    tested = {row["submission"]: row for row in statistics.get("rows") or []}
    rows = []
    for row in board.get("rows") or []:
        more = tested.get(row["submission"], {})
        # Those of the statistics are of what ranks, those of the aggregate of all plain means.
        intervals = {**((row.get("aggregate") or {}).get("spread") or {}),
                     **{name: known for name, known in (more.get("intervals") or {}).items()
                        if known}}
        above = more.get("above") or {}
        rows.append({
            "rank": None if row.get("baseline") else row["rank"], "team": plain(row["team"], 60),
            "policy": plain(row["name"], 60), "submission": row["submission"],
            "group": more.get("group"), "participant_faults": more.get("participant_faults"),
            "successes": (row.get("aggregate") or {}).get("successes"),
            "episodes": (row.get("aggregate") or {}).get("episodes"),
            "numbers": {metric["name"]: {
                "value": number_of(row, metric),
                "low": (intervals.get(metric["name"]) or {}).get("low"),
                "high": (intervals.get(metric["name"]) or {}).get("high")}
                for metric in [SUCCESS, *board.get("columns", [])]},
            "p_above": above.get("p_adjusted"), "decided": above.get("decided")})
    return rows


def best_of(pairs):
    """Of (value, who) the largest; who came first of equal ones."""
    known = [pair for pair in pairs if pair[0] is not None]
    return max(known, key=lambda pair: pair[0], default=None)


def records(results):
    """The farthest that an episode came, and the highest obstacle of each kind that one passed, of
    each submission and of all; None where nothing is known."""
    rows = []
    for result in results:
        distances = [value for row in rows_of(result)
                     if (value := value_of(row, "distance_m")) is not None]
        rows.append({"submission": result["submission"], "team": plain(result["team"], 60),
                     "distance_m": max(distances, default=None), "obstacles": obstacles(result)})
    kinds = sorted({kind for row in rows for kind in row["obstacles"]})
    best = {}
    for key, pick in [("distance_m", lambda row: row["distance_m"])] + [
            (kind, lambda row, kind=kind: row["obstacles"].get(kind)) for kind in kinds]:
        found = best_of([(pick(row), row) for row in rows])
        best[key] = None if found is None else {
            "value": found[0], "unit": "m", "submission": found[1]["submission"],
            "team": found[1]["team"]}
    return {"kinds": kinds, "rows": rows, "best": best}


def by_course(results):
    """(result, numbers) of those whose episodes are on several kinds of courses."""
    found = []
    for result in results:
        try:
            found.append((result, courses(result)))
        except Refused:
            continue
    return found


def by_joint(results):
    """(result, numbers) of those whose episodes tell joint ranges."""
    return [(result, found) for result in results if (found := joints(result))]
