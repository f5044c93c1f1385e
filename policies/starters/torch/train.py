"""Trains the network of submission/network.py by a plain policy gradient on the environments that the
grader plays, and writes submission/weights.npz.

    python train.py --env myograde/Elbow-v0 --steps 200000

It needs the packages myograde[gym] and torch. It is a beginning: it learns to hold the elbow, and is no
match for what libraries such as Stable-Baselines3 do on the larger tracks."""

import argparse
import pathlib
import sys

import numpy
import torch

from myograde import envs

SUBMISSION = pathlib.Path(__file__).resolve().parent / "submission"
# At the end, as the kit there has the same name as the installed package.
sys.path.append(str(SUBMISSION))
import network  # pylint: disable=wrong-import-position

DISCOUNT = 0.97  # per step


def options():
    parser = argparse.ArgumentParser(description="Trains the policy's network.")
    parser.add_argument("--env", default="myograde/Elbow-v0", choices=sorted(envs.ENVIRONMENTS))
    parser.add_argument("--steps", type=int, default=200_000, help="control steps, of all "
                        "environments together")
    parser.add_argument("--envs", type=int, default=16, help="environments side by side")
    parser.add_argument("--length", type=int, default=100, help="steps between two updates")
    parser.add_argument("--seed", type=int, default=1_000_000, help="of the first episode; keep "
                        "away from those that are graded")
    return parser.parse_args()


def play(world, observation, policy, log_std, length):
    """Steps all environments `length` times. Of each step and environment: the observation, the
    action, the reward, whether the episode goes on, and whether the step counts: the one after an
    episode's end begins the next one and plays nothing. Then the last observation."""
    steps, begins = [], numpy.zeros(world.num_envs, dtype=bool)
    for _ in range(length):
        seen = torch.from_numpy(network.limited(observation))
        with torch.no_grad():
            action = torch.normal(policy(seen), log_std.exp())
        observation, reward, terminated, truncated, _ = world.step(action.clamp(-1, 1).numpy())
        ends = terminated | truncated
        steps.append((seen, action, torch.tensor(reward), torch.tensor(~ends),
                      torch.tensor(~begins)))
        begins = ends
    return [torch.stack(column) for column in zip(*steps)], observation


def returns_of(rewards, goes_on):
    """The discounted sum of the rewards from each step to the end of its episode."""
    returns, later = torch.zeros_like(rewards), torch.zeros(rewards.shape[1])
    for step in reversed(range(len(rewards))):
        later = rewards[step] + DISCOUNT * later * goes_on[step]
        returns[step] = later
    return returns


def update(optimizer, policy, log_std, played):
    seen, action, reward, goes_on, counts = played
    returns = returns_of(reward * counts, goes_on)
    advantage = returns - returns.mean(dim=1, keepdim=True)
    advantage = (advantage / (advantage.std() + 1e-8))[counts]
    drawn = torch.distributions.Normal(policy(seen[counts]), log_std.exp())
    loss = -(drawn.log_prob(action[counts]).sum(dim=1) * advantage).mean()
    optimizer.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
    optimizer.step()
    return reward[counts].mean().item()


def main():
    chosen = options()
    torch.manual_seed(chosen.seed)
    world = envs.vec(chosen.env, chosen.envs)
    observation, _ = world.reset(seed=chosen.seed)
    outputs = world.single_action_space.shape[0]
    policy = network.module(network.new_weights(observation.shape[1], outputs))
    log_std = torch.full((outputs,), -0.7, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([*policy.parameters(), log_std], lr=3e-3)
    rounds = max(1, chosen.steps // (chosen.envs * chosen.length))
    for number in range(1, rounds + 1):
        played, observation = play(world, observation, policy, log_std, chosen.length)
        mean = update(optimizer, policy, log_std, played)
        if number == rounds or number % 10 == 0:
            print(f"round {number} of {rounds}: mean reward of a step {mean:.4f}", flush=True)
    world.close()
    network.save(network.weights_of(policy), SUBMISSION / "weights.npz")
    print(f"{SUBMISSION / 'weights.npz'} is written")


if __name__ == "__main__":
    main()
