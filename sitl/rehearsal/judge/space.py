"""Rules of the true track, room to zones and fences and heights, and the geometry behind them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from sitl.rehearsal.judge.case import Case, Floats, MissionVersion, Responsible, Violation
from sitl.rehearsal.judge.mission_reader import Area, Pair, RawMission

_FAR_M: Final = 50_000.0
"""Where no fence is drawn, no way is longer."""

STOP_M: Final = 12.0
"""Nearer than this no vehicle stops: what is drawn there need not be kept out of at once."""

STOP_S: Final = 6.0
"""What a vehicle has to stop in front of, or in, a zone that appears where it cannot stop."""

DRIFT_M: Final = 2.0
"""So much nearer a vehicle may come while it stops where a pilot left it too near to a zone."""

_CLIMBS_M: Final = 12.0
"""So far a vehicle may drift, or brake, that climbs where a pilot, or a landing, left it low."""

_BESIDE_HOME_M: Final = 3.0
"""So far beyond the acceptance radius it may climb, and begin to land."""


_TAKEN_S: Final = 0.5
"""So much sooner than it is seen to count a changed file may be flown by."""

_INSIDE_M: Final = 1.0
"""By so much a vehicle may be deeper in a zone than it knows."""


_CORNER_M: Final = 0.4
"""Round corners of an open space become edges that are no farther off."""


class Rooms(NamedTuple):
    """What a vehicle kept from an area while a mission file counted.

    Attributes:
        version: The file.
        area: Of it.
        first: Number of the first sample in that time.
        metres: From it on, what the way from each sample to the next keeps; infinite where nothing
            counts.
    """

    version: MissionVersion
    area: Area
    first: int
    metres: Floats


@lru_cache(maxsize=1)  # of the flight that is being judged
def rooms_of(case: Case) -> list[Rooms]:
    """What the vehicle kept from every zone and fence of every mission file."""
    return [
        _rooms(case, version, area) for version in case.versions for area in version.mission.areas
    ]


def _rooms(case: Case, version: MissionVersion, area: Area) -> Rooms:
    """Measure the track from each sample in the air to the next, within the area's altitudes."""
    first, last = np.searchsorted(case.time_s, (version.from_s, version.until_s)).tolist()
    numbers = np.flatnonzero(case.flying[first:last]) + first
    after = np.minimum(numbers + 1, len(case.places) - 1)
    # Down at once: a simulated vehicle that was started anew stands at home.
    down = case.armed[numbers] & ~case.armed[after] & ~case.flying[after]
    after = np.where(down, numbers, after)
    heights = case.above_m[numbers] + case.ground_m
    climb_m = case.above_m[after] + case.ground_m - heights
    level = climb_m == 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        limits = [(limit - heights) / climb_m for limit in (area.lower_m, area.upper_m)]
    begin = np.where(level, 0.0, np.maximum(np.minimum(*limits), 0.0))
    end = np.where(level, 1.0, np.minimum(np.maximum(*limits), 1.0))
    within = np.where(level, (area.lower_m <= heights) & (heights <= area.upper_m), begin <= end)
    here = case.places[numbers]
    step = case.places[after] - here
    ends = np.stack((here + begin[:, None] * step, here + end[:, None] * step), axis=1)
    rooms = np.full(last - first, math.inf)
    rooms[numbers[within] - first] = _rooms_m(area, shapely.linestrings(ends[within]))
    return Rooms(version, area, first, rooms)


def room_m(area: Area, way: Any) -> float:
    """What a way keeps from a zone, or from the border within a fence; negative: how deep."""
    return float(_rooms_m(area, np.array([way], dtype=object))[0])


def _rooms_m(area: Area, ways: Any) -> Floats:
    """`room_m` of many."""
    if not len(ways):
        return np.empty(0)
    outline = area.outline
    coordinates, owners = shapely.get_coordinates(ways, return_index=True)
    corners, starts = shapely.points(coordinates), np.searchsorted(owners, np.arange(len(ways)))

    def farthest_m(shape: BaseGeometry) -> Any:
        """From it, of each way's corners."""
        return np.maximum.reduceat(shapely.distance(shape, corners), starts)

    if area.radius_m:
        if area.fence:
            return np.asarray(area.radius_m - farthest_m(outline))
        return np.asarray(shapely.distance(outline, ways) - area.radius_m)
    border_m = shapely.distance(outline.boundary, ways)
    if area.fence:
        outside_m = farthest_m(outline)
        within_m = np.where(shapely.covers(outline, ways), border_m, 0.0)
        return np.where(outside_m > 0, -outside_m, within_m)
    depths_m = shapely.distance(outline.boundary, corners)
    depths_m = np.where(shapely.intersects(outline, corners), depths_m, 0.0)
    deepest_m = np.maximum.reduceat(depths_m, starts)
    return np.where(shapely.intersects(outline, ways), -deepest_m, border_m)


