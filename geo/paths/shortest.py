"""The shortest clear path between any two places of an airspace.

The search runs in a mesh of the lean shape of the clear area. Where that has no path, or where its
cut corners might make a short path noticeably longer, the search runs in the tight shape. The exact
test of the airspace checks every leg of a result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from geo.airspace import Airspace
from geo.frame import Point
from geo.paths.free_space import BEVEL, FreeSpace
from geo.paths.mesh import Mesh
from geo.paths.polyanya import CornerSearch, Search, Source

Path = tuple[Point, ...]

_CORNER_EXCESS = math.hypot(BEVEL, 1.0) - 1.0
"""By how many distances to keep, per radian turned, lean corners make a path longer at most: so far
behind an arc lie the corners of the square that a needle's end grows."""

_WORTH = 0.03
"""If a path may be longer than necessary by this share, the search repeats in the tight shape."""

_BLUNT = math.radians(40)
"""Turns along an arc are made one up to here: an arc gets 4 % longer, and has few corners."""

_DIRECTIONS = 48

_OUT_M, _OUT_TRIES = 300.0, 200
"""Limits of the search for a way out of a tight place: distance, and number of corners."""

_PATIENCE = 100
"""After so many nodes the search starts from the end too, as one end may be walled in. Then, so
many at a time, the search goes on that knows the path to be longer: it is likely the nearer one."""


@lru_cache(maxsize=8)
def shortest_paths(airspace: Airspace) -> ShortestPaths:
    """The path finder of an airspace; cached."""
    return ShortestPaths(airspace)


