"""What an operator draws into the mission file while a rehearsed vehicle flies, and reloads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from air_router.events import AirspaceChanged
from air_router.requests import Reload
from geo.frame import Point
from geo.zone import Circle, Outline, Zone
from sitl.rehearsal.judge import depth_m

if TYPE_CHECKING:
    import random

    from geo.zone import Shape
    from sitl.rehearsal.companion import Companion
    from sitl.rehearsal.judge import Judge

BRAKING_S: Final = 6.0
"""What a vehicle has to stop in front of, or in, a zone that appears where it cannot stop."""

STOP_M: Final = 12.0
"""Nearer than this no vehicle stops: a zone that appears there is not ours to keep out of."""

HOME_CLEAR_M: Final = 8.0
"""Nearer to home than this the file would be refused."""

_WALL_M, _THICK_M = 22.0, 6.0
"""How far from where the vehicle was first walls are drawn, and how thick."""

_SIDES: Final = ((0, 1), (0, -1), (1, 0), (-1, 0))


class Drawing:
    """Draws zones, and has the judge know them.

    Args:
        judge: Counts what the vehicle comes near to.
        chance: Dice.
        late_s: How much later than usual the vehicle hears of anything, at most.
    """

    def __init__(self, judge: Judge, chance: random.Random, late_s: float) -> None:
        self._judge = judge
        self._chance = chance
        self._late_s = late_s
        self._middle: Point | None = None
        self._walls: list[tuple[str, Shape]] = []

    def circle(self, companion: Companion, place: Point, course_rad: float, ahead_m: float) -> None:
        """A circle so far ahead of the vehicle, or beside or over it."""
        course_rad += self._chance.uniform(-0.5, 0.5)
        centre = Point(
            place.east_m + ahead_m * math.sin(course_rad),
            place.north_m + ahead_m * math.cos(course_rad),
        )
        name = f"added {len(companion.controller.mission.zones)}"
        self._draw(companion, place, name, Circle(centre, self._chance.uniform(4.0, 12.0)))

    def wall(self, companion: Companion, place: Point, side: int) -> None:
        """One of four walls around where the vehicle was when the first of them was drawn."""
        self._middle = place if self._middle is None else self._middle
        east, north = _SIDES[side]
        out_m, along_m = _WALL_M + _THICK_M / 2, _WALL_M + _THICK_M
        middle = self._middle[0] + east * out_m, self._middle[1] + north * out_m
        half = (_THICK_M / 2, along_m) if east else (along_m, _THICK_M / 2)
        ring = tuple(
            Point(middle[0] + e * half[0], middle[1] + n * half[1])
            for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        )
        if self._draw(companion, place, f"wall {side}", Outline(ring)):
            self._walls.append((f"wall {side}", Outline(ring)))

    def open(self, companion: Companion) -> None:
        """The wall that was drawn last is taken away."""
        if not self._walls:
            return
        name, shape = self._walls.pop()
        mission = companion.controller.mission
        left = tuple(zone for zone in mission.zones if zone.name != name)
        self._reload(companion, left)
        if name not in {zone.name for zone in companion.controller.mission.zones}:
            judge = self._judge
            judge.added[:] = [added for added in judge.added if added != shape]
            judge.drawn_over[:] = [drawn for drawn in judge.drawn_over if drawn[0] != shape]

    def _draw(self, companion: Companion, place: Point, name: str, shape: Shape) -> bool:
        """Whether the zone counts from now on: the file may be refused, or a change under way."""
        mission = companion.controller.mission
        if -depth_m(shape, *mission.home) < HOME_CLEAR_M:
            return False
        self._reload(companion, (*mission.zones, Zone(name, shape)))
        if name not in {zone.name for zone in companion.controller.mission.zones}:
            return False
        if -depth_m(shape, *place) > STOP_M + self._late_s * mission.speed_m_s:
            self._judge.added.append(shape)
        else:
            self._judge.drawn_over.append((shape, BRAKING_S + self._late_s))
        return True

    def _reload(self, companion: Companion, zones: tuple[Zone, ...]) -> None:
        companion.hear(Reload())
        companion.hear(AirspaceChanged(companion.controller.mission.fences, zones))
