"""A policy that plays every track, and as yet does little: its muscles twitch at random. Replace
what act does."""

import random
import sys

import myograde


class MyPolicy(myograde.Policy):
    name = "@NAME@"  # for logs
    # False: every entry of an action is normalized to [-1, 1]. True: muscles in [0, 1], targets of
    # a prosthesis in rad.
    direct = False

    def start(self):
        """Called once. self.welcome tells the track and the bounds of every entry, the layouts name
        the parts of both vectors; "myograde spec" prints what they mean. What is printed is shown
        with the result."""
        print(f"track {self.welcome.track}, profile {self.welcome.profile}", file=sys.stderr)
        for vector, layout in (("observation", self.observation_layout),
                               ("action", self.action_layout)):
            for part in layout.values():
                print(f"{vector}: {part.name} from {part.offset}, size {part.size}, unit "
                      f"{part.unit}", file=sys.stderr)

    def reset(self, episode):
        """Called at the beginning of each episode. Randomness from the policy seed alone makes a
        policy play the same whenever it is graded again."""
        self.random = random.Random(episode.policy_seed)

    def act(self, observation):
        """Called for each step: takes welcome.observation_size numbers, returns
        welcome.action_size. self.give_up() would end the episode."""
        active = self.named(observation)["act"]  # of the muscles, 0 to 1
        action = {part.name: [0.0] * part.size for part in self.action_layout.values()}
        action["muscles"] = [-1.0 if muscle > 0.5 else self.random.uniform(-1.0, 0.2)
                             for muscle in active]
        return self.action_layout.join(action)


if __name__ == "__main__":
    myograde.serve(MyPolicy())
