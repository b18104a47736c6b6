"""The shortest path through a mesh of triangles: any angle, exact, without a graph.

The method is Polyanya (Cui, Harabor and Grastien, "Compromise-free pathfinding on a navigation
mesh", IJCAI 2017), written for triangles. A search node is an interval of a triangle's side and
the last turning point (root), that sees all of it; A* takes the nodes in the order of the shortest
path that they may still allow. Where an interval ends at a corner of the border the path may turn
there: all triangles around the corner are entered at once, so that no interval ever lies in line
with its root, which is where degenerate maps break such a search.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from heapq import heapify, heappop, heappush, heappushpop
from typing import NamedTuple

from geo.frame import Point
from geo.paths.mesh import ON_M, Mesh, Place

_FLAT_M2 = 1e-8
"""A vertex so near to a line of sight (as twice the triangle's area) counts as on it."""

_SPECK_M = 1e-9
"""A shorter interval leads nowhere that its ends do not."""

_HERE = -1
"""The entry of a node whose root sees the goal without entering another triangle."""

_Span = tuple[float, float, float, float]
_Node = tuple[float, int, int, float, float, float, float]
"""Estimate of the whole path, root, entry; the interval's left and right end (east, north)."""


class Source(NamedTuple):
    """A place where a path may begin, after `length_m` metres of what came before it."""

    length_m: float
    place: Point


def shortest(
    mesh: Mesh,
    sources: Sequence[Source],
    goal: Point,
    *,
    allowed: Callable[[Point], bool] | None = None,
) -> tuple[Point, ...] | None:
    """The shortest path to the goal from any of the sources, its source first.

    Args:
        mesh: where the path stays.
        sources: where it may begin.
        goal: where it ends.
        allowed: asked for a source, only when a path from there may be the shortest.

    Returns:
        The path; None if there is none, or where the goal is not in the mesh.
    """
    search = _Search(mesh, goal)
    return search.run(sources, allowed) if search.reachable else None


def seen_corners(mesh: Mesh, place: Point) -> list[Point]:
    """The corners seen from a place that a shortest path from there may turn at first."""
    outlook = _Outlook(mesh, place)
    outlook.run([Source(0.0, place)], None)
    return outlook.corners


class _Search:
    """One search: the roots found so far, and the queue of nodes."""

    def __init__(self, mesh: Mesh, goal: Point) -> None:
        self._mesh = mesh
        self._goal = goal
        self._goal_triangles = set(mesh.holding(goal))
        self._goal_entries = {3 * t + side for t in self._goal_triangles for side in range(3)}
        self._roots: list[tuple[float, float, float, int]] = []  # place, metres so far, the former
        self._best_m: dict[int, float] = {}
        self._queue: list[_Node] = []

    @property
    def reachable(self) -> bool:
        return bool(self._goal_triangles)

    def run(
        self, sources: Sequence[Source], allowed: Callable[[Point], bool] | None
    ) -> tuple[Point, ...] | None:
        queue, goals = self._queue, self._goal_entries
        waiting = self._by_estimate(sources)
        estimate_m, source = next(waiting, (math.inf, None))
        node: _Node | None = None
        while True:
            while source is not None and (not queue or estimate_m <= queue[0][0]):
                if node is not None and node[0] < estimate_m:
                    break
                if allowed is None or allowed(source.place):
                    self._begin(source)
                estimate_m, source = next(waiting, (math.inf, None))
            if node is not None:
                node = heappushpop(queue, node)
            elif queue:
                node = heappop(queue)
            else:
                return None
            if node[2] in goals or node[2] == _HERE:
                return self._path(node)
            node = self._expand(node)

    def _by_estimate(self, sources: Sequence[Source]) -> Iterator[tuple[float, Source]]:
        heap = [(s.length_m + math.dist(s.place, self._goal), s) for s in sources]
        heapify(heap)
        while heap:
            yield heappop(heap)

    def _begin(self, source: Source) -> None:
        """Enter all triangles around a source."""
        mesh = self._mesh
        root = self._root(*source.place, source.length_m, -1)
        around = mesh.holding(source.place)
        if not self._goal_triangles.isdisjoint(around):
            self._arrive(root)
            return
        for side in (3 * triangle + side for triangle in around for side in range(3)):
            entry = mesh.back[side]
            if entry >= 0:
                left, right, _, _, _ = mesh.entries[entry]
                span = (*mesh.places[left], *mesh.places[right])
                if not _in_line(source.place, span):
                    heappush(self._queue, self._node(root, entry, span))

    def _root(self, east_m: float, north_m: float, so_far_m: float, former: int) -> int:
        self._roots.append((east_m, north_m, so_far_m, former))
        return len(self._roots) - 1

    def _arrive(self, root: int) -> None:
        east, north, so_far_m, _ = self._roots[root]
        estimate_m = so_far_m + math.dist((east, north), self._goal)
        heappush(self._queue, (estimate_m, root, _HERE, east, north, east, north))

    def _node(self, root: int, entry: int, span: _Span) -> _Node:
        """A node, with the length of the path through it as if nothing stood behind it."""
        root_e, root_n, length_m, _ = self._roots[root]
        goal_e, goal_n = self._goal
        left_e, left_n, right_e, right_n = span
        side_e, side_n = left_e - right_e, left_n - right_n
        goal_hand = side_e * (goal_n - right_n) - side_n * (goal_e - right_e)
        root_hand = side_e * (root_n - right_n) - side_n * (root_e - right_e)
        if goal_hand * root_hand > 0:  # on the root's side of it: the mirror image is as far
            twice = 2 * goal_hand / (side_e * side_e + side_n * side_n)
            goal_e += twice * side_n
            goal_n -= twice * side_e
        ahead_e, ahead_n = goal_e - root_e, goal_n - root_n
        left_e, left_n, right_e, right_n = (
            left_e - root_e,
            left_n - root_n,
            right_e - root_e,
            right_n - root_n,
        )
        if left_e * ahead_n > left_n * ahead_e:
            length_m += math.hypot(left_e, left_n) + math.hypot(ahead_e - left_e, ahead_n - left_n)
        elif right_e * ahead_n < right_n * ahead_e:
            length_m += math.hypot(right_e, right_n)
            length_m += math.hypot(ahead_e - right_e, ahead_n - right_n)
        else:
            length_m += math.hypot(ahead_e, ahead_n)
        return (length_m, root, entry, *span)

    def _expand(self, node: _Node) -> _Node | None:
        """Look through an interval into its triangle; queue all that is seen there but one node."""
        _, root, entry, left_e, left_n, right_e, right_n = node
        root_e, root_n, _, _ = self._roots[root]
        mesh = self._mesh
        left, right, apex, onward_left, onward_right = mesh.entries[entry]
        apex_e, apex_n = mesh.east_m[apex], mesh.north_m[apex]
        left_e, left_n = left_e - root_e, left_n - root_n
        left_hand = left_e * (apex_n - root_n) - left_n * (apex_e - root_e)
        if left_hand >= -_FLAT_M2:
            return self._beyond_left(node, left_hand)
        right_e, right_n = right_e - root_e, right_n - root_n
        right_hand = right_e * (apex_n - root_n) - right_n * (apex_e - root_e)
        if right_hand <= _FLAT_M2:
            return self._beyond_right(node, right_hand)
        seen = None
        if onward_left >= 0:
            place = self._crossing(root, (left_e, left_n), left, apex)
            seen = self._node(root, onward_left, (*place, apex_e, apex_n))
        if onward_right >= 0:
            place = self._crossing(root, (right_e, right_n), right, apex)
            other = self._node(root, onward_right, (apex_e, apex_n, *place))
            if seen is None:
                return other
            heappush(self._queue, other)
        return seen

    def _beyond_left(self, node: _Node, apex_hand: float) -> _Node | None:
        """The apex is on the left of all that is seen, or on its edge: go on over the right."""
        _, root, entry, left_e, left_n, right_e, right_n = node
        root_e, root_n, _, _ = self._roots[root]
        mesh = self._mesh
        left, right, apex, onward_left, onward_right = mesh.entries[entry]
        first = top = mesh.places[apex]
        seen = None
        if onward_right >= 0:
            if apex_hand > _FLAT_M2:
                first = self._crossing(root, (left_e - root_e, left_n - root_n), right, apex)
            last = self._crossing(root, (right_e - root_e, right_n - root_n), right, apex)
            if _apart(first, last):
                seen = self._node(root, onward_right, (*first, *last))
        if mesh.corner[left] and (left_e, left_n) == mesh.places[left]:
            turned = self._turn(root, left)
            if turned is not None:
                if onward_right >= 0 and _apart(top, first):
                    heappush(self._queue, self._node(turned, onward_right, (*top, *first)))
                self._sweep_left(turned, onward_left)
        return seen

    def _beyond_right(self, node: _Node, apex_hand: float) -> _Node | None:
        """As `_beyond_left`, in the mirror."""
        _, root, entry, left_e, left_n, right_e, right_n = node
        root_e, root_n, _, _ = self._roots[root]
        mesh = self._mesh
        left, right, apex, onward_left, onward_right = mesh.entries[entry]
        last = top = mesh.places[apex]
        seen = None
        if onward_left >= 0:
            if apex_hand < -_FLAT_M2:
                last = self._crossing(root, (right_e - root_e, right_n - root_n), left, apex)
            first = self._crossing(root, (left_e - root_e, left_n - root_n), left, apex)
            if _apart(first, last):
                seen = self._node(root, onward_left, (*first, *last))
        if mesh.corner[right] and (right_e, right_n) == mesh.places[right]:
            turned = self._turn(root, right)
            if turned is not None:
                if onward_left >= 0 and _apart(last, top):
                    heappush(self._queue, self._node(turned, onward_left, (*last, *top)))
                self._sweep_right(turned, onward_right)
        return seen

    def _turn(self, root: int, vertex: int) -> int | None:
        """A new root at a corner, unless it was reached as directly before."""
        root_e, root_n, so_far_m, _ = self._roots[root]
        east, north = self._mesh.places[vertex]
        so_far_m += math.hypot(east - root_e, north - root_n)
        if so_far_m >= self._best_m.get(vertex, math.inf) - _SPECK_M:
            return None
        self._best_m[vertex] = so_far_m
        return self._root(east, north, so_far_m, root)

    def _sweep_left(self, root: int, entry: int) -> None:
        """Enter the triangles around a root, leftwards, until the border."""
        mesh = self._mesh
        while entry >= 0:
            if entry in self._goal_entries:
                self._arrive(root)
                return
            _, right, apex, onward_left, onward_right = mesh.entries[entry]
            if onward_right >= 0:
                span = (*mesh.places[apex], *mesh.places[right])
                heappush(self._queue, self._node(root, onward_right, span))
            entry = onward_left

    def _sweep_right(self, root: int, entry: int) -> None:
        mesh = self._mesh
        while entry >= 0:
            if entry in self._goal_entries:
                self._arrive(root)
                return
            left, _, apex, onward_left, onward_right = mesh.entries[entry]
            if onward_left >= 0:
                span = (*mesh.places[left], *mesh.places[apex])
                heappush(self._queue, self._node(root, onward_left, span))
            entry = onward_right

    def _crossing(self, root: int, ray: Place, base: int, apex: int) -> Place:
        """Where a ray from a root meets the side between two vertices that it passes between."""
        mesh = self._mesh
        root_e, root_n, _, _ = self._roots[root]
        base_e, base_n = mesh.east_m[base], mesh.north_m[base]
        base_hand = ray[0] * (base_n - root_n) - ray[1] * (base_e - root_e)
        if -_FLAT_M2 <= base_hand <= _FLAT_M2:
            return base_e, base_n
        apex_e, apex_n = mesh.east_m[apex], mesh.north_m[apex]
        apex_hand = ray[0] * (apex_n - root_n) - ray[1] * (apex_e - root_e)
        if -_FLAT_M2 <= apex_hand <= _FLAT_M2:
            return apex_e, apex_n
        share = base_hand / (base_hand - apex_hand)
        return base_e + share * (apex_e - base_e), base_n + share * (apex_n - base_n)

    def _path(self, node: _Node) -> tuple[Point, ...]:
        """The way back from a node in the goal's triangle."""
        _, root, _, left_e, left_n, right_e, right_n = node
        root_e, root_n, _, former = self._roots[root]
        goal_e, goal_n = self._goal
        ahead_e, ahead_n = goal_e - root_e, goal_n - root_n
        path = [self._goal]
        if (left_e - root_e) * ahead_n - (left_n - root_n) * ahead_e > _FLAT_M2:
            path.append(Point(left_e, left_n))
        elif (right_e - root_e) * ahead_n - (right_n - root_n) * ahead_e < -_FLAT_M2:
            path.append(Point(right_e, right_n))
        path.append(Point(root_e, root_n))
        while former >= 0:
            root_e, root_n, _, former = self._roots[former]
            path.append(Point(root_e, root_n))
        return tuple(path[::-1])


class _Outlook(_Search):
    """A search that only notes where it could turn; it looks for nothing."""

    def __init__(self, mesh: Mesh, place: Point) -> None:
        super().__init__(mesh, place)
        self._goal_entries = set()
        self._goal_triangles = set()
        self.corners: list[Point] = []

    def _turn(self, root: int, vertex: int) -> int | None:
        turned = super()._turn(root, vertex)
        if turned is not None:
            self.corners.append(Point(*self._mesh.places[vertex]))
        return None


def _in_line(place: Point, span: _Span) -> bool:
    """Whether a point lies on the line through two others."""
    along_e, along_n = span[2] - span[0], span[3] - span[1]
    hand = along_e * (place.north_m - span[1]) - along_n * (place.east_m - span[0])
    return abs(hand) <= ON_M * math.hypot(along_e, along_n)


def _apart(one: Place, other: Place) -> bool:
    return abs(one[0] - other[0]) + abs(one[1] - other[1]) > _SPECK_M
