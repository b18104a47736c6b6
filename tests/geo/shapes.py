"""Shapes to try things with, small and random."""

import math

from hypothesis import strategies as st

from geo.airspace.zone import Circle, Outline, Zone
from geo.frame import Point


def ring(*corners):
    return tuple(Point(*corner) for corner in corners)


def box_ring(west, south, east, north):
    return ring((west, south), (east, south), (east, north), (west, north))


def box(name, west, south, east, north, **more):
    return Zone(name, box_ring(west, south, east, north), **more)


coordinate = st.floats(-90, 90).map(lambda value: round(value, 3))
place = st.builds(Point, coordinate, coordinate)


def star(centre, radii, turn=0.0, shrink=1.0):
    """A polygon around its centre: simple, whatever the radii, and mostly concave."""
    angles = [turn + 2 * math.pi * step / len(radii) for step in range(len(radii))]
    return tuple(
        Point(
            centre.east_m + shrink * radius_m * math.cos(angle),
            centre.north_m + shrink * radius_m * math.sin(angle),
        )
        for radius_m, angle in zip(radii, angles, strict=True)
    )


@st.composite
def outlines(draw):
    """Concave outlines, half of them with a hole of the same form."""
    centre = draw(place)
    radii = draw(st.lists(st.floats(2, 40), min_size=3, max_size=9))
    turn = draw(st.floats(0, 6.28))
    holes = ()
    if draw(st.booleans()) and len(radii) > 4:  # the centre lies within for sure
        holes = (star(centre, radii, turn, 0.4),)
    return Outline(star(centre, radii, turn), holes)


circles = st.builds(Circle, place, st.floats(1, 40))
shapes = st.one_of(outlines(), circles)
