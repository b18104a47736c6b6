"""What the vehicle was told and may follow any moment: commands arrive when they arrive.

Pure. Between the decision on a leg and the vehicle's turn lies a link, and machines that may be
busy. Until then the vehicle goes on with what it was told before, to the end of its present leg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import permutations
from typing import Final

from air_router.controller.model.actions import FlyToNode, FlyToPoint, Motion
from air_router.routing.departure import PendingSetpoint
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point

BRAKING_M_S2: Final = 2.0
"""Deceleration to count on. PX4 brakes with MPC_ACC_HOR 3 m/s2, but jerk-limited, so later."""

REACTION_S: Final = 0.6
"""Flight time between the telemetry that a decision rests on and the vehicle braking: a PX4 takes
half a second to build its deceleration up, and the link its time."""

_FAR_M: Final = 5.0
"""The target that it reports counts from here on: nearer, its stopping distance covers it,
and where it hovers it is as far off as estimates wander."""

_TURNING_S: Final = 0.3
_TURNING_S2_M: Final = 1 / 12
"""A vehicle that is turned away just before the end of its leg swings beyond it: by its way in that
time, and by what braking at 2 instead of 3 m/s2 takes more while it speeds up sideways."""


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

    def forget(self) -> None:
        """The pilot or a ground station has told it something since."""
        self._sent.clear()
        self._settled = False

    def doubtful(self, jump: FlyToNode, *, shows: bool) -> bool:
        """Whether a jump would seem to be followed while something before it is still to come.

        An earlier jump to the same item was given up, and came late, or comes yet.

        Args:
            jump: what is about to be commanded.
            shows: the vehicle says already what it would say if it followed it.
        """
        before = self._sent[:-1] if self._sent and self._sent[-1] == jump else self._sent
        under_way = before[self._settled :]
        return bool(under_way) and (shows or jump in before)

    def open(self, telemetry: Telemetry) -> list[Point]:
        """Where it was sent by us and has not arrived: there it is flying, or begins to."""
        return [
            motion.position
            for motion in self._sent
            if isinstance(motion, FlyToNode | FlyToPoint)
            and math.dist(motion.position, telemetry.position) > self.near_m
        ]

    def pending(self, telemetry: Telemetry) -> tuple[PendingSetpoint, ...]:
        """Everywhere that it may be flying to now: by our commands, and by its own telemetry."""
        here, target, places = telemetry.position, telemetry.target, self.open(telemetry)
        if target is not None and math.dist(target, here) > _FAR_M:
            places.append(target)
        if not places:
            return ()
        speed_m_s = max(self.speed_m_s, math.hypot(*telemetry.velocity_m_s))
        beyond_m = _TURNING_S * speed_m_s + _TURNING_S2_M * speed_m_s**2
        ways = [(here, place) for place in dict.fromkeys(places)]
        # It may turn from the end of one to another, and away there.
        for one, other in permutations(dict.fromkeys(places), 2):
            if math.dist(one, other) > self.near_m:
                ways.append((one, other))
        return tuple(_setpoint(start, place, beyond_m) for start, place in ways)


def _setpoint(start: Point, place: Point, beyond_m: float) -> PendingSetpoint:
    share = 1.0 + beyond_m / math.dist(start, place)
    east_m, north_m = start
    reach = Point(
        east_m + share * (place.east_m - east_m), north_m + share * (place.north_m - north_m)
    )
    return PendingSetpoint(place, reach)


def stopping_point(telemetry: Telemetry, reaction_s: float = REACTION_S) -> Point:
    """Where the vehicle comes to rest if it is told now to brake.

    Told in time it sweeps at most the triangle of its position, this point and its new target.
    """
    east_m_s, north_m_s = telemetry.velocity_m_s
    speed_m_s = math.hypot(east_m_s, north_m_s)
    travel_s = reaction_s + speed_m_s / (2 * BRAKING_M_S2)
    east_m, north_m = telemetry.position
    return Point(east_m + east_m_s * travel_s, north_m + north_m_s * travel_s)