class ShortestPaths:
    """Finds shortest clear paths and connected parts of an airspace.

    A gap counts as open when it is wider than the required distances to both its sides by 0.2 mm;
    between pointed corners of two zones by 0.01 % more, of a zone and a fence by up to 0.6 %, next
    to a circle by 1 cm or 0.004 % of the distance.

    Args:
        airspace: the zones, fences and required distances.
    """

    def __init__(self, airspace: Airspace) -> None:
        self.airspace = airspace
        self.space = FreeSpace(airspace)
        self.mesh = Mesh(self.space.lean)
        self._required_m = max(airspace.fence_distance_m, *airspace.distances_m, 0.0)  # largest

    def path(
        self,
        start: Point,
        end: Point,
        *,
        first: Callable[[Point], bool] | None = None,
        doors: Iterable[Point] = (),
    ) -> Path | None:
        """The shortest clear path between two places.

        Args:
            start: where the path begins.
            end: where it ends.
            first: takes the end of the first leg; replaces the test that this leg is clear.
            doors: with `first`: further ends of the first leg, besides the corners visible from
                start.

        Returns:
            The corners, with start and end; None if there is no path.
        """
        start, end = Point(*start), Point(*end)
        if first is None:
            return self._clear_path(start, end)
        if first(end):
            return (start, end)
        if not self.airspace.point_clear(end):
            return None
        plain = self._clear_path(start, end)
        if plain is not None and first(plain[1]):
            return plain
        return self._path_by_doors(start, end, first, [*doors])

    def part_of(self, point: Point) -> int | None:
        """The connected part of the clear area that contains a place.

        Args:
            point: the place.

        Returns:
            The number of the part in the lean shape (see `connected`); None if the place is not
            clear.
        """
        landing = self._landing(self.mesh, point)
        return None if landing is None else landing[1]

    def parts_of(self, points: Sequence[Point]) -> list[int | None]:
        """`part_of` of many places.

        Args:
            points: the places.

        Returns:
            A number or None for each place.
        """
        found = zip(points, self.mesh.parts_of(points), strict=True)
        return [self.part_of(point) if part is None else part for point, part in found]

    def connected(self, a: Point, b: Point) -> bool:
        """Whether a clear path between two places exists."""
        one = self.part_of(a)
        if one is None:
            return self._pocket_path(a, b) is not None
        return one == self.part_of(b)

    def nearest(self, point: Point, reachable_from: Point | None = None) -> Point | None:
        """The clear place nearest to a point.

        Args:
            point: any place.
            reachable_from: the result must be reachable from this place; if this place is not
                clear, from the clear place nearest to it.

        Returns:
            The point itself if it is clear; None if there is no such place.
        """
        part = None
        start = point if reachable_from is None else reachable_from
        if not len(self.mesh) or not np.isfinite([point, start]).all():
            return None
        if reachable_from is not None:
            part = self.part_of(reachable_from)
            if part is None:
                part = self.mesh.nearest(reachable_from)[1]
        if self.airspace.point_clear(point) and part in {None, self.part_of(point)}:
            return point
        found = self.mesh.nearest(point, part)[0]
        return found if self.airspace.point_clear(found) else None

    def exits(self, point: Point) -> list[Point]:
        """Clear places around a place that is not clear.

        Args:
            point: the place.

        Returns:
            Places in 48 directions, nearest first.
        """
        return self.mesh.all_around(point, _DIRECTIONS) if len(self.mesh) else []

    def way_out(self, point: Point, near: Airspace) -> Path | None:
        """The shortest path from a place that is not clear to a clear place.

        Args:
            point: where the path begins.
            near: an airspace in which the point is clear: shorter distances, or fewer zones.

        Returns:
            The path, clear in `near`; None if there is none within 300 m.
        """
        if not len(self.mesh):
            return None
        places = [self.mesh.nearest(point)[0], *self.mesh.corners_within(point, _OUT_M)]
        for least_m in (_OUT_M / 8, _OUT_M):  # few zones are near enough for a short one
            best: Path | None = None
            local = ShortestPaths(near.around(point, least_m + max(least_m / 2, self._required_m)))
            for place in places[:_OUT_TRIES]:
                if math.dist(point, place) >= least_m:
                    break
                path = local.path(point, place)
                if path is not None and path_length_m(path) < least_m:
                    best, least_m = path, path_length_m(path)  # noqa: PLW2901
            if best is not None:
                return best
        return None

    def _clear_path(self, start: Point, end: Point) -> Path | None:
        here, there = self._landing(self.mesh, start), self._landing(self.mesh, end)
        # No gap without width lies between two places of one part that see each other.
        joined = here is None or there is None or here[1] == there[1]
        if joined and self.airspace.leg_clear(start, end):
            return (start, end)
        if here is None and there is None:
            return self._pocket_path(start, end)
        if here is None or there is None or here[1] != there[1]:
            return None
        back = end < start  # one search direction makes both paths the same
        one, other = (there[0], here[0]) if back else (here[0], there[0])
        path = self._between(self.mesh, one, other)
        if path is None:
            return None
        path = self._closer(path, path_length_m(one) + path_length_m(other))
        return path[::-1] if back else path

    def _between(self, mesh: Mesh, here: Path, there: Path) -> Path | None:
        """The shortest path in a mesh between the ends of two paths that lead there."""
        path = shortest_path(mesh, [Source(0.0, here[-1])], there[-1])
        if path is None:
            return None
        path = self._begun_at(here[:-1], path)
        path = self._begun_at(there[:-1], path[::-1])[::-1]
        return self._clear_and_blunt(path)

    def _landing(self, mesh: Mesh, point: Point) -> tuple[Path, int] | None:
        """A path from a clear place into a mesh, and the part of it that this leads to.

        It is the place alone, but where only exact corners leave it clear.
        """
        part = mesh.part_of(point)
        if part is not None:
            return (point,), part
        if not len(mesh) or not self.airspace.point_clear(point):
            return None
        place, part = mesh.nearest(point)
        if self.airspace.leg_clear(point, place):
            return (point, place), part
        if mesh is not self.mesh:
            return None
        nearby = self._nearby(point)
        for place in mesh.all_around(point, _DIRECTIONS):
            path = shortest_path(nearby, [Source(0.0, point)], place)
            if path is not None and self._all_clear(path):
                return path, mesh.nearest(place)[1]
        return None

    def _nearby(self, point: Point) -> Mesh:
        """The tight clear area around a place, as far as corners may reach too far there."""
        reach_m = 3 * self._required_m + 1.0
        east_m, north_m = point
        west_m, south_m = east_m - reach_m, north_m - reach_m
        return Mesh(self.space.tight((west_m, south_m, east_m + reach_m, north_m + reach_m)))

    def _pocket_path(self, start: Point, end: Point) -> Path | None:
        """A path within a pocket between corners that the mesh does not have."""
        if not (self.airspace.point_clear(start) and self.airspace.point_clear(end)):
            return None
        path = shortest_path(self._nearby(start), [Source(0.0, start)], end)
        return path if path is not None and self._all_clear(path) else None

    def _begun_at(self, start: Path, path: Path) -> Path:
        """A path that begins beside the mesh, with as few corners of the mesh as it can."""
        if not start:
            return path
        for skipped in range(min(3, len(path)) - 1, 0, -1):
            if self.airspace.leg_clear(start[-1], path[skipped]):
                return (*start, *path[skipped:])
        return (*start, *path)

    def _closer(self, path: Path, offset_m: float) -> Path:
        """The path, or a shorter one around the same corners if they make a difference.

        Args:
            path: as the mesh has it.
            offset_m: how much of it leads into the mesh and out of it, and may be a detour.
        """
        length_m = path_length_m(path)
        excess_m = sum(map(abs, _turns(path))) * _CORNER_EXCESS * self._required_m + 2 * offset_m
        if excess_m < _WORTH * length_m:
            return path
        # All that is as near is within an ellipse around the ends.
        slack_m = (math.sqrt(max(length_m**2 - math.dist(path[0], path[-1]) ** 2, 0.0))) / 2 + 1.0
        ends = np.array([path[0], path[-1]])
        west, south = (ends.min(axis=0) - slack_m).tolist()
        east, north = (ends.max(axis=0) + slack_m).tolist()
        nearby = Mesh(self.space.tight((west, south, east, north)))
        here, there = self._landing(nearby, path[0]), self._landing(nearby, path[-1])
        closer = here and there and self._between(nearby, here[0], there[0])
        return closer if closer is not None and path_length_m(closer) < length_m else path

    def _clear_and_blunt(self, path: Path) -> Path | None:
        """A path along arcs as one that turns less often, where that is clear; else unchanged."""
        blunt = _blunted(path, self._required_m) if len(path) > 3 else path
        if len(blunt) < len(path) and self._all_clear(blunt):
            return blunt
        return path if self._all_clear(path) else None

    def _path_by_doors(
        self, start: Point, end: Point, first: Callable[[Point], bool], doors: list[Point]
    ) -> Path | None:
        mesh = self.mesh
        goal = self._landing(mesh, end)
        if goal is None:
            return None
        begin = start if mesh.part_of(start) is not None else mesh.nearest(start)[0]
        search = CornerSearch(mesh, [Source(0.0, begin)], goal[0][-1])
        search.run(math.inf)
        places = [begin, *doors, *search.corners]
        sources = [Source(math.dist(start, place), place) for place in dict.fromkeys(places)]
        path = shortest_path(mesh, sources, goal[0][-1], allowed=first)
        if path is None:
            return None
        path = self._begun_at(goal[0][:-1], path[::-1])[::-1]
        return (start, *path) if self._all_clear(path) else None

    def _all_clear(self, path: Sequence[Point]) -> bool:
        places = np.array(path, dtype=float)
        return bool(self.airspace.legs_clear_between(places[:-1], places[1:]).all())


