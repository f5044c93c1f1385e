"""A policy that does the same whatever it sees, and takes a while for it: its first argument is how
many milliseconds it sleeps in each step. For tests that need a lease to last."""

import sys
import time

import myograde

PAUSE_S = float(sys.argv[1]) / 1000


class Patient(myograde.Policy):
    name = "patient"

    def reset(self, episode):
        self.steps = 0

    def act(self, observation):
        self.steps += 1
        time.sleep(PAUSE_S)
        size = self.welcome.action_size
        return [(self.steps * (entry + 3) % 7) / 7 for entry in range(size)]


if __name__ == "__main__":
    myograde.serve(Patient())
