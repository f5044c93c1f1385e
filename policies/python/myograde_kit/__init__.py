"""The Python kit: a policy is a class with reset and act, handed to run().

    import myograde_kit

    class Still(myograde_kit.Policy):
        def act(self, observation):
            return [-1.0] * self.welcome.action_size

    if __name__ == "__main__":
        myograde_kit.run(Still())

Needs the package `lcm` (the runtime "python" of a grader has it) and the
message types of the folder `myograde` beside this one.
"""

from .kit import Episode, Policy, run

__all__ = ["Episode", "Policy", "run"]
