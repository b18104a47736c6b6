"""The simulated vehicle as a process: UDP sockets and the wall clock around `MavlinkVehicle`."""

from __future__ import annotations

import logging
import select
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from mocha_link.lifetime import Closeable
from sitl.mavlink_link import MavlinkLink
from sitl.mavlink_vehicle import STEP_S, MavlinkVehicle, VehicleSettings
from sitl.udp_link import Address, UdpLink

_log = logging.getLogger(__name__)

_LEAST_WAIT_S: Final = 0.004  # at high speeds several steps are done at once
_MOST_BEHIND_S: Final = 0.25


@dataclass(frozen=True, slots=True)
class Ports:
    """Where a vehicle listens and sends; see `px4_ports` for PX4's.

    Attributes:
        onboard_bind: Of the API link.
        onboard_to: Its partner until somebody talks.
        ground_bind: Of the ground station link.
        ground_to: Its partner until somebody talks; None: no such link.
        truth_bind: Of the truth link.
        truth_to: Its receiver.
    """

    onboard_bind: Address
    onboard_to: Address
    ground_bind: Address
    ground_to: Address | None
    truth_bind: Address
    truth_to: Address


def px4_ports(instance: int) -> Ports:
    """The ports of PX4's SITL instance N; it only ever sends to its own machine."""
    return Ports(
        ("", 14580 + instance),
        ("127.0.0.1", 14540 + instance if instance <= 9 else 14549),
        ("", 18570 + instance),
        ("127.0.0.1", 14550),
        ("127.0.0.1", 19450 + instance),
        ("127.0.0.1", 19410 + instance),
    )


class VehicleProcess(Closeable):
    """Runs a vehicle; a context manager that frees its ports.

    Args:
        settings: The vehicle.
        ports: Its places on the network.

    Raises:
        PortInUseError: one of the ports is taken.
    """

    def __init__(self, settings: VehicleSettings, ports: Ports) -> None:
        self._speed = settings.speed
        self._vehicle = MavlinkVehicle(settings)
        self._links: list[tuple[MavlinkLink, UdpLink]] = []
        try:
            self._open(self._vehicle.onboard, ports.onboard_bind, ports.onboard_to, "API link")
            if ports.ground_to is not None:
                self._open(self._vehicle.ground, ports.ground_bind, ports.ground_to, "GCS link")
            self._open(self._vehicle.truth, ports.truth_bind, ports.truth_to, "truth")
        except BaseException:
            self.close()
            raise

    @property
    def vehicle(self) -> MavlinkVehicle:
        """The vehicle that runs."""
        return self._vehicle

    def port(self, link: MavlinkLink) -> int:
        """The port that a link receives on."""
        return next(end.port for opened, end in self._links if opened is link)

    def run(self, stopped: Callable[[], bool]) -> None:
        """Run until `stopped` says so; it is asked at least fifty times a second."""
        step_s = STEP_S / self._speed
        least_wait_s = _LEAST_WAIT_S if step_s < _LEAST_WAIT_S else 0.0
        level = logging.WARNING
        next_s = time.monotonic()
        while not stopped():
            now_s = time.monotonic()
            if now_s - next_s > _MOST_BEHIND_S:
                _log.log(level, "too slow for this speed: %.2f s of real time lost", now_s - next_s)
                level, next_s = logging.DEBUG, now_s  # once is enough
            while next_s <= now_s:
                self._vehicle.step()
                next_s += step_s
            self._flush()
            self._receive(min(max(next_s - time.monotonic(), least_wait_s), STEP_S))

    def close(self) -> None:
        """Free the ports."""
        for _, end in self._links:
            end.close()
        self._links.clear()

    def _open(self, link: MavlinkLink, bind: Address, partner: Address, what: str) -> None:
        self._links.append((link, UdpLink(bind, partner, what)))

    def _receive(self, timeout_s: float) -> None:
        """Answer what comes in until it is time for the next step."""
        end_s = time.monotonic() + timeout_s
        while (left_s := end_s - time.monotonic()) > 0:
            ready = select.select([end for _, end in self._links], [], [], left_s)[0]
            for link, end in self._links:
                if end not in ready:
                    continue
                for datagram in end.receive():
                    if link is not self._vehicle.truth:
                        self._vehicle.receive(link, datagram)
            if ready:
                self._flush()

    def _flush(self) -> None:
        for link in (self._vehicle.onboard, self._vehicle.ground, self._vehicle.truth):
            frames = link.take_frames()
            end = next((end for opened, end in self._links if opened is link), None)
            if frames and end is not None:
                end.send(frames)
