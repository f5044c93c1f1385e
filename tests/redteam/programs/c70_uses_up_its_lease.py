"""Every step within its budget, all together more than the lease allows."""
import hostile


class Busy(hostile.Player):
    def act(self, observation):
        hostile.burn(0.15)
        return super().act(observation)


hostile.myograde_kit.run(Busy())
