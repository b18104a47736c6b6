"""Where a mission that cannot be flown is wrong, for pictures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from air_router.files.mission_document import MissionDocument, MissionPoint, RefusedRing
from air_router.mission.mission import Mission
from geo.airspace.zone import Shape
from geo.frame import Point
from mocha_link.team.document import Problem

_FAR_M = 50_000.0
"""Places farther from home than this are typing errors; no sheet shows them."""


@dataclass(frozen=True, slots=True)
class Faults:
    """What is to be drawn in red.

    Attributes:
        count: how many problems there are.
        spots: places that are wrong: home, waypoints, rally points.
        legs: straight legs from one waypoint to the next that begin, end or lead where the vehicle
            must not be.
        shapes: fences and zones that are wrong, though they are areas.
        refused: rings that are no areas.
        off_sheet: labels of places too far away to be drawn.
    """

    count: int
    spots: tuple[MissionPoint, ...]
    legs: tuple[tuple[Point, Point], ...]
    shapes: tuple[Shape, ...]
    refused: tuple[RefusedRing, ...]
    off_sheet: tuple[str, ...] = ()


def faults_of(draft: MissionDocument, mission: Mission) -> Faults:
    """The faults of a judged draft."""
    spots = [*draft.waypoints, *draft.rally_points, *([draft.home] if draft.home else [])]
    wrong = [spot for spot in spots if _blamed(draft.problems, spot.keys)]
    areas = [area for area in (*draft.fences, *draft.zones) if area.place is None]
    return Faults(
        count=len(set(draft.problems)),
        spots=tuple(wrong),
        legs=_legs(draft, mission, {spot.label for spot in wrong}),
        shapes=tuple(area.shape for area in areas if _blamed(draft.problems, area.keys)),
        refused=tuple(draft.refused),
        off_sheet=tuple(spot.label for spot in wrong if far(spot.position, mission)),
    )


def far(position: Point, mission: Mission) -> bool:
    """Whether a place is too far from home for a sheet."""
    return math.dist(position, mission.home) > _FAR_M


def blocked_legs(mission: Mission) -> list[tuple[Point, Point]]:
    """Straight legs from home over the waypoints in order, and home, that are not clear."""
    stops = [mission.home, *(w.position for w in mission.waypoints), mission.home]
    legs = [(a, b) for a, b in pairwise(stops) if a != b]
    if not legs:
        return []
    ends = np.array(legs, dtype=float)
    clear = mission.planning_airspace.legs_clear_between(ends[:, 0], ends[:, 1])
    return [leg for leg, ok in zip(legs, clear, strict=True) if not ok]


def _legs(
    draft: MissionDocument, mission: Mission, wrong: set[str]
) -> tuple[tuple[Point, Point], ...]:
    places = {
        spot.position for spot in (*draft.waypoints, draft.home) if spot and spot.label in wrong
    }
    return tuple(
        (start, end)
        for start, end in blocked_legs(mission)
        if (start in places or end in places) and not (far(start, mission) or far(end, mission))
    )


def _blamed(problems: Sequence[Problem], keys: Sequence[str | int]) -> bool:
    """Whether a problem is about the value at these keys, or a part of it."""
    length = len(keys)
    return any(problem.keys[:length] == tuple(keys) for problem in problems if problem.keys)
