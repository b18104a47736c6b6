"""Ground robots that explore: where they drive, whom they leave a goal to, what they believe."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.messages import (
    MAP_TOPIC,
    PATH_TOPIC,
    POSE_TOPIC,
    PathMessage,
    PoseMessage,
    SeenObject,
    SightingsMessage,
)
from geo.frame import Point
from geo.grid import GridError, SemanticGrid, Terrain
from sitl.world.explorers.exploration import Exploration
from sitl.world.explorers.explorer import GroundRobot
from sitl.world.explorers.knowledge import GoalBook, GoalClaim, read_map
from sitl.world.explorers.messages import (
    CLAIMS_TOPIC,
    OBJECTS_TOPIC,
    REACHABILITY_TOPIC,
    ClaimedGoal,
    ClaimedGoalsMessage,
    degrees,
    read_claims,
    read_sightings,
)
from sitl.world.explorers.published_errors import (
    LOCALISATION_M,
    RECALL,
    with_published_errors,
)
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.towns.town_file import load_town
from sitl.world.towns.town_generator import generate
from sitl.world.towns.ways import PASSABLE, Ways

URBAN = load_town(Path(__file__).parents[4] / "missions" / "urban" / "town.yaml")
START = URBAN.starts[0]
QUICK = ExplorerSettings(progress=1.0, recognition_m=15.0)
NEAR_SIGHTED = ExplorerSettings(progress=1.0, recognition_m=5.0)


def map_of(town, cells=None):
    raster = town.raster
    cells = raster.cells if cells is None else cells
    return SemanticGrid(
        town.frame.origin, raster.resolution_m, raster.west_m, raster.south_m, cells
    ).encode()


MAP = map_of(URBAN)


def sightings(*places):
    objects = [SeenObject(kind="vehicle", **degrees(URBAN.frame, place)) for place in places]
    return SightingsMessage(stamp_s=0.0, objects=tuple(objects)).encode()


def drive(robots, until_s, since_s=0.0, *, deliver=True, check=None):
    """All robots side by side; with `deliver` each gets every message of every other at once."""
    now_s = since_s
    sent = []
    while now_s <= until_s:
        for robot in robots:
            robot.step(now_s)
        for robot in robots:
            for topic, data in robot.outbox():
                sent.append((now_s, robot.name, topic, data))
                if deliver:
                    for other in robots:
                        if other is not robot:
                            other.take(robot.name, topic, data, now_s)
        if check is not None:
            check()
        now_s += 1.0
    return sent


def explorer(settings=QUICK, map_=MAP):
    """A robot that got the map."""
    robot = GroundRobot("io", URBAN, 1, START, settings)
    robot.take("titan", MAP_TOPIC, map_, 0.0)
    return robot


def claims_message(stamp_s, *goals):
    claimed = []
    for place, status in goals:
        latitude_deg, longitude_deg = URBAN.frame.to_geodetic(place)
        claimed.append(
            ClaimedGoal(latitude_deg=latitude_deg, longitude_deg=longitude_deg, status=status)
        )
    return ClaimedGoalsMessage(stamp_s=stamp_s, goals=tuple(claimed)).encode()


def test_without_messages_a_robot_waits_where_it_is():
    robot = GroundRobot("io", URBAN, 1, START, NEAR_SIGHTED)
    sent = drive([robot], 20.0)
    assert robot.position == START
    assert robot.visited == []
    assert [topic for _, _, topic, _ in sent].count(POSE_TOPIC) == 21
    pose = PoseMessage.decode(next(data for _, _, topic, data in sent if topic == POSE_TOPIC))
    there = URBAN.frame.to_local(pose.latitude_deg, pose.longitude_deg)
    assert math.dist(there, START) < 1e-3


def test_it_sees_seven_metres_of_ground_and_publishes_it():
    robot = GroundRobot("io", URBAN, 1, START, QUICK)
    robot.step(0.0)
    known = np.flatnonzero(robot.knowledge.cells)
    middle = URBAN.lattice.centre(URBAN.lattice.cell(START))
    assert {math.dist(URBAN.lattice.centre(cell), middle) <= 7.0 for cell in known} == {True}
    assert np.array_equal(robot.knowledge.cells[known], URBAN.ground[known])
    seen = dict(robot.outbox())[REACHABILITY_TOPIC]
    other = GroundRobot("europa", URBAN, 1, URBAN.starts[40], QUICK)
    other.step(0.0)
    other.take("io", REACHABILITY_TOPIC, seen, 0.0)
    assert np.array_equal(other.knowledge.cells[known], URBAN.ground[known])


@pytest.fixture(scope="module")
def five():
    """Five robots that got the map, each of whose places was looked at every second."""
    robots = [GroundRobot(f"r{n}", URBAN, n, URBAN.starts[n], QUICK) for n in range(5)]
    places = []
    for robot in robots:
        robot.take("titan", MAP_TOPIC, MAP, 0.0)
    sent = drive(robots, 650.0, check=lambda: places.append([r.position for r in robots]))
    return robots, sent, np.array(places)


def test_robots_with_a_map_visit_every_vehicle_once(five):
    robots, sent, _ = five
    visits = [visit for robot in robots for visit in robot.visited]
    assert sorted(visit.goal for visit in visits) == sorted(goal.id for goal in URBAN.goals)
    last = [data for _, name, topic, data in sent if topic == CLAIMS_TOPIC and name == "r0"][-1]
    _, claims = read_claims(last, URBAN.frame)
    assert [claim.status for claim in claims] == ["visited"] * len(robots[0].visited)


def test_no_robot_is_ever_in_a_house_or_too_fast(five):
    _, _, places = five
    cells = [[URBAN.lattice.cell(Point(*place)) for place in row] for row in places]
    assert PASSABLE[URBAN.ground[np.array(cells)]].all()
    steps_m = np.hypot(*np.moveaxis(np.diff(places, axis=0), -1, 0))
    assert steps_m.max() <= 1.5 + 1e-9


def test_with_nothing_left_to_do_they_return(five):
    robots, _, places = five
    for robot, home in zip(robots, places[0], strict=True):
        assert math.dist(robot.position, home) <= 5.0


def test_the_ways_they_announce_lead_through_no_house(five):
    _, sent, _ = five
    raster = URBAN.raster
    ways = [PathMessage.decode(data).points for _, _, topic, data in sent if topic == PATH_TOPIC]
    assert len(ways) >= 15
    for way in ways:
        points = [URBAN.frame.to_local(*point) for point in way]
        for a, b in pairwise(points):
            parts = np.linspace(0, 1, 40)
            north = ((a[1] + parts * (b[1] - a[1]) - raster.south_m) / 0.5).astype(int)
            east = ((a[0] + parts * (b[0] - a[0]) - raster.west_m) / 0.5).astype(int)
            assert Terrain.BUILDING not in raster.cells[north, east]


@pytest.mark.parametrize(
    ("other", "status", "keeps"),
    [
        ("callisto", "in_progress", False),
        ("titania", "in_progress", True),
        ("titania", "visited", False),
    ],
)
def test_of_two_that_claim_a_goal_the_first_by_name_keeps_it(other, status, keeps):
    robot = explorer()
    sent = drive([robot], 10.0)
    goal = robot.book.current
    assert goal is not None
    beside = Point(goal.east_m + 10.0, goal.north_m - 10.0)
    robot.take(other, CLAIMS_TOPIC, claims_message(5.0, (beside, status)), 10.0)
    assert (robot.book.current == goal) == keeps
    robot.step(11.0)
    assert robot.book.current is not None
    assert (robot.book.current == goal) == keeps
    sent += [(11.0, "io", topic, data) for topic, data in robot.outbox()]
    last = [data for _, _, topic, data in sent if topic == CLAIMS_TOPIC][-1]
    claimed = read_claims(last, URBAN.frame)[1]
    assert math.dist(claimed[-1].place, robot.book.current) < 1e-3


def test_a_goal_that_cannot_be_reached_in_time_is_given_up_and_tried_again_at_home():
    cells = URBAN.raster.cells.copy()
    cells[cells == Terrain.VEHICLE] = Terrain.ROAD
    settings_ = NEAR_SIGHTED.model_copy(update={"patience_s_m": 0.5})
    robot = explorer(settings_, map_of(URBAN, cells))
    robot.take("europa", OBJECTS_TOPIC, sightings(Point(-10, -15)), 0.0)
    sent = drive([robot], 400.0)
    claims = [read_claims(data, URBAN.frame) for _, _, topic, data in sent if topic == CLAIMS_TOPIC]
    lengths = [len(claimed) for _, claimed in claims]
    assert lengths[:4] == [1, 0, 1, 0]
    assert claims[2][0] - claims[1][0] > 10.0
    assert robot.visited == []


def test_a_place_without_a_vehicle_is_visited_but_not_found():
    cells = np.where(URBAN.raster.cells == 5, 1, URBAN.raster.cells).astype(np.uint8)
    robot = explorer(map_=map_of(URBAN, cells))
    robot.take("europa", OBJECTS_TOPIC, sightings(Point(59, 3)), 0.0)
    drive([robot], 60.0)
    assert GoalClaim(robot.book.claims[0].place, "visited") in robot.book.claims
    assert any(math.dist(c.place, (59, 3)) < 0.1 for c in robot.book.claims)
    assert all(math.dist(g.position, (59, 3)) > 8 for g in URBAN.goals)
    assert {visit.goal for visit in robot.visited} <= {"v08", "v09"}


def test_what_goes_wrong_is_a_setting():
    """Vehicles that no map shows, goals that are elsewhere, and ways that end before the goal."""

    def visited(unmapped=(), **errors):
        settings_ = NEAR_SIGHTED.model_copy(update={"recognition_m": 0.5, **errors})
        robot = GroundRobot("io", URBAN, 1, START, settings_)
        robot.unmapped = unmapped
        robot.take("titan", MAP_TOPIC, MAP, 0.0)
        drive([robot], 400.0)
        return {visit.goal for visit in robot.visited}, robot

    found, _ = visited()
    assert len(found) > 4
    lost = [goal.position for goal in URBAN.goals if goal.id in found]
    assert not found & visited(unmapped=lost)[0]
    nothing, robot = visited(located=0.0)
    assert not nothing
    assert len(robot.book.claims) > 4  # it takes them for visited
    nothing, robot = visited(stuck=1.0, patience_s_m=1.5)
    assert not nothing
    assert robot.book.failed


def test_a_robot_that_is_not_where_it_believes_to_be_misses_vehicles():
    """The mean error of its position is a setting; it needs to recognise the vehicle of a goal."""

    def visited(mean_m):
        settings_ = QUICK.model_copy(update={"recognition_m": 7.0, "localisation_m": mean_m})
        found = []
        for seed in range(4):
            robot = GroundRobot("io", URBAN, seed, START, settings_)
            robot.take("titan", MAP_TOPIC, MAP, 0.0)
            drive([robot], 400.0)
            assert len(robot.book.claims) > 4  # it takes them for visited all the same
            found += robot.visited
        return len(found)

    exact, near, far, lost = (visited(mean_m) for mean_m in (0.0, 0.9, 10.0, 1000.0))
    assert lost == 0
    assert 0.9 * exact <= near <= exact
    assert 0.05 * exact < far < 0.6 * exact


def test_published_errors_are_drawn_by_the_seed_within_their_ranges():
    given = ExplorerSettings(recall=0.3, localisation_m=1.0)
    assert with_published_errors(given, 1) == given
    settings = given.model_copy(update={"errors": "published"})
    drawn = [with_published_errors(settings, seed) for seed in range(200)]
    assert drawn == [with_published_errors(settings, seed) for seed in range(200)]
    for name, (low, high) in (("recall", RECALL), ("localisation_m", LOCALISATION_M)):
        values = [getattr(each, name) for each in drawn]
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    rest = {"recall", "localisation_m"}
    assert all(each.model_dump(exclude=rest) == settings.model_dump(exclude=rest) for each in drawn)


def test_a_team_with_published_errors_has_one_draw_and_vehicles_that_no_map_shows():
    settings = ExplorerSettings(errors="published")
    exploration = Exploration(URBAN, ("io", "europa"), 3, settings, drawn_starts=False)
    robots = list(exploration.robots().values())
    assert robots[0].settings == robots[1].settings == with_published_errors(settings, 3)
    teams = (replace(exploration, seed=seed).robots() for seed in range(20))
    unmapped = sum(len(team["io"].unmapped) for team in teams) / (20 * len(URBAN.goals))
    assert 1 - RECALL[1] < unmapped < 1 - RECALL[0]


def test_a_map_that_lies_about_houses_does_not_lead_into_them():
    cells = URBAN.raster.cells.copy()
    cells[cells == Terrain.BUILDING] = Terrain.ROAD
    robot = explorer(map_=map_of(URBAN, cells))

    def stands_free():
        assert PASSABLE[URBAN.ground[URBAN.lattice.cell(robot.position)]]

    drive([robot], 600.0, check=stands_free)
    assert len(robot.visited) > 4


def test_a_map_of_elsewhere_shows_nothing_and_one_between_the_cells_is_refused():
    robot = GroundRobot("io", URBAN, 1, START, QUICK)
    cells = np.ones((4, 4), dtype=np.uint8)
    far = SemanticGrid(URBAN.frame.origin, 0.5, 9000.0, 0.0, cells)
    robot.take("titan", MAP_TOPIC, far.encode(), 0.0)
    assert not robot.knowledge.cells.any()
    between = SemanticGrid(URBAN.frame.origin, 0.5, 0.25, 0.0, cells)
    with pytest.raises(GridError):
        robot.take("titan", MAP_TOPIC, between.encode(), 0.0)


def test_vehicles_in_a_map_are_found_where_they_are_and_crumbs_are_not():
    reading = read_map(MAP, URBAN.lattice)
    assert len(reading.vehicles) == 15
    for goal in URBAN.goals:
        assert min(math.dist(goal.position, place) for place in reading.vehicles) < 0.5
    cells = np.zeros_like(URBAN.raster.cells)
    cells[100:103, 100:105] = Terrain.VEHICLE
    assert read_map(map_of(URBAN, cells), URBAN.lattice).vehicles == ()


def test_an_explorer_finds_vehicles_without_any_map():
    town = generate(2, 2, 1, goals=4, starts=4)
    robot = GroundRobot("io", town, 1, town.starts[0], QUICK.model_copy(update={"idle": "explore"}))

    def stands_free():
        assert PASSABLE[town.ground[town.lattice.cell(robot.position)]]

    drive([robot], 700.0, check=stands_free)
    assert sorted(visit.goal for visit in robot.visited) == ["v1", "v2", "v3", "v4"]


def test_sightings_have_the_places_of_vehicles():
    robot = GroundRobot("io", URBAN, 1, Point(24.0, -1.0), QUICK)
    robot.step(0.0)
    seen = read_sightings(dict(robot.outbox())[OBJECTS_TOPIC], URBAN.frame)
    assert seen
    assert all(min(math.dist(p, g.position) for g in URBAN.goals) < 1e-3 for p in seen)


def test_ways_refuse_what_cannot_be_reached():
    ground = np.full(URBAN.lattice.rows * URBAN.lattice.columns, Terrain.BUILDING, dtype=np.uint8)
    ground[:3] = Terrain.ROAD
    ways = Ways(URBAN.lattice, ground, 0)
    assert ways.to(2) == [1, 2]
    assert ways.nearest(URBAN.lattice.centre(50), 4.0) is None
    with pytest.raises(ValueError, match="no way"):
        ways.to(50)


PLACES = st.tuples(st.integers(0, 3), st.integers(0, 3)).map(lambda p: Point(p[0] * 40, p[1] * 40))


NAMES = ("callisto", "europa", "io")
DEEDS = st.tuples(
    st.sampled_from(NAMES),
    st.sampled_from(["claim", "visit", "fail", *NAMES]),
)


def do(book, deed):
    free = book.free(Point(0, 0))
    if deed == "claim" and book.current is None and free:
        book.claim(free[0])
    elif deed == "visit" and book.current is not None:
        book.visit()
    elif deed == "fail" and book.current is not None:
        book.give_up(failed=True)


@given(
    known=st.lists(st.lists(PLACES, max_size=6), min_size=3, max_size=3),
    deeds=st.lists(DEEDS, max_size=30),
)
def test_claims_converge_however_messages_travel(known, deeds):
    """Once all robots have all claims, no goal is in progress twice, or visited and open."""
    books = {name: GoalBook(name) for name in NAMES}
    newest = {}

    def publish(book):
        stamp_s, _ = newest.get(book.name, (0.0, []))
        newest[book.name] = stamp_s + 1.0, list(book.claims)

    def deliver(book, name):
        if book.on_claims(name, *newest[name]):
            book.give_up(failed=False)
            publish(book)

    for book, places in zip(books.values(), known, strict=True):
        book.learn(places)
        publish(book)
    for name, deed in deeds:
        if deed in NAMES:
            deliver(books[name], deed)
        else:
            do(books[name], deed)
        publish(books[name])
    for _ in range(2):
        for book in books.values():
            for name in NAMES:
                deliver(book, name)
    claimed = [book.current for book in books.values() if book.current is not None]
    claims = [claim for book in books.values() for claim in book.claims]
    visited = {claim.place for claim in claims if claim.status == "visited"}
    assert len(claimed) == len(set(claimed))
    assert not visited & set(claimed)
