"""Robots that `growbot serve` owns, through HTTP on the user's socket, like growbot's commands."""

from __future__ import annotations

import http.client
import json
import os
import socket
import stat
import struct
import time
import uuid
from pathlib import Path
from typing import Any, Iterator, Optional, Union

from growbot._conditions import Conditions
from growbot._errors import BoardError, FileError, InputError
from growbot._growbot import Plan, Scene

#: Timeout of a request, s. A command to a robot may wait for its board.
_RESPONSE_TIMEOUT_S = 30.0
#: Interval at which a service that has ended is tried again, s.
_RECONNECT_DELAY_S = 0.5

_COMMANDS = ("pause", "continue", "stop", "emergency-stop")
_TASKS = ("preheat", "load", "unload", "purge")


class _Connection(http.client.HTTPConnection):
    """HTTP on a Unix socket."""

    def __init__(self, path: Path, timeout: Optional[float]) -> None:
        super().__init__("localhost", timeout=timeout)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.settimeout(self.timeout)
        self.sock.connect(str(self._path))
        credentials = self.sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        owner = _CREDENTIALS.unpack(credentials)[1]
        if not _is_trusted(owner):
            self.close()
            raise BoardError(
                f"the program that listens on {self._path} belongs to user {owner}, so it is not the growbot service "
                "of this user: remove the socket, and start `growbot serve` again",
                value=owner,
            )


#: Process, user and group of the program at the other end of a socket (struct ucred).
_CREDENTIALS = struct.Struct("3i")


def _is_trusted(user: int) -> bool:
    """Returns whether this program trusts programs of another user: of its own user, or of root."""
    return user in (os.geteuid(), 0)


def _check_folder(folder: Path) -> None:
    """Raises BoardError if another user can put a socket in place of the service's."""
    found = folder.stat()
    mode = stat.S_IMODE(found.st_mode)
    if not _is_trusted(found.st_uid):
        raise BoardError(
            f"{folder} belongs to user {found.st_uid}, so another user can answer in place of the service: "
            "remove this folder",
            value=found.st_uid,
        )
    if mode & 0o077:
        raise BoardError(
            f"{folder} has mode {mode:04o}, so another user can answer in place of the service: "
            f"run `chmod go-rwx {folder}`",
            value=f"{mode:04o}",
            limit="0700",
        )


def _socket_of_user() -> Optional[Path]:
    """Returns the socket on which this user's service listens. None without a home directory."""

    def absolute(key: str) -> Optional[Path]:
        path = Path(os.environ.get(key, ""))
        return path if path.is_absolute() else None

    runtime, state, home = absolute("XDG_RUNTIME_DIR"), absolute("XDG_STATE_HOME"), absolute("HOME")
    if runtime is not None:
        return runtime / "growbot/serve.sock"
    if state is None and home is not None:
        state = home / ".local/state"
    return None if state is None else state / "growbot/serve/serve.sock"


