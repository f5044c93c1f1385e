"""A trained network in NumPy: used by policy.py on the server and by play_at_home.py at home."""

import pathlib

import numpy as np


class Network:
    """Linear layers with ReLU between them. Products are added up in one order on every processor,
    which a BLAS library does not promise, so that actions are the same to the last bit."""

    def __init__(self, path):
        with np.load(path) as arrays:
            self.low, self.high = arrays["low"], arrays["high"]
            self.layers = [(arrays[f"weight{i}"], arrays[f"bias{i}"])
                           for i in range(sum(name.startswith("bias") for name in arrays))]

    def act(self, observation):
        """The action, an array within the action space, of an observation."""
        values = np.asarray(observation, dtype=np.float64)
        for number, (weight, bias) in enumerate(self.layers):
            values = np.sum(weight * values, axis=1) + bias
            if number + 1 < len(self.layers):
                values = np.maximum(values, 0.0)
        return np.clip(values, self.low, self.high)


def of_folder(folder):
    return Network(pathlib.Path(folder) / "weights.npz")
