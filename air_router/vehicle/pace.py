"""Client of a simulated world's clock, which waits for its participants.

A process in simulated time reports its progress as lines of JSON over TCP: `{"name": "team",
"reached_s": 12.3}`. The world (`sitl.process.pace`) runs at most `PACE_ALLOWANCE_S` ahead of the
slowest process. It does not wait for a closed connection.
"""

import contextlib
import json
import logging
import math
import socket
from dataclasses import dataclass
from typing import Final, Self

from air_router.vehicle.limits import PACE_CONNECT_S, PACE_STEP_S
from air_router.vehicle.vehicle import Telemetry, VehicleEvent
from mocha_link.lifetime import Closeable

_log = logging.getLogger(__name__)


_PORTS: Final = range(1, 65536)


@dataclass(frozen=True, slots=True)
class PaceSource:
    """Address of a simulation's clock.

    Attributes:
        host: Host of the world's clock.
        port: Its TCP port.
        speed: Highest speed of the world, as a multiple of real time.
    """

    host: str
    port: int
    speed: float = 1.0

    @classmethod
    def of(cls, text: str) -> Self:
        """Parse HOST:PORT or HOST:PORT,SPEED. Raises ValueError if it is neither."""
        place, _, speed = text.partition(",")
        host, _, port = place.rpartition(":")
        wrong = ValueError(f"'{text}' is not HOST:PORT or HOST:PORT,SPEED")
        try:
            source = cls(host, int(port), float(speed or 1.0))
        except ValueError:
            raise wrong from None
        if not host or source.port not in _PORTS or not 0.0 < source.speed < math.inf:
            raise wrong
        return source

    def __str__(self) -> str:
        return f"{self.host}:{self.port},{self.speed:g}"

    def connect(self) -> socket.socket:
        """Open a non-blocking connection to the world's clock. Raises OSError."""
        connection = socket.create_connection((self.host, self.port), PACE_CONNECT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        return connection


class PaceClient(Closeable):
    """Reports this process's progress, from one thread; does nothing without a world.

    Args:
        source: Where to report; None: no report.
        name: This process's name in the world's log.
    """

    def __init__(self, source: PaceSource | None, name: str) -> None:
        self._source = source
        self._name = name
        self._socket: socket.socket | None = None  # None until the first report
        self._reported_s = -math.inf  # vehicle's clock

    def reached(self, time_s: float) -> None:
        """Report that everything up to this time of the vehicle's clock is done."""
        if self._source is None or abs(time_s - self._reported_s) < PACE_STEP_S:
            return
        self._reported_s = time_s
        try:
            if self._socket is None:
                self._socket = self._source.connect()
            self._socket.send(line({"name": self._name, "reached_s": round(time_s, 3)}))
        except BlockingIOError:
            pass  # a thousand reports wait there already
        except OSError as error:
            _log.debug("the world's clock is gone: %s", error)
            self.close()

    def received(self, event: VehicleEvent) -> None:
        """Handle a vehicle event: reports start with arming."""
        if isinstance(event, Telemetry) and (event.armed or self._reported_s > -math.inf):
            self.reached(event.time_s)

    def close(self) -> None:
        """End the reports: the world no longer waits for this process."""
        self._source = None
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()
            self._socket = None


def line(fields: dict[str, object]) -> bytes:
    """A message as sent over the connection."""
    return json.dumps(fields).encode() + b"\n"