class ServiceClient:
    """Client of this user's service."""

    def __init__(self, path: Path) -> None:
        self._path = path

    @classmethod
    def find(cls) -> Optional[ServiceClient]:
        """Returns the running service. None if no service listens. Raises BoardError if it may be another user's."""
        path = _socket_of_user()
        if path is None or not path.exists():
            return None
        _check_folder(path.parent)
        service = cls(path)
        try:
            service._connected(_RESPONSE_TIMEOUT_S).close()
        except OSError:
            return None
        return service

    def _connected(self, timeout: Optional[float]) -> _Connection:
        connection = _Connection(self._path, timeout)
        connection.connect()
        return connection

    def _send(self, connection: _Connection, path: str, body: Any = None) -> http.client.HTTPResponse:
        method, headers = ("GET", {}) if body is None else ("POST", {"content-type": "application/json"})
        if path.endswith("/jobs") and body is not None:
            headers["idempotency-key"] = uuid.uuid4().hex
        text = None if body is None else json.dumps(body)
        connection.request(method, f"/api/v1{path}", body=text, headers=headers)
        response = connection.getresponse()
        if response.status >= 400:
            content = response.read()
            try:
                detail = str(json.loads(content)["detail"])
            except (ValueError, KeyError, TypeError):
                detail = content.decode(errors="replace")[:500]
            kind = InputError if response.status in (404, 422) else BoardError
            raise kind(detail)
        return response

    def _bytes(self, path: str, body: Any = None) -> bytes:
        connection = self._connected(_RESPONSE_TIMEOUT_S)
        try:
            return self._send(connection, path, body).read()
        finally:
            connection.close()

    def bytes(self, path: str, body: Any = None) -> bytes:
        """Sends GET to a path, or POST with a body, and returns the response."""
        try:
            return self._bytes(path, body)
        except (OSError, http.client.HTTPException) as error:
            raise BoardError(f"the service does not respond ({error}): check that `growbot serve` runs") from error

    def json(self, path: str, body: Any = None) -> Any:
        """Like bytes, but parses the response as JSON."""
        return json.loads(self.bytes(path, body))

    def robot_at(self, port: str) -> Optional[dict[str, Any]]:
        """Returns the robot at a port. None if the service does not own it."""

        def is_there(other: str) -> bool:
            return other == port or (os.path.exists(port) and os.path.realpath(other) == os.path.realpath(port))

        return next((robot for robot in self.json("/robots") if is_there(robot["port"])), None)

    def lines(self, job: str) -> Iterator[Optional[str]]:
        """Yields the lines of a job's run log when they are written, each once, and None from time to time.

        If the service ends, this waits for it, because it resumes its jobs when it runs again.
        """
        after = 0
        while True:
            try:
                connection = self._connected(None)
                try:
                    for number, line in _events(self._send(connection, f"/jobs/{job}/events?after={after}")):
                        after = after if number is None else number
                        yield line
                finally:
                    connection.close()
                # The events of a job end with it, but the connection may have ended for another reason.
                if json.loads(self._bytes(f"/jobs/{job}"))["state"] != "active":
                    return
                time.sleep(_RECONNECT_DELAY_S)
            except (OSError, http.client.HTTPException):
                yield None
                time.sleep(_RECONNECT_DELAY_S)


def _events(response: http.client.HTTPResponse) -> Iterator[tuple[Optional[int], Optional[str]]]:
    """Yields the numbers and data of server-sent events. A comment, which keeps the connection alive, has neither."""
    number, data = None, None
    for raw in response:
        line = raw.decode().rstrip("\r\n")
        if not line:
            yield number, data
            number, data = None, None
        elif line.startswith("id:"):
            number = int(line[3:])
        elif line.startswith("data:"):
            data = line[5:].lstrip()


class ServiceGrowth:
    """A job of the service, with the interface of a growth on a board of this program."""

    def __init__(self, service: ServiceClient, robot: str, job: str, log: Optional[Path]) -> None:
        self._service, self._robot, self._job, self._log = service, robot, job, log
        self._lines = service.lines(job)
        self._result: Optional[dict[str, Any]] = None
        self.ended = False

    @property
    def result_json(self) -> Optional[str]:
        return None if self._result is None else json.dumps(self._result)

    def next_json(self) -> Optional[str]:
        interrupted: Optional[KeyboardInterrupt] = None
        while not self.ended:
            try:
                line = next(self._lines, "")
                if line == "":
                    self._end()
                    break
                if line is None or interrupted is not None and '"event":"end"' not in line:
                    continue
                event = json.loads(line)
                if event.get("event") != "end":
                    return line
                self._result = event["result"]
            except KeyboardInterrupt as interrupt:
                # The first Ctrl-C stops the robot. A second one sends the emergency stop, even while the first waits.
                try:
                    self._send_command("stop" if interrupted is None else "emergency-stop")
                except KeyboardInterrupt:
                    self._send_command("emergency-stop")
                interrupted = interrupt
                self._lines = self._service.lines(self._job)
        if interrupted is not None:
            raise interrupted
        return None

    def _end(self) -> None:
        """Records the end of the run log."""
        self.ended = True
        if self._log is not None:
            _write(self._log, self._service.bytes(f"/jobs/{self._job}/log"))
        if self._result is None:
            why = self._service.json(f"/jobs/{self._job}").get("reason") or "the service gave no reason"
            raise BoardError(f"job {self._job} ended without a result: {why}")
        outcome = self._result["outcome"]
        if outcome not in ("done", "stopped"):
            fault = f" ({self._result['fault']})" if self._result.get("fault") else ""
            raise BoardError(
                f"the growth ended with {outcome}{fault}: check robot {self._robot}, then resume the body with "
                "`growbot resume` if the robot still stores it",
                outcome,
                "done",
            )

    def _send_command(self, command: str) -> None:
        self._service.json(f"/robots/{self._robot}/commands", {"command": command})

    def send_command(self, name: str) -> None:
        if name in _COMMANDS:
            self._send_command(name)
        elif name in _TASKS:
            self._service.bytes(f"/jobs/{self._job}/live/commands/{name}", {})
        else:
            known = ", ".join(_COMMANDS + _TASKS)
            raise InputError(f"unknown command {name!r}: give one of {known}", name, known)