def shortest_path(
    mesh: Mesh,
    sources: Sequence[Source],
    goal: Point,
    *,
    allowed: Callable[[Point], bool] | None = None,
) -> Path | None:
    """The shortest path to a goal from any of several sources.

    Args:
        mesh: the area that contains the path.
        sources: the places where the path may begin, each with a length in meters before it.
        goal: where the path ends.
        allowed: whether a path may begin at a source; called only for a candidate.

    Returns:
        The corners, beginning with the source; None if there is no path, or if the goal is not in
        the mesh.
    """
    ahead = Search(mesh, sources, goal, allowed)
    patience: float = _PATIENCE if len(sources) == 1 and allowed is None else math.inf
    if ahead.run(patience):
        return ahead.path
    back = Search(mesh, [Source(sources[0].length_m, goal)], sources[0].place)
    search = back
    while not search.run(patience):
        search = max(ahead, back, key=lambda one: one.least_m)
    path = search.path
    return path[::-1] if path is not None and search is back else path


def path_length_m(path: Sequence[Point]) -> float:
    """Length of the line through the points, in metres."""
    return sum(math.dist(a, b) for a, b in pairwise(path))


def _turns(path: Path) -> list[float]:
    """By how much a path turns at each of its corners, in radians; to the left is more than 0."""
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(path)]
    return [math.remainder(b - a, math.tau) for a, b in pairwise(headings)]


def _blunted(path: Path, short_m: float) -> Path:
    """Small turns to one hand, short legs apart, made one: where the legs around them meet."""
    turns = [0.0, *_turns(path)]
    corners: list[Point] = []
    first = 1
    while first < len(turns):
        last, turn = first, turns[first]
        while (
            last + 1 < len(turns)
            and turns[last + 1] * turn > 0
            and abs(turn + turns[last + 1]) <= _BLUNT
            and math.dist(path[last], path[last + 1]) <= short_m
        ):
            last += 1
            turn += turns[last]
        alone = last == first
        corners.append(path[first] if alone else _meeting(path, first, last))
        first = last + 1
    return (path[0], *corners, path[-1])


def _meeting(path: Path, first: int, last: int) -> Point:
    """Where the leg to one corner and the leg from a later one meet, made longer."""
    (a_e, a_n), (b_e, b_n) = path[first - 1], path[first]
    (c_e, c_n), (d_e, d_n) = path[last], path[last + 1]
    in_e, in_n, out_e, out_n = b_e - a_e, b_n - a_n, d_e - c_e, d_n - c_n
    share = ((c_e - b_e) * out_n - (c_n - b_n) * out_e) / (in_e * out_n - in_n * out_e)
    return Point(b_e + share * in_e, b_n + share * in_n)
