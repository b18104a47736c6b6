"""The rules for the first leg from the vehicle's current position, also when it is near a zone.

* The whole leg is clear in the caller's airspace. The router plans with the whole tracking margin,
  and with half of it if that fails. A leg of a route is checked again with half of the margin
  before it is flown, because the vehicle is never exactly at a node of the route.
* For a moving vehicle the whole area that its turn may sweep (`Momentum`) is clear, and so is the
  rest of its current leg: the vehicle stays on that leg until the new command arrives.
* A vehicle that is already closer (wind, noise, a newly drawn zone), or that would stop closer,
  has leeway: for the first meters the leg may be as close as the vehicle is now or will be when
  it stops. After that the leg is clear. Along the whole leg the vehicle keeps
  the clearance to every zone to which it keeps it now.
* A vehicle that would stop within the clearance brakes first.
* A vehicle inside a zone or outside the fence takes a short way out that enters no other zone.
* If no such leg leads out of a tight place (a lane between two zones), the vehicle flies the legs
  of the shortest way out that comes no closer to anything than the vehicle is now.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Final, NamedTuple

from air_router.routing.limits import (
    BRAKING_M_S2,
    HOVER_DRIFT_M,
    LEEWAY_M,
    LEEWAY_OUT_OF_ZONE,
    LEG_ROUNDING_M,
    SAME_PLACE_M,
    STANDING_M_S,
    WAY_OUT_DETOUR,
    WAY_OUT_DETOUR_M,
)
from geo.airspace import FENCE, Airspace
from geo.frame import Point
from geo.paths import ShortestPaths, path_length_m


class Momentum(NamedTuple):
    """How far a moving vehicle coasts after a command to stop or to fly elsewhere.

    The vehicle reacts after `reaction_s`. Then its velocity changes linearly from v to the new u
    with a = `BRAKING_M_S2`, which takes T = |u - v| / a. The path is a parabola whose control
    polygon has the sides v T / 2 and u T / 2. Halved once (de Casteljau), the polygon has its
    corners at v T / 4, no farther than the stopping point, and at v T / 2 + u T / 4.

    Attributes:
        rest: Where the vehicle stops if it is commanded to brake now.
        velocity_m_s: East and north.
        speed_m_s: Speed on the new leg.
        reaction_s: Delay before the vehicle follows a new command.
    """

    rest: Point
    velocity_m_s: tuple[float, float]
    speed_m_s: float
    reaction_s: float

    def turn(self, here: Point, end: Point) -> Point:
        """The fourth corner: the turn to `end` lies within `here`, `rest`, `end` and this point.

        For a hovering vehicle this is `rest`. A vehicle that cannot stop before `end` turns wider.
        """
        rest, (east_m_s, north_m_s) = self.rest, self.velocity_m_s
        length_m = math.dist(rest, end)
        if math.hypot(east_m_s, north_m_s) < STANDING_M_S or length_m == 0.0:
            return rest
        speed_m_s = min(self.speed_m_s, math.sqrt(2 * BRAKING_M_S2 * length_m))  # it stops there
        new_east_m_s = speed_m_s * (end.east_m - rest.east_m) / length_m
        new_north_m_s = speed_m_s * (end.north_m - rest.north_m) / length_m
        change_m_s = math.hypot(new_east_m_s - east_m_s, new_north_m_s - north_m_s)
        quarter_s = change_m_s / (4 * BRAKING_M_S2)
        straight_s = self.reaction_s + 2 * quarter_s
        return Point(
            here.east_m + straight_s * east_m_s + quarter_s * new_east_m_s,
            here.north_m + straight_s * north_m_s + quarter_s * new_north_m_s,
        )


class PendingSetpoint(NamedTuple):
    """The end of a leg that the vehicle may be flying, and the point it may overshoot to."""

    place: Point  # the end of the leg
    reach: Point  # beyond it, where the vehicle overshoots to


class Stand(Enum):
    """Where the vehicle is at departure, and where it would stop: a row of `RULES`.

    *Near* means nearer to a zone or the fence than a route may come, *too near* nearer than the
    clearance.
    """

    CLEAR = "it hovers and is not near"
    MOVING = "it moves, is not near, and would not stop near"
    WITHIN = "it is in a zone or outside the fence, and not near another zone"
    WITHIN_NEAR = "it is in a zone or outside the fence, and is or will be near another zone"
    TOO_FAST = "it would stop too near, or is too near and would stop nearer still"
    TOO_NEAR = "it is too near"
    NEAR = "it is near, or would stop near"


class Begins(Enum):
    """How the first leg may begin."""

    AS_ROUTES = "clear along its whole length, including the area that the turn may sweep"
    BY_LEEWAY = "nearer to the zone for the first meters, then clear"
    BRAKING = "not yet: the vehicle brakes first"


class Rule(NamedTuple):
    """The rule for a first leg. Each function takes the departure.

    Attributes:
        begins: How the leg may begin.
        first: Airspace for the first meters.
        reach_m: Length of the first meters.
        whole: Airspace for the whole leg in addition; None: no further rule.
        warning: Warning about the start, printed by `air-router plan`; empty: no warning.
    """

    begins: Begins
    first: Callable[[Departure], Airspace] | None = None
    reach_m: Callable[[Departure], float] | None = None
    whole: Callable[[Departure], Airspace] | None = None
    warning: Callable[[Departure], str] | None = None


class Departure:
    """Checks first legs from one position.

    Args:
        airspace: Airspace with the margin that this first leg has to keep.
        paths: Shortest paths with the margin that routes keep.
        start: The vehicle's position.
        momentum: How far the vehicle coasts; None: it hovers.
        pending: Ends of earlier legs that the vehicle may still fly to before the new command
            arrives.

    Attributes:
        start: The vehicle's position.
        rest: Where the vehicle would stop.
        pending: Ends of earlier legs that it may still be flying to.
        moving: Whether the vehicle may have left `start` when the new command arrives.
    """

    def __init__(
        self,
        airspace: Airspace,
        paths: ShortestPaths,
        start: Point,
        momentum: Momentum | None,
        pending: Sequence[PendingSetpoint] = (),
    ) -> None:
        self._airspace = airspace
        self._paths = paths
        self.start = start
        self._momentum = momentum
        self.rest = momentum.rest if momentum is not None else start
        self.pending = tuple(pending)
        self.moving = self.rest != start or bool(self.pending)

    # Where the vehicle is.

    @cached_property
    def stand(self) -> Stand:
        """The row of `RULES` that applies."""
        if not self.in_margin:
            return Stand.MOVING if self.moving else Stand.CLEAR
        if self._zones_here:
            here_m, rest_m = self._others_clearance_left_m
            clear = min(here_m, rest_m) >= 0 or rest_m < here_m - HOVER_DRIFT_M
            return Stand.WITHIN if clear else Stand.WITHIN_NEAR
        too_near = self._left_here_m < 0
        if self._least_left_m < (self._left_here_m - HOVER_DRIFT_M if too_near else 0):
            return Stand.TOO_FAST
        return Stand.TOO_NEAR if too_near else Stand.NEAR

    @cached_property
    def in_margin(self) -> bool:
        """Whether the vehicle is near, or would stop near."""
        here = self._airspace.point_clear(self.start)
        return not (here and (not self.moving or self._airspace.point_clear(self.rest)))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to the operator about the vehicle's position."""
        rule = RULES[self.stand]
        warning = "" if rule.warning is None else rule.warning(self)
        return (warning,) if warning else ()

    @cached_property
    def _zones_here(self) -> tuple[str, ...]:
        """The zones that the vehicle is in, and the fence if it is outside."""
        return tuple(self._airspace.zones_at(self.start))

    @cached_property
    def _left_here_m(self) -> float:
        """Distance beyond the clearance at the current position; negative: too near."""
        return self._airspace.clearance_left_m(self.start)[0] + self._airspace.margin_m

    @cached_property
    def _least_left_m(self) -> float:
        """The smaller distance beyond the clearance: current position or stopping point."""
        return min(
            self._left_here_m,
            self._airspace.clearance_left_m(self.rest)[0] + self._airspace.margin_m,
        )

    @cached_property
    def _others(self) -> Airspace:
        """The other zones (those the vehicle is not in), with half of clearance plus margin.

        A zone's own clearance is reduced by as many meters as the mission's.
        """
        others = self._airspace.without_zones_at(self.start)
        return others.with_margin((others.margin_m - others.clearance_m) / 2)

    @cached_property
    def _others_clearance_left_m(self) -> tuple[float, float]:
        """Distance to the other zones beyond the clearance: current position, stopping point."""
        here_m, rest_m = (
            self._others.clearance_left_m(place)[0] for place in (self.start, self.rest)
        )
        return here_m, rest_m

    # What the rules require.

    def first_near(self) -> Airspace:
        """The present distance, or that at the stopping point if smaller."""
        airspace = self._airspace
        return airspace.relaxed(
            airspace.margin_m - self._least_left_m + LEG_ROUNDING_M,
            self._nearest_m(airspace) - LEG_ROUNDING_M,
        )

    def reach_near_m(self) -> float:
        """Twice the distance to clear airspace, flown straight away from the zone."""
        drift_m = math.dist(self.start, self.rest)
        return 2 * (self._airspace.margin_m - self._least_left_m) + drift_m + LEEWAY_M

    def whole_near(self) -> Airspace:
        """The clearance, to every zone to which the vehicle keeps it now."""
        return self._airspace.with_margin(0.0).clear_of_leg(self.start, self.rest)

    def warning_near(self) -> str:
        """Warning that the vehicle is too near; empty if it is not."""
        if self._left_here_m >= 0:
            return ""
        clearance_left_m, name = self._airspace.clearance_left_m(self.start)
        distance_m = clearance_left_m + self._airspace.required_m(name)
        where = f"{distance_m:.1f} m from {names_of((name,))}"
        return f"the vehicle is {where}: it moves away first"

    def first_within(self) -> Airspace:
        """No minimum to its own zone; half of clearance plus margin to all others."""
        return self._others

    def reach_within_m(self) -> float:
        """The distance to the nearest clear point, plus leeway."""
        nearest = self._paths.nearest(self.start)
        if nearest is None:
            return 0.0
        return LEEWAY_OUT_OF_ZONE * math.dist(self.start, nearest) + LEEWAY_M

    def warning_within(self) -> str:
        """Warning that the vehicle is in a zone or outside the fence."""
        zones_here = self._zones_here
        where = "outside the fence" if FENCE in zones_here else f"inside {names_of(zones_here)}"
        return f"the vehicle is {where}: it takes the shortest way out"

    def first_within_near(self) -> Airspace:
        """No minimum to its own zone; to others the distance now, or at its stop if smaller."""
        shortfall_m = LEG_ROUNDING_M - min(self._others_clearance_left_m)
        others = self._airspace.without_zones_at(self.start)
        return self._others.relaxed(shortfall_m, self._nearest_m(others) - LEG_ROUNDING_M)

    def whole_within_near(self) -> Airspace:
        """Half of clearance plus margin, to every other zone to which it keeps that now."""
        return self._others.clear_of_leg(self.start, self.rest)

    @cached_property
    def _first(self) -> Airspace | None:
        """Airspace for the first meters; None: the route's own airspace, or no leg is allowed."""
        first = RULES[self.stand].first
        return None if first is None else first(self)

    @cached_property
    def _whole(self) -> Airspace | None:
        whole = RULES[self.stand].whole
        return None if whole is None else whole(self)

    @cached_property
    def _reach_m(self) -> float:
        reach_m = RULES[self.stand].reach_m
        return 0.0 if reach_m is None else reach_m(self)

    def _nearest_m(self, airspace: Airspace) -> float:
        """Distance from the current position or the stopping point to the nearest zone or fence."""
        return min(airspace.distance_m(place) for place in (self.start, self.rest))

    def clear(self, end: Point) -> bool:
        """Whether the area that the vehicle may sweep on a straight leg to `end` is clear.

        The area includes its current position, its stopping point, and `end` itself.
        """
        if not self.moving:
            return self._airspace.leg_clear(self.start, end)
        return self._airspace.swept_clear(self._area(end))

    def allows(self, end: Point) -> bool:
        """Whether the vehicle may fly straight to `end`, a clear point."""
        if RULES[self.stand].begins is Begins.AS_ROUTES:
            return self.clear(end)
        if self._first is None:
            return False  # it brakes first
        turning, bound = self._turning(end), self._bound(end)
        area = [*turning, *bound]
        if self._whole is not None and not self._whole.swept_clear(area):
            return False
        if math.dist(self.start, end) > self._reach_m:
            later = [_along(place, end, self._reach_m) for place in turning]
            if not self._airspace.swept_clear([*later, *bound]):
                return False
        return self._first.swept_clear(area)

    def _area(self, end: Point) -> list[Point]:
        """The corners of the area that the vehicle may sweep on its way to `end`, turning late."""
        return [*self._turning(end), *self._bound(end)]

    def _turning(self, end: Point) -> list[Point]:
        """The corners of the area swept before the vehicle heads for `end`."""
        turn = self.rest if self._momentum is None else self._momentum.turn(self.start, end)
        return [self.start, self.rest, turn]

    def _bound(self, end: Point) -> list[Point]:
        """The corners of the area swept after that."""
        elsewhere = [on.reach for on in self.pending if math.dist(on.place, end) > SAME_PLACE_M]
        return [*elsewhere, end]

    @property
    def special(self) -> bool:
        """Whether another rule than a clear leg applies to the first leg."""
        return self.in_margin or self.moving

    @cached_property
    def way_out(self) -> tuple[Point, ...] | None:
        """The shortest way out of a tight place, if no single leg leads out."""
        near = self._first
        if near is None or any(self.allows(place) for place in self._paths.exits(self.start)):
            return None
        way = self._paths.way_out(self.start, near)
        if way is None or not all(near.leg_clear(a, b) for a, b in pairwise(way)):
            return None
        return way

    def leads_out(self, end: Point) -> bool:
        """Whether this is a leg of the shortest way out of a tight place; see `way_out`."""
        near = self._first
        if near is None or self.way_out is None or not near.swept_clear(self._area(end)):
            return False
        left_m = 0.0
        if not self._airspace.point_clear(end):
            onward = self._paths.way_out(end, near)
            if onward is None:
                return False
            left_m = path_length_m(onward)
        way_m = math.dist(self.start, end) + left_m
        return way_m <= WAY_OUT_DETOUR * path_length_m(self.way_out) + WAY_OUT_DETOUR_M

    def allowed(self, ends: Sequence[Point]) -> list[bool]:
        """`allows` for several ends."""
        if self.in_margin:
            return [self.allows(end) for end in ends]
        straight = self._airspace.legs_clear(self.start, ends)
        if not self.moving:
            return straight
        return [ok and self.allows(end) for ok, end in zip(straight, ends, strict=True)]


