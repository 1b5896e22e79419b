"""Exceptions. Each has the value, the limit and the code of its reason."""

from __future__ import annotations

from typing import Optional, Union

ErrorValue = Optional[Union[float, str]]


class Error(Exception):
    """Base class of all errors of growbot.

    value is the value that caused the error, and limit is its limit: numbers in the unit of the message, or texts. Both
    are None if they do not apply. code names the reason why a growth is refused, such as "plan-warnings". It is None for
    other errors. The message ends with what to do.
    """

    value: ErrorValue
    limit: ErrorValue
    code: Optional[str]

    def __init__(
        self, message: str, value: ErrorValue = None, limit: ErrorValue = None, code: Optional[str] = None
    ) -> None:
        super().__init__(message)
        self.value = value
        self.limit = limit
        self.code = code


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
