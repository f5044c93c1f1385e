"""Python imports this in the agent's process, before the agent, where PYTHONPATH leads to it. It
makes an agent repeatable that knows nothing of seeds: random, numpy.random, torch, tensorflow and
unseeded spaces of gymnasium are seeded with each episode's policy seed (0 before the first). It
skips the minute in which agents wait for their environment's container, which is there already. And
it has gymnasium stand for gym, which the templates up to 2023 import, where there is no gym. Whatever
fails here must not keep the agent from running."""

import importlib.abc
import importlib.machinery
import importlib.util
import os
import sys
import time

_HERE = os.path.dirname(os.path.abspath(__file__))
_RESET = "/evaluation.Environment/reset"
_SEED_KEY = "myograde-policy-seed"
_LONG_S = 1.0


class _Episode:
    """What is seeded with what."""

    seed = 0
    number = 0  # of resets that were answered
    spaces = 0  # seeded since the last of them

    @classmethod
    def begin(cls, seed):
        cls.seed, cls.number, cls.spaces = seed, cls.number + 1, 0
        myograde_seeding.seed(seed)


class _Reset:
    """The stub's method `reset`: the answer brings the seed."""

    def __init__(self, method):
        self._method = method

    def __call__(self, request, *arguments, **named):
        response, call = self._method.with_call(request, *arguments, **named)
        for key, value in call.trailing_metadata() or ():
            if key == _SEED_KEY:
                _Episode.begin(int(value))
        return response

    def __getattr__(self, name):
        return getattr(self._method, name)


def _hook_grpc(module):
    original = module.insecure_channel

    def insecure_channel(*arguments, **named):
        channel = original(*arguments, **named)
        method_of = channel.unary_unary

        def unary_unary(method, *more, **options):
            result = method_of(method, *more, **options)
            return _Reset(result) if method == _RESET else result

        channel.unary_unary = unary_unary
        return channel

    module.insecure_channel = insecure_channel


def _hook_space(module):
    """Of gymnasium.spaces.space: a space that nobody seeded draws from the episode's seed."""
    space = module.Space
    generator_of, seed_by_agent = space.np_random.fget, space.seed

    def seed(self, value=None):
        self.__dict__["_seeded_by_agent"] = value is not None
        return seed_by_agent(self, value)

    def np_random(self):
        own = self.__dict__
        if not own.get("_seeded_by_agent") and own.get("_episode") != _Episode.number:
            own["_episode"] = _Episode.number
            seed_by_agent(self, (_Episode.seed + _Episode.spaces) % 2**32)
            _Episode.spaces += 1
        return generator_of(self)

    space.seed = seed
    space.np_random = property(np_random)


_HOOKS = {"grpc": _hook_grpc, "gymnasium.spaces.space": _hook_space,
          "gym.spaces.space": _hook_space}


class _HookOnImport(importlib.abc.MetaPathFinder):
    """Finds what the other finders find, and hooks into it once it is imported."""

    def __init__(self):
        self._asking = set()

    def find_spec(self, name, _path=None, _target=None):
        if name not in _HOOKS or name in self._asking:
            return None
        self._asking.add(name)
        try:
            spec = importlib.util.find_spec(name)
        finally:
            self._asking.discard(name)
        execute = getattr(spec and spec.loader, "exec_module", None)
        if execute is None:
            return spec

        def execute_and_hook(module):
            execute(module)
            try:
                _HOOKS[name](module)
            except Exception as error:
                print("template: can't seed {} ({})".format(name, error), file=sys.stderr)

        spec.loader.exec_module = execute_and_hook
        return spec


class _Gym(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """gym and its modules: those of gymnasium, which has the same spaces."""

    def find_spec(self, name, _path=None, _target=None):
        top, _, rest = name.partition(".")
        if top != "gym":
            return None
        if not rest and (importlib.machinery.PathFinder.find_spec("gym")
                         or not importlib.machinery.PathFinder.find_spec("gymnasium")):
            return None
        if rest and sys.modules["gym"] is not sys.modules.get("gymnasium"):
            return None
        return importlib.machinery.ModuleSpec(name, self)

    def create_module(self, spec):
        return importlib.import_module("gymnasium" + spec.name[len("gym"):])

    def exec_module(self, module):
        pass


def _skip_long_sleeps():
    sleep = time.sleep

    def sleep_once_there_is_an_episode(seconds):
        if seconds < _LONG_S or _Episode.number > 0:
            sleep(seconds)

    time.sleep = sleep_once_there_is_an_episode


def _run_the_next_one():
    """The sitecustomize that this one hides."""
    others = [folder for folder in sys.path if os.path.abspath(folder) != _HERE]
    spec = importlib.machinery.PathFinder.find_spec("sitecustomize", others)
    if spec is not None and spec.loader is not None:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


try:
    import myograde_seeding

    myograde_seeding.seed(0)
    sys.meta_path.insert(0, _HookOnImport())
    sys.meta_path.insert(0, _Gym())
    _skip_long_sleeps()
except Exception as error:
    print("template: the agent is not seeded ({})".format(error), file=sys.stderr)
_run_the_next_one()
