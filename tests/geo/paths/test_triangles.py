"""Large areas are cut into the triangles that GEOS cuts them into, but where these are a choice."""

import random

import numpy as np
import pytest
import shapely
from shapely import Polygon, affinity

from benchmarks.route.maps import made
from geo.paths import triangles
from geo.paths.free_space import FreeSpace
from geo.paths.triangles import LARGE, triangles_of


def corners_of(pieces):
    ends = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3].tolist()
    return {tuple(sorted(map(tuple, three))) for three in ends}


@pytest.fixture
def wholes(monkeypatch):
    """The areas that are left to GEOS as a whole."""
    left = []
    clipped = triangles._clipped

    def spy(areas):
        left.extend([areas] if isinstance(areas, Polygon) else [])
        return clipped(areas)

    monkeypatch.setattr(triangles, "_clipped", spy)
    return left


def walled(seed):
    """Thin walls at all angles: their sides run across triangles of others' corners."""
    chance, walls = random.Random(seed), []
    for _ in range(chance.randint(2, 40)):
        east_m, north_m = chance.uniform(50, 950), chance.uniform(50, 950)
        long_m, wide_m = chance.choice([3, 10, 200, 400]), chance.choice([1, 3, 8])
        wall = shapely.box(east_m, north_m, east_m + long_m, north_m + wide_m)
        walls.append(affinity.rotate(wall, chance.uniform(0, 360)))
    return shapely.get_parts(shapely.box(0, 0, 1000, 1000).difference(shapely.union_all(walls)))


def comb(seed):
    """Teeth of all lengths, much longer than they are apart."""
    chance = random.Random(seed)
    teeth = [(2.0 * i, 500 if i % 2 else chance.uniform(0.5, 499)) for i in range(60)]
    return [Polygon([(0, 0), *teeth, (121, 0)])]


@pytest.mark.parametrize("areas", [walled, comb])
def test_sides_across_other_triangles(areas, wholes):
    for seed in range(40):
        parts = areas(seed)
        pieces, part = triangles_of(parts, large=0)
        left = len(wholes)
        assert corners_of(pieces) == corners_of(triangles_of(parts)[0]), seed
        del wholes[left:]
        area_m2 = np.bincount(part, shapely.area(pieces))
        assert area_m2 == pytest.approx([part.area for part in parts])
    assert len(wholes) <= 3  # of about 70: rounding where corners lie on a line


def test_a_large_map(wholes):
    parts = FreeSpace(made(2, 400).airspace).lean
    assert shapely.get_num_coordinates(parts).max() > LARGE
    ours = corners_of(triangles_of(parts)[0])
    assert not wholes
    assert ours == corners_of(triangles_of(parts, large=10**9)[0])


def test_where_corners_leave_a_choice_the_area_is_filled(wholes):
    rooms = [shapely.box(e, n, e + 2, n + 3) for e in range(1, 40, 4) for n in range(1, 40, 4)]
    (area,) = shapely.get_parts(shapely.box(0, 0, 44, 44).difference(shapely.union_all(rooms)))
    pieces, _ = triangles_of([area], large=0)
    assert not wholes
    assert shapely.area(pieces).sum() == pytest.approx(area.area)
    assert shapely.union_all(pieces).equals(area)


def test_an_area_whose_border_meets_itself_is_left_to_geos(wholes):
    bow = [(0, 0), (4, 0), (4, 4), (2, 2), (0, 4)]
    hole = [(1, 1), (3, 1), (2, 2)]
    area = Polygon(bow, [hole])
    pieces, _ = triangles_of([area], large=0)
    assert wholes == [area]
    assert shapely.area(pieces).sum() == pytest.approx(area.area)


def test_no_area_has_no_triangles():
    pieces, part = triangles_of([])
    assert len(pieces) == len(part) == 0
