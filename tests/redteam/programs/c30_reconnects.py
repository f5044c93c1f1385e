"""Leaves the bus in the middle of an episode; comes back, or does not."""
import os
import sys
import time

import lcm

import hostile
from myograde.action_t import action_t
from myograde.episode_ready_t import episode_ready_t
from myograde.episode_start_t import episode_start_t
from myograde.hello_t import hello_t
from myograde.observation_t import observation_t

WAY = sys.argv[1]
bus = None
welcomed = False
left = False


def on_welcome(_channel, _data):
    global welcomed
    welcomed = True


def on_start(_channel, data):
    ready = episode_ready_t()
    ready.episode = episode_start_t.decode(data).episode
    bus.publish("MYOGRADE_EPISODE_READY", ready.encode())


def on_observation(_channel, data):
    global left
    seen = observation_t.decode(data)
    if seen.step >= 4 and not left:
        left = True
        if WAY == "exits":
            os.closerange(3, 1024)
            sys.exit(0)
        if WAY == "breaks":
            # Behind liblcm's back: its threads find their sockets closed.
            os.closerange(3, 1024)
        raise ConnectionResetError
    answer = action_t()
    answer.episode, answer.step = seen.episode, seen.step
    answer.size = hostile.ACTION_SIZE
    answer.values = [0.0] * answer.size
    bus.publish("MYOGRADE_ACTION", answer.encode())


def connect():
    global bus
    bus = lcm.LCM(os.environ["MYOGRADE_LCM_URL"])
    bus.subscribe("MYOGRADE_WELCOME", on_welcome)
    bus.subscribe("MYOGRADE_EPISODE_START", on_start)
    bus.subscribe("MYOGRADE_OBSERVATION", on_observation)


def say_hello():
    hello = hello_t()
    hello.protocol_version, hello.name = 1, "reconnects"
    bus.publish("MYOGRADE_HELLO", hello.encode())


connect()
while not welcomed:
    say_hello()
    bus.handle_timeout(100)
while True:
    try:
        bus.handle_timeout(1000)
    except ConnectionResetError:
        if WAY == "breaks":
            sys.exit("the bus is gone")
        bus = None
        connect()
        if WAY == "greets":
            say_hello()
        if WAY == "greets-often":
            for i in range(3000):
                say_hello()
                if i % 10 == 0:
                    time.sleep(0.002)  # a full queue would lose them
