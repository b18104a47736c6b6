"""What a flight kept, against its true track: the room beyond the clearance, and who used it up.

A leg is checked for the hull of where the vehicle reports to be, where it would come to rest, the
corner of its turn, and its end. What the true track leaves that hull by is what the tracking margin
is for: the error of the estimate, of the controller, and of the wind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from air_router.controller.motion import REACTION_S
from air_router.flight import COMMAND_S
from air_router.routing import BRAKING_M_S2, Momentum
from geo.frame import Point
from sitl.rehearsal.judge import (
    Case,
    Evidence,
    EvidenceError,
    Responsible,
    end_of,
    is_motion,
    space,
)

STANDS_M_S: Final = 0.5
"""A leg that is begun faster than this is a turn."""

NEAR_M: Final = 5.0
"""Nearer than this to its end a leg is about to end."""

_OVER_M: Final = 1.0
"""A place that is farther than this from where it is has not been reached."""

_MODE_S: Final = 0.5
"""The mode of a leg may leave so long after the leg."""


@dataclass(frozen=True, slots=True)
class Used:
    """How far the true track left what was checked for one leg.

    Attributes:
        kind: "straight", "turn" (begun at speed), "end" (near its end), as in the table.
        metres: How far outside, at the worst.
        turned_deg: By how much the leg turns from where it flew before; 0: it stood.
    """

    kind: str
    metres: float
    turned_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class Figures:
    """Of one flight.

    Attributes:
        end: How it ended.
        spare_m: The least room beyond the clearance, of any zone or fence, while it was ours.
        off_m: The most that the reported position was off the true one, horizontally.
        used: Of every leg.
    """

    end: str
    spare_m: float
    off_m: float
    used: tuple[Used, ...]

    def most_m(self, kind: str) -> float:
        """The worst of a kind of leg."""
        return max((used.metres for used in self.used if used.kind == kind), default=0.0)


def figures(evidence: Evidence) -> Figures:
    """What a flight has kept, and used. Raises EvidenceError: it has not been flown."""
    case = Case(evidence)
    ours = np.array([by is Responsible.OURS for by in case.by])
    spare_m = math.inf
    for each in space.rooms_of(case):
        kept = each.metres[ours[each.first :][: len(each.metres)]]
        spare_m = min(spare_m, float(kept.min(initial=math.inf)) - each.area.clearance_m)
    if not case.received("GLOBAL_POSITION_INT"):
        raise EvidenceError(f"the companion received no position: {evidence.outcome}")
    return Figures(end_of(case).value, spare_m, _off_m(case), tuple(_used(case)))


class _Reported:
    """The positions that the vehicle reported, as the companion received them, in metres."""

    def __init__(self, case: Case) -> None:
        reported = case.received("GLOBAL_POSITION_INT")
        self.time_s = np.array([m.time_s for m in reported])
        degrees = [np.array([m.fields[name] / 1e7 for m in reported]) for name in ("lat", "lon")]
        self.places = np.column_stack(case.mission.frame.metres(*degrees))
        # MAVLink: x north, y east
        self.velocity_m_s = np.array([(m.fields["vy"], m.fields["vx"]) for m in reported]) / 100.0

    def at(self, time_s: float) -> int:
        return max(int(np.searchsorted(self.time_s, time_s, side="right")) - 1, 0)


def _off_m(case: Case) -> float:
    """Measured while it is slow: of a fast one only the clocks would be compared."""
    reported = _Reported(case)
    slow = np.hypot(*reported.velocity_m_s.T) < STANDS_M_S
    at = np.clip(np.searchsorted(case.time_s, reported.time_s), 0, len(case.places) - 1)
    off_m = np.hypot(*(reported.places - case.places[at]).T)
    return float(off_m[slow & case.flying[at]].max(initial=0.0))


def _used(case: Case) -> Iterator[Used]:
    reported, speed_m_s = _Reported(case), case.mission.speed_m_s
    reaction_s = REACTION_S + COMMAND_S * case.evidence.speed
    legs = [(m.time_s, Point(*to)) for m, to in case.legs if m.delivered]
    others_s = [m.time_s for m in case.commands if is_motion(m)]  # of one leg perhaps two
    before: Point | None = None
    for number, (from_s, to) in enumerate(legs):
        first = reported.at(from_s)
        here = Point(*map(float, reported.places[first]))
        velocity = (float(reported.velocity_m_s[first][0]), float(reported.velocity_m_s[first][1]))
        until_s = min((at_s for at_s in others_s if at_s > from_s + _MODE_S), default=math.inf)
        next_s, next_to = legs[number + 1] if number + 1 < len(legs) else (math.inf, None)
        if next_s <= from_s + _MODE_S:
            before = to
            continue  # it was called off before it could be flown
        span = (case.time_s >= from_s) & (case.time_s < until_s)
        ours = [case.by[at] is Responsible.OURS for at in np.flatnonzero(span)]
        places = case.places[span][np.array(ours, dtype=bool) & ~case.lands[span]]
        if len(places) > 1 and case.flying[case.at(from_s)] and to != next_to:
            yield from _of_leg(here, velocity, to, before, speed_m_s, reaction_s, places)
        before = to


def _of_leg(  # noqa: PLR0913, PLR0917 - all that a leg is checked by
    here: Point,
    velocity_m_s: tuple[float, float],
    to: Point,
    before: Point | None,
    leg_m_s: float,
    reaction_s: float,
    places: np.ndarray,
) -> Iterator[Used]:
    """The worst of its beginning, its middle and its end."""
    flown_m_s = math.hypot(*velocity_m_s)
    travel_s = reaction_s + flown_m_s / (2 * BRAKING_M_S2)
    rest = Point(here[0] + travel_s * velocity_m_s[0], here[1] + travel_s * velocity_m_s[1])
    momentum = Momentum(rest, velocity_m_s, leg_m_s, reaction_s)
    checked = [here, rest, momentum.turn(here, to), to]
    if before is not None and math.dist(before, here) > _OVER_M:  # it may fly on to there
        checked.append(_beyond(here, before, leg_m_s))
    hull = shapely.MultiPoint(checked).convex_hull
    out_m = shapely.distance(hull, shapely.points(places))
    begun_m = shapely.distance(shapely.Point(here), shapely.points(places))
    left_m = shapely.distance(shapely.Point(to), shapely.points(places))
    fast = flown_m_s >= STANDS_M_S
    reach_m = math.dist(here, rest) + NEAR_M
    ends = left_m < NEAR_M
    begins = (begun_m < reach_m) & ~ends & fast
    turned = math.degrees(_turn_rad(velocity_m_s, here, to)) if fast else 0.0
    for kind, where in (("turn", begins), ("end", ends), ("straight", ~begins & ~ends)):
        if where.any():
            yield Used(kind, float(out_m[where].max()), turned)


def _beyond(here: Point, place: Point, speed_m_s: float) -> Point:
    """How far it swings past the end of the leg that it may be on."""
    share = 1.0 + (0.3 * speed_m_s + speed_m_s**2 / 12) / math.dist(here, place)
    return Point(*(a + share * (b - a) for a, b in zip(here, place, strict=True)))


def _turn_rad(velocity_m_s: tuple[float, float], here: Point, to: Point) -> float:
    east_m_s, north_m_s = velocity_m_s
    east_m, north_m = to[0] - here[0], to[1] - here[1]
    cross = east_m_s * north_m - north_m_s * east_m
    return abs(math.atan2(cross, east_m_s * east_m + north_m_s * north_m))
