"""The results section of a challenge's paper, for one board."""

import style
from board import (SUCCESS, by_course, by_joint, criterion_of, history, ranking, records, title_of)
from board_drawings import draw_history, draw_intervals
from body_drawings import draw_joints
from drawings import draw_courses, draw_survival, p_text
from evaluation import headline, label, missing, played, survival
from order import Refused
from page import document, facts, figure, h, name, notices, section, table
from plain import counted, heading, interval, number, percent, plain
from submission_report import written_time

MOST_COMPARED = 5  # submissions in a figure with a colour each


def first(rows, results):
    """The results of the first ranked rows, in the order of the board."""
    known = {result["submission"]: result for result in results}
    ranked = [known[row["submission"]] for row in rows
              if row["rank"] is not None and row["submission"] in known]
    return ranked[:MOST_COMPARED]


def survivals(results):
    found = []
    for result in results:
        try:
            found.append((result, survival(result)))
        except Refused:
            continue
    return found


def numbers_of(order):
    """All numbers of the report. Figures of episodes are those of the first rows."""
    board, statistics = order["board"], order["statistics"]
    results = [result for result in order["results"] if "error" not in result]
    rows = ranking(board, statistics)
    leaders = first(rows, results)
    try:
        over_time = history(board, statistics, order["moments"])
    except Refused:
        over_time = None
    return {
        "track": board["track"], "profile": board["profile"], "phase": board.get("phase"),
        "board": board["board"], "config": board["config"], "episodes": board.get("episodes"),
        "criterion": criterion_of(statistics, board), "ranking": rows,
        "records": records(results), "history": over_time,
        "played": [{"submission": result["submission"], "team": result["team"],
                    "official": headline(result)["success"], "played": found}
                   for result in results if (found := played(result))],
        "survival": [{"submission": result["submission"], **found}
                     for result, found in survivals(leaders)],
        "courses": [{"submission": result["submission"], "courses": found}
                    for result, found in by_course(leaders)],
        "joints": [{"submission": result["submission"], "joints": found}
                   for result, found in by_joint(leaders)],
        "missing": absent(order, results)}


def absent(order, results):
    """What the report can't show, and why."""
    sentences = []
    board = order["board"]
    if not board.get("complete", True):
        sentences.append(f"The board is frozen as of {written_time(board.get('frozen_at'))}: what "
                         "ended later is not in it yet.")
    refused = [result for result in order["results"] if "error" in result]
    if refused:
        sentences.append(
            f"The episodes of {counted(len(refused), 'submission')} are not shown to who asked for "
            f"this report, so the distances, obstacles, courses and joints are without them: "
            f"{plain(refused[0]['error'], 200)}")
    told = {}
    for result in results:
        for sentence in missing(result):
            told.setdefault(sentence, []).append(result["submission"])
    sentences += [f"{'Submission' if len(whose) == 1 else 'Submissions'} "
                  f"{', '.join(map(str, whose[:20]))}{' and others' if len(whose) > 20 else ''}: "
                  f"{sentence}" for sentence, whose in told.items()]
    return sentences


def ranking_table(order, numbers):
    board = order["board"]
    columns = [SUCCESS, *board.get("columns", [])]
    rows = []
    for row in numbers["ranking"]:
        cells = ["baseline" if row["rank"] is None else row["rank"],
                 "–" if row["group"] is None else row["group"], name(row["team"]),
                 name(row["policy"]), row["submission"]]
        for metric in columns:
            one = row["numbers"][metric["name"]]
            cells.append([number(one["value"], metric["digits"]), h("br"), h(
                "span", interval(one["low"], one["high"], metric["digits"]), class_="quiet")])
        cells += ["–" if row["participant_faults"] is None else row["participant_faults"],
                  "–" if row["p_above"] is None else
                  p_text(row["p_above"]) + (" *" if row["decided"] else "")]
        rows.append(cells)
    if not rows:
        return h("p", "The board is empty: only whole evaluations rank.")
    used = order["statistics"].get("statistics") or {}
    ends = 5 + len(columns)
    return [table(f"Table 1. {plain(title_of(board))}: means over "
                  f"{counted(numbers['episodes'] or 0, 'episode')} with 95 % intervals",
                  ["rank", "group", "team", "policy", "id", *map(heading, columns),
                   "faults", "p (above)"], rows, (0, 1, 4, *range(5, ends + 2))),
            h("p", plain(board.get("order") or "", 2000)),
            h("p", f"p: paired permutation test against the row above over the same episodes, "
              f"corrected (Holm) for {counted(used.get('tests') or 0, 'test')}; * decides at the "
              f"level {used.get('level', '–')}. Rows of one group: their order is not decided.",
              class_="quiet")]


