import math
from pathlib import Path

import numpy as np
import pytest

from air_router.messages import PathMessage, PoseMessage, SightingsMessage
from geo.frame import Geodetic, LocalFrame, Point
from geo.grid import GridError, SemanticGrid
from sitl.world.air_to_ground import AirToGround
from sitl.world.explorers.exploration import Exploration, first_visits
from sitl.world.explorers.explorer import Visit
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.ground_robots import Every
from sitl.world.measured_link import MeasuredLink
from sitl.world.radio import RadioModel
from sitl.world.towns.terrain import Camera, LandCover, Raster
from sitl.world.towns.town_file import load_town
from sitl.world.ugv import Patrol, PatrolPlan
from sitl.world.world import STEP_S, Truth, World
from sitl.world.world_file import WorldPlan

FRAME = LocalFrame(Geodetic(40.0, -75.0))
UNIX_S = 1_800_000_000.0
ALL_TOPICS = ("/pose", "/path", "/sightings")
WEST, EAST = Point(-200, 0), Point(200, 0)


def make_world(air=None, vehicles=("titan",), **topics) -> World:
    land_cover = LandCover(vehicles=(Point(-195, 9),))
    patrols = {
        "io": PatrolPlan(Patrol([WEST, Point(-200, 60)])),
        "europa": PatrolPlan(Patrol([EAST])),
    }
    plan = WorldPlan(RadioModel(air=air), Camera(), land_cover, patrols)
    raster = Raster.draw(LandCover(), (WEST, EAST), 1.0, 50.0)
    published_topics = {name: topics.get(name, ALL_TOPICS) for name in patrols}
    return World(plan, FRAME, vehicles, raster, published_topics)


def truth(time_s: float, position: Point, height_m: float = 40.0) -> Truth:
    return Truth(time_s, UNIX_S + time_s, position, height_m, 0.0)


def at(world: World, time_s: float, position: Point, height_m: float = 40.0):
    return world.step({"titan": truth(time_s, position, height_m)})


def drive(world: World, seconds: float, position: Point, start_s: float = 0.0):
    return [
        at(world, start_s + count * STEP_S, position)
        for count in range(round(seconds / STEP_S) + 1)
    ]


def test_robots_set_off_when_the_vehicle_takes_off_however_long_it_got_ready():
    driven = []
    for ready_s in (1.0, 60.0):
        world = make_world()
        for count in range(round(ready_s / STEP_S)):
            at(world, count * STEP_S, EAST, height_m=0.1)
        assert world.robots["io"].driven_m == 0
        drive(world, 20, EAST, start_s=ready_s)
        drive(world, 1, EAST, start_s=ready_s + 20)
        at(world, ready_s + 22, EAST, height_m=0.1)  # landed: they drive on
        driven.append(world.robots["io"].driven_m)
    assert driven[0] == pytest.approx(driven[1]) == pytest.approx(22, abs=2 * STEP_S)


def test_links_follow_the_vehicle_and_contacts_are_counted():
    world = make_world()
    changes = [
        change
        for step in (*drive(world, 5, WEST), *drive(world, 5, EAST, 6), *drive(world, 5, WEST, 12))
        for change in step.links
    ]
    assert [(c.a, c.b, c.up) for c in changes] == [
        ("titan", "io", True),
        ("titan", "io", False),
        ("titan", "europa", True),
        ("titan", "io", True),
        ("titan", "europa", False),
    ]
    contact = world.contact("io", "titan")
    assert contact.count == 2
    assert contact.seconds == pytest.approx(11, abs=0.2)
    assert contact.last_s == UNIX_S + 17
    assert contact.closest_m == pytest.approx(39.5, abs=0.1)
    assert world.contact("io", "europa").count == 0
    assert world.contact("io", "europa").last_s is None


def test_above_the_roofs_the_link_may_be_that_of_3gpp():
    """200 m away, with a line of sight; below the roofs it is as any other."""
    link = AirToGround("uma_av", 2.4, 0)
    middle = Point(60, 30)
    world = make_world("uma_av")
    drive(world, 5, middle)
    europa = EAST.east_m, EAST.north_m, 0.5
    lost_db = link.loss_db(np.array([(60, 30, 40)]), np.array([europa]))[0, 0]
    assert world.contact("titan", "europa").up
    reading = next(r for r in at(world, 6, middle).readings if r.robot == "europa")
    assert reading.peer == "titan"
    assert reading.rssi_dbm == round(20 - lost_db, 1)
    at(world, 7, middle, height_m=24.0)
    assert not world.contact("titan", "europa").up


