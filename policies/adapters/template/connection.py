"""A conversation with the grader in which the policy takes the steps: it asks for the next episode
and hands over actions, where the kit calls the policy. The protocol is in protocol/README.md."""

import os
import select
import sys
import time

import lcm

from myograde.action_t import action_t
from myograde.episode_ready_t import episode_ready_t
from myograde.episode_start_t import episode_start_t
from myograde.give_up_t import give_up_t
from myograde.hello_t import hello_t
from myograde.observation_t import observation_t
from myograde.welcome_t import welcome_t

PROTOCOL_VERSION = 1
RESEND_S = 0.1
# The grader asks every 250 ms at the latest while it waits for this policy,
# and resets and steps in far less than this.
SILENCE_DEADLINE_S = 600.0


class EvaluationOver(Exception):
    """The grader has no further episode."""


class Stop:
    """Set once, from a signal handler too; wakes whoever waits for the grader."""

    def __init__(self):
        self._waits, self._sets = os.pipe()

    def set(self):
        os.write(self._sets, b"1")

    def fileno(self):
        return self._waits


class Connection:
    """What the grader says is kept until the policy asks for it. Of one thread. `policy_seed` is
    the current episode's, `welcome` the grader's. Every wait ends with SystemExit and a sentence
    after SILENCE_DEADLINE_S without a word, and with EvaluationOver once `stop` is set."""

    def __init__(self, name, direct, stop):
        url = os.environ.get("MYOGRADE_LCM_URL", "")
        try:
            self._lcm = lcm.LCM(url)
        except RuntimeError as error:
            sys.exit(f'error: no LCM bus at "{url}" ({error}); set MYOGRADE_LCM_URL')
        self._stop = stop
        self.welcome = None
        self.policy_seed = 0
        self._start = None  # the last episode_start_t
        self._observation = None  # the last of the episode that is played
        self._ready = None  # the answer to its episode_start_t
        self._answer = None  # to _observation: channel and bytes, sent again when asked again
        self._lcm.subscribe("MYOGRADE_WELCOME", self._on_welcome)
        self._lcm.subscribe("MYOGRADE_EPISODE_START", self._on_episode_start)
        self._lcm.subscribe("MYOGRADE_OBSERVATION", self._on_observation)
        self._greet(name, direct)

    def begin_episode(self, leg_sets):
        """Waits for an episode that was not begun yet and begins it with these
        leg_parameter_set_t values; one that is still played is given up. Returns the first
        observation, a sequence of floats."""
        begun = self._ready.episode if self._ready else -1
        if self._observation is not None and self._answer is None and self._start.episode == begun:
            give_up = give_up_t()
            give_up.episode, give_up.step = self._observation.episode, self._observation.step
            self._say("MYOGRADE_GIVE_UP", give_up.encode())
        self._wait(lambda: self._start is not None and self._start.episode > begun)
        self._ready = episode_ready_t()
        self._ready.episode = self._start.episode
        self.policy_seed = self._start.policy_seed
        self._ready.leg_sets = list(leg_sets)
        self._ready.num_leg_sets = len(leg_sets)
        self._observation = self._answer = None
        self._lcm.publish("MYOGRADE_EPISODE_READY", self._ready.encode())
        self._wait(lambda: self._observation is not None)
        return self._observation.values

    def step(self, values):
        """Answers the last observation. Returns the next one, or None where the episode ended."""
        answered = self._observation
        action = action_t()
        action.episode, action.step = answered.episode, answered.step
        action.size, action.values = len(values), values
        self._say("MYOGRADE_ACTION", action.encode())
        self._wait(lambda: self._observation.step > answered.step
                   or self._start.episode > answered.episode)
        return self._observation.values if self._observation.step > answered.step else None

    def _say(self, channel, message):
        self._answer = (channel, message)
        self._lcm.publish(channel, message)

    def _greet(self, name, direct):
        hello = hello_t()
        hello.protocol_version = PROTOCOL_VERSION
        hello.name = name
        hello.direct = int(direct)
        hello.num_leg_sets = 0
        hello.leg_sets = []
        encoded = hello.encode()
        deadline = time.monotonic() + SILENCE_DEADLINE_S
        while self.welcome is None:
            if time.monotonic() > deadline:
                sys.exit("error: no grader answered on the bus; check MYOGRADE_LCM_URL")
            self._lcm.publish("MYOGRADE_HELLO", encoded)
            self._handle(RESEND_S)
        if not self.welcome.accepted:
            sys.exit(f"error: the grader refused this policy: {self.welcome.reason}")

    def _wait(self, arrived):
        deadline = time.monotonic() + SILENCE_DEADLINE_S
        while not arrived():
            if time.monotonic() > deadline:
                sys.exit(f"error: nothing was heard from the grader for {SILENCE_DEADLINE_S:.0f} s")
            self._handle(1.0)

    def _handle(self, seconds):
        readable, _, _ = select.select([self._lcm.fileno(), self._stop], [], [], seconds)
        if self._stop in readable:
            raise EvaluationOver
        if readable:
            self._lcm.handle()

    def _on_welcome(self, _channel, data):
        if self.welcome is None:
            self.welcome = welcome_t.decode(data)

    def _on_episode_start(self, _channel, data):
        start = episode_start_t.decode(data)
        if self._start is None or start.episode > self._start.episode:
            self._start = start
        elif self._ready is not None and start.episode == self._ready.episode:
            self._lcm.publish("MYOGRADE_EPISODE_READY", self._ready.encode())

    def _on_observation(self, _channel, data):
        observation = observation_t.decode(data)
        if self._ready is None or observation.episode != self._ready.episode:
            return
        if self._observation is None or observation.step > self._observation.step:
            self._observation = observation
            self._answer = None
        elif self._answer is not None and observation.step == self._observation.step:
            self._lcm.publish(*self._answer)
