"""Answers that are old, duplicate, early or contradictory."""
import sys
import time

import hostile
from myograde.give_up_t import give_up_t

bus = hostile.RawBus()


def each_step(send):
    """Makes an attack in each step."""
    def attack(player):
        send(*player.now)
        player.when = (player.now[0], player.now[1] + 1)
    return attack


def double(episode, step):
    bus.publish("MYOGRADE_ACTION", hostile.still(episode, step))


def old_flood(player):
    for i in range(3000):
        bus.publish("MYOGRADE_ACTION", hostile.still(0, i % 3))
        if i % 50 == 0:
            time.sleep(0.001)
    time.sleep(0.2)


def future(player):
    for i in range(100):
        bus.publish("MYOGRADE_ACTION", hostile.still(0, player.now[1] + 1 + i))
        time.sleep(0.001)


def far_future(player):
    for _ in range(100):
        bus.publish("MYOGRADE_ACTION", hostile.still(2**63 - 1, 2**63 - 1))
        bus.publish("MYOGRADE_ACTION", hostile.still(-2**63, -2**63))
        time.sleep(0.001)


def second_publisher(_player):
    def other():
        rival = hostile.RawBus()
        for step in range(20):
            for _ in range(5):
                rival.publish("MYOGRADE_ACTION", hostile.still(0, step, 0.5))
                time.sleep(0.002)
    hostile.spawn(other)


def old_few(episode, step):
    if step % 10 == 0 and step > 0:
        bus.publish("MYOGRADE_ACTION", hostile.still(episode, 0))


def give_up(episode, step):
    message = give_up_t()
    message.episode, message.step = episode, step
    return message.encode()


def give_up_future(player):
    for i in range(100):
        bus.publish("MYOGRADE_GIVE_UP", give_up(0, player.now[1] + 1 + i))
        time.sleep(0.001)


def give_up_and_act(episode, step):
    """Gives up five times, and sends an action as well."""
    for _ in range(5):
        bus.publish("MYOGRADE_GIVE_UP", give_up(episode, step))


WAYS = {
    "give-up-future": give_up_future,
    "give-up-and-act": each_step(give_up_and_act),
    "double": each_step(double),
    "old-few": each_step(old_few),
    "old-flood": old_flood,
    "future": future,
    "far-future": far_future,
    "two-publishers": second_publisher,
}
hostile.play(WAYS[sys.argv[1]], step=5)
