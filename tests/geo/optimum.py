"""Shortest paths by brute force, and clearances by plain distances: nothing of the code under test.

Zones are grown with fine arcs, all their corners are joined to all others, Dijkstra does the rest.
"""

import math
import random
from itertools import pairwise

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely import Point as Spot

from geo.airspace.airspace import Airspace, Zone
from geo.frame import Point

CLEARANCE_M = 5.0
_ARC_STEPS = 12


def ring(places):
    return tuple(Point(*place) for place in places)


def least_m(path, fence, zones):
    """The closest approach of any leg, by distances between plain shapes; -1 if outside."""
    least_m = math.inf
    for a, b in pairwise(path):
        leg = LineString([a, b]) if tuple(a) != tuple(b) else Spot(a)
        if fence is not None:
            if not fence.contains(leg):
                return -1.0
            least_m = min(least_m, leg.distance(fence.exterior))
        least_m = min([least_m, *shapely.distance(leg, zones)])
    return least_m


class Ground:
    """A fence and zones as plain rings."""

    def __init__(self, fence, zones, clearance_m=CLEARANCE_M):
        self.clearance_m = clearance_m
        self.fence = Polygon(fence)
        self.zones = [Polygon(zone) for zone in zones]
        self.airspace = Airspace(
            ring(fence), [Zone(str(n), ring(z)) for n, z in enumerate(zones)], clearance_m
        )

    def least_m(self, path):
        return least_m(path, self.fence, self.zones)

    def grown(self, share=1.0):
        """The clear area with arcs that are never too near (share 1), or too near for sure."""
        excess = 1 / math.cos(0.75 * (math.pi / 2) / _ARC_STEPS) if share == 1.0 else share
        reach_m = self.clearance_m * excess
        zones = [zone.buffer(reach_m, quad_segs=_ARC_STEPS) for zone in self.zones]
        inside = self.fence.buffer(-reach_m, quad_segs=_ARC_STEPS)
        return inside.difference(shapely.union_all(zones))

    def connected(self, start, goal, share=1.0):
        """Whether some part of the clear area holds both places."""
        parts = shapely.get_parts(self.grown(share))
        return any(
            part.dwithin(Spot(start), 1e-6) and part.dwithin(Spot(goal), 1e-6) for part in parts
        )


class BruteForce:
    """All corners of the clear area, and who of them sees whom."""

    def __init__(self, free):
        self._free = free.buffer(1e-6)
        shapely.prepare(self._free)
        self.corners = _reflex(free)
        count = len(self.corners)
        self._apart_m = np.full((count + 2, count + 2), np.inf)
        one, other = np.triu_indices(count, 1)
        self._join(one, other, self.corners)

    def holds(self, place):
        return bool(shapely.intersects_xy(self._free, *place))

    def length_m(self, start, goal):
        count = len(self.corners)
        places = np.vstack([self.corners, [start, goal]])
        for end in (count, count + 1):
            self._apart_m[end, :] = self._apart_m[:, end] = np.inf
            others = np.flatnonzero(np.arange(count + 2) != end)
            self._join(np.full(len(others), end), others, places)
        so_far_m = np.full(count + 2, np.inf)
        so_far_m[count] = 0.0
        done = np.zeros(count + 2, dtype=bool)
        while True:
            waiting = np.where(done, np.inf, so_far_m)
            node = int(waiting.argmin())
            if node == count + 1 or not np.isfinite(waiting[node]):
                return float(so_far_m[count + 1])
            done[node] = True
            so_far_m = np.minimum(so_far_m, so_far_m[node] + self._apart_m[node])

    def _join(self, one, other, places):
        lines = shapely.linestrings(np.stack([places[one], places[other]], axis=1))
        seen = shapely.covers(self._free, lines)
        one, other = one[seen], other[seen]
        apart_m = np.hypot(*(places[one] - places[other]).T)
        self._apart_m[one, other] = self._apart_m[other, one] = apart_m


def _reflex(free):
    found = [np.zeros((0, 2))]
    for part in shapely.get_parts(free):
        oriented = shapely.geometry.polygon.orient(part)
        for border in (oriented.exterior, *oriented.interiors):
            here = shapely.get_coordinates(border)[:-1]
            before, after = here - np.roll(here, 1, 0), np.roll(here, -1, 0) - here
            found.append(here[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < 0])
    return np.vstack(found)


FENCES = (
    ((-100, -100), (100, -100), (100, 100), (-100, 100)),
    ((-100, -100), (0, -70), (100, -100), (100, 100), (0, 40), (-100, 100)),
)


def scattered(seed):
    """One to eight concave zones that may overlap, touch each other and cross the fence."""
    chance = random.Random(seed)
    zones = []
    for _ in range(chance.randint(1, 8)):
        east, north = chance.uniform(-85, 85), chance.uniform(-85, 85)
        reach = chance.uniform(6, 40)
        angles = sorted(chance.uniform(0, math.tau) for _ in range(chance.randint(3, 9)))
        corners = [
            (
                east + reach * chance.uniform(0.3, 1) * math.cos(angle),
                north + reach * chance.uniform(0.3, 1) * math.sin(angle),
            )
            for angle in angles
        ]
        if Polygon(corners).is_valid and Polygon(corners).area > 1:
            zones.append(corners)
    return Ground(FENCES[chance.random() < 0.3], zones), chance


def gridded(seed):
    """Boxes and trapezia on a 10 m grid: shared sides, corners in line, gaps of twice 5 m."""
    chance = random.Random(seed)
    zones = []
    for _ in range(chance.randint(2, 9)):
        west, south = chance.randrange(-80, 80, 10), chance.randrange(-80, 80, 10)
        east, north = west + chance.choice((10, 20, 30)), south + chance.choice((10, 20, 40))
        slant = chance.choice((0, 0, 10))
        zones.append([(west, south), (east + slant, south), (east, north), (west, north)])
    return Ground(FENCES[0], zones), chance


def places(chance, count, step=None):
    """Random places, on a grid of so many metres if that is given."""
    if step is None:
        return [Point(chance.uniform(-95, 95), chance.uniform(-95, 95)) for _ in range(count)]
    return [
        Point(float(chance.randrange(-95, 96, step)), float(chance.randrange(-95, 96, step)))
        for _ in range(count)
    ]
