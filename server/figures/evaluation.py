"""The numbers of one evaluation that figures and reports show, from its answer by the API
(server/api/ADDRESSES.md, GET /v1/evaluations/ID with rows). Nothing is drawn here.

What a phase withholds is null there, and rows of an older grader have no details: both are left out
of the numbers, and `missing` of an evaluation's numbers says so in words."""

from estimates import histogram, is_number, mean, reached, share, spread
from order import Refused
from plain import counted, plain

# Kinds of course, by their number in the facts.
COURSES = ("flat", "hilly", "rough", "stairs", "mixed")
FORCE = {"name": "peak_force", "title": "peak force", "unit": "N", "digits": 1, "better": "neither"}
NO_FAULT = ("success", "failure")
# Moments that details tell of, in the order in which they usually come.
MOMENTS = {"first_contact_time": "first contact", "handover_time": "handover",
           "release_time": "release", "goal_contact_time": "contact with the goal",
           "peak_force_time": "largest force", "fall_time": "fall", "settle_time": "settled",
           "solved_time": "solved"}


def label(result):
    """Who it is, in a legend or a title."""
    name = result.get("name")
    if result.get("submission") is None:
        return f"{plain(name or 'local run', 32)}, graded locally"
    words = f"{result['submission']}: {plain(result['team'], 32)}"
    return f"{words}, {plain(name, 32)}" if name else words


def rows_of(result):
    return result.get("episode_rows") or []


def played_of(result):
    """The rows without phantoms: trials that the official code counts and ends at once, because the
    one before was solved (profile as-graded). They say nothing of the policy."""
    return [row for row in rows_of(result) if "phantom" not in (row.get("end"), row.get("reason"))]


def played(result):
    """The success rate of the episodes that were played; None if all were."""
    rows = played_of(result)
    if len(rows) == len(rows_of(result)):
        return None
    return share(sum(row.get("outcome") == "success" for row in rows), len(rows))


def part_of(row, key):
    """A part of a row that may be withheld or missing, as an object."""
    part = row.get(key)
    return part if isinstance(part, dict) else {}


def value_of(row, name):
    value = part_of(row, "metrics").get(name)
    return value if is_number(value) else None


def shown_metrics(result):
    return [metric for metric in result.get("metrics") or [] if metric["name"] != "success"]


def kind_of(row):
    """"success", "failure", "fault" or "withheld"."""
    outcome = row.get("outcome")
    if not outcome:
        return "withheld"
    return outcome if outcome in NO_FAULT else "fault"


def withholds_details(result):
    """What a phase withholds of logs it withholds of details, too."""
    return bool({"logs", "metrics"} & set(result.get("withheld") or []))


def missing(result):
    """Sentences about what the API did not tell of this evaluation."""
    sentences = []
    if result.get("withheld"):
        parts = ", ".join(result["withheld"])
        sentences.append(f"The phase withholds these parts until it is published: {parts}.")
    if withholds_details(result):
        return sentences
    rows = rows_of(result)
    without = [row for row in rows if not part_of(row, "details")]
    unplayed = sum(not row.get("steps") for row in without)
    for count, why in ((unplayed, "ended before the first step"),
                       (len(without) - unplayed, "were played by a grader from before details were measured")):
        if count:
            which = "All episodes" if count == len(rows) else f"{count:,} of {counted(len(rows), 'episode')}"
            sentences.append(f"{which} {why}, so details such as joint ranges are missing.")
    return sentences


def headline(result):
    """Each metric's mean with its interval, and the success rate, with and without phantoms."""
    aggregate = result.get("aggregate") or {}
    known = aggregate.get("spread") or {}
    rates = share(aggregate.get("successes"), aggregate.get("episodes")) if (
        is_number(aggregate.get("successes"))) else share(0, 0)
    numbers = []
    for metric in shown_metrics(result):
        if metric["name"] == "success_rate":
            continue
        interval = known.get(metric["name"]) or {}
        numbers.append({**metric, "mean": aggregate.get(metric["name"]),
                        "low": interval.get("low"), "high": interval.get("high")})
    return {"success": rates, "played": played(result), "metrics": numbers}


def values_of(result, metric):
    """The values of the episodes that have one, and of what kind each is."""
    pairs = []
    for row in played_of(result):
        value = value_of(row, metric["name"])
        if value is None and metric is FORCE:
            value = part_of(row, "facts").get(FORCE["name"])
        if is_number(value):
            pairs.append((value, kind_of(row)))
    return pairs


def distributions(result):
    """Of each metric: how its values lie, as quartiles and as a histogram by outcome."""
    metrics = shown_metrics(result)
    if not any("force" in metric["name"] for metric in metrics):
        metrics = metrics + [FORCE]
    found = []
    for metric in metrics:
        pairs = values_of(result, metric)
        if not pairs:
            continue
        values, kinds = zip(*pairs)
        found.append({**metric, **spread(values), "histogram": histogram(values, kinds)})
    if not found:
        raise Refused(nothing(result, "metrics"))
    return found


