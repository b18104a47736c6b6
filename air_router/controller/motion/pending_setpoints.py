"""What the vehicle was told and may follow any moment: commands arrive when they arrive.

Pure. Between the decision on a leg and the vehicle's turn lies a link, and machines that may be
busy. Until then the vehicle goes on with what it was told before, to the end of its present leg.
"""

from __future__ import annotations

import math
from itertools import permutations
from typing import Final

from air_router.controller.model.actions import FlyToNode, FlyToPoint, Motion
from air_router.routing.departure import PendingSetpoint
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point

_FAR_M: Final = 5.0
"""Its own word of where it flies to counts from here on: nearer, its stopping distance covers it,
and where it hovers it is as far off as estimates wander."""

_TURNING_S: Final = 0.3
_TURNING_S2_M: Final = 1 / 12
"""A vehicle that is turned away just before the end of its leg swings beyond it: by its way in that
time, and by what braking at 2 instead of 3 m/s2 takes more while it speeds up sideways."""


class PendingSetpoints:
    """The commands that the vehicle may be following, or may yet begin to follow, in order.

    Args:
        near_m: A place nearer than this has been reached.
        speed_m_s: How fast it flies there; faster, if it was seen to.
    """

    def __init__(self, near_m: float, speed_m_s: float) -> None:
        self._near_m = near_m
        self._speed_m_s = speed_m_s
        self._sent: list[Motion] = []
        self._settled = False

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

    def open(self, telemetry: Telemetry) -> tuple[Point, ...]:
        """Where it was sent by us and has not arrived: there it is flying, or begins to."""
        here = telemetry.position
        return tuple(
            motion.position
            for motion in self._sent
            if isinstance(motion, FlyToNode | FlyToPoint)
            and math.dist(motion.position, here) > self._near_m
        )

    def pending(self, telemetry: Telemetry) -> tuple[PendingSetpoint, ...]:
        """Everywhere that it may be flying to now: by our commands, and by its own word."""
        places, target = self.open(telemetry), telemetry.target
        if target is not None and math.dist(target, telemetry.position) > _FAR_M:
            places = (*places, target)
        speed_m_s = max(self._speed_m_s, math.hypot(*telemetry.velocity_m_s))
        beyond_m = _TURNING_S * speed_m_s + _TURNING_S2_M * speed_m_s**2
        here, pending = telemetry.position, dict.fromkeys(places)
        setpoint = [_setpoint(here, place, beyond_m) for place in pending]
        # It may turn from the end of one to another, and away there.
        setpoint += [
            _setpoint(one, other, beyond_m)
            for one, other in permutations(pending, 2)
            if math.dist(one, other) > self._near_m
        ]
        return tuple(setpoint)


def _setpoint(here: Point, place: Point, beyond_m: float) -> PendingSetpoint:
    share = 1.0 + beyond_m / math.dist(here, place)
    east_m, north_m = here
    reach = Point(
        east_m + share * (place.east_m - east_m), north_m + share * (place.north_m - north_m)
    )
    return PendingSetpoint(place, reach)
