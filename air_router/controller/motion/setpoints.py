"""Where the vehicle may be flying to: the motions commanded so far, and its stopping point.

Commands arrive late: the vehicle may follow the previous one, the newest one, or turn from one to
the other.
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
"""The flight mode in which PX4 flies each motion."""


@dataclass(slots=True, eq=False)
class PendingSetpoints:
    """The commands that the vehicle may be following or may still begin to follow, in order.

    Args:
        near_m: A place nearer than this counts as reached.
        speed_m_s: Planned speed; the actual speed counts if it is higher.
    """

    near_m: float
    speed_m_s: float
    _sent: list[Motion] = field(default_factory=list)  # in order; the first may be confirmed
    _settled: bool = False  # the first is confirmed

    def sent(self, motion: Motion) -> None:
        """Add a commanded motion; earlier ones count until it is confirmed."""
        if not self._sent or motion != self._sent[-1]:
            self._sent.append(motion)

    def confirmed(self, motion: Motion) -> None:
        """The vehicle follows this motion: earlier ones are void, because the link keeps the order.

        Of several equal ones the newest is meant: motions commanded meanwhile were not sent yet.
        """
        for index in reversed(range(len(self._sent))):
            if self._sent[index] == motion:
                del self._sent[:index]
                self._settled = True
                return

    @property
    def all_known(self) -> Sequence[Motion]:
        """All motions that the vehicle may follow; empty while it may follow an earlier one."""
        return self._sent if self._settled else ()

    def forget(self) -> None:
        """Forget all: a pilot or a ground station has commanded the vehicle since."""
        self._sent.clear()
        self._settled = False

    def under_way(self, jump: FlyToNode) -> bool:
        """Whether a motion commanded before a jump may still arrive."""
        return bool(self._before(jump)[self._settled :])

    def given_up(self, jump: FlyToNode) -> bool:
        """Whether an earlier jump to the same item was given up and may arrive late."""
        return jump in self._before(jump)

    def _before(self, jump: FlyToNode) -> list[Motion]:
        return self._sent[:-1] if self._sent and self._sent[-1] == jump else self._sent

    def open(self, telemetry: Telemetry, unsent: Motion | None = None) -> list[Point]:
        """Commanded places that the vehicle has not reached: it is flying there, or may begin to.

        Args:
            telemetry: The vehicle's position.
            unsent: A motion that was decided but not sent yet. An equal one may have been sent.
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
        """All places that the vehicle may be flying to, by our commands and by its telemetry.

        Args:
            telemetry: The vehicle's position and target.
            unsent: A motion that was decided but not sent yet. An equal one may have been sent.
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
        # The vehicle may turn at one end toward another, and turn away there.
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
    """Where the vehicle stops if it is commanded to brake now."""
    east_m_s, north_m_s = telemetry.velocity_m_s
    travel_s = reaction_s + math.hypot(east_m_s, north_m_s) / (2 * BRAKING_M_S2)
    east_m, north_m = telemetry.position
    return Point(east_m + travel_s * east_m_s, north_m + travel_s * north_m_s)
