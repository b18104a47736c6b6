"""Links are predicted from distance, from what is mapped in between, and from what was measured."""

import random

import numpy as np
import pytest

from air_router.link_model import DISTANCE, MODELS, PATH_LOSS, SEMANTIC, fitted
from air_router.seek_policies import LinkSample
from geo.frame import Geodetic, Point
from geo.grid import GridPatch, SemanticGrid, Terrain

HEIGHT_M = 40.0


def town(**walls):
    """Road, with a wall along the east of the given class between two distances."""
    grid = SemanticGrid.blank(Geodetic(38.5, -98.5), 0.5, Point(-200, -200), Point(200, 200))
    grid.cells[:] = Terrain.ROAD
    for terrain, (west_m, east_m) in walls.items():
        columns = slice(int((west_m + 200) * 2), int((east_m + 200) * 2))
        grid.cells[:, columns] = Terrain[terrain]
    return grid


def probability(model, here, place, height_m=HEIGHT_M):
    return float(model.probability(np.array([(*here, height_m)]), np.array([place]))[0])


def sampled(linked, count=300, seed=1):
    """Links that were measured all over the town, by the verdict of `linked`."""
    chance = random.Random(seed)
    samples = []
    for number in range(count):
        here = Point(chance.uniform(-150, 150), chance.uniform(-150, 150))
        place = Point(chance.uniform(-150, 150), chance.uniform(-150, 150))
        row = "a", 2.0 * number, here, HEIGHT_M, place
        samples.append(LinkSample(*row, linked(here, place)))
    return samples


def test_before_anything_is_measured_the_near_are_received_better_than_the_far():
    for kind in MODELS:
        model = fitted(kind, [], town())
        near, far = (probability(model, (east, 0), (0, 0)) for east in (10, 190))
        assert 1 > near > far > 0, kind.name


@pytest.mark.parametrize("wall", ["BUILDING", "VEGETATION"])
def test_before_anything_is_measured_what_is_mapped_in_between_weakens_a_link(wall):
    model = fitted(SEMANTIC, [], town(**{wall: (2, 20)}))
    hidden, clear = (probability(model, (east, 0), (0, 0)) for east in (100, -100))
    assert hidden < clear


def test_a_vehicle_above_a_robot_looks_past_what_stands_around_it():
    model = fitted(SEMANTIC, [], town(BUILDING=(3, 20)))
    free = fitted(SEMANTIC, [], town())
    assert probability(model, (1, 0), (0, 0)) == probability(free, (1, 0), (0, 0))


def test_a_wall_that_measured_links_pass_counts_no_more():
    walled = town(BUILDING=(2, 20))
    through = sampled(lambda *_: True)
    assert probability(fitted(SEMANTIC, through, walled), (100, 0), (0, 0)) > 0.9


def test_a_wall_that_measured_links_do_not_pass_counts_more_than_before():
    walled = town(BUILDING=(-6, 0))
    beside = Point(3, 0)
    links = [
        LinkSample("a", 2.0 * n, Point(east, 0), HEIGHT_M, beside, east > 0)
        for n, east in enumerate([*range(-90, -50), *range(50, 90)] * 3)
    ]
    before, after = (fitted(SEMANTIC, samples, walled) for samples in ([], links))
    assert probability(after, (-70, 0), beside) < probability(before, (-70, 0), beside)
    assert probability(after, (-70, 0), beside) < 0.1
    assert probability(after, (70, 0), beside) > 0.8


def test_with_the_map_unseen_links_are_predicted_better_where_buildings_block():
    def passes(here, place):
        return abs(place[0]) > 20 or abs(here[0] - place[0]) < 40

    walled, measured, unseen = town(BUILDING=(-20, 20)), sampled(passes), sampled(passes, seed=2)
    air = np.array([(*sample.here, HEIGHT_M) for sample in unseen])
    places = np.array([sample.place for sample in unseen])
    linked = np.array([sample.linked for sample in unseen])
    brier = {
        kind.name: float(
            ((fitted(kind, measured, walled).probability(air, places) - linked) ** 2).mean()
        )
        for kind in MODELS
    }
    assert brier[SEMANTIC.name] < 0.8 * min(brier[PATH_LOSS.name], brier[DISTANCE.name])


def test_ground_that_is_not_mapped_counts_by_what_the_rest_is_like():
    grid = town()
    grid.cells[:, 400:] = Terrain.UNKNOWN  # the east
    roads = probability(fitted(SEMANTIC, [], grid), (100, 0), (0, 0))
    grid.cells[:, :400] = Terrain.BUILDING
    houses = probability(fitted(SEMANTIC, [], grid), (100, 0), (0, 0))
    assert houses < roads


def test_without_a_map_only_distance_counts_and_places_off_the_map_are_free():
    blind = fitted(SEMANTIC, [], None)
    assert probability(blind, (50, 0), (0, 0)) == probability(blind, (0, -50), (0, 0))
    walled = fitted(SEMANTIC, [], town(BUILDING=(-200, 200)))
    assert probability(walled, (1050, 0), (1000, 0)) == probability(blind, (50, 0), (0, 0))


def test_what_is_painted_later_counts_at_once():
    grid = town()
    model = fitted(SEMANTIC, [], grid)
    before = probability(model, (100, 0), (0, 0))
    cells = np.full((40, 40), Terrain.BUILDING, dtype=np.uint8)
    grid.paint(GridPatch(2.0, -10.0, 0.5, cells))
    assert probability(model, (100, 0), (0, 0)) < before
