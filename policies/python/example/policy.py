"""An example: slow waves of excitation over the muscles, new phases in each episode."""

import math
import random

import myograde


class Waves(myograde.Policy):
    name = "python-waves"

    def start(self):
        parts = self.welcome.action_parts
        self.muscles = next(part.size for part in parts if part.name == "muscles")
        self.rest = self.welcome.action_size - self.muscles

    def reset(self, episode):
        generator = random.Random(episode.policy_seed)
        self.phases = [generator.uniform(0.0, 2.0 * math.pi) for _ in range(self.muscles)]
        self.step = 0

    def act(self, observation):
        angle = 2.0 * math.pi * self.step * self.welcome.control_period_s
        self.step += 1
        return [-0.6 + 0.4 * math.sin(angle + phase) for phase in self.phases] + [0.0] * self.rest


if __name__ == "__main__":
    myograde.serve(Waves())
