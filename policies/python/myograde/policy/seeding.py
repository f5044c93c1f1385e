"""Seeds the usual sources of randomness, those among them that are imported later as well, so that
an episode can be played again. What has no global state to seed must be given the policy seed by
the policy: jax.random.PRNGKey(policy_seed), numpy.random.default_rng(policy_seed)."""

import importlib.abc
import importlib.util
import random
import sys

_current = None  # the seed in force


def seed(value: int) -> None:
    """Seeds what is imported, and remembers the seed for what is not yet."""
    global _current
    if _current is None:
        sys.meta_path.insert(0, _SeedOnImport())
    _current = value
    random.seed(value)
    for name, seed_module in _SEEDERS.items():
        if name in sys.modules:
            seed_module(sys.modules[name], value)


def _seed_numpy(module, value):
    module.seed(value % 2**32)


def _seed_torch(module, value):
    # A module that is not yet whole, in the middle of its own import, is seeded after it.
    if hasattr(module, "manual_seed"):
        module.manual_seed(value % 2**63)


def _seed_tensorflow(module, value):
    if hasattr(module, "random"):
        module.random.set_seed(value % 2**31)


# Libraries that are slow to import are never imported here.
_SEEDERS = {"numpy.random": _seed_numpy, "torch": _seed_torch, "tensorflow": _seed_tensorflow}


class _SeedOnImport(importlib.abc.MetaPathFinder):
    """Finds what the other finders find, and seeds it once it is imported."""

    def __init__(self):
        self._asking = False

    def find_spec(self, name, _path=None, _target=None):
        if name not in _SEEDERS or self._asking:
            return None
        self._asking = True
        try:
            spec = importlib.util.find_spec(name)
        finally:
            self._asking = False
        execute = getattr(spec and spec.loader, "exec_module", None)
        if execute is None:
            return spec

        def execute_and_seed(module):
            execute(module)
            _SEEDERS[name](module, _current)

        spec.loader.exec_module = execute_and_seed
        return spec
