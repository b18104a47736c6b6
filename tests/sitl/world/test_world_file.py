import dataclasses
import itertools
import math
from pathlib import Path

import pytest

from air_router.files.mission_form import Timers
from air_router.gossip.mapper import Mapper
from air_router.mission.loading import load_mission
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point
from geo.grid import GridPatch, Terrain
from geo.validity import Validity
from mocha_link.team.document import DocumentError
from mocha_link.team.team import Team
from sitl.experiment.engine.engine import Run
from sitl.experiment.settings import MissionTimers, RunSettings
from sitl.team.roles import roles_of
from sitl.team.team_world import make_world
from sitl.world.ugv import PatrolRobot
from sitl.world.world_file import load_world

MISSIONS = Path(__file__).parents[3] / "missions"
ROBOTS = ("callisto", "europa", "io")


@pytest.fixture(scope="module")
def pennovation():
    return load_mission(MISSIONS / "pennovation" / "mission.yaml")


@pytest.fixture(scope="module")
def urban():
    return load_mission(MISSIONS / "urban" / "mission.yaml")


def load(tmp_path, mission, text, robots=ROBOTS, seed=1):
    path = tmp_path / "world.yaml"
    path.write_text(text)
    return load_world(path, mission, robots, seed)


def problems_of(tmp_path, mission, text) -> list[str]:
    with pytest.raises(DocumentError) as caught:
        load(tmp_path, mission, text)
    return [f"{p.line}:{p.column}: {p.message}" for p in caught.value.problems]


@pytest.mark.parametrize("name", ["pennovation", "urban"])
def test_in_an_hour_of_patrol_no_two_robots_receive_each_other_but_the_vehicle_can(name, request):
    mission = request.getfixturevalue(name)
    plan = load_world(MISSIONS / name / "world.yaml", mission, ROBOTS, seed=1)
    assert set(plan.patrols) == set(ROBOTS)
    robots = [PatrolRobot(name, patrol) for name, patrol in plan.patrols.items()]
    closest_m = math.inf
    for _ in range(3600):
        for robot in robots:
            robot.step(1.0)
        for a, b in itertools.combinations(robots, 2):
            closest_m = min(closest_m, math.dist(a.position, b.position))
    loss_db = plan.radio.reference_loss_db + plan.radio.ground_to_ground_loss_db
    ground = plan.radio.model_copy(update={"reference_loss_db": loss_db})
    assert closest_m > ground.longest_range_m + 10
    height_m = mission.altitude_above_home_m
    slant_m = plan.radio.range_m(plan.radio.sensitivity_dbm)
    assert 60 < math.sqrt(slant_m**2 - height_m**2) < 72
    # wherever a robot is, the vehicle finds it from one of its waypoints, with room to spare
    trigger_m = math.sqrt(plan.radio.range_m(-75.0) ** 2 - height_m**2)
    for plan_of_robot in plan.patrols.values():
        for metres in range(int(plan_of_robot.patrol.length_m)):
            here = plan_of_robot.patrol.at(metres).position
            assert min(math.dist(here, w.position) for w in mission.waypoints) < trigger_m - 20


@pytest.mark.parametrize("name", ["pennovation", "urban"])
def test_the_shipped_worlds_fit_the_vehicles_map(name, request):
    mission = request.getfixturevalue(name)
    team = Team.load(mission.team)
    plan = load_world(MISSIONS / name / "world.yaml", mission, ROBOTS, seed=1)
    world = make_world(mission, team, roles_of(mission, team), plan)
    assert set(Terrain) - {Terrain.UNKNOWN, Terrain.HUMAN, Terrain.GRAVEL} == {
        Terrain(value) for value in set(world.raster.cells.flat)
    }
    mapper = Mapper(mission)
    patch = plan.camera.picture(world.raster, mission.home, mission.altitude_above_home_m, 20.0)
    assert isinstance(patch, GridPatch)
    assert mapper.paint(patch.encode())
    assert mapper.known_cells > 2000


