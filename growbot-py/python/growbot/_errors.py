"""Exceptions. Each has the value, the limit and the remedy."""

from __future__ import annotations

from typing import Optional, Union

ErrorValue = Optional[Union[float, str]]


class Error(Exception):
    """Base class of all errors of growbot.

    value is the value that caused the error, and limit is its limit: numbers in the unit of the message, or texts. Both
    are None if they do not apply. remedy states what to do. It is the end of the message.
    """

    value: ErrorValue
    limit: ErrorValue
    remedy: str

    def __init__(self, message: str, value: ErrorValue = None, limit: ErrorValue = None) -> None:
        super().__init__(message)
        self.value = value
        self.limit = limit
        self.remedy = _remedy_of(message)


class InputError(Error, ValueError):
    """A value that is not possible: out of range, not finite, or contradictory."""


class InputTypeError(Error, TypeError):
    """A value of a wrong type or shape."""


class FileError(Error, ValueError):
    """A file that is missing or not valid."""


class NoPathError(Error):
    """The planner found no path."""


class BoardError(Error, RuntimeError):
    """A board that does not respond, rejects a request, or has a fault."""


def _remedy_of(message: str) -> str:
    """Returns the part of a message after its last colon or semicolon. Messages end with the remedy."""
    at = max(message.rfind(": "), message.rfind("; "))
    return message[at + 2 :] if at >= 0 else message
