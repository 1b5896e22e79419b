"""Exceptions: each has the value, the limit and the remedy."""

from __future__ import annotations

from typing import Optional, Union

Told = Optional[Union[float, str]]


class Error(Exception):
    """What was asked for cannot be had.

    value is the offending value and limit what it may be, where there are such: numbers in the unit of the message, or
    words. remedy says what to do; it is the end of the message.
    """

    value: Told
    limit: Told
    remedy: str

    def __init__(self, message: str, value: Told = None, limit: Told = None) -> None:
        super().__init__(message)
        self.value = value
        self.limit = limit
        self.remedy = _remedy_of(message)


class InputError(Error, ValueError):
    """A value that cannot be: out of range, not finite, contradictory."""


class InputTypeError(Error, TypeError):
    """A value of a wrong type or shape."""


class FileError(Error, ValueError):
    """A file that is missing, or is not what it should be."""


class NoPathError(Error):
    """No path leads there."""


class BoardError(Error, RuntimeError):
    """A board that is silent, refuses, or has a fault."""


def _remedy_of(message: str) -> str:
    """Messages say what failed, the value and the limit; then, after a colon or a semicolon, what to do."""
    at = max(message.rfind(": "), message.rfind("; "))
    return message[at + 2 :] if at >= 0 else message