def test_without_a_file_robots_patrol_legal_places_far_apart(pennovation):
    plan = load_world(None, pennovation, ROBOTS, seed=7)
    ground = pennovation.airspace.as_drawn()
    for robot in plan.patrols.values():
        for start, end in robot.patrol.legs():
            assert ground.leg_clear(start, end)
        assert 0 < robot.speed_m_s <= 1.5
    first = [robot.patrol.stops[0] for robot in plan.patrols.values()]
    assert min(math.dist(a, b) for a, b in itertools.combinations(first, 2)) > 100
    assert len(plan.land_cover.buildings) == len(pennovation.zones)


def test_zones_of_the_air_are_no_buildings(pennovation):
    shape, mast = pennovation.zones[0].shape, Circle(Point(0.0, 0.0), 5.0)
    zones = (
        Zone("house", shape),
        Zone("airway", shape, band=Band(lower_m=60)),
        Zone("on Sundays", shape, validity=Validity(())),
        Zone("mast", mast, band=Band(-20, 30)),
    )
    plan = load_world(None, dataclasses.replace(pennovation, zones=zones), ROBOTS, seed=7)
    assert plan.land_cover.buildings == (shape.ring, mast.corners)


def test_the_seed_chooses_the_default_world(pennovation):
    def stops(seed):
        plan = load_world(None, pennovation, ROBOTS, seed)
        return [robot.patrol.stops for robot in plan.patrols.values()], plan.seed

    assert stops(3) == stops(3)
    assert stops(3) != stops(4)


def test_robots_that_the_file_does_not_mention_stay_away_from_those_it_does(tmp_path, urban):
    text = "coordinates: local\nrobots:\n  io: {patrol: [[-133, 34]]}\n"
    plan = load(tmp_path, urban, text)
    assert plan.patrols["io"].patrol.stops == (Point(-133, 34),)
    for name in ("callisto", "europa"):
        assert math.dist(plan.patrols[name].patrol.stops[0], (-133, 34)) > 100


def test_an_empty_file_is_a_default_world(tmp_path, pennovation):
    plan = load(tmp_path, pennovation, "# nothing\n")
    assert plan.radio.shadowing_db == 0
    assert plan.land_cover.roads == ()
    assert set(plan.patrols) == set(ROBOTS)


def test_every_key_arrives(tmp_path, urban):
    plan = load(
        tmp_path,
        urban,
        """
coordinates: local
radio: {tx_power_dbm: 10, reference_loss_db: 41, path_loss_exponent: 3, shadowing_db: 2,
        ground_to_ground_loss_db: 9, shadowing_interval_s: 5, sensitivity_dbm: -80,
        reading_interval_s: 0.25, rate_bytes_s: 250000, air: uma_av, carrier_ghz: 5.2}
camera: {fov_across_deg: 80, fov_along_deg: 70, min_height_m: 3, interval_s: 2}
terrain:
  margin_m: 20
  roads: [{width_m: 5, points: [[0, 0], [0, 50]]}]
  vegetation: [[[40, 40], [50, 40], [50, 50]]]
  buildings: [[[90, 20], [95, 20], [95, 25]]]
  vehicles: [[1, 2]]
robots:
  io: {patrol: [[0, 0], [0, 50]], closed: false, speed_m_s: 1.5, start_m: 10}
""",
        seed=9,
    )
    assert plan.seed == 9
    assert (plan.radio.tx_power_dbm, plan.radio.sensitivity_dbm) == (10, -80)
    assert (plan.radio.reading_interval_s, plan.radio.rate_bytes_s) == (0.25, 250_000)
    assert (plan.radio.air, plan.radio.carrier_ghz) == ("uma_av", 5.2)
    assert (plan.camera.fov_along_deg, plan.camera.interval_s) == (70, 2)
    assert plan.margin_m == 20
    assert plan.land_cover.roads[0].width_m == 5
    assert plan.land_cover.vehicles == (Point(1, 2),)
    assert len(plan.land_cover.buildings) == 1
    assert plan.patrols["io"].patrol.at(60).position == pytest.approx((0, 40))
    assert plan.patrols["io"].start_m == 10


EXPLORE = f"explore: {{town: {MISSIONS}/urban/town.yaml, goals: seed, starts: seed}}\n"


