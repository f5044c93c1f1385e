#!/usr/bin/python3
"""Draws what the bench measured: one SVG for each curve, and bars of steps per second.

    plots.py JSON DIR

JSON is what `bench.py --json` wrote. Points are medians, bars around them reach from the smallest
to the largest measurement. Needs matplotlib (Debian package python3-matplotlib)."""

import json
import pathlib
import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402  (after the choice of its output)

COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"]
LIMIT = {"color": "#555555", "linestyle": "--", "linewidth": 1.2}
STEPS = {"manipulation": 1000, "locomotion": 2000}  # of an episode of the bench
# Of the environment's rate, what the project wants to reach.
TARGETS = {"manipulation": {"evaluation_all": 0.92, "evaluation_python_all": 0.82},
           "locomotion": {"evaluation_all": 0.88, "evaluation_python_all": 0.75}}
BARS = [  # of the figure: key, name, key of its limit, where its spread is
    ("mjstep_1core", "mj_step × 5\n1 core", "mjstep_1core", ("one_core", "mjstep")),
    ("engine_1core", "engine calls\n1 core", "mjstep_1core", ("one_core", "engine")),
    ("env_1core", "environment\n1 core", "mjstep_1core", ("one_core", "env")),
    ("episode_cpp", "one lease\nC++ policy", "mjstep_1core", None),
    ("episode_python", "one lease\nPython policy", "mjstep_1core", None),
    ("mjstep_all", "mj_step × 5\nall cores", "mjstep_all", ("all_cores", "mjstep")),
    ("engine_all", "engine calls\nall cores", "mjstep_all", ("all_cores", "engine")),
    ("env_all", "environment\nall cores", "mjstep_all", ("all_cores", "env")),
    ("evaluation_all", "evaluation\nC++ policy", "mjstep_all", ("evaluation_all",)),
    ("evaluation_python_all", "evaluation\nPython policy", "mjstep_all",
     ("evaluation_python_all",))]
STYLE = {"svg.hashsalt": "myograde", "svg.fonttype": "path", "font.size": 11, "axes.grid": True,
         "grid.color": "#dddddd", "axes.axisbelow": True, "axes.spines.top": False,
         "axes.spines.right": False, "figure.constrained_layout.use": True}


def save(figure, folder, name):
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    plt.close(figure)


def reach(spread, scale=1):
    """Lengths of an error bar below and above the median."""
    return (scale * (spread["median"] - spread["min"]), scale * (spread["max"] - spread["median"]))


def curve(folder, name, title, x_label, y_label, lines, limits=(), y_log=False):
    """`lines`: {label: [(x, median, below, above)]}, left out if it has no points.
    `limits`: [(y, label)]."""
    figure, axes = plt.subplots(figsize=(8, 4.8))
    lines = {label: measured for label, measured in lines.items() if measured}
    for (label, measured), colour in zip(lines.items(), COLOURS):
        xs, ys, below, above = zip(*measured)
        axes.errorbar(xs, ys, yerr=(below, above), label=label, color=colour, marker="o",
                      markersize=5, capsize=4, linewidth=1.6)
    for y, label in limits:
        axes.axhline(y, label=label, **LIMIT)
    axes.set_xscale("log")
    if y_log:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, 1.08 * axes.get_ylim()[1])
    every = sorted({point[0] for measured in lines.values() for point in measured})
    axes.set_xticks(every, [f"{x:,}".replace(",", " ") for x in every])
    axes.minorticks_off()
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    # Below the axes, so that it hides nothing.
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=3, frameon=False)
    save(figure, folder, name)


def points(rows, x, y, scale):
    """The rows that have `y`, a spread or a number."""
    found = []
    for row in rows:
        if row.get(y) is None:
            continue
        spread = row[y] if isinstance(row[y], dict) else dict.fromkeys(("median", "min", "max"),
                                                                       row[y])
        found.append((row[x], scale * spread["median"], *reach(spread, scale)))
    return found


