"""Boards: a context manager, whose growths are iterators of typed events."""

from __future__ import annotations

import json
import os
import weakref
from types import TracebackType
from typing import Any, Iterator, Optional, Union

from growbot import _growbot
from growbot._conditions import Conditions
from growbot._errors import BoardError
from growbot._growbot import Plan, Robot
from growbot.events import Event, Status, from_fields


def connect(port: str = "sim", *, robot: Optional[Union[Robot, str]] = None, take_over: bool = False) -> Board:
    """Connects to a robot: "sim", "emulator", "tcp:HOST:PORT", or a serial device such as "/dev/ttyACM0".

    robot is the one that is simulated; elsewhere the board says what it is. With take_over, another host loses the
    board.

        with growbot.connect("sim") as board:
            for event in board.grow(plan):
                print(event)
    """
    return Board(_growbot.Board(port, robot, take_over))


class Growth(Iterator[Event]):
    """A growth under way: an iterator of its events, until the body is done.

    Ctrl-C stops the robot and raises KeyboardInterrupt once it has stopped; a second one gives the emergency stop. Who
    leaves the loop before the end leaves a robot that is told to stop.
    """

    def __init__(self, inner: _growbot.Growth) -> None:
        self._inner = inner

    def __iter__(self) -> Growth:
        return self

    def __next__(self) -> Event:
        told = self._inner.next_json()
        if told is None:
            raise StopIteration
        return from_fields(json.loads(told))

    def wait(self) -> dict[str, Any]:
        """Grows to the end, and gives the result."""
        for _ in self:
            pass
        return self.result or {}

    @property
    def result(self) -> Optional[dict[str, Any]]:
        """What the growth came to, as `growbot grow --json` has it; None before its end."""
        told = self._inner.result_json
        return None if told is None else json.loads(told)

    @property
    def ended(self) -> bool:
        """Whether it has come to an end, and all its events are read."""
        return self._inner.ended

    def stop(self) -> None:
        """Stops the robot, and waits until it has stopped."""
        self._inner.order("stop")
        try:
            self.wait()
        except BoardError:
            # It came to another end.
            pass

    def order(self, name: str) -> None:
        """Gives an order: "pause", "continue", "preheat", "load", "unload", "purge", "stop" or "emergency-stop"."""
        self._inner.order(name)


class Board:
    """A robot at the end of a port; leaving the with block stops what grows, and disconnects."""

    def __init__(self, inner: _growbot.Board) -> None:
        self._inner = inner
        self._growth: Optional[weakref.ref[Growth]] = None

    def __enter__(self) -> Board:
        return self

    def __exit__(
        self,
        kind: Optional[type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()

    @property
    def simulated(self) -> bool:
        """Whether the robot is a simulated one."""
        return self._inner.simulated

    def grow(
        self,
        plan: Plan,
        *,
        conditions: Optional[Conditions] = None,
        seed: int = 1,
        log: Optional[Union[str, os.PathLike[str]]] = None,
        replace_log: bool = False,
        force: bool = False,
    ) -> Growth:
        """Grows a plan. log names the run log (.jsonl); force grows in spite of warnings that speak against it.

        conditions with feedback=True close the loop; its noises and biases are for simulated robots alone.
        """
        self._must_be_idle()
        growth = Growth(self._inner.grow(plan, conditions, seed, log, replace_log, force))
        self._growth = weakref.ref(growth)
        return growth

    def _under_way(self) -> Optional[Growth]:
        growth = None if self._growth is None else self._growth()
        return None if growth is None or growth.ended else growth

    def _must_be_idle(self) -> None:
        if self._under_way() is not None:
            raise BoardError("a growth is under way: read its events to the end, or stop it", "growing", "idle")

    def status(self) -> Status:
        """What the board is doing."""
        self._must_be_idle()
        status = from_fields(json.loads(self._inner.status_json()))
        assert isinstance(status, Status)
        return status

    def stop(self) -> str:
        """Stops a body that another program has begun; in words, how."""
        self._must_be_idle()
        return self._inner.stop()

    def emergency_stop(self) -> None:
        """Everything off, at once; raises BoardError unless the board says that it has obeyed."""
        growth = self._under_way()
        if growth is not None:
            growth.order("emergency-stop")
            growth.stop()
            return
        self._inner.emergency_stop()

    def close(self) -> None:
        """Stops what grows, and disconnects."""
        growth = self._under_way()
        if growth is not None:
            growth.stop()
        self._inner.close()