def nothing(result, what):
    """Why there is nothing to draw."""
    who = f"submission {result['submission']}" if result["submission"] is not None else "the run"
    if what in (result.get("withheld") or []):
        return f"the phase of {who} withholds the {what} of its episodes until it is published"
    if not rows_of(result):
        return f"{who} has no episode yet that ended"
    return f"the episodes of {who} have no {what}"


def has_distance(result):
    return any(metric["name"] == "distance_m" for metric in result.get("metrics") or [])


def courses(result):
    """Per kind of course: the success rate, the distance, the highest obstacle that was passed."""
    by_course = {}
    for row in played_of(result):
        course = part_of(row, "facts").get("course")
        if isinstance(course, int) and not isinstance(course, bool):
            by_course.setdefault(course, []).append(row)
    if not by_course:
        reason = nothing(result, "logs")
        raise Refused(reason if "withholds" in reason or "yet" in reason else
                      f"the episodes of submission {result['submission']} are not on courses of "
                      "several kinds, so there is nothing to compare")
    found = []
    for course, rows in sorted(by_course.items()):
        name = COURSES[course] if 0 <= course < len(COURSES) else f"course {course}"
        known = [row for row in rows if row.get("outcome")]
        successes = sum(row["outcome"] == "success" for row in known)
        distances = [value for row in rows if (value := value_of(row, "distance_m")) is not None]
        found.append({"course": name, "episodes": len(rows),
                      "success": share(successes, len(known)),
                      "distance_m": {**mean(distances), "most": max(distances, default=None)}})
    return found


def obstacles(result):
    """The highest obstacle of each kind that an episode passed, in m; {} if no episode tells."""
    highest = {}
    for row in played_of(result):
        heights = part_of(row, "details").get("obstacle_heights")
        for kind, height in (heights if isinstance(heights, dict) else {}).items():
            if is_number(height):
                highest[plain(kind, 32)] = max(height, highest.get(plain(kind, 32), 0.0))
    return highest


def survival(result):
    """The share of episodes that had not failed by each time, and at each distance."""
    rows = [row for row in played_of(result) if row.get("outcome")]
    failed = [row for row in rows if row["outcome"] != "success"]
    times = [row["sim_time_s"] for row in failed if is_number(row.get("sim_time_s"))]
    curves = {}
    if rows and len(times) == len(failed):
        curves["time_s"] = reached(times, len(rows))
    distances = [value for row in failed if (value := value_of(row, "distance_m")) is not None]
    if rows and has_distance(result) and len(distances) == len(failed):
        curves["distance_m"] = reached(distances, len(rows))
    if not curves:
        raise Refused(nothing(result, "metrics" if rows else "outcomes"))
    return {"episodes": len(rows), "failed": len(failed), "curves": curves,
            "farthest": {"time_s": max((row["sim_time_s"] for row in rows
                                        if is_number(row.get("sim_time_s"))), default=None),
                         "distance_m": max((value for row in rows if (value := value_of(
                             row, "distance_m")) is not None), default=None)}}


def joints(result):
    """Of each joint the smallest and the largest angle of all episodes against its limits, and
    where half of the episodes had theirs; in rad, as measured. [] if no episode tells."""
    by_joint = {}
    for row in played_of(result):
        ranges = part_of(row, "details").get("joint_ranges")
        for name, values in (ranges if isinstance(ranges, dict) else {}).items():
            if isinstance(values, list) and len(values) == 4 and all(map(is_number, values)):
                by_joint.setdefault(plain(name, 40), []).append(values)
    found = []
    for name, ranges in by_joint.items():
        lows, highs = spread([one[0] for one in ranges]), spread([one[1] for one in ranges])
        found.append({"joint": name, "episodes": len(ranges), "unit": "rad",
                      "least": lows["least"], "most": highs["most"],
                      "median_least": lows["quartiles"][1], "median_most": highs["quartiles"][1],
                      "limit_low": ranges[0][2], "limit_high": ranges[0][3]})
    return found


def joint_pain(result):
    """Of each joint the mean over episodes of its pain per step, largest first."""
    by_joint = {}
    for row in played_of(result):
        pains = part_of(row, "details").get("pain_by_joint")
        steps = row.get("steps")
        if not isinstance(pains, dict) or not is_number(steps) or steps <= 0:
            continue
        for name, pain in pains.items():
            if is_number(pain):
                by_joint.setdefault(plain(name, 40), []).append(pain / steps)
    found = [{"joint": name, **mean(pains)} for name, pains in by_joint.items()]
    return sorted(found, key=lambda joint: -joint["mean"])


def moments(result):
    """When things happened in the episodes in which they did, in s of simulated time."""
    found = []
    for key, title in MOMENTS.items():
        times = [time for row in played_of(result)
                 if is_number(time := part_of(row, "details").get(key))]
        if times:
            found.append({"moment": title, "episodes": len(times), "unit": "s", **spread(times)})
    return found


def endings(result):
    """How many episodes ended in which way."""
    counts = {}
    for row in rows_of(result):
        way = row.get("reason") or row.get("outcome")
        if way:
            counts[plain(way, 40)] = counts.get(plain(way, 40), 0) + 1
    return dict(sorted(counts.items(), key=lambda one: (-one[1], one[0])))