def bars(result, folder):
    for kind, figures in result["tracks"].items():
        figure, axes = plt.subplots(figsize=(11, 5.2))
        for place, (key, _, limit, where) in enumerate(BARS):
            spread = figures["spread"] if where else None
            for step in where or ():
                spread = spread.get(step) if spread else None
            value = figures[key]
            # The limit is what its bar is measured against.
            colour = "#777777" if key == limit else COLOURS[0] if place < 5 else COLOURS[2]
            axes.bar(place, value, 0.72, color=colour,
                     yerr=[[x] for x in reach(spread)] if spread else None, capsize=4)
            share = "" if key == limit else f"\n{value / figures[limit]:.2f}"
            axes.annotate(f"{value:.0f}{share}", (place, 0), (0, 6), textcoords="offset points",
                          ha="center", va="bottom", fontsize=10, color="white", weight="bold")
            if key in TARGETS[kind]:
                wanted = TARGETS[kind][key] * figures["env_all"]
                axes.hlines(wanted, place - 0.42, place + 0.42, color=COLOURS[1], linewidth=2,
                            label="wanted: a share of the environment"
                                  if key == "evaluation_all" else None)
        for core, first, last in (("1core", -0.5, 4.5), ("all", 4.5, 9.5)):
            axes.hlines(figures[f"mjstep_{core}"], first, last, **LIMIT,
                        label="limit: five plain mj_step" if core == "all" else None)
        axes.set_xticks(range(len(BARS)), [bar[1] for bar in BARS], fontsize=9)
        axes.set(ylabel="control steps per second",
                 title=f"{kind.capitalize()}: grading against the physics alone "
                       f"({result['cores']} cores; below a rate its share of the limit)")
        axes.margins(y=0.08)
        axes.grid(axis="x", visible=False)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)
        save(figure, folder, f"steps_{kind}")


def growth(result, folder):
    grown = result["growth"]
    physics = [STEPS[kind] / figures["engine_1core"] for kind, figures in result["tracks"].items()]
    # A thousandth of so many seconds is so many milliseconds.
    limits = [(min(physics), "1 ‰ of an episode's physics")]
    curve(folder, "growth_episodes",
          "What an episode costs the daemon, by length of the evaluation",
          "episodes of the evaluation", "daemon's processor time per episode, ms",
          {"all of it": points(grown["by_episodes"], "episodes", "daemon_cpu_s_per_episode", 1e3),
           "each after the first": points(grown["by_episodes"], "episodes",
                                          "daemon_cpu_s_per_further_episode", 1e3)}, limits)
    curve(folder, "growth_teams", "What an episode costs the daemon, by number of teams",
          "teams", "daemon's processor time per episode, ms",
          {"leases of ten episodes": points(grown["by_teams"], "teams",
                                            "daemon_cpu_s_per_episode", 1e3)}, limits)
    calls = {"Next": "next_s", "Finished": "finished_s", "Add": "add_s", "PlaceOf": "place_of_s",
             "NextDeadline": "deadline_s", "Escalate": "escalate_s"}
    for name, x, label in (("leases", "leases", "queued leases (200 teams)"),
                           ("teams", "teams", "teams (the longest queue)")):
        # From the median to the 99th hundredth: the largest of thousands tells of the host.
        lines = {call: [(row[x], 1e6 * row[key]["median"], 0,
                         1e6 * (row[key]["p99"] - row[key]["median"]))
                        for row in grown["scheduler"][f"by_{name}"]] for call, key in calls.items()}
        curve(folder, f"growth_scheduler_{name}", f"The scheduler's decisions, by number of {name}",
              label, "time of a call, µs (bar: to the 99th of 100)", lines, y_log=True)
    curve(folder, "growth_memory", "Memory of the daemon", "episodes of the evaluation, or teams",
          "resident memory, MB",
          {"by episodes": points(grown["by_episodes"], "episodes", "daemon_bytes", 1e-6),
           "by teams": points(grown["by_teams"], "teams", "daemon_bytes", 1e-6)})


def store(result, folder):
    sizes = result["store"]["sizes"]
    curve(folder, "growth_store", "Commands against a store of many episodes",
          "episode rows in the store", "time of the command, ms",
          {"submit": points(sizes, "episode_rows", "submit_s", 1e3),
           "leaderboard": points(sizes, "episode_rows", "leaderboard_s", 1e3)},
          [(1e3 * result["store"]["program_start_s"], "limit: start of the program")])
    curve(folder, "growth_store_bytes", "Size of the store", "episode rows in the store",
          "bytes per episode row",
          {"the whole store": points(sizes, "episode_rows", "bytes_per_row", 1)})


def draw(result, folder):
    """Writes the plots of what `result` has: a part that was left out has none."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        bars(result, folder)
        if result.get("growth"):
            growth(result, folder)
        if result.get("store"):
            store(result, folder)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: plots.py JSON DIR")
    draw(json.loads(pathlib.Path(sys.argv[1]).read_text()), sys.argv[2])
