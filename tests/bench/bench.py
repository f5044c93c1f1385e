#!/usr/bin/env python3
"""Measures the speed of grading against the physics alone, and writes JSON and a table.

    bench.py --build BUILD_DIR --source SOURCE_DIR [--json FILE] [--quick] [--track KIND ...]

tests/bench/README.md says what each figure is and how it is measured."""

import argparse
import datetime
import importlib.util
import json
import os
import pathlib
import platform
import statistics
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import growth  # noqa: E402  (needs the folder above)
import processes  # noqa: E402
import storage  # noqa: E402
from grader import Grader  # noqa: E402

TRACKS = ("manipulation", "locomotion")
EPISODE_STEPS = {"manipulation": 1000, "locomotion": 2000}


class Bench:
    def __init__(self, options):
        self.quick = options.quick
        self.build = pathlib.Path(options.build)
        self.source = pathlib.Path(options.source)
        self.cores = len(os.sched_getaffinity(0))
        self.policies = {"cpp": self.build / "tests/bench/latency",
                         "python": self.build / "tests/bench/zero-python"}

    def say(self, text):
        print(f"  {text}", file=sys.stderr, flush=True)

    # --- physics and environment, in one process ---

    def step_bench(self, grader, track, kind, *words):
        command = [self.build / "tests/myograde_step_bench", grader.configs / "tracks", track,
                   "--steps", EPISODE_STEPS[kind], *words]
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True,
                              timeout=3600)
        if done.returncode != 0:
            raise RuntimeError(done.stderr)
        return json.loads(done.stdout)

    def steps(self, grader, kind):
        """Control steps per second of environment, engine and mj_step on one core."""
        repetitions, episodes = (2, 1) if self.quick else (5, 4)
        return self.step_bench(grader, f"bench-{kind}", kind, "--episodes", episodes,
                               "--repetitions", repetitions)

    def alone(self, grader, kind, threads, leases, episodes, engine=False):
        """The environment, and the engine if asked for, with the very leases of an evaluation:
        episodes differ in what they cost, and a machine's speed changes within minutes, so it is
        measured beside each."""
        return self.step_bench(grader, self.run_track(grader, kind, leases, episodes), kind,
                               "--threads", threads, "--leases", leases, "--episodes", episodes,
                               "--repetitions", 1, *([] if engine else ["--environment-only", 1]))

    # --- one lease at a time, and whole evaluations ---

    def run_track(self, grader, kind, leases, episodes):
        name = f"run-{kind}-{leases}-{episodes}"
        grader.add_track(name, {"extends": f"bench-{kind}", "episodes_per_lease": episodes,
                                "seeds": {"first": 0, "count": leases * episodes}})
        return name

    def evaluate(self, grader, kind, policy, slots, leases, episodes, watch=None):
        """A whole evaluation through a new daemon. Returns its result and its seconds."""
        track = self.run_track(grader, kind, leases, episodes)
        grader.choose_data(f"data-{time.monotonic_ns()}")
        with grader.running_with(slots=slots):
            if watch is not None:
                watch.start(grader.pid)
            result = grader.ask("submit", self.policies[policy], "--track", track, "--team",
                                "Bench", "--wait")
            if watch is not None:
                watch.stop()
            shown = grader.ask("show", result["submission"], "--episodes")
            status = grader.ask("status", result["submission"])
        expected = EPISODE_STEPS[kind]
        short = [row["index"] for row in shown["episode_rows"] if row["steps"] != expected]
        if short:
            raise RuntimeError(f"{kind}: episodes {short} were not played to step {expected}")
        return shown, seconds_between(status["started_at"], status["finished_at"])

    def one_lease(self, grader, kind, policy):
        """Rate within the episodes of a lease that has the machine to itself, what was shown of
        it, and the times of the environment's steps in the same episodes."""
        episodes = 2 if self.quick else 4
        alone = self.alone(grader, kind, 1, 1, episodes)["env_step_s"]
        shown, _ = self.evaluate(grader, kind, policy, 1, 1, episodes)
        rows = shown["episode_rows"]
        rate = sum(row["steps"] for row in rows) / sum(row["wall_s"] for row in rows)
        return rate, shown, alone

    def whole(self, grader, kind, policy):
        """Rates of whole evaluations, and what was measured alone before the first and after
        each."""
        leases, episodes = (4, 2) if self.quick else (10, 10)
        rates = []
        alone = [self.alone(grader, kind, self.cores, leases, episodes, engine=policy == "cpp")]
        # A quick one takes seconds, a whole one a minute and more.
        for _ in range(3 if policy == "cpp" or self.quick else 1):
            shown, seconds = self.evaluate(grader, kind, policy, self.cores, leases, episodes)
            rates.append(sum(row["steps"] for row in shown["episode_rows"]) / seconds)
            alone.append(self.alone(grader, kind, self.cores, leases, episodes))
        return rates, alone

    def lease_start(self, grader, kind):
        """Seconds from a lease's start to the policy's main(), with warm and cold file caches,
        and the largest memory that a simulator had. Looking at memory takes time, so it is done
        in a lease that is not timed."""
        def once(watch=None):
            shown, _ = self.evaluate(grader, kind, "cpp", 1, 1, 1, watch)
            said = processes.last_json(shown["output"][0]["stderr_tail"])
            return said["started_at"] - epoch(shown["started_at"])
        memory = processes.MemoryWatch("myograde-sim")
        once(memory)
        warm = [once() for _ in range(2 if self.quick else 7)]
        cold = []
        for _ in range(0 if self.quick else 3):
            if processes.drop_file_caches():
                cold.append(once())
        times = {"warm_s": summary(warm), "cold_s": summary(cold) if cold else None}
        return times, memory.largest

    def track(self, kind):
        with Grader(self.build / "bin", self.source) as grader:
            self.say(f"{kind}: environment and engine on one core")
            one = self.steps(grader, kind)
            self.say(f"{kind}: one lease, C++ policy")
            cpp, shown, env_step = self.one_lease(grader, kind, "cpp")
            self.say(f"{kind}: one lease, Python policy")
            python, _, _ = self.one_lease(grader, kind, "python")
            self.say(f"{kind}: whole evaluations on {self.cores} cores, C++ policy, each between "
                     "the same leases without all but the environment")
            rates, measured = self.whole(grader, kind, "cpp")
            self.say(f"{kind}: whole evaluations, Python policy")
            python_rates, python_measured = self.whole(grader, kind, "python")
            self.say(f"{kind}: start of a lease")
            start, memory = self.lease_start(grader, kind)
        many = measured[0]
        alone, python_alone = ([run["env"]["median"] for run in runs]
                               for runs in (measured, python_measured))
        over = ratios(rates, between(alone))
        python_over = ratios(python_rates, between(python_alone))
        seen = processes.last_json(shown["output"][0]["stderr_tail"])
        return {
            **{f"{name}_1core": one[name]["median"] for name in ("mjstep", "engine", "env")},
            **{f"{name}_all": many[name]["median"] for name in ("mjstep", "engine")},
            "env_all": statistics.median(alone),
            "env_over_engine": one["env_over_engine"]["median"],
            "env_over_mjstep": one["env_over_mjstep"]["median"],
            "episode_cpp": cpp,
            "episode_python": python,
            "evaluation_all": statistics.median(rates),
            "evaluation_python_all": statistics.median(python_rates),
            "evaluation_over_env": statistics.median(over),
            "python_over_env": statistics.median(python_over),
            "lease_start": start,
            "step_latency_s": {
                part: {"environment": env_step[part], "whole": seen[part],
                       "transport_and_policy": max(0.0, seen[part] - env_step[part])}
                for part in ("p50", "p99", "max")},
            "sim_pss_bytes": memory,
            "log_bytes_per_episode": log_bytes(shown),
            "spread": {"one_core": one, "all_cores": many,
                       "evaluation_all": summary(rates),
                       "evaluation_python_all": summary(python_rates),
                       "evaluation_env_all": summary(alone),
                       "evaluation_over_env": summary(over),
                       "python_over_env": summary(python_over)}}

    def store(self):
        counts = (1000, 10000) if self.quick else (1000, 100000, 1000000)
        self.say("store: submit and leaderboard at " + ", ".join(map(str, counts)) + " rows")
        with Grader(self.build / "bin", self.source) as grader:
            return storage.measure(grader, self.build / "policies/zero", counts)


    def growth(self):
        return growth.measure(self.build, self.source, self.cores, self.quick, self.say)


