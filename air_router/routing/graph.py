"""The waypoint graph: the operator's waypoints and the clear legs between them.

Two nodes are joined if they are at most `max_edge_m` apart and the straight leg between them is
clear. If that leaves several pieces, each piece is joined to its neighbors by the shortest detours
around zones, so the graph is connected wherever the airspace is.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from shapely import STRtree

from air_router.mission import HOME_NODE, Mission
from air_router.routing.limits import GRAPH_NEIGHBOURS
from geo.frame import Point
from geo.paths import ShortestPaths, path_length_m, shortest_paths

_Floats = npt.NDArray[np.float64]
_Integers = npt.NDArray[np.intp]


class WaypointGraph:
    """Home (node 0), the waypoints (by number), and the clear ways between them.

    Attributes:
        mission: The mission of the graph.
        paths: Shortest paths in the mission's planning airspace.
        places: Positions of the nodes, one row (east, north) each.
        neighbours: The joined nodes of each node, with the length of the way.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.paths: ShortestPaths = shortest_paths(mission.planning_airspace)
        positions = [mission.home, *(waypoint.position for waypoint in mission.waypoints)]
        self._positions = dict(enumerate(positions, start=HOME_NODE))  # by node
        self.places: _Floats = np.array(positions, dtype=float)
        self.neighbours: list[list[tuple[int, float]]] = [[] for _ in positions]
        # corners of detour edges
        self._vias: dict[tuple[int, int], tuple[Point, ...]] = {}
        self._join_visible()
        self._join_pieces()

    @cached_property
    def graph(self) -> Any:
        """The same as a `networkx.Graph[int]`, for programs that know those.

        Nodes have `position` (a Point). Edges have `length_m` and `via`, the corners of a detour
        from the lower node to the higher (usually none).
        """
        import networkx as nx  # noqa: PLC0415 - slow to import, and needed by no command

        graph: nx.Graph[int] = nx.Graph()
        for node, position in self._positions.items():
            graph.add_node(node, position=position)
        graph.add_edges_from(
            (node, other, {"length_m": length_m, "via": self._vias.get((node, other), ())})
            for node, around in enumerate(self.neighbours)
            for other, length_m in around
            if node < other
        )
        return graph

    @property
    def edges(self) -> Iterator[tuple[int, int]]:
        """The pairs of joined nodes, the lower first."""
        for node, around in enumerate(self.neighbours):
            yield from ((node, other) for other, _ in around if node < other)

    @property
    def connected(self) -> bool:
        """Whether the graph is connected."""
        return not self._pieces().any()

    @property
    def positions(self) -> dict[int, Point]:
        """Position of every node, in meters east and north."""
        return self._positions

    def position(self, node: int) -> Point:
        """The position of a node. Raises KeyError if there is no such node."""
        return self._positions[node]

    def via(self, start: int, end: int) -> tuple[Point, ...]:
        """The corners between two joined nodes, from start to end."""
        corners = self._vias.get((min(start, end), max(start, end)), ())
        return corners if start < end else corners[::-1]

    @property
    def detours(self) -> Iterator[tuple[int, int]]:
        """The edges that are not straight."""
        return iter(self._vias)

    def _join_visible(self) -> None:
        """Join all pairs within reach with a clear straight leg, tested in one batch."""
        points: npt.NDArray[np.object_] = np.asarray(shapely.points(self.places))
        reach_m = self.mission.planner.max_edge_m
        low, high = STRtree(points).query(points, predicate="dwithin", distance=reach_m)
        low, high = low[low < high], high[low < high]
        clear = self.mission.planning_airspace.legs_clear_between(
            self.places[low], self.places[high]
        )
        low, high = low[clear], high[clear]
        lengths_m = np.hypot(*(self.places[low] - self.places[high]).T)
        order = np.lexsort((high, low))
        for one, other, length_m in zip(
            low[order].tolist(), high[order].tolist(), lengths_m[order].tolist(), strict=True
        ):
            self.neighbours[one].append((other, length_m))
            self.neighbours[other].append((one, length_m))

    def _join_pieces(self) -> None:
        """Join pieces by clear detours, until no more can be joined."""
        while True:
            pieces = self._pieces()
            if pieces.max() == 0:
                return
            regions = self._regions
            pairs = {
                pair
                for piece in range(pieces.max() + 1)
                for pair in self._nearest_pairs(pieces, regions, piece)
            }
            joined = [self._join(low, high) for low, high in sorted(pairs)]
            if not any(joined):
                return

    @cached_property
    def _regions(self) -> _Integers:
        """The connected part of the clear area of each node."""
        parts = self.paths.parts_of([*self._positions.values()])
        regions = np.array([-1 if part is None else part for part in parts], dtype=np.intp)
        home = regions[HOME_NODE]
        for region in set(regions.tolist()) - {int(home)}:
            node = int(np.flatnonzero(regions == region)[0])
            if self.paths.connected(self._positions[HOME_NODE], self._positions[node]):
                regions[regions == region] = home
        return regions

    def _pieces(self) -> _Integers:
        """The connected piece of the graph of each node, by number."""
        pieces = [-1] * len(self.neighbours)
        piece = 0
        for first in range(len(pieces)):
            if pieces[first] >= 0:
                continue
            pieces[first] = piece
            reached = [first]
            while reached:
                for other, _ in self.neighbours[reached.pop()]:
                    if pieces[other] < 0:
                        pieces[other] = piece
                        reached.append(other)
            piece += 1
        return np.array(pieces, dtype=np.intp)

    def _nearest_pairs(
        self, pieces: _Integers, regions: _Integers, piece: int
    ) -> Iterator[tuple[int, int]]:
        """The nearest pairs of nodes between a piece and its neighbors in the same region."""
        mine = np.flatnonzero(pieces == piece)
        theirs = np.flatnonzero((pieces != piece) & (regions == regions[mine[0]]))
        if len(mine) > len(theirs) or not len(theirs):
            return  # the other pieces find it
        apart_m = np.hypot(*(self.places[mine][:, None] - self.places[theirs]).transpose(2, 0, 1))
        nearest = apart_m.argmin(axis=0)
        least_m = apart_m[nearest, np.arange(len(theirs))]
        met: set[int] = set()
        for index in np.argsort(least_m).tolist():
            other = int(theirs[index])
            if pieces[other] not in met:
                met.add(int(pieces[other]))
                one = int(mine[nearest[index]])
                yield min(one, other), max(one, other)
                if len(met) == GRAPH_NEIGHBOURS:
                    return

    def _join(self, low: int, high: int) -> bool:
        path = self.paths.path(self._positions[low], self._positions[high])
        if path is None:
            return False
        length_m = path_length_m(path)
        self.neighbours[low].append((high, length_m))
        self.neighbours[high].append((low, length_m))
        if len(path) > 2:
            self._vias[low, high] = path[1:-1]
        return True
