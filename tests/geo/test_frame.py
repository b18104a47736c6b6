import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyproj import Geod

from geo.frame import FrameError, Geodetic, LocalFrame, Point

WGS84 = Geod(ellps="WGS84")
latitudes = st.floats(-89, 89)
longitudes = st.floats(-180, 180)
offsets = st.floats(-3500, 3500)
points = st.builds(Point, offsets, offsets)


@settings(max_examples=40, deadline=None)
@given(latitudes, longitudes, points, points)
def test_distances_are_those_of_the_ellipsoid_to_a_millimetre(lat, lon, a, b):
    frame = LocalFrame(Geodetic(lat, lon))
    (lat_a, lon_a), (lat_b, lon_b) = frame.to_geodetic(a), frame.to_geodetic(b)
    _, _, distance_m = WGS84.inv(lon_a, lat_a, lon_b, lat_b)
    assert distance_m == pytest.approx(math.dist(a, b), abs=2e-3)


@settings(max_examples=40, deadline=None)
@example(0.0, -180.0, Point(-1.2e-07, 1.0))  # on the antimeridian, but for rounding
@given(latitudes, longitudes, points)
def test_degrees_and_metres_convert_back_and_forth(lat, lon, point):
    frame = LocalFrame(Geodetic(lat, lon))
    assert frame.to_local(*frame.to_geodetic(point)) == pytest.approx(tuple(point), abs=1e-3)


@pytest.mark.parametrize(
    ("origin", "place", "distance_m"),
    [
        ((47.4, 12.0), (47.4, 12.0001), 7.55),  # border of UTM zones 32 and 33
        ((0.0, 30.0), (-0.0001, 30.0), 11.06),  # equator: UTM's hemispheres
        ((10.0, 179.9999), (10.0, -179.9999), 21.93),  # antimeridian
        ((60.4, 3.0), (60.4, 3.0001), 5.51),  # Norway's wider zone
    ],
)
def test_borders_of_map_systems_are_no_borders(origin, place, distance_m):
    assert math.hypot(*LocalFrame(Geodetic(*origin)).to_local(*place)) == pytest.approx(
        distance_m, abs=0.01
    )


def test_east_is_east_and_north_is_north():
    frame = LocalFrame(Geodetic(39.94, -75.2))
    assert frame.to_local(39.94, -75.2) == (0, 0)
    east, north = frame.to_local(39.941, -75.199)
    assert east == pytest.approx(85.5, abs=0.1)
    assert north == pytest.approx(111.0, abs=0.1)


@pytest.mark.parametrize("place", [(91, 0), (0, 181), (math.nan, 0), (0, math.inf)])
def test_no_place_on_earth_is_refused(place):
    with pytest.raises(FrameError, match="is not within"):
        LocalFrame(Geodetic(*place))
    with pytest.raises(FrameError, match="is not within"):
        LocalFrame(Geodetic(0, 0)).to_local(*place)


@pytest.mark.parametrize("point", [(math.nan, 0), (0, math.inf), (3e7, 0)])
def test_metres_beyond_the_earth_are_refused(point):
    with pytest.raises(FrameError, match="not a place"):
        LocalFrame(Geodetic(0, 0)).to_geodetic(Point(*point))