def epoch(text):
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()


def seconds_between(first, last):
    return epoch(last) - epoch(first)


def between(values):
    """The means of neighbours: a machine's speed changes from one minute to the next."""
    return [(before + after) / 2 for before, after in zip(values, values[1:])]


def ratios(over, under):
    return [value / limit for value, limit in zip(over, under)]


def summary(values):
    return {"median": statistics.median(values), "min": min(values), "max": max(values),
            "values": values}


def log_bytes(shown):
    """Mean bytes of an episode's log as it lies on the disk; None if none was kept."""
    sizes = [row["log"]["packed_bytes"] for row in shown["episode_rows"] if row.get("log")]
    return statistics.mean(sizes) if sizes else None


def table(result):
    lines = [f"{'control steps per second':34}"
             + "".join(f"{kind:>14}" for kind in result["tracks"])]
    names = {
        "mjstep_1core": "five plain mj_step, one core", "engine_1core": "engine calls, one core",
        "env_1core": "environment, one core", "mjstep_all": "five plain mj_step, all cores",
        "engine_all": "engine calls, all cores", "env_all": "environment, all cores",
        "episode_cpp": "one lease, C++ policy", "episode_python": "one lease, Python policy",
        "evaluation_all": "whole evaluation, C++ policy",
        "evaluation_python_all": "whole evaluation, Python policy"}
    ratios = {
        "env_over_engine": "environment / engine calls", "env_over_mjstep": "environment / mj_step",
        "evaluation_over_env": "whole evaluation / environment",
        "python_over_env": "the same with Python"}
    for key, text in names.items():
        lines.append(f"{text:34}" + "".join(f"{t[key]:14.0f}" for t in result["tracks"].values()))
    for key, text in ratios.items():
        lines.append(f"{text:34}" + "".join(f"{t[key]:14.3f}" for t in result["tracks"].values()))
    for part in ("p50", "p99", "max"):
        lines.append(f"{'step as a policy sees it, ' + part + ', us':34}" + "".join(
            f"{1e6 * t['step_latency_s'][part]['whole']:14.0f}" for t in result["tracks"].values()))
    lines.append(f"{'start of a lease, warm, ms':34}" + "".join(
        f"{1e3 * t['lease_start']['warm_s']['median']:14.0f}" for t in result["tracks"].values()))
    lines.append(f"{'memory of a simulator (PSS), MB':34}" + "".join(
        f"{t['sim_pss_bytes'] / 1e6:14.1f}" for t in result["tracks"].values()))
    lines.append(f"{'log of an episode, KB':34}" + "".join(
        f"{(t['log_bytes_per_episode'] or 0) / 1e3:14.1f}" for t in result["tracks"].values()))
    for row in (result["store"] or {}).get("sizes", []):
        lines.append(f"{row['episode_rows']:>9} rows: "
                     f"start {row['start_s']:.2f} s, "
                     f"submit {1e3 * row['submit_s']['median']:.1f} ms, "
                     f"leaderboard {1e3 * row['leaderboard_s']['median']:.1f} ms, "
                     f"{row['bytes_per_row']:.0f} bytes a row")
    return "\n".join(lines + growth_lines(result["growth"]))