def depths_m(area: Area, places: Floats) -> Floats:
    """How deep each place is in a zone, or outside of a fence; negative: how far from there."""
    return -_rooms_m(area, shapely.points(places))


def open_space(areas: Iterable[Area], more_m: float = 0.0) -> BaseGeometry:
    """Where one may be with the clearance of all these areas kept, and so much more, in metres."""
    fences, zones = [], []
    for area in areas:
        kept_m = area.clearance_m + more_m
        if area.fence:
            fences.append(area.polygon.buffer(-kept_m))
        else:
            zones.append(area.polygon.buffer(kept_m))
    everywhere = shapely.box(-_FAR_M, -_FAR_M, _FAR_M, _FAR_M)
    return shapely.intersection_all([everywhere, *fences]).difference(shapely.union_all(zones))


def leads_home(mission: RawMission, place: Pair, more_m: float = 0.0) -> bool:
    """Whether zones and fences, and what is to be kept from them, leave a way home from there.

    With so much more than the clearance kept, in metres.

    Those that do not apply where it cruises, or not always, count as no obstacle.
    """
    free = open_space((area for area in mission.cruised if not area.periods), more_m)
    parts = [part for part in shapely.get_parts(free) if part.area > 0.0]
    here, home = shapely.Point(place), shapely.Point(0.0, 0.0)
    return bool(parts) and min(parts, key=here.distance) is min(parts, key=home.distance)


def way_home_m(mission: RawMission, place: Pair, more_m: float = 0.0) -> float:
    """The length of the shortest way home, m, with the clearances and so much more kept.

    Infinite where there is none. From a place that is too near to something, and to a home that is,
    it leads straight on. What applies at certain hours only counts as an obstacle, too.
    """
    parts = [part for part in shapely.get_parts(open_space(mission.cruised, more_m)) if part.area]
    here, home = shapely.Point(place), shapely.Point(0.0, 0.0)
    if not parts:
        return math.inf
    free = min(parts, key=home.distance)
    if free is not min(parts, key=here.distance):
        return math.inf
    begin, end = (shapely.shortest_line(free, each).coords[0] for each in (here, home))
    on_m = math.dist(begin, place) + math.hypot(*end)
    return on_m + _shortest_m(free, (float(begin[0]), float(begin[1])), (end[0], end[1]))


def _shortest_m(free: BaseGeometry, begin: Pair, end: Pair) -> float:
    """The length of the shortest way within a polygon: by A* from corner to corner in sight."""
    corners = shapely.get_coordinates(free.simplify(_CORNER_M))
    places = np.vstack((begin, end, corners))
    room = free.buffer(2 * _CORNER_M)  # a corner that was rounded off may lie outside
    shapely.prepare(room)
    to_end_m = np.hypot(*(places - places[1]).T)
    way_m = np.full(len(places), math.inf)
    way_m[0] = 0.0
    open_ = np.ones(len(places), dtype=bool)
    while True:
        at = int(np.argmin(np.where(open_, way_m + to_end_m, math.inf)))
        if at == 1 or not (open_[at] and math.isfinite(way_m[at])):
            return float(way_m[1])
        open_[at] = False
        step_m = np.hypot(*(places - places[at]).T)
        better = np.flatnonzero(open_ & (way_m[at] + step_m < way_m))
        ends = np.stack((np.broadcast_to(places[at], (len(better), 2)), places[better]), axis=1)
        seen = better[shapely.covers(room, shapely.linestrings(ends))]
        way_m[seen] = way_m[at] + step_m[seen]


def leaves_low(case: Case, index: int) -> bool:
    """Whether a changed file has drawn a zone over, or above, the vehicle there: it leaves it low.

    That is one that applies at its height, or higher.
    """
    version = case.version_at(float(case.time_s[index]) + _TAKEN_S)
    if version is case.versions[0]:
        return False
    here, height_m = shapely.Point(case.place(index)), float(case.above_m[index]) + case.ground_m
    before = case.versions[case.versions.index(version) - 1].mission.areas
    new = (area for area in version.mission.areas if not any(map(area.same, before)))
    higher = (area for area in new if area.upper_m > height_m)
    return any(room_m(area, here) < area.clearance_m + DRIFT_M for area in higher)


def keeps_its_room(case: Case) -> Iterator[Violation]:
    """The clearance is kept from every zone and fence, also between two samples."""
    for rooms in rooms_of(case):
        known = [v for v in case.versions if v.until_s <= rooms.version.from_s][-1:]
        new = bool(known) and not any(map(rooms.area.same, known[0].mission.areas))
        yield from _nearest(case, rooms, new=new)


