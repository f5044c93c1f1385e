"""A policy that plays every track, and as yet does little: its muscles twitch at random. Replace
what act does."""

import random
import sys

import myograde_kit


def part_of(vector, parts, name):
    """The entries of the part `name` in a vector; none if the track has no such part."""
    for part in parts:
        if part.name == name:
            return vector[part.offset:part.offset + part.size]
    return []


class MyPolicy(myograde_kit.Policy):
    name = "@NAME@"  # for logs
    # False: every entry of an action is normalized to [-1, 1]. True: muscles in [0, 1], targets of
    # a prosthesis in rad.
    direct = False

    def start(self):
        """Called once. self.welcome tells the track, the parts of both vectors by name, and the
        bounds of every entry; "myograde spec" prints what they mean. What is printed is shown with
        the result."""
        print(f"track {self.welcome.track}, profile {self.welcome.profile}", file=sys.stderr)
        for vector, parts in (("observation", self.welcome.observation_parts),
                              ("action", self.welcome.action_parts)):
            for part in parts:
                print(f"{vector}: {part.name} from {part.offset}, size {part.size}, unit "
                      f"{part.unit}", file=sys.stderr)
        self.muscles = next(part for part in self.welcome.action_parts if part.name == "muscles")

    def reset(self, episode):
        """Called at the beginning of each episode. Randomness from the policy seed alone makes a
        policy play the same whenever it is graded again."""
        self.random = random.Random(episode.policy_seed)

    def act(self, observation):
        """Called for each step: takes welcome.observation_size numbers, returns
        welcome.action_size. self.give_up() would end the episode."""
        # Activations of the muscles; `observation` has the other parts as well.
        active = part_of(observation, self.welcome.observation_parts, "act")
        action = [0.0] * self.welcome.action_size
        for i in range(self.muscles.size):
            tired = i < len(active) and active[i] > 0.5
            action[self.muscles.offset + i] = -1.0 if tired else self.random.uniform(-1.0, 0.2)
        return action


if __name__ == "__main__":
    myograde_kit.run(MyPolicy())
