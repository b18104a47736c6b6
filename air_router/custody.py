"""Who has the vehicle: what we commanded last, and whether somebody else has changed the mode.

The mode that the autopilot reports is the only truth. While a command is under way both the old
and the new mode are ours to expect; once it is confirmed, any other mode is somebody else's.
"""

from __future__ import annotations

from dataclasses import dataclass

from air_router.actions import FlyToNode, LandHere, Motion
from air_router.vehicle import FlightMode, Telemetry


@dataclass(slots=True)
class Custody:
    """The last command to the vehicle and the mode that it implies."""

    pending: Motion | None = None
    _mode: FlightMode | None = None

    def assume(self, mode: FlightMode) -> None:
        """Take the vehicle in the mode that the pilot (or the start) put it in."""
        self.pending = None
        self._mode = mode

    def commanded(self, motion: Motion) -> None:
        """A motion was asked for; it is pending until confirmed or failed."""
        self.pending = motion
        match motion:
            case FlyToNode():
                self._mode = FlightMode.MISSION
            case LandHere():
                self._mode = FlightMode.LAND
            case _:
                self._mode = FlightMode.HOLD

    def confirmed(self, motion: Motion) -> None:
        """The vehicle follows; an older command's late confirmation changes nothing."""
        if motion is self.pending:
            self.pending = None

    def failed(self, motion: Motion) -> bool:
        """The vehicle did not follow; True if that was the last command.

        The mode stays the one of the last success: if it is now another one, somebody chose it.
        """
        if motion is not self.pending:
            return False
        self.pending = None
        self._mode = None
        return True

    def release(self) -> None:
        """Hands off."""
        self.pending = None
        self._mode = None

    def taken(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle flies in a mode that we did not ask for."""
        if self.pending is not None:
            return False
        if self._mode is None:
            # A command failed: hovering or flying the plan may still be ours, nothing else is.
            return telemetry.mode not in {FlightMode.MISSION, FlightMode.HOLD, FlightMode.LAND}
        return telemetry.mode is not self._mode
