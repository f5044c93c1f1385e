"""A policy whose actions are those of a neural network. It plays every track; until ../train.py has
written weights.npz, the network is an untrained one."""

import pathlib
import sys

import myograde
import network

WEIGHTS = pathlib.Path(__file__).with_name("weights.npz")


class MyPolicy(myograde.Policy):
    name = "@NAME@"  # for logs

    def start(self):
        """Called once, when the track and the layout of both vectors are known. What is printed is
        shown with the result."""
        self.play = network.player(self.weights())
        backend = "NumPy" if network.torch is None else f"PyTorch {network.torch.__version__}"
        print(f"track {self.welcome.track}, profile {self.welcome.profile}, with {backend}",
              file=sys.stderr)
        for vector, layout in (("observation", self.observation_layout),
                               ("action", self.action_layout)):
            for part in layout.values():
                print(f"{vector}: {part.name} from {part.offset}, size {part.size}, unit "
                      f"{part.unit}", file=sys.stderr)

    def weights(self):
        inputs, outputs = self.welcome.observation_size, self.welcome.action_size
        if WEIGHTS.exists():
            weights = network.load(WEIGHTS)
            if (weights[0][0].shape[1], weights[-1][0].shape[0]) == (inputs, outputs):
                return weights
            print(f"{WEIGHTS.name} is of another track: an untrained network plays",
                  file=sys.stderr)
        return network.new_weights(inputs, outputs)

    def act(self, observation):
        """Called for each step. The kit has seeded random, numpy.random and torch with the episode's
        policy seed before."""
        return self.play(observation)


if __name__ == "__main__":
    myograde.serve(MyPolicy())
