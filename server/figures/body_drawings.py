"""Figures of what the body did: angles of joints against their limits, pain by joint, and when
things happened."""

import math

import style
from drawings import finish, rounded_height, whiskers


def degrees(angle):
    return angle * 180 / math.pi


def draw_joints(title, entries):
    """Of each joint the angles of all episodes, thin, and those of half of them, thick, against its
    limits. `entries`: (label, numbers) of submissions of one track."""
    names = []
    for _, found in entries:
        names += [joint["joint"] for joint in found if joint["joint"] not in names]
    each = 0.17 + 0.09 * len(entries)
    drawn, axes = style.figure(rounded_height(len(names), each))
    axis = axes[0][0]
    step = 0.7 / len(entries)
    for place, (_, found) in enumerate(entries):
        colour = style.COLOURS[place % len(style.COLOURS)]
        for joint in found:
            row = names.index(joint["joint"])
            at = row + (place - (len(entries) - 1) / 2) * step
            axis.plot([degrees(joint["least"]), degrees(joint["most"])], [at, at], color=colour,
                      linewidth=1)
            axis.plot([degrees(joint["median_least"]), degrees(joint["median_most"])], [at, at],
                      color=colour, linewidth=3.4, solid_capstyle="butt")
            axis.vlines([degrees(joint["limit_low"]), degrees(joint["limit_high"])], row - 0.42,
                        row + 0.42, color="#000000", linewidth=1.1)
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.set_xlabel("angle (°)")
    axis.grid(axis="x")
    axis.grid(False, axis="y")
    finish(drawn, title, [name for name, _ in entries])
    return drawn


def draw_joint_pain(title, entries):
    """The mean pain of each joint, with its interval."""
    names = []
    for _, found in entries:
        names += [joint["joint"] for joint in found if joint["joint"] not in names]
    drawn, axes = style.figure(rounded_height(len(names), 0.2))
    axis = axes[0][0]
    step = 0.6 / len(entries)
    for place, (_, found) in enumerate(entries):
        for joint in found:
            at = names.index(joint["joint"]) + (place - (len(entries) - 1) / 2) * step
            whiskers(axis, at, joint["mean"], joint["low"], joint["high"],
                     style.COLOURS[place % len(style.COLOURS)], across=True)
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.set_xlim(left=0)
    axis.set_xlabel("pain per step (limit torque in kN m), mean and 95 % interval")
    axis.grid(axis="x")
    axis.grid(False, axis="y")
    finish(drawn, title, [name for name, _ in entries])
    return drawn


def draw_moments(title, found):
    """When things happened: quartiles, and from the first to the last."""
    drawn, axes = style.figure(rounded_height(len(found), 0.28, 1.6))
    axis = axes[0][0]
    for place, moment in enumerate(found):
        low, middle, high = moment["quartiles"]
        axis.plot([moment["least"], moment["most"]], [place, place], color=style.COLOURS[0],
                  linewidth=1)
        axis.plot([low, high], [place, place], color=style.COLOURS[0], linewidth=6,
                  solid_capstyle="butt")
        axis.plot([middle], [place], "|", color="#ffffff", markersize=6, markeredgewidth=1.6)
    axis.set_yticks(range(len(found)), [
        f"{moment['moment']} ({moment['episodes']})" for moment in found])
    axis.set_ylim(len(found) - 0.4, -0.6)
    axis.set_xlim(left=0)
    axis.set_xlabel("simulated time (s)")
    axis.grid(axis="x")
    axis.grid(False, axis="y")
    finish(drawn, title, [])
    return drawn
