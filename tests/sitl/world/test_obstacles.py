"""Links from the air by what stands in a town, whose heights no map has."""

import numpy as np
import pytest

from geo.frame import LocalFrame, Point
from geo.grid import Terrain
from sitl.world import Obstacles
from sitl.world.air_to_ground import free_space_db
from sitl.world.obstacles import CROWNS_M, ROOFS_M, heights_m
from sitl.world.towns import Town, generate
from sitl.world.towns.town import Bounds

SHADOWING_DB = 3 * 5.0  # at the most


def box(west_m, south_m, east_m, north_m):
    corners = ((west_m, south_m), (east_m, south_m), (east_m, north_m), (west_m, north_m))
    return tuple(Point(*corner) for corner in corners)


def town(buildings=(), vegetation=()):
    edge_m = 100.0
    return Town(
        name="a field",
        frame=LocalFrame((38.5, -98.5)),
        bounds=Bounds(-edge_m, -edge_m, edge_m, edge_m),
        outline=box(-edge_m, -edge_m, edge_m, edge_m),
        roads=(),
        vegetation=vegetation,
        buildings=buildings,
        yards=(),
        goals=(),
        starts=(),
        home=Point(0, 0),
    )


def link(seed=1, **stands):
    own = Obstacles(town(**stands), 2.4, seed, building_loss_db_m=1.0, most_building_db=30.0)

    def lost_db(air, ground=(0.0, 0.0, 0.5)):
        away_m = np.linalg.norm(np.subtract(air, ground))
        loss_db = own.loss_db(np.array([air]), np.array([ground]))[0, 0]
        return float(loss_db - free_space_db(away_m, 2.4))

    return lost_db


def mean_db(air, **stands):
    return np.mean([link(seed, **stands)(air) for seed in range(12)])


WEST_WALL = {"buildings": (box(-20, -100, -2, 100),)}
GROVE = {"vegetation": (box(-40, -100, 100, 100),)}


def test_in_the_open_a_link_has_free_space_and_some_shadowing():
    assert abs(mean_db((60.0, 0.0, 40.0))) < 1.5
    assert abs(link()((60.0, 0.0, 40.0))) <= SHADOWING_DB


def test_a_building_beside_the_robot_hides_it_from_that_side_only():
    assert mean_db((-90.0, 0.0, 30.0), **WEST_WALL) > 8
    assert abs(mean_db((90.0, 0.0, 30.0), **WEST_WALL)) < 1.5


def test_no_building_hides_a_robot_from_above():
    assert abs(mean_db((0.0, 0.0, 40.0), **WEST_WALL)) < 1.5


def test_trees_weaken_a_link_from_above_as_well_and_more_from_the_side():
    above, aside = mean_db((0.0, 0.0, 40.0), **GROVE), mean_db((90.0, 0.0, 30.0), **GROVE)
    assert 1 < above < CROWNS_M[1] < aside + CROWNS_M[1]
    assert above < aside < 34.1 + 1.5


def test_buildings_take_no_more_than_their_limit():
    everywhere = {"buildings": (box(-100, -100, 100, 100),)}
    lost_db = [link(seed, **everywhere)((95.0, 0.0, 26.0)) for seed in range(6)]
    assert max(lost_db) <= 30 + SHADOWING_DB


def test_the_seed_chooses_heights_within_their_spans():
    made = generate(3, 3, 3)
    heights = heights_m(made, 5)
    assert heights.shape == made.raster.cells.shape
    for kind, (low_m, high_m) in (
        (Terrain.BUILDING, ROOFS_M),
        (Terrain.VEGETATION, CROWNS_M),
    ):
        own = heights[made.raster.cells == kind]
        assert low_m <= own[own > 0].min() <= own.max() <= high_m
    assert not heights[made.raster.cells == Terrain.ROAD].any()
    assert np.array_equal(heights, heights_m(made, 5))
    assert not np.array_equal(heights, heights_m(made, 6))


@pytest.mark.parametrize("count", [1, 3])
def test_all_pairs_are_those_of_each_pair(count):
    own = Obstacles(town(**WEST_WALL), 2.4, 1, building_loss_db_m=1.0, most_building_db=30.0)
    air = np.array([(-90.0 + 40 * n, 10.0 * n, 40.0) for n in range(count)])
    ground = np.array([(0.0, 0.0, 0.5), (30.0, -20.0, 0.5)])
    together = own.loss_db(air, ground)
    assert together.shape == (count, 2)
    for a in range(count):
        for g in range(2):
            apart = own.loss_db(air[a : a + 1], ground[g : g + 1])[0, 0]
            assert together[a, g] == pytest.approx(apart)
