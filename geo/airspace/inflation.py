"""Shapes grown by a distance, or by slightly more, never by less; shrunk when it is negative."""

from __future__ import annotations

import math

from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from geo.airspace.zone import Circle, Shape, circle_ring

_ARC_STEPS = 16
_EXCESS_M = 0.02


def rounded(shape: Shape, reach_m: float) -> BaseGeometry:
    """With round corners: at most 0.3 % of the distance, and two centimetres at circles, more."""
    if isinstance(shape, Circle):
        return _circle(shape, reach_m)
    # GEOS rounds the number of steps of an arc, so that a step may be half as long again: the
    # usual compensation for the chord still falls short, this one does not.
    step = 1.5 * (math.pi / 2) / _ARC_STEPS
    return shape.polygon.buffer(reach_m / math.cos(step / 2), quad_segs=_ARC_STEPS)


def _circle(shape: Circle, reach_m: float) -> BaseGeometry:
    radius_m = shape.radius_m + reach_m
    if radius_m <= 0:
        return Polygon()
    outward = reach_m >= 0
    return Polygon(circle_ring(shape.centre, radius_m, outward=outward, within_m=_EXCESS_M))
