"""Judges a flight by where the vehicle really was, from the zones' corners alone.

Deliberately apart from the code that plans and checks routes: its own point-in-polygon test and its
own distances, so that a mistake there cannot hide here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from geo.zone import Circle, Outline

if TYPE_CHECKING:
    from air_router.mission import Mission
    from geo.zone import Shape

_Corner = tuple[float, float]

LEFT_M = 1.0
"""So far outside of it a vehicle has left a zone."""


class End(Enum):
    """How a flight ended; the first four are as they should be."""

    LANDED = "landed at home"
    PILOT = "held or landed by the pilot"
    FAILSAFE = "in the autopilot's failsafe"
    HOVERS = "hovers where its last leg ended"
    STAYED = "stayed on the ground"
    NOT = "did not end"


def inside_ring(ring: Sequence[_Corner], east_m: float, north_m: float) -> bool:
    """Whether a place is inside a ring of (east, north): a ray to the east, crossings counted."""
    inside = False
    for (e1, n1), (e2, n2) in zip(ring, (*ring[1:], ring[0]), strict=True):
        if (n1 > north_m) != (n2 > north_m):
            inside ^= east_m < e1 + (north_m - n1) * (e2 - e1) / (n2 - n1)
    return inside


def ring_distance_m(ring: Sequence[_Corner], east_m: float, north_m: float) -> float:
    """Distance of a place to the border of a ring."""
    best = math.inf
    for (e1, n1), (e2, n2) in zip(ring, (*ring[1:], ring[0]), strict=True):
        along_e, along_n = e2 - e1, n2 - n1
        length_2 = along_e**2 + along_n**2
        share = (east_m - e1) * along_e + (north_m - n1) * along_n
        share = min(max(share / length_2, 0.0), 1.0) if length_2 > 0 else 0.0
        away_m = math.hypot(east_m - e1 - share * along_e, north_m - n1 - share * along_n)
        best = min(best, away_m)
    return best


def depth_m(shape: Shape, east_m: float, north_m: float) -> float:
    """How deep inside a shape a place is; negative outside: the distance to it."""
    if isinstance(shape, Circle):
        away_m = math.hypot(east_m - shape.centre[0], north_m - shape.centre[1])
        return shape.radius_m - away_m
    assert isinstance(shape, Outline)  # noqa: S101 - there is no other shape
    rings = (shape.ring, *shape.holes)
    border_m = min(ring_distance_m(ring, east_m, north_m) for ring in rings)
    in_hole = any(inside_ring(hole, east_m, north_m) for hole in shape.holes)
    inside = inside_ring(shape.ring, east_m, north_m) and not in_hole
    return border_m if inside else -border_m


@dataclass(slots=True)
class Judge:
    """Watches one flight.

    Attributes:
        added: Zones that count as the mission's do.
        drawn_over: Zones that were drawn over the vehicle, or so near that it cannot stop before
            them, with the seconds that it has to stop: after that they count once it is outside.
        deepest_m: Deepest into a zone (or out of a fence) while we answered for the vehicle;
            negative: the closest approach.
        deepest_other_m: The same while somebody else did: the pilot, a failsafe.
        ours_s: For how long we answered for it.
    """

    mission: Mission
    added: list[Shape] = field(default_factory=list)
    drawn_over: list[tuple[Shape, float]] = field(default_factory=list)
    deepest_m: float = -math.inf
    deepest_other_m: float = -math.inf
    ours_s: float = 0.0

    def see(self, place: tuple[float, float], step_s: float, *, ours: bool) -> None:
        """The vehicle is in the air at this place (east, north)."""
        depths = [depth_m(zone.shape, *place) for zone in self.mission.airspace.zones]
        depths += [depth_m(shape, *place) for shape in self.added]
        self._let_leave(place, step_s)
        depths += [-depth_m(shape, *place) for shape in self.mission.fences]
        deepest_m = max(depths, default=-math.inf)
        if ours:
            self.deepest_m = max(self.deepest_m, deepest_m)
            self.ours_s += step_s
        else:
            self.deepest_other_m = max(self.deepest_other_m, deepest_m)

    def _let_leave(self, place: tuple[float, float], step_s: float) -> None:
        waiting = [(shape, left_s - step_s) for shape, left_s in self.drawn_over]
        self.drawn_over = []
        for shape, left_s in waiting:
            if left_s <= 0.0 and depth_m(shape, *place) < -LEFT_M:
                self.added.append(shape)
            else:
                self.drawn_over.append((shape, left_s))


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the judge says of a flight."""

    scene: str
    fault: str
    end: End
    deepest_m: float
    flown_s: float
    expected: bool
    why: str = ""

    @property
    def good(self) -> bool:
        """Nothing inside a zone, and an end as it should be."""
        return self.deepest_m < 0.0 and self.expected
