"""The report of one submission."""

import json

import style
from body_drawings import draw_joint_pain, draw_joints, draw_moments
from drawings import draw_courses, draw_distributions, draw_survival
from estimates import is_number
from evaluation import (courses, distributions, endings, headline, joint_pain, joints, kind_of,
                        label, missing, moments, obstacles, rows_of, shown_metrics, survival,
                        value_of)
from order import Refused
from page import (document, facts, figure, h, name, notices, picture, section, table)
from plain import counted, heading, interval, lines, number, percent, plain


# What two numbers of like names are.
NOTES = {"peak_force_n": "of all contacts of the object, in every physics step; not official",
         "max_touch_n": "the official code calls it \"peak force\": its touch sensor, once per control "
                        "step"}


def tried(make, *arguments):
    """What `make` gives, or nothing if there is nothing to show."""
    try:
        return make(*arguments) or None
    except Refused:
        return None


def numbers_of(result):
    """All numbers of the report."""
    return {"submission": result["submission"], "evaluation": result.get("evaluation"),
            "state": result["state"], "headline": headline(result),
            "distributions": tried(distributions, result) or [],
            "endings": endings(result), "courses": tried(courses, result) or [],
            "survival": tried(survival, result), "obstacles": obstacles(result),
            "joints": joints(result), "joint_pain": joint_pain(result),
            "moments": moments(result), "missing": missing(result)}


def written_time(text):
    return f"{text[:19].replace('T', ' ')} UTC" if isinstance(text, str) else None


def head(result):
    what = result["phase"] if result.get("phase") else (
        f"{result['track']}, rules {result['profile']}")
    return facts([
        ("Team", name(plain(result["team"])) if result["team"] else None),
        ("Policy", name(plain(result.get("name") or "–"))),
        ("Phase" if result.get("phase") else "Track", plain(what)),
        ("Kind", "graded locally, which ranks nowhere" if result["submission"] is None
         else "ranked" if result.get("ranked") else "practice"),
        ("State", result["state"]),
        ("Reason", plain(result["reason"]) if result.get("reason") else None),
        ("Accepted", written_time(result.get("accepted_at"))),
        ("Finished", written_time(result.get("finished_at")))])


def verdict(numbers, result):
    """The numbers that rank it."""
    success = numbers["headline"]["success"]
    rows = []
    if success["whole"]:
        rows.append(["Success", percent(success["part"], success["whole"]),
                     f"[{100 * success['low']:.1f}, {100 * success['high']:.1f}] %",
                     f"{success['part']} of {counted(success['whole'], 'episode')}"])
    played = numbers["headline"]["played"]
    if played:
        rows.append(["Success without phantoms", percent(played["part"], played["whole"]),
                     f"[{100 * played['low']:.1f}, {100 * played['high']:.1f}] %",
                     f"{played['part']} of {played['whole']} played; the other "
                     f"{counted(success['whole'] - played['whole'], 'episode')} followed a solved one "
                     "and ended at once"])
    for metric in numbers["headline"]["metrics"]:
        better = NOTES.get(metric["name"], "") if metric["better"] == "neither" else (
            f"{metric['better']} is better")
        rows.append([heading(metric), number(metric["mean"], metric["digits"]),
                     interval(metric["low"], metric["high"], metric["digits"]), better])
    if not rows:
        return None
    official = "These are what the official code reports." if result.get("official_figures") else ""
    if official and any(metric["name"] in NOTES for metric in numbers["headline"]["metrics"]):
        official = official[:-1] + ", whose \"peak force\" is the peak touch."
    return [table("Means over the episodes", ["number", "mean", "95 % interval", ""], rows, (1, 2)),
            notices([official] if official else [])]


def curves_text(numbers):
    return (f"Share of the {counted(numbers['episodes'], 'episode')} that had not failed, with "
            f"95 % intervals at each place; {numbers['failed']:,} failed in the end.")


