"""The shortest path through a mesh of triangles: any angle, exact, without a graph.

The method is Polyanya (Cui, Harabor and Grastien, "Compromise-free pathfinding on a navigation
mesh", IJCAI 2017), written for triangles. A search node is what a turning point (root) sees through
a side of a triangle, kept as a cone between two rays; A* takes the nodes in the order of the
shortest path that they may still allow. Rays lead to vertices and are never cut to intervals, so
that nothing is lost by rounding, however narrow a gap is. A cone is followed as long as it leads
into one triangle only: nodes are queued where it divides and where a path may turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from heapq import heapify, heappop, heappush
from typing import NamedTuple

from geo.frame import Point
from geo.paths.mesh import ON_M, Mesh, Place

_SPECK_M = 1e-9
"""A corner whose path became shorter by less than this is not expanded again."""

_ROUNDED_M = 1e-11
"""By how much rounding may move a place; one that is on a ray but for this is on it."""

_CLOSE_M2 = 1e-5
"""A place whose cross product with a ray is more is not on the ray; below, the exact test runs."""

_NOWHERE, _LEFTWARD, _RIGHTWARD = -1, -2, -3
"""Instead of the vertex on a ray: none; the root is still to be turned at, to that hand."""

_HERE = -1
"""The entry of a node whose root sees the goal."""

_Cone = tuple[float, float, int, float, float, int]
"""The left and the right ray from a root (east, north), each with the vertex that it leads to."""

_Node = tuple[float, int, int, float, float, int, float, float, int]
"""Estimate of the whole path, root, entry, and the cone through the entry's side."""


class Source(NamedTuple):
    """A place where a path may begin, after `length_m` metres of what came before it."""

    length_m: float
    place: Point


