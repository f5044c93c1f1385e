"""What the Python kits seed, with stand-ins for the libraries that take seconds to import."""

import importlib
import pathlib
import random
import sys
import tempfile
import unittest

import numpy as np
from myograde.policy import seeding

FAKE = """
seeds = []
class random:
    @staticmethod
    def set_seed(value):
        seeds.append(value)
def manual_seed(value):
    seeds.append(value)
"""


class Seeding(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        for name in ("torch", "tensorflow"):
            package = pathlib.Path(self.folder.name) / name
            package.mkdir()
            (package / "__init__.py").write_text(FAKE)
        sys.path.insert(0, self.folder.name)

    def tearDown(self):
        sys.path.remove(self.folder.name)
        self.folder.cleanup()
        for name in ("torch", "tensorflow"):
            sys.modules.pop(name, None)

    def test_the_usual_sources_repeat(self):
        draws = []
        for value in (7, 8, 7, 2**63 - 1):
            seeding.seed(value)
            draws.append((random.random(), np.random.random()))
        self.assertEqual(draws[0], draws[2])
        self.assertEqual(len({*draws}), 3)

    def test_what_is_imported_is_seeded_for_each_episode(self):
        torch = importlib.import_module("torch")
        seeding.seed(5)
        seeding.seed(6)
        self.assertEqual(torch.seeds[-2:], [5, 6])

    def test_what_is_imported_later_is_seeded_then(self):
        seeding.seed(2**63 - 1)
        self.assertNotIn("torch", sys.modules)
        torch = importlib.import_module("torch")
        tensorflow = importlib.import_module("tensorflow")
        self.assertEqual(torch.seeds, [2**63 - 1])
        self.assertEqual(tensorflow.seeds, [2**31 - 1])
        self.assertEqual(torch.__spec__.origin,
                         str(pathlib.Path(self.folder.name, "torch/__init__.py")))

    def test_the_real_torch(self):
        sys.path.remove(self.folder.name)
        try:
            seeding.seed(3)
            torch = importlib.import_module("torch")
        except ImportError:
            self.skipTest("torch is not installed")
        finally:
            sys.path.insert(0, self.folder.name)
        first = torch.rand(3)
        seeding.seed(3)
        self.assertTrue(torch.equal(first, torch.rand(3)))


if __name__ == "__main__":
    unittest.main(verbosity=2)
