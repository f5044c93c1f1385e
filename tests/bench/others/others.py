#!/usr/bin/env python3
"""Control steps per second of other people's environments beside ours, in the same run.

Run by run.sh, which makes the virtual environments. All play the zero action. README.md of the
folder above says what each figure is."""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import bench  # noqa: E402  (in the folder above)
from grader import Grader  # noqa: E402

TIMEOUT_S = 900
OTHERS = {"myosuite": "MyoSuite, Python", "loop": "official style of loop (gRPC, pickle)",
          "envpool": "EnvPool, C++"}
OURS = {"env": "ours, environment alone", "evaluation": "ours, whole evaluation, C++ policy",
        "evaluation_python": "ours, whole evaluation, Python"}


class Unavailable(RuntimeError):
    pass


def start(python, what, track, steps, environments=1):
    return subprocess.Popen(
        [python, "-B", "-W", "ignore", str(HERE / "one.py"), what, track, "--steps", str(steps),
         "--environments", str(environments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        # One thread each, as the cores are shared out by processes or by EnvPool itself.
        env=dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1"))


def finish(process):
    try:
        out, err = process.communicate(timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise Unavailable(f"it was not done after {TIMEOUT_S} s") from None
    if process.returncode != 0:
        # The last line that says something.
        said = [line.strip() for line in err.splitlines() if len(line.strip()) > 3]
        raise Unavailable(said[-1] if said else f"exit {process.returncode}")
    return json.loads(out.splitlines()[-1])


def rate(python, what, track, steps, cores):
    """Steps per second of all cores together. EnvPool has a thread for each environment, the
    others a process."""
    processes = []
    try:
        if what == "envpool":
            processes.append(start(python, what, track, steps, cores))
        else:
            processes += [start(python, what, track, steps) for _ in range(cores)]
        results = [finish(process) for process in processes]
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()
    return {"rate": sum(result["steps"] / result["seconds"] for result in results),
            "ends": sum(result["ends"] for result in results)}


def other(python, why, what, track, options, cores):
    """The figures of one of the others, or why there are none."""
    if not python:
        return {"skipped": " ".join(why.split()) or "its packages are not installed"}
    steps, repetitions = (200, 1) if options.quick else (1000, 3)
    figures = {}
    try:
        for name, count in (("one_core", 1), ("all_cores", cores)):
            runs = [rate(python, what, track, steps, count) for _ in range(repetitions)]
            rates = [run["rate"] for run in runs]
            figures[name] = {"median": statistics.median(rates), "min": min(rates),
                             "max": max(rates), "episodes_ended": sum(r["ends"] for r in runs)}
    except Unavailable as error:
        return {"skipped": str(error)}
    return figures


def ours(measured, track, quick):
    """Of the environment alone and of whole evaluations through the daemon."""
    figures = {"env": {}}
    leases, episodes = (2, 1) if quick else (4, 2)
    with Grader(measured.build / "bin", measured.source) as grader:
        for name, threads in (("one_core", 1), ("all_cores", measured.cores)):
            rates = [measured.alone(grader, track, threads, leases, episodes)["env"]["median"]
                     for _ in range(1 if quick else 3)]
            figures["env"][name] = {"median": statistics.median(rates), "min": min(rates),
                                    "max": max(rates)}
        for name, policy in (("evaluation", "cpp"), ("evaluation_python", "python")):
            rates = []
            for _ in range(1 if quick else 3):
                shown, seconds = measured.evaluate(grader, track, policy, measured.cores, leases,
                                                   episodes)
                rates.append(sum(row["steps"] for row in shown["episode_rows"]) / seconds)
            figures[name] = {"all_cores": {"median": statistics.median(rates), "min": min(rates),
                                           "max": max(rates)}}
    return figures


def ratios(figures):
    """Ours over each of the others, by cores."""
    found = {}
    for mine in OURS:
        for theirs in OTHERS:
            for cores in ("one_core", "all_cores"):
                if cores in figures[mine] and cores in figures[theirs]:
                    found[f"{mine}_over_{theirs}_{cores}"] = (
                        figures[mine][cores]["median"] / figures[theirs][cores]["median"])
    return found


def table(result):
    lines = []
    for track, figures in result["tracks"].items():
        lines.append(f"{track + ', control steps per second':40}{'one core':>10}"
                     f"{'all cores':>11}{'environment of ours over it':>30}")
        for key, text in {**OTHERS, **OURS}.items():
            if "skipped" in figures[key]:
                lines.append(f"{text:40}   skipped: {figures[key]['skipped']}")
                continue
            cells = [f"{figures[key][cores]['median']:.0f}" if cores in figures[key] else "-"
                     for cores in ("one_core", "all_cores")]
            over = [f"{figures['ratios'][name]:.2f}" for name in
                    (f"env_over_{key}_one_core", f"env_over_{key}_all_cores")
                    if name in figures["ratios"]]
            lines.append(f"{text:40}{cells[0]:>10}{cells[1]:>11}{' / '.join(over):>30}")
        lines.append("")
    return "\n".join(lines).rstrip()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", required=True, help="build folder, as for bench.py")
    parser.add_argument("--source", required=True, help="the checkout")
    for what, text in OTHERS.items():
        parser.add_argument(f"--{what}", default="", metavar="PYTHON", help=f"that has {text}")
        parser.add_argument(f"--{what}-why", default="", metavar="TEXT", help="why there is none")
    parser.add_argument("--json", metavar="FILE", help="write the JSON to FILE")
    parser.add_argument("--quick", action="store_true", help="one repetition of fewer steps")
    options = parser.parse_args()
    if options.json and not pathlib.Path(options.json).absolute().parent.is_dir():
        parser.error(f"--json: there is no folder for {options.json}")
    measured = bench.Bench(options)
    result = {"cores": measured.cores, "quick": options.quick, "load_before": os.getloadavg()[0],
              "tracks": {}}
    for track in bench.TRACKS:
        figures = {}
        for what, text in OTHERS.items():
            measured.say(f"{track}: {text}")
            figures[what] = other(getattr(options, what), getattr(options, f"{what}_why"), what,
                                  track, options, measured.cores)
        measured.say(f"{track}: ours")
        figures.update(ours(measured, track, options.quick))
        figures["ratios"] = ratios(figures)
        result["tracks"][track] = figures
    if options.json:
        pathlib.Path(options.json).write_text(json.dumps(result, indent=2, sort_keys=True) + "\n")
    print(table(result))


if __name__ == "__main__":
    main()
