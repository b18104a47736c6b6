"""What the vehicle may be flying to: the motions that were commanded, and where it would stop.

Commands arrive when they arrive, so that a vehicle may follow the one before, the newest, or turn
from one to the other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from types import MappingProxyType
from typing import Final

from air_router.controller.model import FlyToNode, FlyToPoint, HoldHere, LandHere, Motion
from air_router.controller.motion.limits import FAR_M, REACTION_S, TURNING_S, TURNING_S2_M
from air_router.routing import BRAKING_M_S2, PendingSetpoint
from air_router.vehicle import FlightMode, Telemetry
from geo.frame import Point

MODES: Final[Mapping[type[Motion], FlightMode]] = MappingProxyType(
    {
        FlyToNode: FlightMode.MISSION,
        FlyToPoint: FlightMode.HOLD,
        HoldHere: FlightMode.HOLD,
        LandHere: FlightMode.LAND,
    }
)
"""The flight mode in which a motion is flown."""


@dataclass(slots=True, eq=False)
class PendingSetpoints:
    """The commands that the vehicle may be following, or may yet begin to follow, in order.

    Args:
        near_m: A place nearer than this has been reached.
        speed_m_s: How fast it flies there; faster, if it was seen to.
    """

    near_m: float
    speed_m_s: float
    _sent: list[Motion] = field(default_factory=list)  # in order; the first may be confirmed
    _settled: bool = False  # the first of them is

    def sent(self, motion: Motion) -> None:
        """This was commanded; what was before holds until it is confirmed."""
        if not self._sent or motion != self._sent[-1]:
            self._sent.append(motion)

    def confirmed(self, motion: Motion) -> None:
        """The vehicle follows this: what was commanded before it is void, on a link in order.

        Of several alike it is the newest: what was commanded meanwhile has not left yet.
        """
        for index in reversed(range(len(self._sent))):
            if self._sent[index] == motion:
                del self._sent[:index]
                self._settled = True
                return

    @property
    def all_known(self) -> Sequence[Motion]:
        """All that it may be following; none while that may be something from before these."""
        return self._sent if self._settled else ()

    def forget(self) -> None:
        """The pilot or a ground station has commanded something since."""
        self._sent.clear()
        self._settled = False

    def under_way(self, jump: FlyToNode) -> bool:
        """Whether something that was commanded before a jump is still to come."""
        return bool(self._before(jump)[self._settled :])

    def given_up(self, jump: FlyToNode) -> bool:
        """Whether a jump to the same item was given up before, and may come late."""
        return jump in self._before(jump)

    def _before(self, jump: FlyToNode) -> list[Motion]:
        return self._sent[:-1] if self._sent and self._sent[-1] == jump else self._sent

    def open(self, telemetry: Telemetry, unsent: Motion | None = None) -> list[Point]:
        """Where it was sent by us and has not arrived: there it is flying, or begins to.

        Args:
            telemetry: Where it is.
            unsent: Was decided on, and has not left for the vehicle. An equal one may have.
        """
        return [
            motion.position
            for motion in self._sent
            if isinstance(motion, FlyToNode | FlyToPoint)
            and motion is not unsent
            and math.dist(motion.position, telemetry.position) > self.near_m
        ]

    def pending(
        self, telemetry: Telemetry, unsent: Motion | None = None
    ) -> tuple[PendingSetpoint, ...]:
        """Everywhere that it may be flying to now: by our commands, and by its own telemetry.

        Args:
            telemetry: Where it is, and its target.
            unsent: Was decided on, and has not left for the vehicle. An equal one may have.
        """
        here, target, places = telemetry.position, telemetry.target, self.open(telemetry, unsent)
        if target is not None and math.dist(target, here) > FAR_M:
            places.append(target)
        if not places:
            return ()
        speed_m_s = max(self.speed_m_s, math.hypot(*telemetry.velocity_m_s))
        beyond_m = TURNING_S * speed_m_s + TURNING_S2_M * speed_m_s**2
        places = [*dict.fromkeys(places)]
        found = [_setpoint(here, place, beyond_m) for place in places]
        # It may turn from the end of one to another, and away there.
        for one, other in permutations(places, 2):
            if math.dist(one, other) > self.near_m:
                found.append(_setpoint(one, other, beyond_m))
        return tuple(found)


def _setpoint(start: Point, place: Point, beyond_m: float) -> PendingSetpoint:
    share = 1.0 + beyond_m / math.dist(start, place)
    east_m, north_m = start
    reach = Point(
        east_m + share * (place.east_m - east_m), north_m + share * (place.north_m - north_m)
    )
    return PendingSetpoint(place, reach)


def stopping_point(telemetry: Telemetry, reaction_s: float = REACTION_S) -> Point:
    """Where the vehicle comes to rest if it is announced now to brake."""
    east_m_s, north_m_s = telemetry.velocity_m_s
    travel_s = reaction_s + math.hypot(east_m_s, north_m_s) / (2 * BRAKING_M_S2)
    east_m, north_m = telemetry.position
    return Point(east_m + travel_s * east_m_s, north_m + travel_s * north_m_s)