class Search:
    """One search: the roots found so far, and the queue of nodes.

    Attributes:
        path: what was found, once `run` has come to an end.
    """

    def __init__(
        self,
        mesh: Mesh,
        sources: Sequence[Source],
        goal: Point,
        allowed: Callable[[Point], bool] | None = None,
    ) -> None:
        self.path: tuple[Point, ...] | None = None
        self._mesh = mesh
        self._goal = goal
        self._goal_triangles = set(mesh.holding(goal))  # that hold the goal
        # sides of these
        self._goal_entries = {3 * t + side for t in self._goal_triangles for side in range(3)}
        self._entries = mesh.entries_towards(self._goal_triangles)
        self._roots: list[tuple[float, float, float, int]] = []  # place, metres so far, the former
        self._best_m: dict[int, float] = {}  # shortest to each vertex
        self._queue: list[_Node] = []  # heap, by estimate
        self._allowed = allowed
        # sources not begun, by estimate
        self._waiting = self._by_estimate(sources if self._goal_triangles else ())
        self._next = next(self._waiting, None)

    @property
    def least_m(self) -> float:
        """No path that is still to be found is shorter."""
        return self._queue[0][0] if self._queue else math.inf

    def run(self, most: float) -> bool:
        """Look at so many nodes more at most; whether that was the end of the search."""
        queue = self._queue
        while most > 0:
            while self._next is not None and (not queue or self._next[0] <= queue[0][0]):
                _, source = self._next
                if self._allowed is None or self._allowed(source.place):
                    self._begin(source)
                self._next = next(self._waiting, None)
            if not queue:
                return True
            node = heappop(queue)
            if node[2] == _HERE:
                self.path = self._path(node[1])
                return True
            if node[5] <= _LEFTWARD:
                self._open(node)
            else:
                self._follow(node)
            most -= 1
        return False

    def _by_estimate(self, sources: Sequence[Source]) -> Iterator[tuple[float, Source]]:
        heap = [(s.length_m + math.dist(s.place, self._goal), s) for s in sources]
        heapify(heap)
        while heap:
            yield heappop(heap)

    def _begin(self, source: Source) -> None:
        """Enter all triangles around a source."""
        mesh, (east, north) = self._mesh, source.place
        root = self._root(east, north, source.length_m, -1)
        around = mesh.holding(source.place)
        if not self._goal_triangles.isdisjoint(around):
            self._arrive(root)
            return
        for side in (3 * triangle + side for triangle in around for side in range(3)):
            entry = mesh.back[side]
            if entry >= 0:
                left, right, _, _, _ = mesh.entries[entry]
                if not _in_line(source.place, mesh.places[left], mesh.places[right]):
                    self._see(root, entry, left, right)

    def _root(self, east_m: float, north_m: float, so_far_m: float, former: int) -> int:
        self._roots.append((east_m, north_m, so_far_m, former))
        return len(self._roots) - 1

    def _arrive(self, root: int) -> None:
        east, north, so_far_m, _ = self._roots[root]
        estimate_m = so_far_m + math.dist((east, north), self._goal)
        heappush(self._queue, (estimate_m, root, _HERE, 0.0, 0.0, _NOWHERE, 0.0, 0.0, _NOWHERE))

    def _see(self, root: int, entry: int, left: int, right: int) -> None:
        """Queue all that a root sees through a side between two vertices."""
        east, north, _, _ = self._roots[root]
        left_e, left_n = self._mesh.places[left]
        right_e, right_n = self._mesh.places[right]
        cone = (left_e - east, left_n - north, left, right_e - east, right_n - north, right)
        self._push(root, entry, left, right, cone)

    def _push(self, root: int, entry: int, left: int, right: int, cone: _Cone) -> None:
        heappush(self._queue, (self._estimate_m(root, left, right, *cone), root, entry, *cone))

    def _follow(self, node: _Node) -> None:  # noqa: C901, PLR0912 - unrolled: here time is spent
        """Extend a cone through triangles until its view divides, or ends."""
        _, root, entry, left_e, left_n, on_left, right_e, right_n, on_right = node
        entries, goals = self._entries, self._goal_entries
        places, queue, close_m2 = self._mesh.places, self._queue, _CLOSE_M2
        east, north, _, _ = self._roots[root]
        while entry >= 0:
            left, right, apex, onward_left, onward_right = entries[entry]
            if entry in goals:
                cone = (left_e, left_n, on_left, right_e, right_n, on_right)
                self._arrive_through(root, left, right, cone)
                return
            ahead_e, ahead_n = places[apex]
            ahead_e -= east
            ahead_n -= north
            hand = left_e * ahead_n - left_n * ahead_e
            if hand > 0 or (hand > -close_m2 and _along(hand, left_e, left_n, ahead_e, ahead_n)):
                if on_left == left:
                    self._turn(root, left, entry, _LEFTWARD)
                if hand < close_m2 and _along(hand, left_e, left_n, ahead_e, ahead_n):
                    left_e, left_n, on_left = ahead_e, ahead_n, apex
                entry = onward_right
                continue
            hand = right_e * ahead_n - right_n * ahead_e
            if hand < 0 or (hand < close_m2 and _along(hand, right_e, right_n, ahead_e, ahead_n)):
                if on_right == right:
                    self._turn(root, right, entry, _RIGHTWARD)
                if hand > -close_m2 and _along(hand, right_e, right_n, ahead_e, ahead_n):
                    right_e, right_n, on_right = ahead_e, ahead_n, apex
                entry = onward_left
            elif onward_left < 0:  # only the part right of the apex leads on
                left_e, left_n, on_left, entry = ahead_e, ahead_n, apex, onward_right
            elif onward_right < 0:
                right_e, right_n, on_right, entry = ahead_e, ahead_n, apex, onward_left
            else:
                one = (left_e, left_n, on_left, ahead_e, ahead_n, apex)
                other = (ahead_e, ahead_n, apex, right_e, right_n, on_right)
                one_m = self._estimate_m(root, left, apex, *one)
                other_m = self._estimate_m(root, apex, right, *other)
                if one_m <= other_m:
                    heappush(queue, (other_m, root, onward_right, *other))
                    if one_m > queue[0][0]:
                        heappush(queue, (one_m, root, onward_left, *one))
                        return
                    right_e, right_n, on_right, entry = ahead_e, ahead_n, apex, onward_left
                else:
                    heappush(queue, (one_m, root, onward_left, *one))
                    if other_m > queue[0][0]:
                        heappush(queue, (other_m, root, onward_right, *other))
                        return
                    left_e, left_n, on_left, entry = ahead_e, ahead_n, apex, onward_right

    def _turn(self, root: int, vertex: int, entry: int, hand: int) -> None:
        """Queue a corner as a new root, unless it was reached as directly before."""
        if not self._mesh.corner[vertex]:
            return
        root_e, root_n, so_far_m, _ = self._roots[root]
        east, north = self._mesh.places[vertex]
        ray_e, ray_n = east - root_e, north - root_n
        so_far_m += math.hypot(ray_e, ray_n)
        if so_far_m >= self._best_m.get(vertex, math.inf) - _SPECK_M:
            return
        self._best_m[vertex] = so_far_m
        turned = self._root(east, north, so_far_m, root)
        estimate_m = so_far_m + math.dist((east, north), self._goal)
        heappush(self._queue, (estimate_m, turned, entry, ray_e, ray_n, hand, 0.0, 0.0, _NOWHERE))

    def _open(self, node: _Node) -> None:
        """Enter what lies behind a corner, beyond the ray that leads to it, until the border."""
        _, root, entry, east, north, hand, _, _, _ = node
        left, right, apex, onward_left, onward_right = self._entries[entry]
        leftward = hand == _LEFTWARD
        corner = left if leftward else right
        if self._roots[root][2] > self._best_m[corner]:
            return
        places = self._mesh.places
        ahead_e, ahead_n = places[apex][0] - places[corner][0], places[apex][1] - places[corner][1]
        if _along(east * ahead_n - north * ahead_e, east, north, ahead_e, ahead_n):
            pass  # nothing lies between; the former root sees on along this side
        elif leftward and onward_right >= 0:
            cone = (ahead_e, ahead_n, apex, east, north, _NOWHERE)
            self._push(root, onward_right, apex, right, cone)
        elif not leftward and onward_left >= 0:
            cone = (east, north, _NOWHERE, ahead_e, ahead_n, apex)
            self._push(root, onward_left, left, apex, cone)
        entry = onward_left if leftward else onward_right
        while entry >= 0:
            if entry in self._goal_entries:
                self._arrive(root)
                return
            left, right, apex, onward_left, onward_right = self._entries[entry]
            if leftward:
                if onward_right >= 0:
                    self._see(root, onward_right, apex, right)
                entry = onward_left
            else:
                if onward_left >= 0:
                    self._see(root, onward_left, left, apex)
                entry = onward_right

    def _estimate_m(  # noqa: PLR0913, PLR0917 - a cone, unpacked: the hottest call
        self,
        root: int,
        left: int,
        right: int,
        left_e: float,
        left_n: float,
        on_left: int,
        right_e: float,
        right_n: float,
        on_right: int,
    ) -> float:
        """The path through a cone and a side of a triangle as if nothing stood behind it."""
        root_e, root_n, length_m, _ = self._roots[root]
        goal_e, goal_n = self._goal
        (one_e, one_n), (other_e, other_n) = self._mesh.places[left], self._mesh.places[right]
        side_e, side_n = one_e - other_e, one_n - other_n
        goal_hand = side_e * (goal_n - other_n) - side_n * (goal_e - other_e)
        root_hand = side_e * (root_n - other_n) - side_n * (root_e - other_e)
        if goal_hand * root_hand > 0:  # on the root's side of it: the mirror image is as far
            twice = 2 * goal_hand / (side_e * side_e + side_n * side_n)
            goal_e += twice * side_n
            goal_n -= twice * side_e
        ahead_e, ahead_n = goal_e - root_e, goal_n - root_n
        if left_e * ahead_n > left_n * ahead_e:
            if on_left != left:
                left_e, left_n = self._crossing(root, left_e, left_n, left, right)
            length_m += math.hypot(left_e, left_n)
            return length_m + math.hypot(ahead_e - left_e, ahead_n - left_n)
        if right_e * ahead_n < right_n * ahead_e:
            if on_right != right:
                right_e, right_n = self._crossing(root, right_e, right_n, left, right)
            length_m += math.hypot(right_e, right_n)
            return length_m + math.hypot(ahead_e - right_e, ahead_n - right_n)
        return length_m + math.hypot(ahead_e, ahead_n)

    def _arrive_through(self, root: int, left: int, right: int, cone: _Cone) -> None:
        """Enter the triangle behind a side: straight, or along the edge of the view."""
        left_e, left_n, on_left, right_e, right_n, on_right = cone
        east, north, so_far_m, _ = self._roots[root]
        ahead_e, ahead_n = self._goal[0] - east, self._goal[1] - north
        via = None
        if left_e * ahead_n > left_n * ahead_e:
            via = left_e, left_n
            if on_left != left:
                via = self._crossing(root, left_e, left_n, left, right)
        elif right_e * ahead_n < right_n * ahead_e:
            via = right_e, right_n
            if on_right != right:
                via = self._crossing(root, right_e, right_n, left, right)
        if via is not None:
            so_far_m += math.hypot(*via)
            root = self._root(east + via[0], north + via[1], so_far_m, root)
        self._arrive(root)

    def _crossing(self, root: int, ray_e: float, ray_n: float, left: int, right: int) -> Place:
        """Where a ray from a root meets the side that it passes through, as seen from the root."""
        east, north, _, _ = self._roots[root]
        left_e, left_n = self._mesh.places[left]
        right_e, right_n = self._mesh.places[right]
        left_hand = ray_e * (left_n - north) - ray_n * (left_e - east)
        right_hand = ray_e * (right_n - north) - ray_n * (right_e - east)
        across = left_hand - right_hand
        share = min(max(left_hand / across, 0.0), 1.0) if across > 0 else 0.0
        here_e, here_n = left_e + share * (right_e - left_e), left_n + share * (right_n - left_n)
        return here_e - east, here_n - north

    def _path(self, root: int) -> tuple[Point, ...]:
        """The way back from a root that sees the goal, without corners that it does not turn at."""
        path = [self._goal]
        while root >= 0:
            east, north, _, former = self._roots[root]
            here = Point(east, north)
            while len(path) > 1 and _in_line(path[-1], here, path[-2]):
                path.pop()
            path.append(here)
            root = former
        return tuple(path[::-1])


class CornerSearch(Search):
    """A search that never arrives: it notes the corners seen at which a shortest path may turn."""

    def __init__(self, mesh: Mesh, sources: Sequence[Source], goal: Point) -> None:
        super().__init__(mesh, sources, goal)
        self._goal_entries = set()  # it has no goal
        self._goal_triangles = set()
        self.corners: list[Point] = []  # where a path could turn first

    def _open(self, node: _Node) -> None:
        self.corners.append(Point(*self._roots[node[1]][:2]))


def _along(hand: float, ray_e: float, ray_n: float, ahead_e: float, ahead_n: float) -> bool:
    """Whether a place is on a ray, by the rounding of places; `hand` is their cross product."""
    return abs(hand) <= _ROUNDED_M * (abs(ray_e) + abs(ray_n) + abs(ahead_e) + abs(ahead_n))


def _in_line(place: Place, one: Place, other: Place) -> bool:
    """Whether a point lies on the line through two others."""
    along_e, along_n = other[0] - one[0], other[1] - one[1]
    hand = along_e * (place[1] - one[1]) - along_n * (place[0] - one[0])
    return abs(hand) <= ON_M * math.hypot(along_e, along_n)
