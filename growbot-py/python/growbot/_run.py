"""Run logs."""

from __future__ import annotations

import json
from typing import Any, Iterator, Optional

from growbot import _growbot
from growbot.events import Event, event_from_dict


class RunLog(_growbot.RunLog):
    """The log of a growth, as written by `growbot grow --log` and Board.grow, as far as it can be read.

    RunLog(file) reads a log, even if its end is missing.
    """

    def events(self) -> Iterator[Event]:
        """Returns all events, the header first."""
        return (event_from_dict(json.loads(line)) for line in self._events_json())

    @property
    def result(self) -> Optional[dict[str, Any]]:
        """Result of the growth, in the format of `growbot grow --json`. None if the log has no end."""
        result = self._result_json()
        return None if result is None else json.loads(result)
