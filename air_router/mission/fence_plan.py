"""The mission's fence as PX4 takes it: the second line of defence, should all else fail.

PX4's areas are circles and polygons without holes, whose sides are straight in degrees; they have
no altitude limits, no hours and no clearance, and the vehicle stays inside of every inclusion and
outside of every exclusion. What they cannot say is left to the companion, which keeps to all of it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely import LinearRing
from shapely import Point as ShapelyPoint

from air_router.mission.mission import Mission
from air_router.mission.plan_item import Command, Frame, PlanItem, degrees_e7
from geo.airspace.zone import Circle, Outline, Ring, Shape
from geo.frame import LocalFrame, Point

FENCE_POINTS: Final = 64
"""So many points of a fence PX4 1.17 stores as it comes: a circle is one, a polygon its corners."""

FENCE_TOO_LONG: Final = "fence-points"
"""The code of the note that a mission has more of them: PX4 would refuse the upload."""

_STEP_M: Final = 2_000.0
"""Longer sides get corners in between, where they are not straight in degrees."""

_STRAIGHT_E7: Final = 1.5
"""Corners that lie so near to the straight line between others, in units of 1e-7 degrees (1 cm),
are not sent."""

_CIRCLES: Final = frozenset({Command.FENCE_CIRCLE_INCLUSION, Command.FENCE_CIRCLE_EXCLUSION})

_HALF_TURN_E7: Final = 180 * 10**7


@dataclass(frozen=True, slots=True)
class FencePlan:
    """The fence as items, and what they cannot say.

    Attributes:
        items: For the upload; polygons are runs of vertices that know their number, circles come
            last.
        simpler: For each area that is not on board as it is drawn, its name and why.
    """

    items: tuple[PlanItem, ...]
    simpler: tuple[tuple[str, str], ...]


def fence_plan(mission: Mission) -> FencePlan:
    """The fence of a mission; zones that lie outside of it or do not apply are not in it."""
    items: list[PlanItem] = []
    simpler: list[tuple[str, str]] = []

    def add(name: str, shape: Shape, *, inclusion: bool) -> None:
        area = _area_items(mission.frame, shape, inclusion=inclusion)
        if not area:
            simpler.append((name, "it lies on the antimeridian, where PX4's test fails"))
        items.extend(area)

    for fence in mission.fences:
        add("fence", fence, inclusion=True)
        for hole in fence.holes if isinstance(fence, Outline) else ():
            add("fence", Outline(hole), inclusion=False)
    inside = shapely.intersection_all([fence.polygon for fence in mission.fences])
    for zone in mission.airspace.zones:
        if mission.fences and not inside.intersects(zone.polygon):
            continue
        around = _hole_around(zone.shape, mission.home)
        if around is not None:
            add(zone.name, Outline(around), inclusion=True)
        else:
            add(zone.name, zone.shape, inclusion=False)
    simpler += [
        (idle.zone.name, "PX4 would apply it at all altitudes, and the mission flies above it")
        for idle in mission.idle_zones
        if idle.below
    ]
    # PX4 1.17 takes every area behind a circle for a circle, corner by corner.
    items.sort(key=lambda item: item.command in _CIRCLES)
    return FencePlan(tuple(items), tuple(simpler))


def _hole_around(shape: Shape, home: Point) -> Ring | None:
    """The hole of a zone that home lies in: the whole flight is in there.

    The other holes are out of reach: filled, they keep no vehicle from anywhere.
    """
    for hole in () if isinstance(shape, Circle) else shape.holes:
        if Outline(hole).polygon.contains(ShapelyPoint(home)):
            return hole
    return None


def _area_items(frame: LocalFrame, shape: Shape, *, inclusion: bool) -> list[PlanItem]:
    """The items of one area; none if PX4 cannot test it."""
    if isinstance(shape, Circle):
        command = Command.FENCE_CIRCLE_INCLUSION if inclusion else Command.FENCE_CIRCLE_EXCLUSION
        corners, parameter = [degrees_e7(frame, shape.centre)], shape.radius_m
    else:
        command = Command.FENCE_INCLUSION if inclusion else Command.FENCE_EXCLUSION
        corners = _corners_e7(frame, shape.ring)
        parameter = float(len(corners))
    parameters = (parameter, 0.0, 0.0, 0.0)
    return [
        PlanItem(command, Frame.GLOBAL_INT, parameters, x, y, autocontinue=True) for x, y in corners
    ]


def _corners_e7(frame: LocalFrame, ring: Ring) -> list[tuple[int, int]]:
    """The corners that a ring needs where sides are straight in degrees; none at 180 degrees."""
    dense: list[Sequence[float]] = []
    for start, end in zip(ring, (*ring[1:], ring[0]), strict=True):
        steps = max(math.ceil(math.dist(start, end) / _STEP_M), 1)
        for step in range(steps):
            share = step / steps
            dense.append([(1 - share) * a + share * b for a, b in zip(start, end, strict=True)])
    corners = np.rint(frame.to_geodetic_many(dense) * 1e7)
    if np.ptp(corners[:, 1]) > _HALF_TURN_E7:
        return []
    needed = shapely.get_coordinates(LinearRing(corners).simplify(_STRAIGHT_E7))[:-1]
    return [(int(x), int(y)) for x, y in needed]
