"""What the first leg from where the vehicle is has to satisfy, however near to zones that is.

* Over its whole length it is clear in the airspace of the caller: with the whole tracking margin
  when a route is planned; with half of it when that fails, and when a leg of the route is about to
  be flown: the vehicle is never exactly at a node, and tight legs must be clear from where it is.
* A moving vehicle needs the whole area clear that its turn may sweep (`Momentum`), and the rest of
  the leg that it is on with it: it goes on with that until the new command arrives.
* A vehicle that is closer than that already (wind, noise, a newly drawn zone), or comes to rest
  closer, may be as close as it is or will be anyhow in the first metres, and then the leg is clear.
  To what it keeps the clearance from now it keeps it all the way.
* One that would come to rest within the clearance has to brake first.
* A vehicle inside a zone, or outside of the fence, takes a short way out that meets no other zone.
* Where no such leg leads out of a tight place (a lane between two zones), the steps of the shortest
  way out are allowed that comes no closer to anything than the vehicle is now.
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
    """What a vehicle flies on by itself, whether it is commanded to stop or sent elsewhere.

    It follows after its reaction. From then on its velocity goes straight over from v to the new u
    with a = `BRAKING_M_S2`, which takes T = |u - v| / a: a parabola; its control polygon has the
    sides v T / 2 and u T / 2. Halved once (de Casteljau), it has its corners at v T / 4, no farther
    than where braking would end, and at v T / 2 + u T / 4.

    Attributes:
        rest: Where it comes to rest if it is announced now to brake.
        velocity_m_s: East and north.
        speed_m_s: How fast it flies the new leg.
        reaction_s: For how long it flies on as it does.
    """

    rest: Point
    velocity_m_s: tuple[float, float]
    speed_m_s: float
    reaction_s: float

    def turn(self, here: Point, end: Point) -> Point:
        """The corner that is missing for its turn to `end` to lie between `here`, `rest` and `end`.

        It is `rest` for a vehicle that stands. Nearer to its end than it can stop, it turns wider.
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
    """The end of a leg that the vehicle may be on, and how far it swings if turned away there."""

    place: Point  # end of the leg
    reach: Point  # behind it, where it swings to


class Stand(Enum):
    """Where the vehicle is as it sets out, and where it would come to rest: a row of `RULES`.

    *Near* is nearer to a zone or the fence than routes keep, *too near* nearer than the clearance.
    """

    CLEAR = "hovers where routes go"
    MOVING = "moves, and would stop where routes go"
    WITHIN = "is in a zone or outside the fence, and near no other zone"
    WITHIN_NEAR = "is in a zone or outside the fence, and is or will be near another zone"
    TOO_FAST = "would stop too near, or is too near and would stop even nearer"
    TOO_NEAR = "is too near"
    NEAR = "is near, or would stop there"


class Begins(Enum):
    """How the first leg may begin."""

    AS_ROUTES = "clear over its whole length and turn"
    BY_LEEWAY = "nearer at first, then clear"
    BRAKING = "not sent: the vehicle brakes first"


class Rule(NamedTuple):
    """What a first leg has to keep to; each function takes the departure.

    Attributes:
        begins: How it may begin.
        first: What its first metres keep to.
        reach_m: How far these reach.
        whole: What the whole leg keeps to beside that; None: nothing.
        warning: What the operator should know about where the vehicle is; empty: nothing.
    """

    begins: Begins
    first: Callable[[Departure], Airspace] | None = None
    reach_m: Callable[[Departure], float] | None = None
    whole: Callable[[Departure], Airspace] | None = None
    warning: Callable[[Departure], str] | None = None


