"""Figures from the numbers of evaluation.py and of the paired tests. Every axis has its unit, and
text of participants reaches matplotlib through plain.py alone."""

import math

import style
from plain import counted, heading, number

MOST_BARS = 400  # of a panel


def rounded_height(rows, each, least=2.2):
    return max(least, 1.1 + each * rows)


def drop_unused(axes, used):
    for axis in axes.flat[used:]:
        axis.set_axis_off()


def draw_distributions(title, found):
    """A histogram for each metric, by outcome, with the quartiles above it."""
    columns = min(2, len(found))
    rows = math.ceil(len(found) / columns)
    drawn, axes = style.figure(2.1 * rows + 0.5, rows, columns)
    seen = {}
    for axis, metric in zip(axes.flat, found):
        edges = metric["histogram"]["edges"]
        wide = edges[1] - edges[0]
        base = [0] * (len(edges) - 1)
        for kind in ("success", "failure", "fault", "withheld"):
            counts = metric["histogram"]["counts"].get(kind)
            if not counts:
                continue
            seen[kind] = axis.bar(edges[:-1], counts, wide, base, align="edge",
                                  color=style.OF_OUTCOME[kind], edgecolor="#ffffff", linewidth=0.4,
                                  hatch=style.HATCH_OF_OUTCOME[kind])
            base = [below + count for below, count in zip(base, counts)]
        low, middle, high = metric["quartiles"]
        top = max(base) * 1.12
        axis.plot([low, high], [top, top], color="#000000", linewidth=1)
        axis.plot([middle], [top], "|", color="#000000", markersize=9, markeredgewidth=1.5)
        axis.set_ylim(0, max(base) * 1.22)
        axis.set_xlabel(heading(metric))
        axis.set_ylabel("episodes")
        # Labels of values that lie close together are long: fewer of them, as differences from one number.
        axis.locator_params(axis="x", nbins=4)
        axis.ticklabel_format(axis="x", useOffset=True)
        axis.yaxis.get_major_locator().set_params(integer=True)
        axis.set_title(f"median {number(middle, metric['digits'])}"
                       + (f" {metric['unit']}" if metric["unit"] else ""), fontweight="normal")
    drop_unused(axes, len(found))
    finish(drawn, title, list(seen), handles=list(seen.values()), always=True)
    return drawn


def whiskers(axis, at, middle, low, high, colour, across=False):
    """A point with its interval, which may be unknown."""
    if middle is None:
        return
    known = low is not None and high is not None
    error = [[max(middle - low, 0)], [max(high - middle, 0)]] if known else [[0], [0]]
    draw = {"fmt": "o", "clip_on": False, "color": colour, "ecolor": colour, "markersize": 4,
            "capsize": 2.5, "elinewidth": 1.2}
    if across:
        axis.errorbar([middle], [at], xerr=error, **draw)
    else:
        axis.errorbar([at], [middle], yerr=error, **draw)


def draw_courses(title, entries):
    """Success rate and distance per kind of course. `entries`: (label, numbers) of submissions."""
    kinds = []
    for _, found in entries:
        kinds += [row["course"] for row in found if row["course"] not in kinds]
    with_distance = any(row["distance_m"]["count"] for _, found in entries for row in found)
    drawn, axes = style.figure(2.9 + 0.16 * len(entries), 1, 2 if with_distance else 1)
    panels = [(axes[0][0], "success rate", lambda row: (
        row["success"]["share"], row["success"]["low"], row["success"]["high"]))]
    if with_distance:
        panels.append((axes[0][1], "mean distance (m)", lambda row: (
            row["distance_m"]["mean"], row["distance_m"]["low"], row["distance_m"]["high"])))
    step = 0.6 / max(len(entries), 1)
    for axis, words, pick in panels:
        for place, (_, found) in enumerate(entries):
            for row in found:
                at = kinds.index(row["course"]) + (place - (len(entries) - 1) / 2) * step
                whiskers(axis, at, *pick(row), style.COLOURS[place % len(style.COLOURS)])
        axis.set_xticks(range(len(kinds)), [f"{kind}\n" + ", ".join(
            str(row["episodes"]) for _, found in entries for row in found
            if row["course"] == kind) for kind in kinds])
        axis.set_xlim(-0.5, len(kinds) - 0.5)
        axis.set_ylabel(words)
        axis.set_xlabel("kind of course, and its episodes")
        # An interval of a mean may reach below 0.
        axis.set_ylim(bottom=min([0, *(pick(row)[1] or 0 for _, found in entries
                                       for row in found)]))
    axes[0][0].set_ylim(0, 1.02)
    finish(drawn, title, [name for name, _ in entries])
    return drawn


