"""Shapes grown by a distance, or by slightly more, never by less; shrunk when it is negative."""

from __future__ import annotations

import math

from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from geo.zone import Circle, Shape, circle_ring

_ARC_STEPS = 16
_MITRED_SHARE = 0.1
"""How much of the distance a mitred shape may reach too far at its corners."""

_LEAST_EXCESS_M = 0.02


def rounded(shape: Shape, reach_m: float) -> BaseGeometry:
    """With round corners: at most 0.3 % of the distance, and two centimetres at circles, more."""
    if isinstance(shape, Circle):
        return _circle(shape, reach_m, _LEAST_EXCESS_M)
    # GEOS rounds the number of steps of an arc, so that a step may be half as long again: the
    # usual compensation for the chord still falls short, this one does not.
    step = 1.5 * (math.pi / 2) / _ARC_STEPS
    return shape.polygon.buffer(reach_m / math.cos(step / 2), quad_segs=_ARC_STEPS)


def mitred(shape: Shape, reach_m: float) -> BaseGeometry:
    """With few corners: at most a tenth of the distance more."""
    if isinstance(shape, Circle):
        return _circle(shape, reach_m, max(_LEAST_EXCESS_M, _MITRED_SHARE * abs(reach_m)))
    # A mitre limit of 1.1 was measured never to fall short of the reach; bevelled corners do.
    return shape.polygon.buffer(reach_m, join_style="mitre", mitre_limit=1.1)


def _circle(shape: Circle, reach_m: float, within_m: float) -> BaseGeometry:
    radius_m = shape.radius_m + reach_m
    if radius_m <= 0:
        return Polygon()
    outward = reach_m >= 0
    return Polygon(circle_ring(shape.centre, radius_m, outward=outward, within_m=within_m))
