"""Whether this host reproduces a server's digests: the episodes shipped with the package, played here."""

from __future__ import annotations

import dataclasses
import os
import pathlib
import sys

from ..errors import MyogradeError
from . import extension


@dataclasses.dataclass(frozen=True)
class Check:
    track: str
    equal: bool
    steps: int  # control steps that were compared and are equal
    detail: str  # if not equal: a sentence


def check(cache: str | os.PathLike[str] | None = None) -> list[Check]:
    """Plays the reference episode of each track in this process. MyogradeError if it can't."""
    logs = sorted(extension.REFERENCE.glob("*.lcmlog.zst"))
    if not logs:
        raise MyogradeError(f"{extension.REFERENCE}: has no episodes; reinstall myograde")
    return [_play(log, cache) for log in logs]


def _play(log: pathlib.Path, cache: str | os.PathLike[str] | None) -> Check:
    played = extension.replay(log, cache)
    return Check(log.name.split(".")[0], played.equal, played.steps, played.detail)


def is_pinned_as_far_as_possible() -> bool:
    """Whether become_pinned() would change nothing."""
    variable = extension.load().PINNED_VARIABLE
    return os.environ.get(variable) == extension.pinned_environment()[variable]


def become_pinned(words: list[str]) -> None:
    """Becomes this Python with `words` and the grader's maths functions; does not return. Programs that it starts inherit that."""
    sys.stdout.flush()
    sys.stderr.flush()
    os.execve(sys.executable, [sys.executable, *words], extension.pinned_environment())
