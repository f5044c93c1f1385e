#!/usr/bin/env python3
"""Plays episodes with random actions in a graded environment, and tells how they ended.

    python random_rollout.py --environment myograde/Locomotion-v0 --episodes 2 --picture last.ppm

Needs myograde[gym]."""

import argparse
import pathlib

import gymnasium
import numpy as np

import myograde.envs


def play(env: gymnasium.Env, seed: int) -> tuple[float, dict]:
    """The reward's sum over an episode, and the last step's info."""
    env.action_space.seed(seed)
    env.reset(seed=seed)
    total, ended = 0.0, False
    while not ended:
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        total += float(reward)
        ended = terminated or truncated
    return total, info


def write_ppm(path: pathlib.Path, picture: np.ndarray) -> None:
    """An image file that needs no library."""
    height, width, _ = picture.shape
    path.write_bytes(f"P6 {width} {height} 255\n".encode() + picture.tobytes())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environment", default="myograde/Elbow-v0",
                        choices=tuple(myograde.envs.ENVIRONMENTS))
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0, help="of the first episode")
    parser.add_argument("--picture", type=pathlib.Path, metavar="FILE.ppm",
                        help="draw the last state")
    options = parser.parse_args()
    env = gymnasium.make(options.environment,
                         render_mode="rgb_array" if options.picture else None)
    for seed in range(options.seed, options.seed + options.episodes):
        reward, info = play(env, seed)
        print(f"seed {seed}: {info['end']} after {info['steps']} steps, reward {reward:.1f}")
    if options.picture:
        write_ppm(options.picture, env.render())


if __name__ == "__main__":
    main()