def test_above_the_roofs_the_link_may_be_the_measured_one():
    near = Point(150, 30)
    world = make_world("aerpaw")
    drive(world, 5, near)
    reading = next(r for r in at(world, 6, near).readings if r.robot == "europa")
    air, ground = np.array([(150, 30, 40)]), np.array([(EAST.east_m, EAST.north_m, 0.5)])
    assert reading.rssi_dbm == round(20 - MeasuredLink(2.4, 0).loss_db(air, ground)[0, 0], 1)


def test_radios_report_who_is_received_and_who_is_not():
    steps = drive(make_world(), 2, WEST)
    readings = {(r.robot, r.peer): r.rssi_dbm for r in steps[0].readings}
    assert len(readings) == 6
    assert readings["io", "titan"] == readings["titan", "io"]
    assert -70 < readings["io", "titan"] < -60
    assert readings["europa", "titan"] is None
    assert readings["io", "europa"] is None
    assert sum(bool(step.readings) for step in steps) == 5  # every half second


def test_robots_publish_at_their_intervals_and_stamp_with_the_simulations_clock():
    steps = drive(make_world(), 20, WEST)
    published = [p for step in steps for p in step.publications if p.robot == "io"]
    poses = [PoseMessage.decode(p.data) for p in published if p.topic == "/pose"]
    assert len(poses) == 21
    assert poses[10].stamp_s == pytest.approx(UNIX_S + 10, abs=0.01)
    assert poses[10].heading_deg == pytest.approx(0)
    here = FRAME.to_local(poses[10].latitude_deg, poses[10].longitude_deg)
    assert here == pytest.approx((-200, 10), abs=0.01)
    sightings = [SightingsMessage.decode(p.data) for p in published if p.topic == "/sightings"]
    assert len(sightings) == 5
    assert len(sightings[0].objects) == 1
    assert sightings[0].objects[0].kind == "vehicle"


def test_a_robot_publishes_its_path_when_it_changes_and_every_ten_seconds():
    steps = drive(make_world(), 65, WEST)
    paths = [
        PathMessage.decode(p.data)
        for step in steps
        for p in step.publications
        if p.robot == "io" and p.topic == "/path"
    ]
    times = [round(path.stamp_s - UNIX_S, 1) for path in paths]
    assert times == [0, 10, 20, 30, 40, 50, 60]
    destinations = [FRAME.to_local(*path.points[-1]) for path in paths]
    assert destinations[0] == pytest.approx((-200, 0), abs=0.01)
    assert destinations[-1] == pytest.approx((-200, 60), abs=0.01)


def test_a_robot_keeps_to_itself_what_its_kind_does_not_publish():
    steps = drive(make_world(io=("/pose",)), 10, WEST)
    assert {p.topic for step in steps for p in step.publications if p.robot == "io"} == {"/pose"}


def test_the_camera_looks_once_a_second_while_the_vehicle_is_up():
    world = make_world()
    assert sum(bool(step.patches) for step in drive(world, 5, WEST)) == 6
    low = [at(world, 10 + t / 10, WEST, height_m=3.0) for t in range(50)]
    assert not any(step.patches for step in low)


def test_a_vehicle_on_the_ground_has_a_low_antenna():
    def received(height_m: float) -> bool:
        world = make_world()
        at(world, 0.0, Point(-160, 0), height_m)
        return world.contact("titan", "io").up

    assert received(10.0)
    assert not received(0.0)


def test_the_world_acts_at_most_every_tenth_of_a_second():
    world = make_world()
    acted = 0
    for count in range(251):  # 10 s at 25 Hz
        if world.due(count / 25):
            at(world, count / 25, WEST)
            acted += 1
    assert acted == 84  # every third packet
    assert world.robots["io"].driven_m == pytest.approx(10, abs=0.1)


def test_a_gap_in_the_truth_stream_is_driven_through():
    world = make_world()
    at(world, 0.0, WEST)
    step = at(world, 30.0, WEST)
    assert world.robots["io"].driven_m == pytest.approx(30)
    assert len([p for p in step.publications if p.topic == "/pose"]) == 2


def test_intervals_do_not_drift_and_missed_turns_are_not_made_up():
    every = Every(1.0)
    assert [t for t in range(100) if every.due(t * 0.3)] == [
        math.ceil(second / 0.3 - 1e-9) for second in range(30)
    ]
    assert every.due(500.0)
    assert not every.due(500.5)
    assert every.due(501.0)


def test_two_vehicles_receive_each_other_and_the_robots_and_each_sees_what_is_below_it():
    world = make_world(vehicles=("titan", "atlas"))
    apart = world.step({"titan": truth(0.0, WEST), "atlas": truth(0.0, EAST)})
    up = {(change.a, change.b) for change in apart.links}
    assert up == {("titan", "io"), ("atlas", "europa")}
    assert apart.patches["atlas"].west_m > 100 > apart.patches["titan"].west_m
    near = world.step({"titan": truth(1.0, WEST), "atlas": truth(1.0, WEST, 55.0)})
    assert ("titan", "atlas", True) in {(c.a, c.b, c.up) for c in near.links}


