#!/usr/bin/env python3
"""Control steps per second of other people's environments beside ours, in the same run.

Run by run.sh, which makes the virtual environments. All play the zero action. The environments in
Python take turns, so that what slows the machine down for a while slows all of them down. README.md
of the folder above says what each figure is."""

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
TURNS = 7
# The maths functions that a grader's simulators have (protocol/base/pinned_maths.h).
PINNED = {"GLIBC_TUNABLES":
          "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL,-AVX"}
OTHERS = {"myosuite": "MyoSuite, Python", "loop": "official style of loop (gRPC, pickle)",
          "envpool": "EnvPool, C++"}
VECTOR = {"vector": "ours, Gymnasium's vector environment"}
IN_PYTHON = {**OTHERS, **VECTOR}
OURS = {**VECTOR,
        "env": "ours, environment alone", "evaluation": "ours, whole evaluation, C++ policy",
        "evaluation_python": "ours, whole evaluation, Python"}


class Unavailable(RuntimeError):
    pass


def start(python, what, track, steps, environments=1):
    return subprocess.Popen(
        [python, "-B", "-W", "ignore", str(HERE / "one.py"), what, track, "--steps", str(steps),
         "--environments", str(environments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        # One thread each, as the cores are shared out by processes, or by EnvPool and ours themselves.
        env=dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1",
                 **(PINNED if what in VECTOR else {})))


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
    """Steps per second of all cores together. EnvPool and ours have a thread for each environment,
    the others a process."""
    processes = []
    try:
        if what in ("envpool", "vector"):
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
            "cpu_rate": (sum(result["steps"] for result in results)
                         / sum(result["cpu_seconds"] for result in results)),
            "ends": sum(result["ends"] for result in results)}


class Contender:
    """One of the environments in Python on one track, and what was measured of it."""

    def __init__(self, what, options, track):
        self.what, self.track = what, track
        self.python = getattr(options, what)
        why = " ".join(getattr(options, f"{what}_why").split())
        self.skipped = None if self.python else why or "its packages are not installed"
        self.turns = {}  # by one_core and all_cores

    def take_turn(self, name, steps, cores):
        if self.skipped:
            return
        try:
            turn = rate(self.python, self.what, self.track, steps, cores)
        except Unavailable as error:
            self.skipped = str(error)
        else:
            self.turns.setdefault(name, []).append(turn)

    def figures(self):
        if self.skipped:
            return {"skipped": self.skipped}
        return {name: {**summary([turn["rate"] for turn in turns]),
                       "cpu": summary([turn["cpu_rate"] for turn in turns]),
                       "episodes_ended": sum(turn["ends"] for turn in turns)}
                for name, turns in self.turns.items()}


def summary(rates):
    return {"median": statistics.median(rates), "min": min(rates), "max": max(rates),
            "turns": rates}


def in_turns(track, options, cores, say):
    """The figures of the environments in Python, or why there are none."""
    contenders = [Contender(what, options, track) for what in IN_PYTHON]
    steps, turns = (200, 1) if options.quick else (500, TURNS)
    for name, count in (("one_core", 1), ("all_cores", cores)):
        for turn in range(turns):
            say(f"{track}: environments in Python on {count} core{'s' * (count > 1)}, turn "
                f"{turn + 1} of {turns}")
            for contender in contenders:
                contender.take_turn(name, steps, count)
    return {contender.what: contender.figures() for contender in contenders}


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


def ratio(mine, theirs):
    """The median over turns, where both took turns."""
    if "turns" in mine and len(mine["turns"]) == len(theirs.get("turns", ())):
        return statistics.median(a / b for a, b in zip(mine["turns"], theirs["turns"]))
    return mine["median"] / theirs["median"]


def ratios(figures):
    """Ours over each of the others, by cores."""
    found = {}
    for mine in OURS:
        for theirs in OTHERS:
            for cores in ("one_core", "all_cores"):
                if cores in figures[mine] and cores in figures[theirs]:
                    found[f"{mine}_over_{theirs}_{cores}"] = ratio(figures[mine][cores],
                                                                   figures[theirs][cores])
    # By CPU time, which other programs on the machine change less. (Most of the loop's is its
    # server's.)
    for theirs in ("envpool", "myosuite"):
        one = [figures[name].get("one_core", {}).get("cpu") for name in ("vector", theirs)]
        if all(one):
            found[f"vector_over_{theirs}_one_core_cpu"] = ratio(*one)
    return found


def table(result):
    lines = []
    for track, figures in result["tracks"].items():
        lines.append(f"{track + ', control steps per second':40}{'one core':>10}"
                     f"{'all cores':>11}{'ours in Python over it':>25}")
        for key, text in {**OTHERS, **OURS}.items():
            if "skipped" in figures[key]:
                lines.append(f"{text:40}   skipped: {figures[key]['skipped']}")
                continue
            cells = [f"{figures[key][cores]['median']:.0f}" if cores in figures[key] else "-"
                     for cores in ("one_core", "all_cores")]
            over = [f"{figures['ratios'][name]:.2f}" for name in
                    (f"vector_over_{key}_one_core", f"vector_over_{key}_all_cores")
                    if name in figures["ratios"]]
            lines.append(f"{text:40}{cells[0]:>10}{cells[1]:>11}{' / '.join(over):>25}")
        by_cpu = [f"{OTHERS[key]} {figures['ratios'][name]:.2f}" for key in ("envpool", "myosuite")
                  if (name := f"vector_over_{key}_one_core_cpu") in figures["ratios"]]
        if by_cpu:
            lines.append(f"ours in Python over theirs on one core, by CPU time: {', '.join(by_cpu)}")
        lines.append("")
    return "\n".join(lines).rstrip()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", required=True, help="build folder, as for bench.py")
    parser.add_argument("--source", required=True, help="the checkout")
    for what, text in IN_PYTHON.items():
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
        figures = in_turns(track, options, measured.cores, measured.say)
        measured.say(f"{track}: ours")
        figures.update(ours(measured, track, options.quick))
        figures["ratios"] = ratios(figures)
        result["tracks"][track] = figures
    if options.json:
        pathlib.Path(options.json).write_text(json.dumps(result, indent=2, sort_keys=True) + "\n")
    print(table(result))


if __name__ == "__main__":
    main()
