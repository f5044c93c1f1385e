"""The zero action, by the Python kit."""

import myograde


class Zero(myograde.Policy):
    name = "python-zero"

    def start(self):
        self.action = [0.0] * self.welcome.action_size

    def act(self, observation):
        return self.action


if __name__ == "__main__":
    myograde.serve(Zero())
