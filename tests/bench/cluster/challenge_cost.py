#!/usr/bin/python3
"""What a challenge costs on machines of a cluster, from what the bench measured on one machine.

    challenge_cost.py BENCH.json [--submissions 292] [--episodes 100] [--lease-episodes 10]
                      [--machines 1] [--vcpus 16] [--steps manipulation=1000,locomotion=30000]
                      [--json]

Of each track, with the rate of whole evaluations on all of the bench's processors (`evaluation_all`):

    rate  = evaluation_all / cores                  control steps per second of one vCPU
    lease = start + lease_episodes * steps / rate   seconds of one lease
    hours = submissions * (episodes / lease_episodes) * lease / (machines * vcpus) / 3600
    leases per second = machines * vcpus / lease

with one lease per vCPU, and `start` as measured (`lease_start`). The defaults are the paper's challenge
on c5.4xlarge machines (16 vCPUs: two threads of each of 8 cores, as the bench counts them), with every
episode played to its time limit, which is the most that it can cost."""

import argparse
import json
import math
import pathlib
import sys

STEPS = {"manipulation": 1000, "locomotion": 30_000}  # 10 s and 300 s at 100 Hz


def steps_of(text):
    steps = dict(STEPS)
    for entry in filter(None, text.split(",")):
        name, _, number = entry.partition("=")
        if name not in STEPS or not number.isdigit() or int(number) == 0:
            raise argparse.ArgumentTypeError(f"{entry!r} is not a TRACK=NUMBER of {', '.join(STEPS)}")
        steps[name] = int(number)
    return steps


def cost(figures, cores, steps, options):
    """The numbers of one track."""
    rate = figures["evaluation_all"] / cores
    start = figures["lease_start"]["warm_s"]["median"]
    lease = start + options.lease_episodes * steps / rate
    leases = options.submissions * math.ceil(options.episodes / options.lease_episodes)
    slots = options.machines * options.vcpus
    return {"steps_per_s_of_a_vcpu": rate, "steps_of_an_episode": steps, "lease_s": lease,
            "leases": leases, "hours": leases * lease / slots / 3600,
            "vcpu_hours": leases * lease / 3600, "leases_per_s": slots / lease}


def parse(words):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("bench", type=pathlib.Path, metavar="BENCH.json")
    for name, usual in (("submissions", 292), ("episodes", 100), ("lease-episodes", 10),
                        ("machines", 1), ("vcpus", 16)):
        parser.add_argument(f"--{name}", type=int, default=usual)
    parser.add_argument("--steps", type=steps_of, default=dict(STEPS))
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(words)
    for name in ("submissions", "episodes", "lease_episodes", "machines", "vcpus"):
        if getattr(options, name) < 1:
            parser.error(f"--{name.replace('_', '-')} must be 1 or more")
    return options


def costs(result, options):
    return {name: cost(figures, result["cores"], options.steps[name], options)
            for name, figures in result["tracks"].items() if name in STEPS}


def main(words):
    options = parse(words)
    tracks = costs(json.loads(options.bench.read_text()), options)
    if options.json:
        print(json.dumps(tracks, indent=2))
        return
    print(f"{options.submissions} submissions of {options.episodes} episodes on {options.machines} "
          f"machines of {options.vcpus} vCPUs:")
    for name, track in tracks.items():
        print(f"{name}: {track['leases']} leases of {track['lease_s']:.1f} s "
              f"({track['steps_per_s_of_a_vcpu']:.0f} steps/s of a vCPU), {track['hours']:.2f} h, "
              f"{track['vcpu_hours']:.0f} vCPU hours, {track['leases_per_s']:.3f} leases/s")
    print(f"together: {sum(track['hours'] for track in tracks.values()):.2f} h")


if __name__ == "__main__":
    main(sys.argv[1:])
