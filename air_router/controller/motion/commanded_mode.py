"""Who has the vehicle: what we commanded, and whether a pilot has changed the mode.

The mode that the autopilot reports is the only truth. While a command is under way (or has
failed) the vehicle may be in the mode before it or in the one that it asks for; once it is
confirmed only in that one. Any other mode was chosen by a pilot or a failsafe.
"""

from __future__ import annotations

from dataclasses import dataclass

from air_router.controller.model.actions import FlyToNode, LandHere, Motion
from air_router.vehicle.vehicle import FlightMode, Telemetry


@dataclass(slots=True)
class CommandedMode:
    """The last command to the vehicle and the modes that it implies.

    Attributes:
        pending: The command that the vehicle has neither confirmed nor failed to follow.
        last: The command that the vehicle follows or is asked to; None when it did not.
        refused_jumps: How many jumps within the plan it did not follow, one after the other.
    """

    pending: Motion | None = None
    last: Motion | None = None
    refused_jumps: int = 0
    _modes: frozenset[FlightMode] = frozenset()

    def assume(self, mode: FlightMode) -> None:
        """Take the vehicle in the mode that the pilot (or the start) put it in."""
        self.pending = None
        self._modes = frozenset({mode})

    def commanded(self, motion: Motion) -> None:
        """A motion was asked for; it is pending until confirmed or failed."""
        self.pending = self.last = motion
        self._modes |= {mode_of(motion)}

    def confirmed(self, motion: Motion) -> None:
        """The vehicle follows; an older command's late confirmation changes nothing."""
        if motion is self.pending:
            self.assume(mode_of(motion))
            if isinstance(motion, FlyToNode):
                self.refused_jumps = 0

    def failed(self, motion: Motion) -> bool:
        """The vehicle did not follow; True if that was the last command."""
        if motion is not self.pending:
            return False
        self.pending = self.last = None
        self.refused_jumps += isinstance(motion, FlyToNode)
        return True

    def release(self) -> None:
        """Hands off."""
        self.pending = self.last = None
        self._modes = frozenset()

    def taken(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle in the air flies in a mode that we did not ask for, or by a failsafe.

        A failsafe may act in the very mode that we asked for: a fence holds a vehicle that hovers
        in Hold. On the ground the autopilot changes its mode by itself, when it disarms.
        """
        flies = telemetry.in_air and telemetry.armed
        return flies and (telemetry.failsafe or telemetry.mode not in self._modes)


def mode_of(motion: Motion) -> FlightMode:
    """The flight mode in which a motion is flown."""
    match motion:
        case FlyToNode():
            return FlightMode.MISSION
        case LandHere():
            return FlightMode.LAND
        case _:
            return FlightMode.HOLD