def finish(drawn, title, names, dashes=False, handles=None, always=False):
    """The title, and below the axes the names of lines or points, if there are several, or
    `always`. `handles` are what the names belong to, if that is not a colour each in the order of
    the palette."""
    drawn.suptitle(title, fontsize=10, fontweight="bold", x=0.01, ha="left")
    if not names or (len(names) < 2 and not always):
        return
    if handles is None:
        handles = style.handles(len(names), dashes)
    columns = min(len(names), 4) if max(map(len, names)) < 20 else 1
    width, height = drawn.get_size_inches()
    below = 0.19 * math.ceil(len(names) / columns) + 0.1
    whole = height + below
    drawn.set_size_inches(width, whole)
    drawn.get_layout_engine().set(rect=(0, below / whole, 1, height / whole))
    drawn.legend(handles, names, loc="lower left", bbox_to_anchor=(0.01, 0), borderaxespad=0.3,
                 labelspacing=0.3, handlelength=3, ncol=columns)


SURVIVAL_AXES = (("distance_m", "distance along the course (m)"),
                 ("time_s", "simulated time (s)"))


def draw_survival(title, entries):
    """The share of episodes that had not failed, over distance and over time."""
    panels = [(key, words) for key, words in SURVIVAL_AXES
              if any(key in numbers["curves"] for _, numbers in entries)]
    drawn, axes = style.figure(2.9, 1, len(panels))
    for axis, (key, words) in zip(axes.flat, panels):
        for place, (_, numbers) in enumerate(entries):
            curve = numbers["curves"].get(key)
            if curve is None:
                continue
            colour = style.COLOURS[place % len(style.COLOURS)]
            end = max(numbers["farthest"][key] or 0.0, curve["at"][-1])
            drawn_at = [*curve["at"], end]
            drawn_share = {side: [*curve[side], curve[side][-1]]
                           for side in ("share", "low", "high")}
            axis.plot(drawn_at, drawn_share["share"], drawstyle="steps-post", color=colour,
                      linestyle=style.DASHES[place % len(style.DASHES)], linewidth=1.5)
            if len(entries) <= 3:
                axis.fill_between(drawn_at, drawn_share["low"], drawn_share["high"], step="post",
                                  color=colour, alpha=0.15, linewidth=0)
        axis.set_xlabel(words)
        axis.set_ylabel("episodes that had not failed")
        axis.set_ylim(0, 1.02)
        axis.set_xlim(left=0)
    finish(drawn, title, [name for name, _ in entries], dashes=True)
    return drawn


def evenly(values):
    """All of them, or of many as many as can be seen."""
    if len(values) <= MOST_BARS:
        return values
    return [values[round(place * (len(values) - 1) / (MOST_BARS - 1))]
            for place in range(MOST_BARS)]


def draw_paired(title, numbers):
    """Of each metric the differences of the episodes, in order, and their mean and interval."""
    metrics = numbers["metrics"]
    drawn, axes = style.figure(rounded_height(len(metrics), 1.15), len(metrics), 1)
    for axis, metric in zip(axes.flat, metrics):
        differences = evenly(sorted(metric["differences"]))
        sides = (("less", style.COLOURS[0], [value for value in differences if value < 0]),
                 ("equal", style.QUIET, [value for value in differences if value == 0]),
                 ("more", style.COLOURS[1], [value for value in differences if value > 0]))
        at = 0
        for _, colour, values in sides:
            axis.bar(range(at, at + len(values)), values, 0.9, color=colour, linewidth=0)
            at += len(values)
        axis.axhline(0, color="#000000", linewidth=0.7)
        if metric["low"] is not None:
            axis.axhspan(metric["low"], metric["high"], color=style.QUIET, alpha=0.25, linewidth=0)
        axis.axhline(metric["difference"], color="#000000", linestyle="--", linewidth=1)
        unit = f" {metric['unit']}" if metric["unit"] else ""
        words = f"mean {number(metric['difference'], metric['digits'])}{unit}"
        if metric["low"] is not None:
            words += (f" (95 %: {number(metric['low'], metric['digits'])} to "
                      f"{number(metric['high'], metric['digits'])})")
        axis.set_title(f"{heading(metric)}: {words}, p = {p_text(metric['p'])}",
                       fontweight="normal")
        axis.set_xticks([])
        axis.set_ylabel(f"difference ({metric['unit']})" if metric["unit"] else "difference")
        axis.margins(x=0.01)
    axes.flat[-1].set_xlabel(f"{counted(numbers['pairs'], 'episode')} on the same seeds, each "
                             "metric in the order of its differences")
    drawn.suptitle(title, fontsize=10, fontweight="bold", x=0.01, ha="left")
    return drawn


def p_text(p):
    return f"{p:.4f}" if p >= 1e-4 else f"{p:.1e}"
