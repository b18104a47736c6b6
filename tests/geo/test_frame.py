import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pyproj import Geod

from geo.frame import FrameError, Geodetic, LocalFrame, Point

WGS84 = Geod(ellps="WGS84")
ORIGINS = [
    (47.4, 12.0),  # border of UTM zones 32 and 33
    (60.4, 3.0),  # Norway's wider zone
    (78.2, 15.6),  # Svalbard
    (0.0, 30.0),  # equator: UTM's hemispheres
    (10.0, 180.0),  # antimeridian
    (-16.5, -179.99),
    (-33.9, 151.2),
    (83.9, -30.0),
    (89.99, 20.0),  # the pole lies within the area
    (90.0, 0.0),
    (-90.0, 0.0),
]
"""Where map systems have borders, and where meridians meet."""
latitudes = st.floats(-89, 89)
longitudes = st.floats(-180, 180)
offsets = st.floats(-3500, 3500)
points = st.builds(Point, offsets, offsets)


@given(latitudes, longitudes, points, points)
def test_distances_are_those_of_the_ellipsoid_to_a_millimetre(lat, lon, a, b):
    frame = LocalFrame(Geodetic(lat, lon))
    (lat_a, lon_a), (lat_b, lon_b) = frame.to_geodetic(a), frame.to_geodetic(b)
    _, _, distance_m = WGS84.inv(lon_a, lat_a, lon_b, lat_b)
    assert distance_m == pytest.approx(math.dist(a, b), abs=2e-3)


@pytest.mark.parametrize("origin", ORIGINS)
def test_within_ten_kilometres_everything_is_right_to_a_centimetre(origin):
    frame = LocalFrame(Geodetic(*origin))
    random = np.random.default_rng(7)
    angle, reach_m = random.uniform(0, 2 * np.pi, 400), 10_000 * np.sqrt(random.uniform(0, 1, 400))
    places = np.stack([reach_m * np.cos(angle), reach_m * np.sin(angle)], axis=-1)
    latitude, longitude = frame.to_geodetic_many(places).T
    a, b = slice(None, 200), slice(200, None)
    azimuth, _, distance_m = WGS84.inv(longitude[a], latitude[a], longitude[b], latitude[b])
    assert np.abs(distance_m - np.hypot(*(places[a] - places[b]).T)).max() < 0.01
    # The vehicle flies along the geodesic, routes are checked along the straight line.
    halfway = WGS84.fwd(longitude[a], latitude[a], azimuth, distance_m / 2)
    middles = frame.to_local_many(halfway[1], halfway[0])
    assert np.abs(middles - (places[a] + places[b]) / 2).max() < 0.01


@pytest.mark.parametrize("origin", ORIGINS)
def test_many_at_once_are_the_same(origin):
    frame = LocalFrame(Geodetic(*origin))
    places = np.random.default_rng(3).uniform(-5000, 5000, (50, 2))
    degrees = frame.to_geodetic_many(places)
    assert np.abs(degrees[:, 1]).max() <= 180
    for place, (latitude, longitude) in zip(places, degrees.tolist(), strict=True):
        assert frame.to_geodetic(Point(*place)) == (latitude, longitude)
    assert frame.to_local_many(*degrees.T) == pytest.approx(places, abs=1e-6)
    assert frame.to_local_many([], []).shape == frame.to_geodetic_many([]).shape == (0, 2)


def test_many_at_once_are_refused_for_the_one_that_is_wrong():
    frame = LocalFrame(Geodetic(0, 0))
    with pytest.raises(FrameError, match=r"latitude 91\.0 is not within"):
        frame.to_local_many([1, 91, math.nan], [1, 1, 1])
    with pytest.raises(FrameError, match=r"longitude nan is not within"):
        frame.to_local_many([1, 1], [1, math.nan])
    with pytest.raises(FrameError, match="not a place"):
        frame.to_geodetic_many([[0, 0], [math.inf, 0]])


@example(0.0, -180.0, Point(-1.2e-07, 1.0))  # on the antimeridian, but for rounding
@given(latitudes, longitudes, points)
def test_degrees_and_metres_convert_back_and_forth(lat, lon, point):
    frame = LocalFrame(Geodetic(lat, lon))
    assert frame.to_local(*frame.to_geodetic(point)) == pytest.approx(tuple(point), abs=1e-6)


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
