"""What can go wrong here. Every message is a sentence for people that says what to do."""

from __future__ import annotations

from typing import Any


class MyogradeError(Exception):
    """The base of all that this package raises on purpose."""


class WrongUse(MyogradeError, ValueError):
    """An argument, file or setting of the caller's that can't be used."""


class Unreachable(MyogradeError):
    """No server answers, or it can't be trusted. What was asked for may have taken effect."""


class DeadlinePassed(MyogradeError, TimeoutError):
    """A wait is over; what was waited for goes on."""


class ServerError(MyogradeError):
    """The server refused a request, or could not carry it out; the text is its own sentence."""

    def __init__(self, status: int, code: str, message: str) -> None:
        super().__init__(message)
        self.status = status  # of HTTP
        self.code = code  # such as "unknown_track"; server/api/README.md lists them

    def __reduce__(self) -> tuple[Any, ...]:
        # An exception is made anew of its text alone otherwise, in a process of a pool too.
        return type(self), (self.status, self.code, str(self))