RULES: Final[Mapping[Stand, Rule]] = MappingProxyType(
    {
        Stand.CLEAR: Rule(Begins.AS_ROUTES),
        Stand.MOVING: Rule(Begins.AS_ROUTES),
        Stand.WITHIN: Rule(
            Begins.BY_LEEWAY,
            first=Departure.first_within,
            reach_m=Departure.reach_within_m,
            warning=Departure.warning_within,
        ),
        Stand.WITHIN_NEAR: Rule(
            Begins.BY_LEEWAY,
            first=Departure.first_within_near,
            reach_m=Departure.reach_within_m,
            whole=Departure.whole_within_near,
            warning=Departure.warning_within,
        ),
        Stand.TOO_FAST: Rule(Begins.BRAKING, warning=Departure.warning_near),
        Stand.TOO_NEAR: Rule(
            Begins.BY_LEEWAY,
            first=Departure.first_near,
            reach_m=Departure.reach_near_m,
            whole=Departure.whole_near,
            warning=Departure.warning_near,
        ),
        Stand.NEAR: Rule(
            Begins.BY_LEEWAY,
            first=Departure.first_near,
            reach_m=Departure.reach_near_m,
            whole=Departure.whole_near,
        ),
    }
)
"""The rule for a first leg, by the vehicle's position. If no leg leads out of a tight place, see
`Departure.way_out`.
"""


def _along(start: Point, end: Point, reach_m: float) -> Point:
    """The point `reach_m` along a leg; its end if the leg is shorter."""
    length_m = math.dist(start, end)
    if length_m <= reach_m:
        return end
    share = reach_m / length_m
    return Point(
        start.east_m + share * (end.east_m - start.east_m),
        start.north_m + share * (end.north_m - start.north_m),
    )


def names_of(names: Sequence[str]) -> str:
    """The names of zones and the fence, as part of a sentence."""
    words = ["the fence" if name == FENCE else f"no-fly zone '{name}'" for name in names]
    return " and ".join(words)
