import numpy as np


class Box:
    """Vectors between two bounds. sample() is random and unseeded unless seed() was called."""

    def __init__(self, low, high, shape=None, dtype=np.float32):
        self.shape = np.shape(low) if shape is None else tuple(shape)
        self.dtype = np.dtype(dtype)
        self.low = np.full(self.shape, low, dtype=dtype)
        self.high = np.full(self.shape, high, dtype=dtype)
        self._generator = np.random.default_rng()

    def seed(self, seed=None):
        self._generator = np.random.default_rng(seed)

    def sample(self):
        return self._generator.uniform(self.low, self.high).astype(self.dtype)