def test_a_seed_means_the_same_robots_and_goals_as_in_an_experiment():
    mission = load_mission(MISSIONS / "explorers" / "mission.yaml")
    roles = roles_of(mission, Team.load(mission.team))
    world = load_world(mission.world, mission, roles.ground, seed=7)
    settings = RunSettings(
        town=MISSIONS / "urban" / "town.yaml", ugvs=5, goals="seed", starts="seed"
    )
    run = Run(settings, 7)
    assert world.exploration.town.goals == run.town.goals
    assert world.land_cover.vehicles == tuple(goal.position for goal in run.town.goals)
    robots = world.exploration.robots()
    assert robots.keys() == run.robots.keys()
    for name, robot in run.robots.items():
        assert robots[name].position == robot.position
        assert robots[name]._next_thought_s == robot._next_thought_s  # its own chance
        assert robots[name].settings == robot.settings
    assert mission.timers == Timers(**MissionTimers().model_dump())


def test_robots_without_a_patrol_explore_the_town_that_the_file_names(tmp_path, urban):
    patrol = "coordinates: local\nrobots: {io: {patrol: [[0, 0]]}}\n"
    text = f"{patrol}{EXPLORE[:-2]}, progress: 0.5}}\n"
    plan = load(tmp_path, urban, text)
    team = Team.load(urban.team)
    world = make_world(urban, team, roles_of(urban, team), plan)
    assert plan.patrols.keys() == {"io"}
    assert isinstance(world.robots["io"], PatrolRobot)
    assert {world.robots[name].settings.progress for name in ("callisto", "europa")} == {0.5}
    assert plan.land_cover.buildings == plan.exploration.town.buildings
    assert load(tmp_path, urban, text, seed=2).land_cover.vehicles != plan.land_cover.vehicles


def test_a_town_elsewhere_or_drawn_twice_is_reported(tmp_path, urban, pennovation):
    (elsewhere,) = problems_of(tmp_path, pennovation, EXPLORE)
    assert "1:17: the town's frame.origin is 38.5, -98.5, and the mission's 39.94" in elsewhere
    twice = problems_of(tmp_path, urban, EXPLORE + "terrain: {roads: [], margin_m: 20}\n")
    assert twice == ["2:18: 'roads' stand in the town's file; remove them here, or 'explore'"]


def test_all_problems_of_a_file_are_reported_at_once_with_their_places(tmp_path, urban):
    text = """\
coordinates: local
terrain:
  vegetation: [[[0, 0], [1, 1]]]
  roads:
    - points: [[0, 0], [1e9, 0]]
robots:
  oi: {patrol: [[0, 0]]}
  io:
    patrol: [[-10, -25], [40, -25]]
"""
    found = problems_of(tmp_path, urban, text)
    assert len(found) == 4
    assert found[0].startswith("3:16: cannot be an area: it has 2 different corners")
    assert found[1].startswith("5:24: ")
    assert "more than 100 km" in found[1]
    assert found[2].startswith("7:7: no ground robot 'oi' in the team; use one of callisto, europa")
    assert found[3].startswith("9:13: the patrol of io drives through the no-fly zone 'east block'")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robots: {io: {patrol: [[0, 0]], speed_m_s: 2}}", "at most 1.5"),
        ("robots: {io: {}}", "missing key 'patrol'"),
        ("radio: {tx_power: 20}", "did you mean 'tx_power_dbm'"),
        ("radio: {air: aerpow}", "'radio.air' cannot be text 'aerpow'; did you mean 'aerpaw'?"),
        ("camera: {fov_along_deg: '60'}", "must be a number"),
        ("robots: {io: {patrol: [[-75.2, 139.9]]}}", "latitude comes first"),
        ("terrain: {roads: [{points: [[0, 0]]}]}", "at least 2"),
        ("explore: {progress: 0.2}", "missing key 'town'"),
        ("explore: {town: none.yaml}", "cannot read the file"),
    ],
)
def test_a_wrong_value_is_named(tmp_path, pennovation, text, message):
    found = problems_of(tmp_path, pennovation, text)
    assert len(found) == 1
    assert message in found[0]
