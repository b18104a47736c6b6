"""The town as a file and as a picture of cells, towns from seeds, and the map painted over them."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from air_router.mission.loading import load_mission
from geo.frame import Point
from geo.grid import SemanticGrid, Terrain
from mocha_link.team.document import DocumentError
from sitl.cli import cli
from sitl.experiment.robots.uav import MapPainter
from sitl.world.towns.terrain import Camera
from sitl.world.towns.town import Bounds, Lattice, coarse
from sitl.world.towns.town_draws import APART_M, drawn_starts, scatter
from sitl.world.towns.town_file import load_town, mission_over, town_text
from sitl.world.towns.town_generator import generate
from sitl.world.towns.ways import PASSABLE, Ways
from sitl.world.world_file import load_world

URBAN = Path(__file__).parents[4] / "missions" / "urban"
CAMERA = Camera(fov_across_deg=60.0, fov_along_deg=45.0)
SMALL = """\
name: Small
frame: {origin: [38.5, -98.5]}
home: [0, 0]
bounds: {west_m: -40, south_m: -20, east_m: 40, north_m: 20}
outline: [[-38, -18], [38, -18], [38, 18], [-38, 18]]
roads:
  - {width_m: 8, points: [[-36, 0], [36, 0]]}
buildings:
  - [[-10, 6], [10, 6], [10, 16], [-10, 16]]
