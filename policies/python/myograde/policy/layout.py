"""Observations and actions by name. tracks.json has what `myograde spec` prints of each track."""

from __future__ import annotations

import dataclasses
import functools
import json
import pathlib
from typing import Any, Iterator, Mapping, Sequence


@dataclasses.dataclass(frozen=True)
class Part:
    """A named part of an observation or an action: `size` entries from `offset` on, in `unit`."""

    name: str
    offset: int
    size: int
    unit: str
    meaning: str = ""  # a sentence; empty in a layout that a welcome brought
    entries: tuple[str, ...] = ()  # the name of each entry; likewise

    @property
    def shape(self) -> tuple[int]:
        """As NumPy writes it."""
        return (self.size,)


class Layout(Mapping[str, Part]):
    """The parts of a vector by name, in their order."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self._parts = {part.name: part for part in parts}
        self.size = sum(part.size for part in parts)

    def __getitem__(self, name: str) -> Part:
        if name not in self._parts:
            raise KeyError(f'there is no part "{name}"; known: {", ".join(self._parts)}')
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def split(self, vector: Any) -> dict[str, Any]:
        """Slices of `vector` by name: views of a NumPy array, copies of a list or tuple. ValueError
        if it has another size than this layout."""
        if len(vector) != self.size:
            raise ValueError(f"the vector has {len(vector)} entries, its layout has {self.size}")
        return {part.name: vector[part.offset:part.offset + part.size]
                for part in self._parts.values()}

    def join(self, parts: Mapping[str, Sequence[float]]) -> list[float]:
        """The inverse: one list of all parts. ValueError if a part is missing, unknown or of
        another size."""
        unknown = sorted(set(parts) - set(self._parts))
        if unknown:
            raise ValueError(f'there is no part "{unknown[0]}"; known: {", ".join(self._parts)}')
        vector: list[float] = []
        for part in self._parts.values():
            values = parts.get(part.name)
            if values is None or len(values) != part.size:
                raise ValueError(f'the part "{part.name}" must have {part.size} entries, and '
                                 + ("is missing" if values is None else f"has {len(values)}"))
            vector.extend(float(value) for value in values)
        return vector


@dataclasses.dataclass(frozen=True)
class Track:
    """What a policy sees of a kind of track: layouts, and the simulated seconds of a step."""

    name: str
    control_period_s: float
    observation: Layout
    action: Layout
    # What follows the observation if policy.json asks for it ("extra_observations"); may be empty.
    # Offsets count from its own first entry.
    extra: Layout = dataclasses.field(default_factory=lambda: Layout([]))


@functools.lru_cache(maxsize=None)
def read_tracks() -> dict[str, Any]:
    """tracks.json."""
    file = pathlib.Path(__file__).with_name("tracks.json")
    return json.loads(file.read_text(encoding="utf-8"))


def tracks() -> tuple[str, ...]:
    """The kinds of tracks that there are. A challenge may give its tracks other names."""
    return tuple(read_tracks())


def track(kind: str) -> Track:
    """The track of this kind, such as "locomotion". ValueError if there is none."""
    known = read_tracks()
    if kind not in known:
        raise ValueError(f'there is no kind of track "{kind}"; known: {", ".join(known)}')
    return Track(kind, known[kind]["control_period_s"], _layout(known[kind]["observation"]),
                 _layout(known[kind]["action"]), _layout(known[kind]["extra"]))


def layout_of(parts: Sequence[Any]) -> Layout:
    """Of the part_t values of a welcome."""
    return Layout([Part(part.name, part.offset, part.size, part.unit) for part in parts])


def _layout(parts: Sequence[Mapping[str, Any]]) -> Layout:
    return Layout([Part(**{**part, "entries": tuple(part["entries"])}) for part in parts])
