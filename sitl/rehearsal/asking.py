"""What operators and programs ask of a rehearsed flight, sensible or not."""

from __future__ import annotations

import random
from typing import Final

from air_router.controller.model.requests import (
    AnyRequest,
    ComeHome,
    ExploreNow,
    GoOn,
    GoTo,
    HoldNow,
    SeekNow,
)
from air_router.mission.mission import Mission
from geo.frame import Point

_ROBOTS: Final = ("callisto", "europa", "io", "phantom")
_HOLD, _GO_ON, _SEEK, _EXPLORE, _HOME = 0.2, 0.4, 0.55, 0.65, 0.69
_BESIDE_M: Final = 40.0


def request_of(choice: float, dice: random.Random, mission: Mission, here: Point) -> AnyRequest:
    """A request by a number from 0 to 1: all verbs, points near waypoints and the vehicle."""
    if choice < _HOLD:
        return HoldNow()
    if choice < _GO_ON:
        return GoOn()
    if choice < _SEEK:
        return SeekNow(dice.choice(_ROBOTS))
    if choice < _EXPLORE:
        return ExploreNow()
    if choice < _HOME:
        return ComeHome()
    count, waits = dice.choice((1, 1, 2, 5)), dice.random() < 0.2
    points = tuple(_place(dice, mission, here) for _ in range(count))
    return GoTo(points, dice.choice((None, 0.0, 5.0)), waits)


def _place(dice: random.Random, mission: Mission, here: Point) -> Point:
    beside = (dice.uniform(-_BESIDE_M, _BESIDE_M), dice.uniform(-_BESIDE_M, _BESIDE_M))
    east_m, north_m = dice.choice((here, dice.choice(mission.waypoints).position))
    return Point(east_m + beside[0], north_m + beside[1])
