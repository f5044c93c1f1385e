#!/usr/bin/env python3
"""Trains a policy by PPO of Stable-Baselines3, and keeps it in a file for export_policy.py.

    python train_ppo.py --steps 100000 -o elbow_ppo.zip

Needs myograde[gym], stable-baselines3 and torch. A few thousand steps show that everything works;
a policy that holds the elbow takes some hundred thousand."""

import argparse
import pathlib

import gymnasium
import torch
from stable_baselines3 import PPO

import myograde.envs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environment", default="myograde/Elbow-v0",
                        choices=tuple(myograde.envs.ENVIRONMENTS))
    parser.add_argument("--profile", default="", help="of the rules (default: the track's)")
    parser.add_argument("--steps", type=int, default=4096, help="control steps to train for")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=pathlib.Path, default=pathlib.Path("elbow_ppo.zip"))
    options = parser.parse_args()

    torch.set_num_threads(1)  # networks this small gain nothing from more
    env = gymnasium.make(options.environment, profile=options.profile)
    # export_policy.py knows this kind of network: ReLU between layers, which is the same on every
    # processor to the last bit, as tanh is not.
    model = PPO("MlpPolicy", env, seed=options.seed, n_steps=min(1024, options.steps), verbose=1,
                device="cpu", policy_kwargs={"net_arch": [64, 64],
                                             "activation_fn": torch.nn.ReLU})
    model.learn(options.steps)
    model.save(options.output)
    print(f"kept in {options.output}; next: export_policy.py {options.output} SUBMISSION")


if __name__ == "__main__":
    main()
