"""Measures a true track: its room to every zone and fence, and its heights."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from sitl.rehearsal.judge.acceptance import Tolerance
from sitl.rehearsal.judge.judge_track import (
    LAND_MODE,
    Floats,
    Judge,
    MissionVersion,
    Responsible,
    Track,
    Violation,
)
from sitl.rehearsal.judge.mission_reader import Area

STOP_M: Final = 12.0
"""Nearer than this no vehicle stops: what is drawn there need not be kept out of at once."""

STOP_S: Final = 6.0
"""What a vehicle has to stop in front of, or in, a zone that appears where it cannot stop."""

DRIFT_M: Final = 2.0
"""So much nearer a vehicle may come while it stops where a pilot left it too near to a zone."""

CLIMBS_M: Final = 12.0
"""So far a vehicle may drift, or brake, that climbs where a pilot gave it back."""

BESIDE_HOME_M: Final = 3.0
"""So far beyond the acceptance radius it may climb, and begin to land."""

_FAR_M: Final = 50_000.0
"""Where no fence is drawn, no way is longer."""

_PART: Final = 25


@dataclass(slots=True)
class SpaceJudge(Judge):
    """Judges one track.

    Attributes:
        tolerance: What the flight's faults excuse.
        nearest_m: The least room while each of them answered.
        seconds: For how long each answered in the air.
    """

    tolerance: Tolerance
    nearest_m: dict[Responsible, float] = field(default_factory=dict)
    seconds: dict[Responsible, float] = field(default_factory=dict)

    def judge(self) -> None:
        """Look at the whole track."""
        track = self.track
        for index, step_s in enumerate(np.diff(track.time_s)):
            if track.flying[index]:
                by = track.by[index]
                self.seconds[by] = self.seconds.get(by, 0.0) + float(step_s)
        for number, version in enumerate(track.versions):
            until_s = (
                track.versions[number + 1].from_s if number + 1 < len(track.versions) else math.inf
            )
            known = [a for a, _ in areas_in_force(track.versions[number - 1])] if number else []
            for area, fence in areas_in_force(version):
                new = number > 0 and not any(same_area(area, other) for other in known)
                self._judge_area((version.from_s, until_s), area, fence=fence, new=new)
        self._judge_heights()

    def _judge_area(self, span: tuple[float, float], area: Area, *, fence: bool, new: bool) -> None:
        track = self.track
        first, last = (bisect.bisect_left(track.time_s, at_s) for at_s in span)
        rooms = rooms_m(track, area, first, last, fence=fence)
        limit_m, leaving, before = area.clearance_m, False, Responsible.OURS
        worst: tuple[float, int, float] | None = None
        for index, room_m in zip(range(first, last), rooms.tolist(), strict=True):
            by = track.by[index]
            self.nearest_m[by] = min(self.nearest_m.get(by, math.inf), room_m)
            if by is Responsible.OURS and math.isfinite(room_m):
                appears = new and index == first
                if appears or (before is not Responsible.OURS and room_m < area.clearance_m):
                    excuse_m = STOP_M if appears else DRIFT_M
                    limit_m, leaving = min(area.clearance_m, room_m - excuse_m), True
                elif leaving and room_m >= area.clearance_m:
                    leaving = new and track.time_s[index] < span[0] + STOP_S
                    limit_m = limit_m if leaving else area.clearance_m
                allowed_m = limit_m - self.tolerance.room_m - track.off_m[index]
                if room_m < allowed_m and (worst is None or allowed_m - room_m > worst[0]):
                    worst = allowed_m - room_m, index, allowed_m
            before = by
        if worst is not None:
            _, index, allowed_m = worst
            room_m = float(rooms[index - first])
            side = "outside" if fence else "inside"
            where = f"{room_m:.2f} m from" if room_m > 0 else f"{-room_m:.2f} m {side} of"
            text = f"{where} {area.name}, {allowed_m:.2f} m are to be kept"
            time_s = float(track.time_s[index])
            self.add(time_s, "room", text, room_m, allowed_m)

    def _judge_heights(self) -> None:
        track, mission = self.track, self.track.mission
        margin_m = mission.vertical_margin_m + self.tolerance.height_m
        low_m, high_m = min(mission.altitudes_m) - margin_m, max(mission.altitudes_m) + margin_m
        near_m = mission.acceptance_m + BESIDE_HOME_M + self.tolerance.home_m
        worst: dict[str, tuple[float, Violation]] = {}
        up = landing = False
        excuse_m, before, back_at = 0.0, Responsible.OURS, 0

        def note(kind: str, text: str, value: float, limit: float) -> None:
            short = abs(value - limit)
            if kind not in worst or short > worst[kind][0]:
                time_s = float(track.time_s[index])
                worst[kind] = short, Violation(time_s, kind, text, value, limit)

        for index in map(int, np.flatnonzero(track.flying)):
            by, above_m, home_m = (
                track.by[index],
                float(track.above_m[index]),
                track.from_home_m(index),
            )
            beyond_m = max(low_m - above_m, above_m - high_m, 0.0)
            up |= above_m >= low_m
            excuse_m = 0.0 if beyond_m == 0.0 else excuse_m
            if by is Responsible.OURS:
                if (
                    before is not Responsible.OURS and beyond_m
                ):  # it may not get farther off from here
                    excuse_m, back_at = beyond_m + DRIFT_M, index
                lands = track.evidence.samples[index].custom_mode == LAND_MODE
                begins = (lands and not landing) or not (up or excuse_m or lands)
                if begins and home_m > (allowed_m := near_m + track.off_m[index]):
                    text = f"{home_m:.1f} m from home, {allowed_m:.1f} m are allowed"
                    note("landing" if lands else "climb", text, home_m, allowed_m)
                if up and not lands and beyond_m > excuse_m:
                    text = f"at {above_m:.1f} m, the plan flies {low_m:.1f} to {high_m:.1f} m"
                    note("altitude", text, above_m, low_m if above_m < low_m else high_m)
                on_m = track.between_m(back_at, index) - track.off_m[index]
                if excuse_m and not lands and on_m > CLIMBS_M + self.tolerance.room_m:
                    text = f"flew {on_m:.0f} m on at {above_m:.1f} m, where it was given back"
                    note("altitude", text, on_m, CLIMBS_M)
                landing = lands
            before = by
        self.violations += [violation for _, violation in worst.values()]


def areas_in_force(version: MissionVersion) -> list[tuple[Area, bool]]:
    """The zones and fences of a mission file, and whether each is a fence."""
    mission = version.mission
    return [(zone, False) for zone in mission.zones] + [(fence, True) for fence in mission.fences]


def leads_home(version: MissionVersion, east_m: float, north_m: float) -> bool:
    """Whether zones and fences, and what is to be kept from them, leave a way home from there.

    Those with limits of altitude or time count as no obstacle.
    """
    free: BaseGeometry = shapely.box(-_FAR_M, -_FAR_M, _FAR_M, _FAR_M)
    for area, fence in areas_in_force(version):
        if area.periods or math.isfinite(area.lower_m) or math.isfinite(area.upper_m):
            continue
        if fence:
            free = free.intersection(area.polygon.buffer(-area.clearance_m))
        else:
            free = free.difference(area.polygon.buffer(area.clearance_m))
    parts = [part for part in shapely.get_parts(free) if part.area > 0.0]
    here, home = shapely.Point(east_m, north_m), shapely.Point(0.0, 0.0)
    return bool(parts) and min(parts, key=here.distance) is min(parts, key=home.distance)


def same_area(area: Area, other: Area) -> bool:
    """Whether two files draw the same."""
    return area.radius_m == other.radius_m and bool(area.outline.equals(other.outline))


def rooms_m(track: Track, area: Area, first: int, last: int, *, fence: bool) -> Floats:
    """The room that the way from each sample to the next keeps; infinite where nothing counts.

    Parts of the track that stay far away are measured as a whole.
    """
    rooms = np.full(last - first, math.inf)
    places = np.column_stack((track.east_m, track.north_m))
    near: list[int] = []
    for begin in range(first, last, _PART):
        end = min(begin + _PART, last)
        counts = track.flying[begin:end]
        if not counts.any():
            continue
        part = places[begin : end + 1]
        if len(part) > 1:
            roughly_m = room_m(area, shapely.linestrings(part), fence=fence)
            if roughly_m > 4 * area.clearance_m:
                rooms[begin - first : end - first][counts] = roughly_m
                continue
        near.extend(map(int, np.flatnonzero(counts) + begin))
    if near:
        numbers, ways = _clipped(track, area, places, np.array(near))
        rooms[numbers - first] = _rooms_m(area, ways, fence=fence)
    return rooms


def _clipped(track: Track, area: Area, places: Floats, numbers: Any) -> tuple[Any, Any]:
    """Of the ways from these samples to the next, the parts within the area's altitudes.

    Returns the numbers of those that have one, and it.
    """
    after = np.minimum(numbers + 1, len(places) - 1)
    # Down at once: a simulated vehicle that was started anew stands at home.
    down = track.armed[numbers] & ~track.armed[after] & ~track.flying[after]
    after = np.where(down, numbers, after)
    heights = track.above_m[numbers] + track.ground_m
    span = track.above_m[after] + track.ground_m - heights
    level = span == 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        limits = [(limit - heights) / span for limit in (area.lower_m, area.upper_m)]
    begin = np.where(level, 0.0, np.maximum(np.minimum(*limits), 0.0))
    end = np.where(level, 1.0, np.minimum(np.maximum(*limits), 1.0))
    within = np.where(level, (area.lower_m <= heights) & (heights <= area.upper_m), begin <= end)
    here = places[numbers]
    step = places[after] - here
    ends = np.stack((here + begin[:, None] * step, here + end[:, None] * step), axis=1)
    return numbers[within], shapely.linestrings(ends[within])


def room_m(area: Area, way: Any, *, fence: bool) -> float:
    """What a line keeps from a zone, or from the border within a fence; negative: how deep."""
    return float(_rooms_m(area, np.array([way], dtype=object), fence=fence)[0])


def _rooms_m(area: Area, ways: Any, *, fence: bool) -> Floats:
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
        if fence:
            return np.asarray(area.radius_m - farthest_m(outline))
        return np.asarray(shapely.distance(outline, ways) - area.radius_m)
    border_m = shapely.distance(outline.boundary, ways)
    if fence:
        outside_m = farthest_m(outline)
        within_m = np.where(shapely.covers(outline, ways), border_m, 0.0)
        return np.where(outside_m > 0, -outside_m, within_m)
    depths_m = shapely.distance(outline.boundary, corners)
    depths_m = np.where(shapely.intersects(outline, corners), depths_m, 0.0)
    deepest_m = np.maximum.reduceat(depths_m, starts)
    return np.where(shapely.intersects(outline, ways), -deepest_m, border_m)


def straight_room_m(
    area: Area, begin: Sequence[float], end: Sequence[float], *, fence: bool
) -> float:
    """The room of a straight leg."""
    return room_m(area, shapely.LineString([begin, end]), fence=fence)
