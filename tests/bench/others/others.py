#!/usr/bin/env python3
"""Control steps per second of other people's environments beside ours, in the same run.

Run by run.sh, which makes the virtual environments. All play the zero action. The environments in
Python take turns, so that what slows the machine down for a while slows all of them down. README.md
of the folder above says what each figure is."""

import argparse
import json
import os
import pathlib
import select
import statistics
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import bench  # noqa: E402  (in the folder above)
from grader import Grader  # noqa: E402

TIMEOUT_S = 300  # of a turn, or a start
STEPS, TURNS = 100, 40
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


class Player:
    """One process of one.py, which stays between its turns so that they can be short."""

    def __init__(self, python, what, track, environments):
        self.process = subprocess.Popen(
            [python, "-B", "-W", "ignore", str(HERE / "one.py"), what, track, "--environments",
             str(environments)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            # One thread each, as the cores are shared out by processes, or by EnvPool and ours
            # themselves.
            env=dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1",
                     **(PINNED if what in VECTOR else {})))

    def begin(self, steps):
        try:
            self.process.stdin.write(f"{steps}\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            pass  # the answer says so

    def answer(self):
        """What the process says next."""
        if not select.select([self.process.stdout], [], [], TIMEOUT_S)[0]:
            raise Unavailable(f"it said nothing for {TIMEOUT_S} s")
        line = self.process.stdout.readline()
        if not line:
            raise Unavailable(f"exit {self.process.wait(timeout=TIMEOUT_S)}")
        return json.loads(line)

    def end(self):
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()


class Contender:
    """One of the environments in Python on one track, and what was measured of it."""

    def __init__(self, what, options, track):
        self.what, self.track = what, track
        self.python = getattr(options, what)
        why = " ".join(getattr(options, f"{what}_why").split())
        self.skipped = None if self.python else why or "its packages are not installed"
        self.players = []
        self.turns = {}  # by one_core and all_cores

    def start(self, cores):
        """EnvPool and ours have a thread for each environment, the others a process."""
        together = self.what in ("envpool", "vector")
        if not self.skipped:
            self.players = [Player(self.python, self.what, self.track, cores if together else 1)
                            for _ in range(1 if together else cores)]
            self.attempt(lambda: [player.answer() for player in self.players])

    def end(self):
        for player in self.players:
            player.end()
        self.players = []

    def attempt(self, work):
        try:
            return work()
        except (Unavailable, OSError, ValueError, subprocess.TimeoutExpired) as error:
            self.skipped = str(error)
            self.end()

    def take_turn(self, name, steps):
        if self.skipped:
            return
        for player in self.players:
            player.begin(steps)
        results = self.attempt(lambda: [player.answer() for player in self.players])
        if results:
            self.turns.setdefault(name, []).append({
                "rate": sum(result["steps"] / result["seconds"] for result in results),
                "cpu_rate": (sum(result["steps"] for result in results)
                             / sum(result["cpu_seconds"] for result in results)),
                "ends": sum(result["ends"] for result in results)})

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
    turns = 4 if options.quick else TURNS
    for name, count in (("one_core", 1), ("all_cores", cores)):
        say(f"{track}: environments in Python on {count} core{'s' * (count > 1)}, {turns} turns")
        try:
            for contender in contenders:
                contender.start(count)
            for _ in range(turns):
                for contender in contenders:
                    contender.take_turn(name, STEPS)
        finally:
            for contender in contenders:
                contender.end()
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
