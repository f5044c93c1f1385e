"""The errors of this package. Every message is a sentence that says what to do."""

from __future__ import annotations

from typing import Any


class MyogradeError(Exception):
    """The base class of all errors of this package."""

    passes = True  # whether the same may succeed a little later


class WrongUse(MyogradeError, ValueError):
    """An argument, file or setting that can't be used."""

    passes = False


class Unreachable(MyogradeError):
    """No server answers, or it can't be trusted. What was asked for may have taken effect."""


class DeadlinePassed(MyogradeError, TimeoutError):
    """A wait timed out; what was waited for continues."""


class ServerError(MyogradeError):
    """The server refused a request, or could not carry it out; the text is its own sentence."""

    def __init__(self, status: int, code: str, message: str) -> None:
        super().__init__(message)
        self.status = status  # of HTTP
        self.code = code  # such as "unknown_track"; server/api/README.md lists them
        self.passes = code == "paused" or status in (408, 429) or status >= 500

    def __reduce__(self) -> tuple[Any, ...]:
        # Otherwise an exception is rebuilt from only its text, as in a process of a pool.
        return type(self), (self.status, self.code, str(self))
