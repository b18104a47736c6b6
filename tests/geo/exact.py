"""Distances of straight legs to shapes, from first principles: no library, no code under test."""

import itertools
import math


def between_segments(a, b, c, d):
    """Distance of segment ab to segment cd."""
    if _cross(a, b, c, d):
        return 0.0
    return min(
        _to_segment(a, c, d), _to_segment(b, c, d), _to_segment(c, a, b), _to_segment(d, a, b)
    )


def to_ring(a, b, ring):
    """Distance of segment ab to the border of a polygon."""
    sides = itertools.pairwise([*ring, ring[0]])
    return min(between_segments(a, b, c, d) for c, d in sides)


def to_circle(a, b, centre, radius_m):
    """Distance of segment ab to a disc; negative where it enters."""
    return _to_segment(centre, a, b) - radius_m


def inside(point, ring):
    """Even-odd rule."""
    x, y = point
    odd = False
    for (ax, ay), (bx, by) in itertools.pairwise([*ring, ring[0]]):
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            odd = not odd
    return odd


def to_area(a, b, ring, holes=()):
    """Distance of segment ab to an area with holes; 0 if they meet."""
    border_m = min(to_ring(a, b, border) for border in (ring, *holes))
    within = inside(a, ring) and not any(inside(a, hole) for hole in holes)
    return 0.0 if within else border_m


def _to_segment(p, a, b):
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    share = 0.0 if square == 0 else ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / square
    share = min(max(share, 0.0), 1.0)
    return math.hypot(p[0] - a[0] - share * dx, p[1] - a[1] - share * dy)


def _turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _cross(a, b, c, d):
    return (_turn(a, b, c) > 0) != (_turn(a, b, d) > 0) and (_turn(c, d, a) > 0) != (
        _turn(c, d, b) > 0
    )
