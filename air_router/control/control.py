"""Sends requests to a flight (`air-router fly --control`, `sim --control`) from another program.

from air_router.control.control import ControlClient

with ControlClient() as uav:
    answer = uav.goto([(39.9415, -75.1990), (39.9420, -75.1995)], hold_s=30)
    print(answer.accepted, answer.why, answer.points)
    if not answer.accepted:
        uav.seek("io")
"""

import dataclasses
import re
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from air_router.errors import AirRouterError, ExitCode
from mocha_link.errors import RequestError
from mocha_link.loopback import is_loopback
from mocha_link.service import EndpointClient, EndpointKeyError, ipc_endpoint

CONTROL_NAME: Final = "flight"
"""The endpoint's name for `--control` without a value."""

NOT_RELOADED: Final = "not-reloaded"

_POLL_S: Final = 0.1
"""Interval of checks whether the mission file has been read."""

_WAYS: Final = ("tcp", "ipc")
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,40}")

Place = tuple[float, float]
"""Latitude and longitude, in degrees."""


class ControlError(RequestError):
    """The flight could not parse a request, or has too many; the message has the reason."""


class ControlUnreachableError(AirRouterError):
    """No program answers at the endpoint, or it is no flight."""

    exit_code = ExitCode.NO_VEHICLE


@dataclass(frozen=True, slots=True)
class ControlReply:
    """The answer to a request.

    Attributes:
        accepted: Whether it is carried out.
        why: A sentence: what the vehicle does, or why not.
        code: The reason for a refusal, for programs (docs/errors.md); None if accepted.
        state: The current state of the flight.
        points: Where the vehicle will hover after a `goto`.
    """

    accepted: bool
    why: str
    code: str | None
    state: str
    points: tuple[Place, ...] = ()


class ControlClient(EndpointClient):
    """Sends requests to one flight. One thread may use it; a context manager.

    A flight that does not answer may come back: every request tries again.

    Args:
        endpoint: The flight's endpoint; None: that of `--control` without a value.
        by: The requester, for the flight's record.
        timeout_s: How long to wait for an answer.

    Raises:
        ControlUnreachableError: The endpoint is invalid; from requests: no answer in time.
        ControlError: From requests: the flight could not parse the request.
    """

    server_kind, server_option = "flight", "--control"
    refused, unreachable = ControlError, ControlUnreachableError

    def __init__(
        self, endpoint: str | None = None, *, by: str | None = None, timeout_s: float = 5.0
    ) -> None:
        self._by = by
        try:
            endpoint = endpoint or ipc_endpoint(CONTROL_NAME)
        except EndpointKeyError as error:
            raise self.unreachable(str(error)) from None
        super().__init__(endpoint, timeout_s=timeout_s)

    def hold(self) -> ControlReply:
        """Stop and hover."""
        return self._reply("hold")

    def resume(self, *, upload: bool = False) -> ControlReply:
        """Resume what was held, or take the flight back from the pilot.

        `upload`: upload the mission's plan first; another one may be on board.
        """
        return self._reply("resume", upload=upload)

    def seek(self, robot: str) -> ControlReply:
        """Seek this robot next, at once."""
        return self._reply("seek", robot=robot)

    def explore(self) -> ControlReply:
        """Explore on."""
        return self._reply("explore")

    def home(self) -> ControlReply:
        """End the mission: come home, and land."""
        return self._reply("home")

    def land(self) -> ControlReply:
        """End the mission: land in place."""
        return self._reply("land")

    def reload(self, *, wait_s: float = 60.0) -> ControlReply:
        """Read the mission file again, because its zones or fences have changed.

        Waits until the file was read: `accepted` reports whether the new zones are in force. After
        `wait_s` the answer reports that it is still being read.
        """
        answer = self._reply("reload")
        limit_s = time.monotonic() + wait_s
        while answer.accepted:
            reading = self.status().get("reload")
            if not isinstance(reading, dict):
                raise self.wrong_server()
            answer = dataclasses.replace(answer, why=str(reading.get("why")))
            if reading.get("under_way") is False:
                if reading.get("good") is not True:
                    answer = dataclasses.replace(answer, accepted=False, code=NOT_RELOADED)
                break
            if time.monotonic() > limit_s:
                break
            time.sleep(_POLL_S)
        return answer

    def goto(self, points: Iterable[Place], *, hold_s: float | None = None) -> ControlReply:
        """Fly to points in order, and hover at the last for `hold_s`."""
        return self._reply("goto", points=[list(point) for point in points], hold_s=hold_s)

    def altitude(self, altitude_m: float) -> ControlReply:
        """Climb or descend in place to an altitude above home, and hold there."""
        return self._reply("altitude", altitude_m=altitude_m)

    def status(self) -> dict[str, Any]:
        """The flight's status; docs/control.md has the keys."""
        return self.request({"request": "status"})

    def request(self, values: dict[str, Any]) -> dict[str, Any]:
        """Send a raw request; return the raw answer."""
        return self.call(values)[0]

    def _reply(self, request: str, **fields: Any) -> ControlReply:
        values = self.request({"request": request, "by": self._by, **fields})
        try:
            return ControlReply(
                accepted=values["accepted"] is True,
                why=str(values["why"]),
                code=None if values["code"] is None else str(values["code"]),
                state=str(values["state"]),
                points=tuple((float(a), float(b)) for a, b in values.get("points", ())),
            )
        except (LookupError, TypeError, ValueError):
            raise self.wrong_server() from None


def endpoint_of(text: str) -> str:
    """Parse an endpoint from the command line: a name, a port of this machine, or a full address.

    Any program that can connect controls the vehicle, so only the same user's programs can.

    Raises:
        ValueError: It is invalid, or others could reach it.
    """
    if text.isdecimal() or text == "*":
        text = f"tcp://127.0.0.1:{text}"
    elif _NAME.fullmatch(text):
        try:
            return ipc_endpoint(text)
        except EndpointKeyError as error:
            raise ValueError(str(error)) from None
    try:
        parts = urlsplit(text)
    except ValueError:
        parts = urlsplit("")
    if parts.scheme not in _WAYS:
        raise ValueError(
            f"{text} is no endpoint; write a name, ipc://PATH, a port or tcp://127.0.0.1:PORT"
        )
    if parts.scheme == "tcp":
        host, _, port = text.removeprefix("tcp://").rpartition(":")
        if not is_loopback(host.strip("[]")):
            raise ValueError(
                f"{text}: other machines could reach it and fly the vehicle; write "
                f"tcp://127.0.0.1:{port}, and reach it from elsewhere through SSH (ssh -L)"
            )
        text = f"tcp://127.0.0.1:{port}" if host == "localhost" else text
    return text