def played_table(numbers):
    rows = [[one["submission"], name(plain(one["team"])),
             *[text for rate in (one["official"], one["played"])
               for text in (percent(rate["part"], rate["whole"]), f"{rate['part']} of {rate['whole']}")]]
            for one in numbers["played"]]
    return table("Success with and without phantoms: trials that the official code counts and ends at once, as "
                 "the one before was solved", ["submission", "team", "official", "", "played", ""], rows,
                 (0, 2, 4)) if rows else None


def records_part(numbers):
    best = numbers["records"]["best"]
    kinds = numbers["records"]["kinds"]
    titles = {"distance_m": "Best distance of an episode",
              **{kind: f"Highest obstacle passed: {kind}" for kind in kinds}}
    found = [[titles[key], number(one["value"], 3), name(one["team"]), one["submission"]]
             for key, one in best.items() if one]
    if not found:
        return None
    rows = [[row["submission"], name(row["team"]), number(row["distance_m"], 3),
             *[number(row["obstacles"].get(kind), 3) for kind in kinds]]
            for row in numbers["records"]["rows"]]
    head = ["submission", "team", "best distance (m)", *[f"{kind} (m)" for kind in kinds]]
    return [table("Best of all submissions", ["what", "m", "team", "submission"], found, (1, 3)),
            table("Best distance and highest obstacle passed, by submission", head, rows,
                  (0, *range(2, len(head))))]


def pairs_of(numbers, key, results):
    known = {result["submission"]: result for result in results}
    return [(label(known[one["submission"]]), one[key] if key in one else one)
            for one in numbers]


def figures(order, numbers):
    """(title, element) of what there is to show."""
    title = title_of(order["board"])
    results = [result for result in order["results"] if "error" not in result]
    drawn = []

    def add(heading_, prefix, made, words):
        if made is not None:
            drawn.append((heading_, figure(style.as_inline_svg(made, prefix), words)))

    add("Ranking", "intervals", draw_intervals(title, numbers["criterion"], numbers["ranking"]),
        f"{heading(numbers['criterion'])} of the first rows: means with 95 % intervals.")
    if numbers["history"]:
        add("The board over time", "history", draw_history(title, numbers["history"]),
            f"{heading(numbers['criterion'])} of each team's entry over time.")
    if numbers["survival"]:
        add("How long episodes went on", "survival",
            draw_survival(title, pairs_of(numbers["survival"], "", results)),
            "Share of the episodes that had not failed.")
    if numbers["courses"]:
        add("Kinds of course", "courses",
            draw_courses(title, pairs_of(numbers["courses"], "courses", results)),
            "Means with 95 % intervals by kind of course.")
    if numbers["joints"]:
        add("Joint angles", "joints",
            draw_joints(title, pairs_of(numbers["joints"], "joints", results)),
            "Angles of each joint against its limits (black). Thin: the whole range of all "
            "episodes. Thick: between the medians of the episodes' smallest and largest angles.")
    return drawn


def head(order):
    board, phase = order["board"], order.get("phase") or {}
    seeds = phase.get("seeds") or {}
    return facts([
        ("Challenge", plain(order["challenge"]) if order.get("challenge") else None),
        ("Phase", plain(phase.get("title") or board["phase"]) if board.get("phase") else None),
        ("Track", f"{board['track']}, rules {board['profile']}"),
        ("Open", f"{written_time(phase.get('opens_at')) or 'from the first'} to "
                 f"{written_time(phase.get('closes_at')) or 'no end'}" if phase else None),
        ("Episodes", f"{board.get('episodes') or 0:,} for each submission"),
        ("Seeds", f"{seeds['kind']}, commitment {seeds['commitment']}"
         if seeds.get("commitment") else seeds.get("kind")),
        ("Config", h("code", board["config"])),
        ("Builds of the grader", ", ".join(
            f"{build['build']} ({counted(build['rows'], 'row')})" for build in
            board.get("builds") or []) or None)])


def page(order, numbers):
    """The bytes of the HTML file."""
    title = f"Results: {title_of(order['board'])}"
    drawn = figures(order, numbers)
    return document(
        title, head(order), notices(numbers["missing"]),
        section("Results", ranking_table(order, numbers), played_table(numbers)),
        section("Distances and obstacles", records_part(numbers)),
        [section(heading_, element) for heading_, element in drawn],
        h("p", f"Made by myograde {plain(order['version'], 32)}.", class_="quiet"))