def _write(path: Path, content: bytes) -> None:
    """Writes a whole file, or leaves it unchanged."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_bytes(content)
        os.replace(beside, path)
    except OSError as error:
        raise FileError(f"cannot write {path} ({error.strerror}): name another file") from error


class ServiceBoard:
    """A robot that the service owns, with the interface of a board of this program."""

    def __init__(self, service: ServiceClient, robot: dict[str, Any]) -> None:
        self._service: Optional[ServiceClient] = service
        self._robot = str(robot["name"])
        self.simulated = bool(robot["simulated"])

    def _require_service(self) -> ServiceClient:
        if self._service is None:
            raise BoardError("the board is disconnected: connect again with growbot.connect")
        return self._service

    def _send_command(self, command: str) -> None:
        self._require_service().json(f"/robots/{self._robot}/commands", {"command": command})

    def grow(
        self,
        plan: Plan,
        conditions: Optional[Conditions] = None,
        seed: Optional[int] = None,
        log: Optional[Union[str, os.PathLike[str]]] = None,
        overwrite: Optional[bool] = None,
        force: Optional[bool] = None,
        ignore_scene: Optional[bool] = None,
        scene: Optional[Scene] = None,
    ) -> ServiceGrowth:
        feedback = conditions is not None and conditions.feedback
        if conditions not in (None, Conditions(), Conditions(feedback=True)) or seed not in (None, 1):
            raise InputError(
                f"robot {self._robot} is owned by the service, which accepts no noise, bias or seed: remove these "
                'conditions, or connect to "sim"'
            )
        path = None if log is None else Path(log)
        if path is not None and path.exists() and not overwrite:
            raise FileError(f"{path} already exists: name another file, or set overwrite=True")
        written = json.loads(plan.to_json())
        request = {
            "plan": written,
            "feedback": feedback,
            "force": bool(force),
            "ignore_scene": bool(ignore_scene),
            "name": "from Python",
        }
        scene_file = scene.file if scene is not None else (written.get("scene") or {}).get("file")
        if scene_file is not None:
            # The service runs in another directory.
            request["scene"] = os.path.abspath(scene_file)
        job = self._require_service().json(f"/robots/{self._robot}/jobs", request)
        return ServiceGrowth(self._require_service(), self._robot, job["id"], path)

    def attach(self) -> ServiceGrowth:
        robot = self._require_service().json(f"/robots/{self._robot}")
        if robot["job"] is None:
            raise BoardError(f"robot {self._robot} has no active job: start a growth", "none", "a job")
        return ServiceGrowth(self._require_service(), self._robot, robot["job"], None)

    def status_json(self) -> str:
        robot = self._require_service().json(f"/robots/{self._robot}")
        values = {key: robot[key] for key in ("laid", "temperature_c", "target_c", "fault")}
        return json.dumps({"event": "status", "state": robot["state"], **values})

    def stop(self) -> str:
        self._send_command("stop")
        return f"stopped: heater and steppers of the {'simulated ' if self.simulated else ''}robot are off"

    def emergency_stop(self) -> None:
        self._send_command("emergency-stop")

    def close(self) -> None:
        self._service = None
