"""Run logs."""

from __future__ import annotations

import json
from typing import Any, Iterator, Optional

from growbot import _growbot
from growbot.events import Event, from_fields


class RunLog(_growbot.RunLog):
    """The log of a growth, as `growbot grow --log` and Board.grow write it: what can be read of it.

    RunLog(file) reads one, also where it was cut off.
    """

    def events(self) -> Iterator[Event]:
        """All events, the header first."""
        return (from_fields(json.loads(told)) for told in self._events_json())

    @property
    def result(self) -> Optional[dict[str, Any]]:
        """What the growth came to, as `growbot grow --json` has it; None where the log has no end."""
        told = self._result_json()
        return None if told is None else json.loads(told)
