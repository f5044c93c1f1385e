"""Every step is within its budget, but together they exceed the lease's."""
import hostile


class Busy(hostile.Player):
    def act(self, observation):
        hostile.burn(0.15)
        return super().act(observation)


hostile.myograde.serve(Busy())
