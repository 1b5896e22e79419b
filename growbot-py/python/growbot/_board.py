"""Boards. A board is a context manager, and its growths are iterators of typed events."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import warnings
import weakref
from types import TracebackType
from typing import Any, Callable, Iterator, Optional, Union

from growbot import _growbot
from growbot._conditions import Conditions
from growbot._errors import BoardError
from growbot._growbot import Plan, Robot, Scene
from growbot.events import Event, event_from_dict


def connect(port: str = "sim", *, robot: Optional[Union[Robot, str]] = None, take_over: bool = False) -> Board:
    """Connects to a robot: "sim", "sim:NAME", "emulator", "tcp:HOST:PORT", or a serial device such as "/dev/ttyACM0".

    robot is the robot to simulate. Other boards report their robot themselves. With take_over, another host loses the
    board. If `growbot serve` owns the robot, the connection uses the service, like growbot's commands.

        with growbot.connect("sim") as board:
            for event in board.grow(plan):
                print(event)
    """
    return Board(_growbot.Board(port, robot, take_over))


class Growth(Iterator[Event]):
    """A growth in progress: an iterator of its events, until the body is done.

    Ctrl-C stops the robot and raises KeyboardInterrupt once it has stopped. A second Ctrl-C sends the emergency stop.
    If your loop ends before the growth does, the robot is stopped, unless a service owns it.
    """

    def __init__(self, inner: _growbot.Growth, board: Optional[Board] = None) -> None:
        self._inner = inner
        # A growth keeps the board of this program, so that the end of the program finds it.
        self._board = board

    def __iter__(self) -> Growth:
        return self

    def __next__(self) -> Event:
        line = self._inner.next_json()
        if line is None:
            raise StopIteration
        return event_from_dict(json.loads(line))

    def wait(self) -> dict[str, Any]:
        """Waits for the end of the growth, and returns the result."""
        for _ in self:
            pass
        return self.result or {}

    @property
    def result(self) -> Optional[dict[str, Any]]:
        """Result of the growth, in the format of `growbot grow --json`. None before the end."""
        result = self._inner.result_json
        return None if result is None else json.loads(result)

    @property
    def ended(self) -> bool:
        """True if the growth has ended and all its events have been read."""
        return self._inner.ended

    def stop(self) -> None:
        """Stops the robot, and waits until it has stopped."""
        self._inner.send_command("stop")
        try:
            self.wait()
        except BoardError:
            # The growth ended with a fault or another outcome.
            pass

    def pause(self) -> None:
        """Pauses after the layer in progress. Returns at once; the event StateChanged reports the pause."""
        self._inner.send_command("pause")

    def continue_(self) -> None:
        """Continues after a pause. Returns at once."""
        self._inner.send_command("continue")

    def emergency_stop(self) -> None:
        """Switches everything off at once, and waits for the end of the growth."""
        self._inner.send_command("emergency-stop")
        self.stop()

    def send_command(self, name: str) -> None:
        """Sends a command: "pause", "continue", "preheat", "load", "unload", "purge", "stop" or "emergency-stop"."""
        self._inner.send_command(name)


# Boards whose ports this program has.
_open: weakref.WeakSet[Board] = weakref.WeakSet()


@atexit.register
def _close_all() -> None:
    """Stops the robots of a program that ends without closing their boards. Otherwise the stop could come too late."""
    boards = list(_open)
    # Each robot is ordered to stop before the first one is waited for.
    for board in boards:
        growth = board._under_way()
        if growth is not None:
            with contextlib.suppress(Exception):
                growth.send_command("stop")
    for board in boards:
        with contextlib.suppress(Exception):
            board.close()


# A child process has neither the threads nor the ports.
os.register_at_fork(after_in_child=_open.clear)


class Board:
    """A robot at a port. The end of the with block stops a growth in progress, and disconnects.

    A program that ends without it stops the robots whose ports it has. A growth of the service then continues.
    """

    def __init__(self, inner: _growbot.Board) -> None:
        self._inner = inner
        self._growth: Callable[[], Optional[Growth]] = lambda: None
        if not inner.is_remote:
            _open.add(self)

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
        """True if the robot is simulated."""
        return self._inner.simulated

    def grow(
        self,
        plan: Plan,
        *,
        conditions: Optional[Conditions] = None,
        seed: int = 1,
        log: Optional[Union[str, os.PathLike[str]]] = None,
        overwrite: bool = False,
        force: bool = False,
        ignore_scene: bool = False,
        scene: Optional[Scene] = None,
    ) -> Growth:
        """Grows a plan. log is the file of the run log (.jsonl), which overwrite replaces.

        force ignores the plan's warnings.
        The plan must be clear in scene, or in the scene that it was planned through. Corrections stay clear, too.
        ignore_scene grows the body without regard to the scene, and warns.

        conditions with feedback=True measure and correct the growth. Their noises and biases are allowed only for
        simulated robots that no service owns.
        """
        self._must_be_idle()
        if ignore_scene and (scene is not None or json.loads(plan.to_json()).get("scene") is not None):
            message = "ignore_scene is set: neither the plan nor its corrections are checked against the scene"
            warnings.warn(message, RuntimeWarning, stacklevel=2)
        inner = self._inner.grow(plan, conditions, seed, log, overwrite, force, ignore_scene, scene)
        growth = Growth(inner, None if self._inner.is_remote else self)
        # A growth that the program has dropped stops by itself, unless a service owns the robot.
        self._growth = (lambda: growth) if self._inner.is_remote else weakref.ref(growth)
        return growth

    def attach(self) -> Growth:
        """Returns the current growth of a robot that a service owns, from its first event on."""
        self._must_be_idle()
        growth = Growth(self._inner.attach())
        self._growth = lambda: growth
        return growth

    def detach(self) -> None:
        """Detaches from the growth, which the service owns. It continues after the with block and this program have ended."""
        if not self._inner.is_remote:
            raise BoardError("no service owns the robot: start `growbot serve` with this robot, and connect again")
        self._growth = lambda: None

    def _under_way(self) -> Optional[Growth]:
        growth = self._growth()
        return None if growth is None or growth.ended else growth

    def _must_be_idle(self) -> None:
        if self._under_way() is not None:
            raise BoardError("a growth is in progress: read its events to the end, or stop it", "growing", "idle")

    def status(self) -> dict[str, Any]:
        """Returns the status of the robot, in the format of `growbot status --json`."""
        self._must_be_idle()
        status: dict[str, Any] = json.loads(self._inner.status_json())
        return status

    def stop(self) -> str:
        """Stops a growth that another program has started. Returns a sentence about the result."""
        self._must_be_idle()
        return self._inner.stop()

    def emergency_stop(self) -> None:
        """Switches everything off at once. Raises BoardError unless the board confirms it."""
        growth = self._under_way()
        if growth is not None:
            growth.emergency_stop()
            return
        self._inner.emergency_stop()

    def close(self) -> None:
        """Stops the current growth, and disconnects."""
        growth = self._under_way()
        try:
            if growth is not None:
                growth.stop()
        finally:
            self._inner.close()
            _open.discard(self)
