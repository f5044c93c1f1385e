"""Waits for what another process does."""

import time


def wait_until(look, seconds, what, fits=bool, every_s=0.05):
    """The first value of `look()` that fits. AssertionError with `what` and the last value if none
    does in time."""
    deadline = time.monotonic() + seconds
    while not fits(value := look()):
        if time.monotonic() > deadline:
            raise AssertionError(f"{what}: {str(value)[-2000:]}")
        time.sleep(every_s)
    return value


def stay_within_a_day(seconds):
    """Waits for midnight (UTC), when teams get their units of a day anew, if it is closer than that."""
    left = 86400 - time.time() % 86400
    if left < seconds:
        time.sleep(left)