def figures(result, numbers):
    """(title, elements): of what there is to show."""
    title = label(result)
    drawn = []

    def add(heading_, prefix, make, found, words):
        if found:
            drawn.append((heading_, figure(style.as_inline_svg(make(title, found), prefix), words)))

    add("Distributions", "distributions", draw_distributions, numbers["distributions"],
        "How the episodes' numbers lie: counts by outcome; the line above has the middle half of "
        "the episodes and the median.")
    add("Kinds of course", "courses", lambda words, found: draw_courses(words, [(words, found)]),
        numbers["courses"], "Means with 95 % intervals: Wilson's of success rates, those of the "
        "normal distribution of distances.")
    if numbers["survival"]:
        add("How long episodes went on", "survival",
            lambda words, found: draw_survival(words, [(words, found)]), numbers["survival"],
            curves_text(numbers["survival"]))
    add("Joint angles", "joints", lambda words, found: draw_joints(words, [(words, found)]),
        numbers["joints"], "Angles of each joint against its limits (black). Thin: the whole range "
        "of all episodes. Thick: between the medians of the episodes' smallest and largest angles.")
    add("Pain by joint", "pain", lambda words, found: draw_joint_pain(words, [(words, found)]),
        numbers["joint_pain"], "Mean over the episodes of each joint's clipped limit torque per "
        "step, in kN m, with 95 % intervals.")
    add("When things happened", "moments", draw_moments, numbers["moments"],
        "First to last, the middle half, and the median, of the episodes in which it happened "
        "(their number in brackets).")
    return drawn


def obstacle_table(numbers):
    rows = [[kind, number(height, 3)] for kind, height in sorted(numbers["obstacles"].items())]
    return table("Highest obstacle passed", ["kind", "height (m)"], rows, (1,)) if rows else None


def endings_table(numbers):
    total = sum(numbers["endings"].values())
    return table("How episodes ended", ["end", "episodes", "share"], [
        [way, f"{count:,}", percent(count, total)] for way, count in numbers["endings"].items()],
        (1, 2)) if total else None


def episode_table(result):
    rows = rows_of(result)
    if not rows:
        return None
    metrics = shown_metrics(result)
    lines_ = []
    for row in rows:
        fault = row.get("fault") or {}
        why = row.get("reason") or ""
        if fault.get("detail"):
            why = f"{why} {fault['detail']}".strip()
        lines_.append([row["index"], row["seed"] if row.get("seed") is not None else "hidden",
                       row.get("outcome") or kind_of(row), name(plain(why)),
                       *[number(value_of(row, metric["name"]), metric["digits"])
                         for metric in metrics],
                       row["steps"] if is_number(row.get("steps")) else "–"])
    last = 4 + len(metrics)
    return h("details", h("summary", f"All {counted(len(rows), 'episode')}"), table(
        "Episodes", ["episode", "seed", "outcome", "reason", *map(heading, metrics), "steps"],
        lines_, (0, 1, *range(4, last + 1))))


def hashes(result):
    grader = result.get("grader") or {}
    return facts([*((key.capitalize(), h("code", value))
                    for key, value in sorted((result.get("hashes") or {}).items()) if value),
                  ("Merkle root", h("code", result["merkle_root"])
                   if result.get("merkle_root") else None),
                  ("Grader", plain(grader["version"]) if grader.get("version") else None),
                  *((key.capitalize(), h("code", grader[key])) for key in ("simulator", "mujoco")
                    if isinstance(grader.get(key), str))])


def receipt_part(receipt):
    if "error" in receipt:
        return h("p", f"There is no receipt: {plain(receipt['error'], 500)}")
    text = json.dumps(receipt["receipt"], ensure_ascii=False, sort_keys=True, indent=1)
    return [h("p", "The grader signed these results. \"myograde verify\" checks the receipt as "
              "\"myograde proof receipt\" writes it, with the organiser's public key."),
            h("details", h("summary", "The receipt"), h("pre", lines(text)))]


def strip_part(strip):
    if "error" in strip:
        return h("p", f"There are no pictures: {plain(strip['error'], 500)}", class_="quiet")
    shown = picture(strip["png"], "The best, the median and the worst episode, by the rules of the "
                                  "board")
    return shown or h("p", "There are no pictures: what was drawn is no PNG file", class_="quiet")


def page(order, numbers):
    """The bytes of the HTML file."""
    result = order["result"]
    which = "Local run" if result["submission"] is None else f"Submission {result['submission']}"
    return document(
        f"{which}: {plain(result.get('name') or result['team'], 80)}",
        head(result), notices(numbers["missing"]),
        section("Result", verdict(numbers, result), endings_table(numbers),
                obstacle_table(numbers)),
        section("Pictures", strip_part(order["strip"]) if "strip" in order else None),
        [section(title, element) for title, element in figures(result, numbers)],
        section("Episodes", episode_table(result)),
        section("What the result follows from", hashes(result)),
        section("Receipt", receipt_part(order["receipt"]) if "receipt" in order else None),
        h("p", f"Made by myograde {plain(order['version'], 32)}.", class_="quiet"))
