"""The kinds of plots: what each needs of an order, its numbers, and its figure."""

import style
from board import history, title_of
from board_drawings import draw_history
from body_drawings import draw_joints
from drawings import draw_courses, draw_distributions, draw_paired, draw_survival
from evaluation import courses, distributions, joints, label, survival, withholds_details
from order import Refused
from plain import plain


def title_for(results):
    if len(results) == 1:
        return label(results[0])
    where = results[0].get("phase") or results[0]["track"]
    return f"{len(results)} submissions to {plain(where, 60)}"


def of_each(order, numbers_of):
    """The numbers of each submission, beside who it is."""
    return [{"submission": result["submission"], "numbers": numbers_of(result)}
            for result in order["results"]]


def entries(order, numbers):
    return [(label(result), one["numbers"]) for result, one in zip(order["results"], numbers)]


def joints_or_refuse(result):
    found = joints(result)
    if not found:
        who = f"submission {result['submission']}"
        raise Refused(f"the phase of {who} withholds what was measured of joints until it is "
                      "published" if withholds_details(result) else
                      f"no episode of {who} tells its joints' ranges: none got to its first step, a "
                      "grader from before they were measured played them, or its track has none")
    return found


KINDS = {
    "board": (
        lambda order: history(order["board"], order["statistics"], order["moments"]),
        lambda order, numbers: draw_history(title_of(order["board"]), numbers)),
    "distributions": (
        lambda order: of_each(order, distributions),
        lambda order, numbers: draw_distributions(title_for(order["results"]),
                                                  numbers[0]["numbers"])),
    "courses": (
        lambda order: of_each(order, courses),
        lambda order, numbers: draw_courses(title_for(order["results"]), entries(order, numbers))),
    "survival": (
        lambda order: of_each(order, survival),
        lambda order, numbers: draw_survival(title_for(order["results"]), entries(order, numbers))),
    "joints": (
        lambda order: of_each(order, joints_or_refuse),
        lambda order, numbers: draw_joints(title_for(order["results"]), entries(order, numbers))),
    "paired": (
        lambda order: order["paired"],
        lambda order, numbers: draw_paired(
            "\nless ".join(label(result) for result in order["results"]), numbers)),
}


def made(order):
    """(numbers, bytes of the file or b"")."""
    numbers_of, draw = KINDS[order["kind"]]
    numbers = numbers_of(order)
    if not order["format"]:
        return numbers, b""
    written = {"svg": style.as_svg, "pdf": style.as_pdf}[order["format"]]
    return numbers, written(draw(order, numbers))