goals: {a: [30, 0], b: [-30, 0]}
starts: [[0, 0], [4, 0]]
"""


@pytest.fixture(scope="module")
def urban():
    return load_town(URBAN / "town.yaml")


def reachable(town):
    ways = Ways(town.lattice, town.ground, town.lattice.cell(town.starts[0]))
    return np.isfinite(ways.costs)


def small(tmp_path, old="", new=""):
    path = tmp_path / "town.yaml"
    path.write_text(SMALL.replace(old, new, 1))
    return path


def codes(path):
    with pytest.raises(DocumentError) as error:
        load_town(path)
    return [(p.line, p.code) for p in error.value.problems]


def test_the_papers_town_is_as_large_as_traced(urban):
    assert 56_000 < urban.area_m2 < 57_500  # the paper: 62,570
    assert len(urban.goals) == 15
    assert len(urban.starts) >= 50


def test_the_wood_is_as_large_as_the_papers_rural_environment_and_mostly_trees():
    rural = load_town(URBAN.parent / "rural" / "town.yaml")
    assert rural.area_m2 == 157_000
    assert len(rural.goals) == 15
    cells = rural.raster.cells
    share = {kind: np.count_nonzero(cells == kind) / 4 / rural.area_m2 for kind in Terrain}
    assert 0.55 < share[Terrain.VEGETATION] < 0.6
    assert share[Terrain.BUILDING] < 0.01
    mission = load_mission(URBAN.parent / "rural" / "mission.yaml")
    assert (rural.frame, rural.home) == (mission.frame, mission.home)
    world = load_world(URBAN.parent / "rural" / "world.yaml", mission, ["ugv01", "ugv02"], 0)
    assert world.exploration is not None
    assert world.radio.air == "aerpaw"


def test_its_vehicles_are_those_of_the_rehearsed_world(urban):
    mission = load_mission(URBAN / "mission.yaml")
    world = load_world(URBAN / "world.yaml", mission, ["callisto", "europa", "io"], 0)
    assert tuple(goal.position for goal in urban.goals) == world.land_cover.vehicles
    assert urban.frame == mission.frame
    assert urban.home == mission.home


def test_robots_stay_in_town_and_get_everywhere(urban):
    reached = reachable(urban)
    centres = [urban.lattice.centre(cell) for cell in np.flatnonzero(reached).tolist()]
    inside = shapely.contains_xy(shapely.Polygon(urban.outline), np.array(centres))
    assert inside.all()
    for road in urban.roads:
        middle = shapely.LineString(road.points)
        for along_m in np.arange(3.0, middle.length - 3.0, 10.0):
            place = Point(*middle.interpolate(along_m).coords[0])
            assert any(reached[cell] for cell in urban.lattice.near(place, 4.0))


def test_a_coarse_cell_is_as_bad_as_the_worst_in_it():
    cells = np.array([[1, 1, 2, 0], [1, 4, 0, 3]], dtype=np.uint8)
    assert coarse(cells, 2).tolist() == [[Terrain.GRASS, Terrain.BUILDING]]
    assert coarse(np.array([[1, 0], [1, 5]], dtype=np.uint8), 2).tolist() == [[Terrain.UNKNOWN]]


def test_a_lattice_knows_its_places():
    lattice = Lattice.over(Bounds(-10, -4, 10, 6))
    assert (lattice.rows, lattice.columns) == (5, 10)
    for cell in range(50):
        assert lattice.cell(lattice.centre(cell)) == cell
    assert lattice.cell(Point(99, -99)) == 9
    assert lattice.near(Point(-9, -3), 2.0) == [0, 1, 10]
    assert lattice.near(Point(500, 0), 20.0) == []


def test_the_written_town_is_the_same_town(urban, tmp_path):
    path = tmp_path / "town.yaml"
    path.write_text(town_text(urban))
    again = load_town(path)
    for name in ("name", "frame", "bounds", "outline", "roads", "vegetation", "buildings"):
        assert getattr(again, name) == getattr(urban, name)
    assert (again.goals, again.starts, again.home) == (urban.goals, urban.starts, urban.home)
    assert np.array_equal(again.raster.cells, urban.raster.cells)
    assert max(map(len, path.read_text().splitlines())) <= 110


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("38.5, -98.5", "-98.5, 38.5, 1", (2, "wrong-length")),
        ("38.5, -98.5", "-98.5, 38.5", (2, "not-on-earth")),
        ("west_m: -40", "west_m: -41", (4, "bounds-uneven")),
        ("west_m: -40", "west_m: 60", (4, "bounds-inverted")),
        ("west_m: -40, south_m: -20", "west_m: -9000, south_m: -9000", (4, "too-large")),
        ("[10, 16], [-10, 16]]", "[-10, 16], [10, 16]]", (9, "zone-self-intersects")),
        ("[30, 0], b", "[-20, 0], b", (10, "goals-too-near")),
        ("[30, 0], b", "[0, 12], b", (10, "goal-unreachable")),
        ("[4, 0]", "[4, 7]", (11, "start-in-building")),
        ("width_m: 8", "wide_m: 8", (7, "unknown-key")),
    ],
)
def test_what_is_wrong_with_a_file_is_reported_with_its_line(tmp_path, old, new, problem):
    path = small(tmp_path, old, new)
    assert problem in codes(path)


def test_a_start_behind_a_wall_is_reported(tmp_path):
    wall = "buildings:\n  - [[20, -20], [24, -20], [24, 20], [20, 20]]"
    text = SMALL.replace("buildings:", wall, 1).replace("[4, 0]", "[34, 0]")
    text = text.replace(
        "[-38, -18], [38, -18], [38, 18], [-38, 18]", "[-40, -20], [40, -20], [0, 20]"
    )
    path = tmp_path / "town.yaml"
    path.write_text(text)
    assert {code for _, code in codes(path)} == {"start-unreachable", "goal-unreachable"}


@given(
    seed=st.integers(0, 10**6),
    size=st.tuples(st.integers(1, 3), st.integers(1, 3)),
    goals=st.integers(0, 4),
)
@settings(max_examples=8)
def test_in_a_generated_town_everything_can_be_reached(seed, size, goals):
    town = generate(seed, *size, goals=goals, starts=12)
    reached = reachable(town)
    assert not (reached & ~PASSABLE[town.ground]).any()
    for place in (*town.starts, town.home, *(goal.position for goal in town.goals)):
        assert any(reached[cell] for cell in town.lattice.near(place, 2.9))
    border = shapely.Polygon(town.outline)
    centres = [town.lattice.centre(cell) for cell in np.flatnonzero(reached).tolist()]
    assert shapely.contains_xy(border, np.array(centres)).all()
    for a in town.goals:
        assert all(math.dist(a.position, b.position) >= APART_M for b in town.goals if b != a)


def test_a_town_that_cannot_be_made_is_refused(urban):
    for arguments in ((0, 1), (40, 40)):
        with pytest.raises(ValueError, match="blocks"):
            generate(1, *arguments)
    with pytest.raises(ValueError, match="vehicles find a place"):
        generate(1, 1, 1, goals=100)
    other = scatter(urban, 3, 15)
    assert len(other.goals) == 15
    assert other.goals != urban.goals
    assert other.goals == scatter(urban, 3, 15).goals


def test_starts_are_drawn_by_seed(urban):
    drawn = drawn_starts(urban, 3, 60)
    assert drawn == drawn_starts(urban, 3, 60)
    assert drawn[:10] != drawn_starts(urban, 4, 60)[:10]
    assert set(drawn) == set(urban.starts)


def test_a_mission_flies_over_every_town():
    town = generate(5, 3, 2, goals=3)
    mission = mission_over(town, altitude_m=40.0)
    assert mission.altitude_above_home_m == 40.0
    assert mission.home == town.home
    seen = MapPainter(town.frame.origin, town.raster, CAMERA)
    for waypoint in mission.waypoints:
        for heading_deg in (0.0, 90.0):
            seen.paint(waypoint.position, 60.0, heading_deg)
    outline = shapely.Polygon(town.outline).area
    assert seen.known_cells * 0.25 > 0.97 * outline
    data = seen.publish()
    assert data is not None
    assert np.array_equal(SemanticGrid.decode(data).cells, seen.grid.cells)
    assert seen.publish() is None  # nothing is new


def test_vehicles_are_not_seen_through_houses(tmp_path):
    town = load_town(small(tmp_path, "a: [30, 0]", "a: [0, 18]"))
    below, beside = town.lattice.cell(Point(1, 5)), town.lattice.cell(Point(-13, 17))
    assert town.vehicles_seen_from(below, 15.0) == ()
    assert [goal.id for goal in town.vehicles_seen_from(beside, 15.0)] == ["a"]
    assert town.vehicles_seen_from(beside, 10.0) == ()


def test_the_command_makes_checks_and_draws_towns(tmp_path, capsys):
    folder = tmp_path / "new"
    arguments = ["town", "2x1", "--seed", "4", "--goals", "3", "--out", str(folder)]
    assert cli.main([*arguments, "--picture", str(tmp_path / "town.png")]) == 0
    assert (tmp_path / "town.png").stat().st_size > 10_000
    assert load_mission(folder / "mission.yaml").home == load_town(folder / "town.yaml").home
    assert cli.main(arguments) == 2
    capsys.readouterr()
    assert cli.main(["town", str(folder / "town.yaml"), "--scatter", "2", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["goals"]) == 2
    assert cli.main(["town", str(small(tmp_path, "width_m", "wide_m"))]) == 3
    assert "[unknown-key]" in capsys.readouterr().err
    assert cli.main(["town", "99x99"]) == 2
    for useless in (("--goals", "3"), ("--seed", "3"), ("--scatter", "-2")):
        capsys.readouterr()
        assert cli.main(["town", str(folder / "town.yaml"), *useless]) == 2
        assert capsys.readouterr().err.startswith((useless[0], "-2 vehicles"))
