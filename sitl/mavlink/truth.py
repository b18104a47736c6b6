"""The vehicle's true position and time, as PX4's SIH simulator sends them over UDP.

The position is in HIL_STATE_QUATERNION. PX4 leaves that message's time at zero; the simulated time
stands in HIL_ACTUATOR_CONTROLS, which it sends on the same link.
"""

from __future__ import annotations

import math
import socket
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from pymavlink.dialects.v20 import common as mavlink

from air_router.errors import AirRouterError
from sitl.mavlink.codec import frames

_LARGEST_DATAGRAM: Final = 65535

_WANTED: Final = frozenset(
    {mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, mavlink.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS}
)


class TruthError(AirRouterError):
    """The truth stream cannot be received; the message says why and what to do."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """One HIL_STATE_QUATERNION, in SI units.

    Attributes:
        time_s: Simulated seconds.
        latitude_deg: WGS-84.
        longitude_deg: WGS-84.
        altitude_amsl_m: Above mean sea level.
        heading_deg: Clockwise from true north, from the attitude quaternion.
    """

    time_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    heading_deg: float


class TruthParser:
    """Finds the newest vehicle state in MAVLink datagrams, and leaves the rest alone."""

    def __init__(self) -> None:
        self._mavlink = mavlink.MAVLink(None)
        self._time_s = 0.0  # simulated, of the last HIL_ACTUATOR_CONTROLS

    def parse(self, datagram: bytes) -> VehicleState | None:
        """The last valid state in a datagram, or None."""
        state: VehicleState | None = None
        for frame in frames(datagram):
            if frame.number not in _WANTED:
                continue
            try:
                message = self._mavlink.decode(bytearray(frame.data))
            except mavlink.MAVError:
                continue
            if message.time_usec:
                self._time_s = message.time_usec / 1e6
            if message.get_type() == "HIL_STATE_QUATERNION":
                state = _state(message, self._time_s) or state
        return state


class TruthReceiver:
    """Receives the truth stream.

    Args:
        url: Where the vehicle sends it to, `udp://127.0.0.1:19410`; port 0 takes a free one.

    Raises:
        TruthError: the address is not of that form, or taken.
    """

    def __init__(self, url: str) -> None:
        host, port = _endpoint(url)
        self._parser = TruthParser()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise TruthError(
                f"cannot receive the vehicle's truth on {url}: {error.strerror}; end the other "
                "simulation, or give another --truth here and to the vehicle"
            ) from None
        self.url = f"udp://{host}:{self._socket.getsockname()[1]}"

    def receive(self, timeout_s: float) -> VehicleState | None:
        """The newest state, None if none came in time. Older ones that waited are passed over."""
        newest: VehicleState | None = None
        try:
            self._socket.settimeout(timeout_s)
            newest = self._parser.parse(self._socket.recv(_LARGEST_DATAGRAM))
            self._socket.setblocking(False)
            while True:
                newest = self._parser.parse(self._socket.recv(_LARGEST_DATAGRAM)) or newest
        except (TimeoutError, BlockingIOError):
            return newest

    def close(self) -> None:
        """Free the port."""
        self._socket.close()


def _endpoint(url: str) -> tuple[str, int]:
    parts = urlsplit(url)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if parts.scheme != "udp" or not host or port is None:
        raise TruthError(f"'{url}' is not a place for the truth stream; write udp://HOST:PORT")
    return host, port


def _state(message: Any, time_s: float) -> VehicleState | None:
    w, x, y, z = message.attitude_quaternion
    heading_deg = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))) % 360
    state = VehicleState(
        time_s,
        message.lat / 1e7,
        message.lon / 1e7,
        message.alt / 1e3,
        heading_deg,
    )
    usable = abs(state.latitude_deg) <= 90 and abs(state.longitude_deg) <= 180
    return state if usable and math.isfinite(heading_deg) else None
