"""Places that a rehearsed operator sends a vehicle to, and where it gets into trouble on its way.

Worked out with the judge's reader of mission files, not with the code that flies.
"""

from __future__ import annotations

import functools
import math
import random
from pathlib import Path
from typing import Final, NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from sitl.rehearsal.judge.mission_reader import Pair, RawMission, read_mission

BRAKING_M_S2, BRAKES_LATER_S = 3.0, 0.3
"""What a PX4 brakes with, and how much later: it builds that up with limited jerk."""

_MARGIN_M, _LEAVING_M = 1.7, 0.9
"""On top of the clearance: nearer places are refused; first legs nearer than the other are, too."""

_SHORT_M: Final = 1.3
"""So much less than the clearance a way keeps that the judge calls bad."""

_TRIES: Final = 120
_FAR_M: Final = 2000.0


def rest(here: Pair, velocity_m_s: Pair) -> Pair:
    """Where a vehicle comes to rest that is told now to brake."""
    seconds = BRAKES_LATER_S + math.hypot(*velocity_m_s) / (2 * BRAKING_M_S2)
    return here[0] + velocity_m_s[0] * seconds, here[1] + velocity_m_s[1] * seconds


class Turn(NamedTuple):
    """A way to somewhere, a place on it, and where it is sent from there."""

    towards: Pair
    at: Pair
    off_to: Pair


class FlyableSpace:
    """Where ways may be flown, and where they are much too near: all zones count at any height.

    Args:
        mission: As the judge reads it.

    Attributes:
        mission: The same.
    """

    def __init__(self, mission: RawMission) -> None:
        self.mission = mission

        def kept(less_m: float) -> BaseGeometry:
            """What is left to fly in."""
            room = [f.polygon.buffer(less_m - f.clearance_m) for f in mission.fences]
            zones = [z.polygon.buffer(z.clearance_m - less_m) for z in mission.zones]
            everywhere = shapely.Point(0.0, 0.0).buffer(_FAR_M)
            return shapely.intersection_all([everywhere, *room]).difference(
                shapely.union_all(zones)
            )

        self._clear, self._leaving = kept(-_MARGIN_M), kept(-_LEAVING_M)  # of goals; of ways
        self._legal = kept(_SHORT_M)  # outside of it the judge calls a way bad
        shapely.prepare([self._clear, self._leaving, self._legal])

    def nearest(self, here: Pair) -> tuple[float, Pair]:
        """How far the next zone or fence is, and its direction: east and north, of length 1."""
        borders = [zone.polygon for zone in self.mission.zones]
        borders += [fence.polygon.boundary for fence in self.mission.fences]
        point = shapely.Point(here)
        near = min(borders, key=point.distance)
        to = shapely.get_coordinates(shapely.shortest_line(point, near))[1]
        away_m = max(float(point.distance(near)), 1e-6)
        return away_m, ((to[0] - here[0]) / away_m, (to[1] - here[1]) / away_m)

    def around_a_corner(self, here: Pair, velocity_m_s: Pair, dice: random.Random) -> Pair | None:
        """A place that is clear from here, and not from where it can stop; None: none found."""
        stands = rest(here, velocity_m_s)
        if not self._legal.covers(shapely.LineString([here, stands])):
            return None
        places = _around(here, dice, 6.0, 45.0)
        swept = shapely.polygons([[here, stands, place] for place in places])
        short = ~shapely.covers(self._legal, swept)
        return self._first(here, [p for p, is_short in zip(places, short, strict=True) if is_short])

    def turn(
        self, here: Pair, speed_m_s: float, brakes_s: float, dice: random.Random
    ) -> Turn | None:
        """A straight way, and a place on it where it is too fast for another; None: none found.

        Too fast, having braked for so long, with a jerk of 4 m/s3, since it was there.
        """
        left_m_s = speed_m_s - 2.0 * brakes_s**2
        for towards in _around(here, dice, 30.0, 70.0):
            if self._first(here, [towards]) is None:
                continue
            away_m = math.dist(here, towards)
            east, north = ((b - a) / away_m for a, b in zip(here, towards, strict=True))
            for along_m in range(12, int(away_m - 12.0), 4):
                at = here[0] + along_m * east, here[1] + along_m * north
                on_m = speed_m_s * brakes_s
                from_ = at[0] + on_m * east, at[1] + on_m * north
                off_to = self.around_a_corner(from_, (left_m_s * east, left_m_s * north), dice)
                if off_to is not None:
                    return Turn(towards, at, off_to)
        return None

    def in_sight(self, here: Pair, dice: random.Random) -> Pair | None:
        """A place that a straight way leads to; None: none found."""
        return self._first(here, _around(here, dice, 25.0, 60.0))

    def _first(self, here: Pair, places: list[Pair]) -> Pair | None:
        lines = (shapely.LineString([here, place]) for place in places)
        found = zip(places, lines, strict=True)
        clear, leaving = self._clear, self._leaving
        return next(
            (p for p, line in found if clear.covers(shapely.Point(p)) and leaving.covers(line)),
            None,
        )


def _around(here: Pair, dice: random.Random, least_m: float, most_m: float) -> list[Pair]:
    ways = [(dice.uniform(0.0, 2 * math.pi), dice.uniform(least_m, most_m)) for _ in range(_TRIES)]
    return [(here[0] + away * math.sin(a), here[1] + away * math.cos(a)) for a, away in ways]


@functools.lru_cache(maxsize=4)
def flyable_space(path: Path, text: str) -> FlyableSpace:
    """Of a mission file with this text."""
    return FlyableSpace(read_mission(path, text, ground_amsl_m=0.0))