def test_a_vehicle_without_a_position_yet_is_not_received():
    world = make_world(vehicles=("titan", "atlas"))
    step = at(world, 0.0, WEST)
    assert {name for r in step.readings for name in (r.robot, r.peer)} == {"titan", "io", "europa"}
    assert step.patches.keys() == {"titan"}
    assert world.approaches["titan", "atlas"].at_s is None


def test_how_near_two_vehicles_came_counts_from_take_off_on():
    world = make_world(vehicles=("titan", "atlas"))
    beside = Point(WEST.east_m + 20, WEST.north_m)
    world.step({"titan": truth(0.0, WEST, 0.2), "atlas": truth(0.0, beside, 0.1)})
    approach = world.approaches["titan", "atlas"]
    assert approach.closest_m == math.inf
    world.step({"titan": truth(1.0, WEST, 40.0), "atlas": truth(1.0, EAST, 30.0)})
    world.step({"titan": truth(2.0, WEST, 40.0), "atlas": truth(2.0, Point(-197, 4), 28.0)})
    world.step({"titan": truth(3.0, WEST, 40.0), "atlas": truth(3.0, EAST, 39.0)})
    assert (approach.closest_m, approach.across_m, approach.up_m) == (13.0, 5.0, 12.0)
    assert (approach.at_s, approach.level_m) == (2.0, 12.0)


URBAN = load_town(Path(__file__).parents[3] / "missions" / "urban" / "town.yaml")
EXPLORER_TOPICS = ("/pose", "/claimed_goals", "/path")


def exploring_world() -> World:
    """Two robots that explore, beside one on patrol."""
    quick = ExplorerSettings(progress=1.0)
    exploration = Exploration(URBAN, ("europa", "io", "oi"), 1, quick, drawn_starts=False)
    patrols = {"oi": PatrolPlan(Patrol([WEST]))}
    plan = WorldPlan(RadioModel(), Camera(), URBAN.land_cover, patrols, exploration=exploration)
    topics = dict.fromkeys(("europa", "io", "oi"), EXPLORER_TOPICS)
    return World(plan, URBAN.frame, ("titan",), URBAN.raster, topics)


def test_exploring_robots_set_off_and_publish_from_the_take_off_on():
    world = exploring_world()
    before = [at(world, count * STEP_S, EAST, height_m=0.1) for count in range(20)]
    published = {(p.robot, p.topic) for step in before for p in step.publications}
    assert {robot for robot, _ in published} == {"oi"}
    after = drive(world, 10, EAST, start_s=2.0)
    poses = [p for step in after for p in step.publications if p.robot == "io"]
    assert {p.topic for p in poses} == {"/pose"}  # it sees ground; its kind does not publish it
    stamps_s = [PoseMessage.decode(p.data).stamp_s - UNIX_S for p in poses]
    assert stamps_s == pytest.approx([2.1 + second for second in range(10)])


def test_exploring_robots_go_to_goals_that_they_receive_and_what_they_find_counts():
    world = exploring_world()
    drive(world, 1, EAST)
    whole = SemanticGrid(
        URBAN.frame.origin, 0.5, URBAN.bounds.west_m, URBAN.bounds.south_m, URBAN.raster.cells
    )
    world.receive("io", "titan", "/map", whole.encode())
    with pytest.raises(GridError):
        world.receive("io", "titan", "/map", b"junk")
    world.receive("oi", "titan", "/map", b"junk")  # on patrol it makes nothing of it
    steps = drive(world, 120, EAST, start_s=1.1)
    assert any(p.topic == "/claimed_goals" for step in steps for p in step.publications)
    (first, *_) = found = world.goals
    assert (first.robot, world.goals_total) == ("io", 15)
    assert UNIX_S < first.time_s <= found[-1].time_s < UNIX_S + 121.1
    assert world.robots["io"].driven_m > 20
    assert world.robots["io"].sightings


def test_a_goal_counts_for_the_robot_that_reached_it_first():
    robots = exploring_world().robots
    robots["io"].visited = [Visit("v1", 5.0, "io"), Visit("v2", 9.0, "io")]
    robots["europa"].visited = [Visit("v2", 8.0, "europa"), Visit("v1", 10.0, "europa")]
    explorers = [robots["io"], robots["europa"]]
    assert first_visits(explorers) == [Visit("v1", 5.0, "io"), Visit("v2", 8.0, "europa")]


def test_an_exploring_robot_that_a_program_plays_stands_where_it_reports_and_is_silent():
    world = exploring_world()
    world.stand("io", EAST)
    steps = drive(world, 5, WEST)
    assert world.robots["io"].position == EAST
    assert not [p for step in steps for p in step.publications if p.robot == "io"]
