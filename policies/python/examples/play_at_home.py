#!/usr/bin/env python3
"""Plays a submission of export_policy.py on a track's seeds without a grader, and prints the result
of each episode as a JSON line, its digest included: that of a server, to the bit.

    python -m myograde run play_at_home.py elbow-ppo --episodes 2

Needs myograde[gym]. `python -m myograde run` starts it with the grader's maths functions, without
which digests may differ."""

import argparse
import importlib.util
import json
import pathlib

import gymnasium

import myograde.envs


def load_network(folder: pathlib.Path):
    """The submission's own code, so that it is tried here as well."""
    spec = importlib.util.spec_from_file_location("network", folder / "network.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.of_folder(folder)


def play(env: gymnasium.Env, network, seed: int) -> dict:
    """The info of an episode's last step."""
    observation, _ = env.reset(seed=seed)
    while True:
        observation, _, terminated, truncated, info = env.step(network.act(observation))
        if terminated or truncated:
            return info


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--environment", default="myograde/Elbow-v0",
                        choices=tuple(myograde.envs.ENVIRONMENTS))
    parser.add_argument("--profile", default="", help="of the rules (default: the track's)")
    parser.add_argument("--episodes", type=int, default=2, help="of the track's ranked seeds")
    options = parser.parse_args()
    network = load_network(options.folder)
    track = myograde.envs.ENVIRONMENTS[options.environment]
    env = gymnasium.make(options.environment, profile=options.profile, exact=True)
    for seed in myograde.envs.seeds(track, options.profile).seeds[:options.episodes]:
        info = play(env, network, seed)
        print(json.dumps({"seed": seed, "end": info["end"], "steps": info["steps"],
                          "digest": info["digest"], "actions_digest": info["actions_digest"]}),
              flush=True)


if __name__ == "__main__":
    main()