def growth_lines(grown):
    if grown is None:
        return []
    lines = []
    for row in grown["by_episodes"]:
        cost = row["daemon_cpu_s_per_episode"]["median"]
        lines.append(f"{row['episodes']:>9} episodes in an evaluation: {1e3 * cost:.2f} ms of the "
                     f"daemon for each, {row['daemon_bytes'] / 1e6:.0f} MB")
    for row in grown["by_teams"]:
        cost = row["daemon_cpu_s_per_episode"]["median"]
        lines.append(f"{row['teams']:>9} teams: {1e3 * cost:.2f} ms of the daemon for an episode")
    for row in grown["scheduler"]["by_leases"]:
        lines.append(f"{row['leases']:>9} queued leases: "
                     f"next start {1e6 * row['next_s']['median']:.1f} us, "
                     f"place in the queue {1e6 * row['place_of_s']['median']:.1f} us")
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", required=True, help="build folder with bin/ and tests/")
    parser.add_argument("--source", required=True, help="the checkout")
    parser.add_argument("--json", metavar="FILE", help="write the JSON to FILE")
    parser.add_argument("--plots", metavar="DIR", help="write a plot (SVG) of each curve to DIR")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions, smaller stores")
    parser.add_argument("--track", action="append", choices=TRACKS, help="only this track")
    options = parser.parse_args()
    if options.json and not pathlib.Path(options.json).absolute().parent.is_dir():
        parser.error(f"--json: there is no folder for {options.json}")
    if options.plots and importlib.util.find_spec("matplotlib") is None:
        sys.exit("error: --plots needs matplotlib, which this Python lacks; install the Debian "
                 "package python3-matplotlib and use /usr/bin/python3")
    bench = Bench(options)
    result = {"cores": bench.cores, "machine": platform.machine(), "quick": bench.quick,
              "load_before": os.getloadavg()[0],
              "tracks": {kind: bench.track(kind) for kind in options.track or TRACKS},
              "store": None if options.track else bench.store(),
              "growth": None if options.track else bench.growth()}
    if options.json:
        pathlib.Path(options.json).write_text(json.dumps(result, indent=2, sort_keys=True) + "\n")
    if options.plots:
        import plots  # only here, as it needs matplotlib
        plots.draw(result, options.plots)
    print(table(result))


if __name__ == "__main__":
    main()
