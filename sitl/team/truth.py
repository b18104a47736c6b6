"""The vehicle's true position and time over UDP, and the simulation's clock that follows it.

The position is in HIL_STATE_QUATERNION, as PX4's SIH simulator sends it. PX4 leaves that message's
time at zero; the simulated time stands in HIL_ACTUATOR_CONTROLS, which it sends on the same link.
"""

import logging
import math
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from air_router.errors import AirRouterError
from sitl.mavlink import frames

_log = logging.getLogger(__name__)

_LARGEST_DATAGRAM: Final = 65535
_STATE, _CLOCK = "HIL_STATE_QUATERNION", "HIL_ACTUATOR_CONTROLS"
_RESTART_S: Final = 1.0  # a step back of more than this is a vehicle that was started anew


class TruthError(AirRouterError):
    """The truth stream cannot be received; the message has the cause and a remedy."""


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
        self._time_s = 0.0  # simulated, as received last

    def parse(self, datagram: bytes) -> VehicleState | None:
        """The last valid state in a datagram, or None."""
        state: VehicleState | None = None
        for frame in frames(datagram):
            if frame.name not in (_STATE, _CLOCK) or not frame.intact:
                continue
            fields = frame.fields()
            if fields["time_usec"]:
                self._time_s = fields["time_usec"] / 1e6
            if frame.name == _STATE:
                state = _state(fields, self._time_s) or state
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


def _state(fields: Mapping[str, Any], time_s: float) -> VehicleState | None:
    w, x, y, z = fields["attitude_quaternion"]
    heading_deg = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))) % 360
    degrees = (fields["lat"] / 1e7, fields["lon"] / 1e7)
    state = VehicleState(time_s, *degrees, fields["alt"] / 1e3, heading_deg)
    usable = abs(state.latitude_deg) <= 90 and abs(state.longitude_deg) <= 180
    return state if usable and math.isfinite(heading_deg) else None


class SimClock:
    """Unix seconds of the simulated world; never runs backwards.

    `now_s` may be called from any thread: it reads one attribute, which `advance`, called from one
    thread only, replaces.

    Args:
        epoch_s: Unix time at simulated time zero; None: such that the first `advance` happens at
            the present wall time.
        wall_s: The wall clock, in Unix seconds.

    Attributes:
        epoch_s: Unix time at simulated time zero; None while it is unknown.
        elapsed_s: Simulated seconds since time zero, through all starts of the vehicle.
    """

    def __init__(self, epoch_s: float | None, wall_s: Callable[[], float] = time.time) -> None:
        self.epoch_s = epoch_s
        self._wall_s = wall_s
        self.elapsed_s = 0.0
        self._offset_s = 0.0  # what came before the vehicle's last start
        self._now_s = wall_s() if epoch_s is None else epoch_s  # Unix

    def now_s(self) -> float:
        """Unix seconds now."""
        return self._now_s

    def advance(self, vehicle_time_s: float) -> None:
        """Follow the vehicle's simulated time.

        A vehicle that is started again begins at zero; the world then goes on from where it was.
        """
        if self.epoch_s is None:
            self.epoch_s = self._wall_s() - vehicle_time_s
        elapsed_s = vehicle_time_s + self._offset_s
        if elapsed_s < self.elapsed_s - _RESTART_S:
            _log.warning("the vehicle's time stepped back: taken as a restart of the vehicle")
            self._offset_s = self.elapsed_s - vehicle_time_s
            elapsed_s = self.elapsed_s
        self.elapsed_s = max(self.elapsed_s, elapsed_s)
        self._now_s = max(self._now_s, self.epoch_s + self.elapsed_s)
