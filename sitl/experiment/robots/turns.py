"""Seek policies for comparison that know no ages: robots have their turns. No mission has them.

Both remember whose turn it is, so each UAV needs its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from air_router.controller.targets import SearchPlace, SeekContext, TargetList, Tour
from geo.frame import Point

AT_ONCE = 3
"""So many robots `ThreeInTurn` goes over in one search, as `tour` does at most."""


class Nearest:
    """Of the robots that were not sought in this round, the nearest; then a new round begins.

    Where a robot is looked for is round robin's choice.
    """

    foresees = False

    def __init__(self) -> None:
        self._sought: set[str] = set()  # in this round

    def order(self, targets: TargetList, context: SeekContext) -> Iterator[SearchPlace]:
        """As `Policy.order`."""
        groups = targets.groups(context.now_s)
        if self._sought.issuperset(groups[0]):
            self._sought.clear()
        free = [robot for robot in groups[0] if robot not in self._sought]
        later = [robot for robot in groups[0] if robot in self._sought]
        first = True
        for group in (free, later, *groups[1:]):
            places = [self.place(robot, targets, context) for robot in group]
            for place in sorted(places, key=lambda each: _flight_s(each, context)):
                if first:
                    self._sought.add(place.robot)
                    first = False
                yield place

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """As `Policy.place`."""
        return targets.place(robot, context.now_s)


def _flight_s(place: SearchPlace, context: SeekContext) -> float:
    return context.flight_s(context.unseen if place.position is None else place.position)


class ThreeInTurn(Tour):
    """The next three robots of the turn in one search, nearest first, along their paths.

    Of `tour` it has the three robots and their places, and no ages, chances or insertion.
    """

    def __init__(self) -> None:
        super().__init__()
        self._turn: list[str] = []  # the next one first

    def order(self, targets: TargetList, context: SeekContext) -> Iterator[SearchPlace]:
        """As `Policy.order`; the first goes over others on its way."""
        self._turn = self._turn or list(targets.names)
        free, *others = targets.groups(context.now_s)
        ready = [robot for robot in self._turn if robot in free]
        chosen, rest = ready[:AT_ONCE], ready[AT_ONCE:]
        places = {robot: self.place(robot, targets, context) for robot in chosen}
        over = _nearest_first(places, context)
        if over:
            sought = over.pop()
            self._turn = [robot for robot in self._turn if robot not in chosen] + chosen
            place = places[sought]
            yield SearchPlace(sought, place.position, place.reason, tuple(over), place.along)
        for robot in (*rest, *over, *(robot for group in others for robot in group)):
            yield self.place(robot, targets, context)


def _nearest_first(places: dict[str, SearchPlace], context: SeekContext) -> list[str]:
    """The robots, each the nearest to the one before; the first the nearest to the vehicle."""

    def way(place: SearchPlace) -> Sequence[Point]:
        last = context.unseen if place.position is None else place.position
        return (*place.along, last)

    left, order = dict(places), []
    here: Point | None = None
    while left:
        away_s = {
            robot: context.straight_s(way(place)[0])
            if here is None
            else context.leg_s(here, way(place)[0])
            for robot, place in left.items()
        }
        robot = min(left, key=lambda each: away_s[each])
        here = way(left.pop(robot))[-1]
        order.append(robot)
    return order
