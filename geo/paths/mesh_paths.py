"""Paths through a mesh, by searches from one end or, where it may be walled in, from both."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from geo.frame import Point
from geo.paths.mesh import Mesh
from geo.paths.polyanya import CornerSearch, Search, Source

_PATIENCE = 100
"""After so many nodes a path is looked for from its end too, as one end may be walled in. Then, so
many at a time, the search goes on that knows the path to be longer: it is likely the nearer one."""


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


def seen_corners(mesh: Mesh, place: Point, goal: Point) -> list[Point]:
    """The corners seen from a place that a shortest path from there to a goal may turn at first."""
    search = CornerSearch(mesh, [Source(0.0, place)], goal)
    search.run(math.inf)
    return search.corners
