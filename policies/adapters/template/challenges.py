"""The challenges whose templates' agents can be played."""

from dataclasses import dataclass

from observations import Baoding, ChaseTag, Locomotion, Manipulation, Relocation, Reorientation


@dataclass(frozen=True)
class Challenge:
    """`environments` are the kinds of track that its template has. `reset_pair`: reset answers as
    Gymnasium's environments do, with the observation and {}; gym's answered with it alone."""

    environments: tuple
    reset_pair: bool


# By the adapter's name.
CHALLENGES = {
    "template-2022": Challenge((Reorientation, Baoding), reset_pair=False),
    "template-2023": Challenge((Relocation, ChaseTag), reset_pair=False),
    "template-2024": Challenge((Manipulation, Locomotion), reset_pair=True),
}
