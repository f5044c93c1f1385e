"""The policy's side of the protocol: see protocol/README.md."""

from __future__ import annotations

import dataclasses
import math
import sys
import time
from typing import Any, Iterable, NoReturn, Sequence

from ..messages import (action_t, episode_ready_t, episode_start_t, give_up_t, hello_t,
                        observation_t, welcome_t)
from . import seeding
from .bus import Bus
from .layout import Layout, layout_of
from .leg import LegSet

PROTOCOL_VERSION = 1
HELLO_PERIOD_S = 0.1
WELCOME_DEADLINE_S = 60.0
# The grader asks every 250 ms at the latest while it waits for this policy,
# and resets and steps in far less than this.
SILENCE_DEADLINE_S = 600.0
# More numbers than any action has, and as many as fit into one datagram.
LARGEST_ACTION = 4096


@dataclasses.dataclass(frozen=True)
class Episode:
    """One episode as the policy may know it."""

    episode: int  # place in this process's run, from 0
    policy_seed: int  # for the policy's own random numbers


class Policy:
    """What a participant writes: act, and any of the other methods below."""

    name: str = "policy"  # for logs; at most 64 bytes
    direct: bool = False  # True: muscles in [0, 1], prosthesis targets in rad
    # What the grader says first; there before start() and the first reset().
    welcome: Any = None  # its welcome_t: track, bounds, budgets
    observation_layout: Layout  # names, offsets, sizes and units of the parts
    action_layout: Layout

    def leg_sets(self) -> Iterable[LegSet]:
        """Locomotion: up to five parameter sets, each in place of the grader's of its index."""
        return []

    def start(self) -> None:
        """Called once, when self.welcome is set."""

    def reset(self, episode: Episode) -> None:
        """Called at the beginning of each episode, once random, numpy.random, torch and tensorflow
        are seeded with its policy_seed."""

    def act(self, observation: Sequence[float]) -> Iterable[float]:
        """Takes welcome.observation_size floats, returns welcome.action_size finite floats. SI
        units; self.named(observation) has the parts by name."""
        raise NotImplementedError("a policy needs act(self, observation)")

    def named(self, observation: Any) -> dict[str, Any]:
        """The observation's parts by name: slices of it."""
        return self.observation_layout.split(observation)

    def give_up(self) -> None:
        """Called by act: ends the episode, and ignores what act returns."""
        self._gives_up = True

    _gives_up = False


class _Conversation:
    def __init__(self, bus: Bus, policy: Policy) -> None:
        self.bus = bus
        self.policy = policy
        self.heard = time.monotonic()
        self.ready = episode_ready_t()
        self.ready.episode = -1
        self.answered_step = -1
        self.answer = ("", b"")  # channel and bytes of the last one, for a step that is asked again
        for channel, handler in (
            ("MYOGRADE_WELCOME", self.on_welcome),
            ("MYOGRADE_EPISODE_START", self.on_episode_start),
            ("MYOGRADE_OBSERVATION", self.on_observation),
        ):
            bus.subscribe(channel, handler)

    def greet(self):
        hello = hello_t()
        hello.protocol_version = PROTOCOL_VERSION
        hello.name = self.policy.name
        hello.direct = int(self.policy.direct)
        hello.leg_sets = [leg_set.message() if isinstance(leg_set, LegSet) else leg_set
                          for leg_set in self.policy.leg_sets()]
        hello.num_leg_sets = len(hello.leg_sets)
        encoded = hello.encode()
        deadline = time.monotonic() + WELCOME_DEADLINE_S
        while self.policy.welcome is None:
            if time.monotonic() > deadline:
                sys.exit("error: no grader answered on the bus for 60 s; check MYOGRADE_LCM_URL")
            self.bus.publish("MYOGRADE_HELLO", encoded)
            self.bus.wait(HELLO_PERIOD_S)
        if not self.policy.welcome.accepted:
            sys.exit(f"error: the grader refused this policy: {self.policy.welcome.reason}")
        self.policy.observation_layout = layout_of(self.policy.welcome.observation_parts)
        self.policy.action_layout = layout_of(self.policy.welcome.action_parts)
        self.policy.start()

    def play(self) -> NoReturn:
        self.heard = time.monotonic()
        while time.monotonic() - self.heard < SILENCE_DEADLINE_S:
            self.bus.wait(1.0)
        sys.exit("error: nothing was heard from the grader for 600 s")

    def on_welcome(self, _channel, data):
        if self.policy.welcome is None:
            self.policy.welcome = welcome_t.decode(data)

    def on_episode_start(self, _channel, data):
        self.heard = time.monotonic()
        start = episode_start_t.decode(data)
        if self.policy.welcome is None or start.episode < self.ready.episode:
            return
        if start.episode > self.ready.episode:
            seeding.seed(start.policy_seed)
            self.policy.reset(Episode(start.episode, start.policy_seed))
            self.ready.episode = start.episode
            self.answered_step = -1
        self.bus.publish("MYOGRADE_EPISODE_READY", self.ready.encode())

    def on_observation(self, _channel, data):
        self.heard = time.monotonic()
        observation = observation_t.decode(data)
        if observation.episode != self.ready.episode or observation.step < self.answered_step:
            return
        if observation.step > self.answered_step:
            self.answer = self.encode_answer(observation)
            self.answered_step = observation.step
        self.bus.publish(*self.answer)

    def encode_answer(self, observation):
        values = self.policy.act(observation.values)
        if self.policy._gives_up:
            self.policy._gives_up = False
            give_up = give_up_t()
            give_up.episode, give_up.step = observation.episode, observation.step
            return "MYOGRADE_GIVE_UP", give_up.encode()
        values = [float(value) for value in values]
        wanted = self.policy.welcome.action_size
        place = f"at step {observation.step} of episode {observation.episode}"
        if len(values) != wanted:
            tell(f"error: act returned {len(values)} numbers {place}, must return {wanted}")
        elif not all(map(math.isfinite, values)):
            tell(f"error: act returned a number that is not finite {place}")
        # Sent nevertheless: the grader decides what a wrong answer means.
        action = action_t()
        action.episode = observation.episode
        action.step = observation.step
        action.values = values[:LARGEST_ACTION]
        action.size = len(action.values)
        return "MYOGRADE_ACTION", action.encode()


def tell(sentence: str) -> None:
    """On standard error, before the grader ends this process."""
    print(sentence, file=sys.stderr, flush=True)


def serve(policy: Policy) -> NoReturn:
    """Plays `policy` until the grader ends the process, as sys.exit does. Exits with 1 and a sentence if there is no
    bus, or no message arrives on it."""
    conversation = _Conversation(Bus(), policy)
    conversation.greet()
    conversation.play()
