"""What the first leg from where the vehicle is has to satisfy, however near to zones that is.

* Over its whole length it is clear in the airspace of the caller: with the whole tracking margin
  when a route is planned; with half of it when that fails, and when a leg of the route is about to
  be flown: the vehicle is never exactly at a node, and tight legs must be clear from where it is.
* A moving vehicle needs the whole area clear that its curve may sweep, and the rest of the leg that
  it is on with it: it goes on with that until the new command arrives.
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
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

from geo.airspace.airspace import FENCE, Airspace
from geo.frame import Point
from geo.paths.shortest import ShortestPaths, path_length_m

_GIVE_M = 0.01
"""How much closer than the vehicle is now a leg out of the margin may come: rounding."""

_DETOUR = 1.05
"""How much longer than the shortest a way out of a tight place may be, from where it is checked."""

_SAME_M = 0.5
"""Places nearer than this to each other are the same; the vehicle tells its own to a centimetre."""

_DRIFT_M = 0.25
"""What a hovering vehicle may seem to drift within its stopping distance."""


class PendingSetpoint(NamedTuple):
    """The end of a leg that the vehicle may be on, and how far it swings if turned away there."""

    place: Point  # end of the leg
    reach: Point  # behind it, where it swings to


class Departure:
    """Judges first legs from one place.

    Args:
        airspace: its airspace with the distance that this first leg has to keep.
        paths: paths at the distance that routes keep.
        start: where the vehicle is.
        stopping: where it comes to rest if it brakes now; None if it stands.
        pending: where else it flies to until it is told, or turns there: ends of legs so far.

    Attributes:
        start: where the vehicle is.
        rest: where it would come to rest.
        pending: where else it may be on its way to.
        moving: whether it may be elsewhere than at the start when it is told.
        in_margin: whether the vehicle is where routes do not go.
        warnings: what the operator should know about that.
    """

    def __init__(
        self,
        airspace: Airspace,
        paths: ShortestPaths,
        start: Point,
        stopping: Point | None,
        pending: Sequence[PendingSetpoint] = (),
    ) -> None:
        self._airspace = airspace
        self._paths = paths
        self.start = start
        self.rest = stopping if stopping is not None else start
        self.pending = tuple(pending)
        self.moving = self.rest != start or bool(self.pending)
        here = airspace.point_clear(start)
        self.in_margin = not (here and (not self.moving or airspace.point_clear(self.rest)))
        self.warnings: tuple[str, ...] = ()
        self._near: Airspace | None = airspace  # what the leg's first metres keep to
        self._kept: Airspace | None = None  # what the whole leg keeps to
        self._reach_m = 0.0  # how far these first metres reach
        if self.in_margin:
            self._relax()

    def _relax(self) -> None:
        """Find out how close to zones, and over how many metres, the leg may be at first."""
        holders = self._airspace.holders(self.start)
        if holders:
            where = "outside of the fence" if FENCE in holders else f"inside {names_of(holders)}"
            self.warnings = (f"the vehicle is {where}: it takes the shortest way out",)
            nearest = self._paths.nearest(self.start)
            self._reach_m = 0.0 if nearest is None else 1.5 * math.dist(self.start, nearest) + 1.0
            others = self._airspace.leaving(self.start)
            self._near = others.with_margin((others.margin_m - others.clearance_m) / 2)
            self._relax_others(others)
            return
        margin_m = self._airspace.margin_m
        spare_m, name = self._airspace.spare_m(self.start)
        here_m = spare_m + margin_m  # what there is on top of the clearance; less than 0: too near
        if here_m < 0:
            distance_m = spare_m + self._airspace.kept_m(name)
            where = f"{distance_m:.1f} m from {names_of((name,))}"
            self.warnings = (f"the vehicle is {where}: it moves away first",)
        kept_m = min(here_m, self._airspace.spare_m(self.rest)[0] + margin_m)
        if kept_m < (0 if here_m >= 0 else here_m - _DRIFT_M):
            self._near = None  # too fast towards a zone: brake before anything else
            return
        drift_m = math.dist(self.start, self.rest)
        self._reach_m = 2 * (margin_m - kept_m) + drift_m + 1.0
        nearest_m = min(self._airspace.distance_m(place) for place in (self.start, self.rest))
        self._near = self._airspace.relaxed(margin_m - kept_m + _GIVE_M, nearest_m - _GIVE_M)
        self._kept = self._airspace.with_margin(0.0).kept_from(self.start, self.rest)

    def _relax_others(self, others: Airspace) -> None:
        """It may stay as near to other zones as it is, on the way out of the one that it is in."""
        near = self._near
        assert near is not None  # noqa: S101 - the caller's
        here_m, rest_m = (near.spare_m(place)[0] for place in (self.start, self.rest))
        if min(here_m, rest_m) >= 0 or rest_m < here_m - _DRIFT_M:
            return
        nearest_m = min(others.distance_m(place) for place in (self.start, self.rest))
        self._kept = near.kept_from(self.start, self.rest)
        self._near = near.relaxed(_GIVE_M - min(here_m, rest_m), nearest_m - _GIVE_M)

    def allows(self, end: Point) -> bool:
        """Whether the vehicle may be sent straight to `end`, which is clear."""
        if not self.in_margin:
            if not self.moving:
                return self._airspace.leg_clear(self.start, end)
            return self._airspace.swept_clear(self._area(end))
        if self._near is None:
            return False
        area = self._area(end)
        if self._kept is not None and not self._kept.swept_clear(area):
            return False
        if math.dist(self.start, end) > self._reach_m:
            turns = [_along(place, end, self._reach_m) for place in (self.start, self.rest)]
            if not self._airspace.swept_clear([*turns, *area[2:]]):
                return False
        return self._near.swept_clear(area)

    def _area(self, end: Point) -> list[Point]:
        """The corners of what the vehicle may sweep if it is sent to `end`, as late as may be."""
        if not self.pending:
            return [self.start, self.rest, end]
        elsewhere = [on.reach for on in self.pending if math.dist(on.place, end) > _SAME_M]
        return [self.start, self.rest, *elsewhere, end]

    @property
    def special(self) -> bool:
        """Whether more, or less, is asked of the first leg than to be clear."""
        return self.in_margin or self.moving

    @cached_property
    def way_out(self) -> tuple[Point, ...] | None:
        """The shortest way out of a tight place that no single leg leads out of."""
        if not self.in_margin or self._near is None:
            return None
        if any(self.allows(place) for place in self._paths.exits(self.start)):
            return None
        way = self._paths.way_out(self.start, self._near)
        if way is None or not all(self._near.leg_clear(a, b) for a, b in pairwise(way)):
            return None
        return way

    def leads_out(self, end: Point) -> bool:
        """Whether a leg is a step of the shortest way out of a tight place; see `way_out`."""
        if self.way_out is None or self._near is None:
            return False
        if not self._near.swept_clear(self._area(end)):
            return False
        left_m = 0.0
        if not self._airspace.point_clear(end):
            onward = self._paths.way_out(end, self._near)
            if onward is None:
                return False
            left_m = path_length_m(onward)
        way_m = math.dist(self.start, end) + left_m
        return way_m <= _DETOUR * path_length_m(self.way_out) + 1.0

    def allowed(self, ends: Sequence[Point]) -> list[bool]:
        """`allows` for many."""
        if self.in_margin:
            return [self.allows(end) for end in ends]
        straight = self._airspace.legs_clear(self.start, ends)
        if not self.moving:
            return straight
        return [ok and self.allows(end) for ok, end in zip(straight, ends, strict=True)]


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
