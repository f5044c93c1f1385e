"""Figures of boards."""

import datetime

import style
from drawings import finish, whiskers
from plain import heading, plain

MOST_NAMED = 8  # lines with a colour of their own
MOST_ROWS = 40  # of the figure of intervals


def time_of(text):
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00"))


def draw_history(title, numbers):
    """The first number of each team over time: the best by the board's rules have names."""
    from matplotlib import dates  # pylint: disable=import-outside-toplevel
    drawn, axes = style.figure(3.4)
    axis = axes[0][0]
    moments = [time_of(moment) for moment in numbers["moments"]]
    named = numbers["teams"][:MOST_NAMED]
    for team in reversed(numbers["teams"][MOST_NAMED:]):
        axis.plot(moments, nans(team["values"]), drawstyle="steps-post", color="#bbbbbb",
                  linewidth=0.8)
    for place, team in reversed(list(enumerate(named))):
        axis.plot(moments, nans(team["values"]), drawstyle="steps-post", linewidth=1.6,
                  color=style.COLOURS[place], linestyle=style.DASHES[place], marker="o",
                  markersize=2.2)
    locator = dates.AutoDateLocator(tz=datetime.timezone.utc, maxticks=7)
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator, tz=datetime.timezone.utc))
    if len(set(moments)) == 1:
        axis.set_xlim(moments[0] - datetime.timedelta(hours=1),
                      moments[0] + datetime.timedelta(hours=1))
    axis.set_xlabel("time (UTC)")
    axis.set_ylabel(heading(numbers["criterion"]))
    axis.margins(y=0.08)
    names = [team["team"] for team in named]
    handles = style.handles(len(named), dashes=True)
    if len(numbers["teams"]) > len(named):
        from matplotlib.lines import Line2D  # pylint: disable=import-outside-toplevel
        handles.append(Line2D([], [], color="#bbbbbb", linewidth=0.8))
        names.append(f"{len(numbers['teams']) - len(named)} other teams")
    finish(drawn, title, names, handles=handles, always=True)
    return drawn


def nans(values):
    return [float("nan") if value is None else value for value in values]


def draw_intervals(title, criterion, rows):
    """The first number of the first rows with its interval."""
    rows = [row for row in rows if row["numbers"].get(criterion["name"], {}).get("value")
            is not None][:MOST_ROWS]
    if not rows:
        return None
    drawn, axes = style.figure(max(2.0, 0.8 + 0.2 * len(rows)))
    axis = axes[0][0]
    for place, row in enumerate(rows):
        one = row["numbers"][criterion["name"]]
        colour = style.QUIET if row["rank"] is None else style.COLOURS[0]
        whiskers(axis, place, one["value"], one["low"], one["high"], colour, across=True)
    axis.set_yticks(range(len(rows)), [
        f"{'baseline' if row['rank'] is None else row['rank']}  {plain(row['team'], 32)}"
        for row in rows])
    axis.invert_yaxis()
    axis.grid(axis="x")
    axis.grid(False, axis="y")
    axis.set_xlabel(f"{heading(criterion)}, mean and 95 % interval")
    finish(drawn, title, [])
    return drawn