def _nearest(case: Case, rooms: Rooms, *, new: bool) -> Iterator[Violation]:
    """Where it was much too near to an area, at the worst; one that is new may be left first."""
    area, clearance_m = rooms.area, rooms.area.clearance_m
    limit_m, leaving, before = clearance_m, False, Responsible.OURS
    worst: tuple[float, int, float, float] | None = None
    for index, room_m in enumerate(rooms.metres.tolist(), rooms.first):
        by = case.by[index]
        if by is Responsible.OURS and math.isfinite(room_m):
            appears = new and index == rooms.first
            if appears or (before is not Responsible.OURS and room_m < clearance_m):
                excuse_m = STOP_M if appears else DRIFT_M
                limit_m, leaving = min(clearance_m, room_m - excuse_m), True
            elif leaving and room_m >= clearance_m:
                leaving = new and case.time_s[index] < rooms.version.from_s + STOP_S
                limit_m = limit_m if leaving else clearance_m
            allowed_m = limit_m - case.row.room_m - case.off_m[index]
            if room_m < allowed_m and (worst is None or allowed_m - room_m > worst[0]):
                worst = allowed_m - room_m, index, room_m, allowed_m
        before = by
    if worst is not None:
        _, index, room_m, allowed_m = worst
        side = "outside" if area.fence else "inside"
        where = f"{room_m:.2f} m from" if room_m > 0 else f"{-room_m:.2f} m {side} of"
        text = f"{where} {area.name}, {allowed_m:.2f} m are required"
        yield Violation(float(case.time_s[index]), "room", text)


def it_is_not_taken_back_in_a_zone(case: Case) -> Iterator[Violation]:
    """What a pilot or a failsafe had is ours again only outside of every zone, within fences."""
    for given in case.given:
        index = case.at(given.end_s)
        if given.end_s > case.time_s[-1] or not case.flying[index]:
            continue
        height_m = float(case.above_m[index]) + case.ground_m
        for area in case.version_at(given.end_s).mission.areas:
            deep_m = float(depths_m(area, case.places[index : index + 1])[0])
            high_m = min(height_m - area.lower_m, area.upper_m - height_m)  # in its altitudes
            if high_m > DRIFT_M and deep_m > _INSIDE_M + case.off_m[index]:
                text = f"taken back {deep_m:.1f} m deep in {area.name}, {given.by} before"
                yield Violation(given.end_s, "authority", text)


def keeps_its_heights(case: Case) -> Iterator[Violation]:
    """The plan's band of altitudes is flown; it climbs and begins to land at home only."""
    worst: dict[str, tuple[float, Violation]] = {}
    for excess_m, violation in _heights(case):
        if violation.kind not in worst or excess_m > worst[violation.kind][0]:
            worst[violation.kind] = excess_m, violation
    yield from (violation for _, violation in worst.values())


def _heights(case: Case) -> Iterator[tuple[float, Violation]]:
    """By how much, and what: every moment at a height, or place, that is none of the plan's."""
    mission, row = case.mission, case.row
    margin_m = mission.vertical_margin_m + row.height_m
    low_m, high_m = min(mission.altitudes_m) - margin_m, max(mission.altitudes_m) + margin_m
    near_m = mission.acceptance_m + _BESIDE_HOME_M + row.home_m
    up = cruised = landing = False
    excuse_m, before, back_at, stops_s = 0.0, Responsible.OURS, 0, -math.inf
    for index in map(int, np.flatnonzero(case.flying)):
        by, above_m, lands = case.by[index], float(case.above_m[index]), bool(case.lands[index])
        beyond_m = max(low_m - above_m, above_m - high_m, 0.0)
        up |= above_m >= low_m
        cruised |= above_m >= low_m + DRIFT_M  # a stopped climb may swing into the band
        excuse_m = 0.0 if beyond_m == 0.0 else excuse_m
        if by is Responsible.OURS:
            stops_s = float(case.time_s[index]) + STOP_S if landing and not lands else stops_s
            stopped = before is not Responsible.OURS or case.time_s[index] < stops_s
            # Farther off than here it may not get then.
            if beyond_m and (stopped or (excuse_m and leaves_low(case, index))):
                excuse_m, back_at = beyond_m + DRIFT_M, index
            home_m, allowed_m = case.from_home_m(index), near_m + case.off_m[index]
            here = case.landing_place is not None and lands  # `reactions` check where
            begins = (lands and not landing and not here) or not (up or excuse_m or lands)
            wrong: list[tuple[str, float, str]] = []
            if begins and home_m > allowed_m:
                text = f"{home_m:.1f} m from home, {allowed_m:.1f} m are allowed"
                wrong.append(("landing" if lands else "climb", home_m - allowed_m, text))
            if cruised and not lands and beyond_m > excuse_m:
                text = f"at {above_m:.1f} m, the plan flies {low_m:.1f} to {high_m:.1f} m"
                wrong.append(("altitude", beyond_m, text))
            on_m = math.dist(case.place(back_at), case.place(index)) - case.off_m[index]
            if excuse_m and above_m < low_m and not lands and on_m > _CLIMBS_M + row.room_m:
                text = f"flew {on_m:.0f} m on at {above_m:.1f} m, where it was given back"
                wrong.append(("altitude", on_m - _CLIMBS_M, text))
            for kind, excess_m, text in wrong:
                yield excess_m, Violation(float(case.time_s[index]), kind, text)
            landing = lands
        before = by
