"""Our own vehicle in this process: as fast as it can be computed, the same every time."""

from __future__ import annotations

from typing import Final

from sitl.conformance.frames import Frame, frames
from sitl.conformance.line import Link
from sitl.mavlink.mavlink_vehicle import MavlinkVehicle, VehicleSettings

_NO_FRAMES: Final[list[tuple[Link, Frame]]] = []


class LocalLine:
    """A `Line` to a simulated vehicle of our own.

    Args:
        settings: What vehicle.
    """

    fresh = True

    def __init__(self, settings: VehicleSettings) -> None:
        self.vehicle = MavlinkVehicle(settings)
        self._ends = {Link.API: self.vehicle.onboard}
        if settings.ground_link:
            self._ends[Link.GROUND] = self.vehicle.ground
        self.links = frozenset(self._ends)

    @property
    def now_s(self) -> float:
        """See `Line`."""
        return self.vehicle.autopilot.time_s

    def send(self, link: Link, frame: bytes) -> None:
        """See `Line`."""
        self.vehicle.receive(self._ends[link], frame)

    def listen(self) -> list[tuple[Link, Frame]]:
        """See `Line`: one step of the simulation."""
        self.vehicle.step()
        self.vehicle.truth.take_frames()
        return [
            (link, frame)
            for link, end in self._ends.items()
            for data in end.take_frames()
            for frame in frames(data)
        ]

    def close(self) -> None:
        """See `Line`."""