class Departure:
    """Judges first legs from one place.

    Args:
        airspace: its airspace with the distance that this first leg has to keep.
        paths: paths at the distance that routes keep.
        start: where the vehicle is.
        momentum: what it flies on by itself; None if it stands.
        pending: where else it flies to until it is announced, or turns there: ends of legs so far.

    Attributes:
        start: where the vehicle is.
        rest: where it would come to rest.
        pending: where else it may be on its way to.
        moving: whether it may be elsewhere than at the start when it is announced.
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

    # Where it stands.

    @cached_property
    def stand(self) -> Stand:
        """The row of `RULES` that holds."""
        if not self.in_margin:
            return Stand.MOVING if self.moving else Stand.CLEAR
        if self._holders:
            here_m, rest_m = self._others_clearance_left_m
            clear = min(here_m, rest_m) >= 0 or rest_m < here_m - HOVER_DRIFT_M
            return Stand.WITHIN if clear else Stand.WITHIN_NEAR
        too_near = self._here_m < 0
        if self._required_m < (self._here_m - HOVER_DRIFT_M if too_near else 0):
            return Stand.TOO_FAST
        return Stand.TOO_NEAR if too_near else Stand.NEAR

    @cached_property
    def in_margin(self) -> bool:
        """Whether the vehicle is, or would come to rest, where routes do not go."""
        here = self._airspace.point_clear(self.start)
        return not (here and (not self.moving or self._airspace.point_clear(self.rest)))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the operator should know about where the vehicle is."""
        rule = RULES[self.stand]
        warning = "" if rule.warning is None else rule.warning(self)
        return (warning,) if warning else ()

    @cached_property
    def _holders(self) -> tuple[str, ...]:
        """The zones that it is in, and the fence that it is outside of."""
        return tuple(self._airspace.zones_at(self.start))

    @cached_property
    def _here_m(self) -> float:
        """What there is on top of the clearance; less than 0: it is too near."""
        return self._airspace.clearance_left_m(self.start)[0] + self._airspace.margin_m

    @cached_property
    def _required_m(self) -> float:
        """The least that there is on top of the clearance, here and where it comes to rest."""
        return min(
            self._here_m, self._airspace.clearance_left_m(self.rest)[0] + self._airspace.margin_m
        )

    @cached_property
    def _others(self) -> Airspace:
        """All that it is not in, with half of the margin."""
        others = self._airspace.without_zones_at(self.start)
        return others.with_margin((others.margin_m - others.clearance_m) / 2)

    @cached_property
    def _others_clearance_left_m(self) -> tuple[float, float]:
        """What there is to spare to these, here and where it comes to rest."""
        here_m, rest_m = (
            self._others.clearance_left_m(place)[0] for place in (self.start, self.rest)
        )
        return here_m, rest_m

    # What the rules request.

    def first_near(self) -> Airspace:
        """No nearer than it is, or would stop."""
        airspace = self._airspace
        return airspace.relaxed(
            airspace.margin_m - self._required_m + LEG_ROUNDING_M,
            self._nearest_m(airspace) - LEG_ROUNDING_M,
        )

    def reach_near_m(self) -> float:
        """Twice as far as it takes to be clear, straight away from there."""
        drift_m = math.dist(self.start, self.rest)
        return 2 * (self._airspace.margin_m - self._required_m) + drift_m + LEEWAY_M

    def whole_near(self) -> Airspace:
        """The clearance to everything from which it keeps that now."""
        return self._airspace.with_margin(0.0).clear_of_leg(self.start, self.rest)

    def warning_near(self) -> str:
        """That it is too near, if it is."""
        if self._here_m >= 0:
            return ""
        spare_m, name = self._airspace.clearance_left_m(self.start)
        distance_m = spare_m + self._airspace.required_m(name)
        where = f"{distance_m:.1f} m from {names_of((name,))}"
        return f"the vehicle is {where}: it moves away first"

    def first_within(self) -> Airspace:
        """A way out, with half the margin to everything else."""
        return self._others

    def reach_within_m(self) -> float:
        """Somewhat farther than to the nearest clear place."""
        nearest = self._paths.nearest(self.start)
        if nearest is None:
            return 0.0
        return LEEWAY_OUT_OF_ZONE * math.dist(self.start, nearest) + LEEWAY_M

    def warning_within(self) -> str:
        """That it is in a zone, or outside of the fence."""
        holders = self._holders
        where = "outside of the fence" if FENCE in holders else f"inside {names_of(holders)}"
        return f"the vehicle is {where}: it takes the shortest way out"

    def first_within_near(self) -> Airspace:
        """The same, but no nearer to the others than it is, or would stop."""
        shortfall_m = LEG_ROUNDING_M - min(self._others_clearance_left_m)
        others = self._airspace.without_zones_at(self.start)
        return self._others.relaxed(shortfall_m, self._nearest_m(others) - LEG_ROUNDING_M)

    def whole_within_near(self) -> Airspace:
        """Half the margin to every other zone from which it keeps that now."""
        return self._others.clear_of_leg(self.start, self.rest)

    @cached_property
    def _first(self) -> Airspace | None:
        """What the first metres keep to; None: routes' own airspace, or no leg at all."""
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
        """How near to anything it is, or comes to rest."""
        return min(airspace.distance_m(place) for place in (self.start, self.rest))

    def clear(self, end: Point) -> bool:
        """Whether all is clear that the vehicle may sweep if it is sent straight to `end`.

        That includes where it is, where it would come to rest, and `end` itself.
        """
        if not self.moving:
            return self._airspace.leg_clear(self.start, end)
        return self._airspace.swept_clear(self._area(end))

    def allows(self, end: Point) -> bool:
        """Whether the vehicle may be sent straight to `end`, which is clear."""
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
        """The corners of what the vehicle may sweep if it is sent to `end`, as late as may be."""
        return [*self._turning(end), *self._bound(end)]

    def _turning(self, end: Point) -> list[Point]:
        """The corners of what it sweeps before it is bound for `end`."""
        turn = self.rest if self._momentum is None else self._momentum.turn(self.start, end)
        return [self.start, self.rest, turn]

    def _bound(self, end: Point) -> list[Point]:
        """The corners of what it sweeps from then on."""
        elsewhere = [on.reach for on in self.pending if math.dist(on.place, end) > SAME_PLACE_M]
        return [*elsewhere, end]

    @property
    def special(self) -> bool:
        """Whether more, or less, is asked of the first leg than to be clear."""
        return self.in_margin or self.moving

    @cached_property
    def way_out(self) -> tuple[Point, ...] | None:
        """The shortest way out of a tight place that no single leg leads out of."""
        near = self._first
        if near is None or any(self.allows(place) for place in self._paths.exits(self.start)):
            return None
        way = self._paths.way_out(self.start, near)
        if way is None or not all(near.leg_clear(a, b) for a, b in pairwise(way)):
            return None
        return way

    def leads_out(self, end: Point) -> bool:
        """Whether a leg is a step of the shortest way out of a tight place; see `way_out`."""
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
        """`allows` for many."""
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
"""What a first leg has to keep to, by where the vehicle is. Where none leads out of a tight place
there is `Departure.way_out`.
"""


def _along(start: Point, end: Point, reach_m: float) -> Point:
    """The point of a leg that is so far from its start; its end if it is shorter."""
    length_m = math.dist(start, end)
    if length_m <= reach_m:
        return end
    share = reach_m / length_m
    return Point(
        start.east_m + share * (end.east_m - start.east_m),
        start.north_m + share * (end.north_m - start.north_m),
    )


def names_of(names: Sequence[str]) -> str:
    """Zones, and the fence, as words of a sentence."""
    words = ["the fence" if name == FENCE else f"no-fly zone '{name}'" for name in names]
    return " and ".join(words)
