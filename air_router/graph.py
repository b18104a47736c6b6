"""The waypoint graph: the operator's waypoints, and the clear ways between them.

Two nodes are joined when they are at most `max_edge_m` apart and the straight leg between them is
clear. Where that leaves the graph in pieces, the pieces are joined by the shortest detours around
zones, so that the graph hangs together wherever the airspace does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations, pairwise

import networkx as nx
from shapely import Point as ShapelyPoint
from shapely import STRtree

from air_router.flight_plan import HOME_NODE
from air_router.mission import Mission
from geo.frame import Point
from geo.visibility import PathFinder, path_finder

_CANDIDATES = 3
"""How many of the nearest pairs of two pieces are tried for the shortest detour."""


class WaypointGraph:
    """Home (node 0), the waypoints (their numbers), and the clear ways between them.

    Attributes:
        mission: what it was made from.
        graph: a networkx graph; nodes have `position` (a Point), edges have `length_m` and `via`,
            the corners of a detour in order from the lower node to the higher (mostly none).
        paths: the path finder of the mission's planning airspace.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.paths: PathFinder = path_finder(mission.planning_airspace)
        self.graph: nx.Graph[int] = nx.Graph()
        self._positions = {HOME_NODE: mission.home}
        self._positions |= {w.number: w.position for w in mission.waypoints}
        for node, position in self._positions.items():
            self.graph.add_node(node, position=position)
        self._join_visible()
        self._join_pieces()

    @property
    def positions(self) -> dict[int, Point]:
        """Position of every node, in metres east and north."""
        return self._positions

    def position(self, node: int) -> Point:
        """Where a node is. Raises KeyError if there is no such node."""
        return self._positions[node]

    def via(self, start: int, end: int) -> tuple[Point, ...]:
        """The corners between two joined nodes, in the order from start to end."""
        corners: tuple[Point, ...] = self.graph.edges[start, end]["via"]
        return corners if start < end else corners[::-1]

    @property
    def detours(self) -> Iterator[tuple[int, int]]:
        """The edges that are not straight."""
        return (edge for edge in self.graph.edges if self.graph.edges[edge]["via"])

    def _join_visible(self) -> None:
        nodes = list(self._positions)
        tree = STRtree([ShapelyPoint(self._positions[node]) for node in nodes])
        reach_m = self.mission.planner.max_edge_m
        for index, node in enumerate(nodes):
            here = self._positions[node]
            hits = tree.query(ShapelyPoint(here), predicate="dwithin", distance=reach_m)
            others = sorted(nodes[hit] for hit in hits if hit > index)
            ends = [self._positions[other] for other in others]
            clear = self.mission.planning_airspace.legs_clear(here, ends)
            for other, end, ok in zip(others, ends, clear, strict=True):
                if ok:
                    self.graph.add_edge(node, other, length_m=math.dist(here, end), via=())

    def _join_pieces(self) -> None:
        pieces = [sorted(piece) for piece in nx.connected_components(self.graph)]
        while len(pieces) > 1:
            joined = self._join_nearest(pieces)
            if joined is None:
                return
            one, other = joined
            pieces = [piece for piece in pieces if piece not in (one, other)]
            pieces.append(sorted(one + other))

    def _join_nearest(self, pieces: list[list[int]]) -> tuple[list[int], list[int]] | None:
        """Join the two pieces with the nearest nodes that a detour can join."""
        gaps = []
        for one, other in combinations(pieces, 2):
            near = sorted((self._apart_m(a, b), a, b) for a in one for b in other)[:_CANDIDATES]
            gaps.append((near[0][0], one, other, near))
        for _, one, other, near in sorted(gaps):
            detours = [detour for _, a, b in near if (detour := self._detour(a, b)) is not None]
            if detours:
                length_m, a, b, via = min(detours)
                self.graph.add_edge(a, b, length_m=length_m, via=via)
                return one, other
        return None

    def _detour(self, a: int, b: int) -> tuple[float, int, int, tuple[Point, ...]] | None:
        low, high = min(a, b), max(a, b)
        path = self.paths.path(self._positions[low], self._positions[high])
        if path is None:
            return None
        return polyline_length_m(path), low, high, path[1:-1]

    def _apart_m(self, a: int, b: int) -> float:
        return math.dist(self._positions[a], self._positions[b])


def polyline_length_m(points: tuple[Point, ...]) -> float:
    """Length of the line through the points, in metres."""
    return sum(math.dist(a, b) for a, b in pairwise(points))
