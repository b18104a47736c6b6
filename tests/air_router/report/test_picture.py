"""Pictures: what is drawn for missions of all shapes."""

import importlib
import re
import struct
from importlib import resources

import pytest

from air_router.report.svg import colours, style_sheet
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from geo.frame import Point
from tests.air_router.local_mission import local_mission


@pytest.fixture(scope="module")
def map_sheet():
    """With matplotlib, which the workers that only collect these tests do without."""
    return importlib.import_module("air_router.report.map_sheet")


@pytest.fixture(scope="module")
def draw_mission():
    return importlib.import_module("air_router.report.picture").draw_mission


def size(path):
    """Width and height of a PNG in pixels."""
    data = path.read_bytes()
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    return struct.unpack(">II", data[16:24])


def made(folder, **changes):
    zones = [[[-60, 20], [-20, 20], [-20, 60]]]
    return local_mission(folder, **{"no_fly_zones": zones, **changes})


@pytest.mark.parametrize(
    "changes",
    [
        {"fence": None, "no_fly_zones": []},
        {"rally_points": [[-50, -50]], "waypoints": [[5000, 0], [0, 40]], "fence": None},
    ],
)
def test_missions_of_all_shapes(draw_mission, tmp_path, changes):
    mission = made(tmp_path, **changes)
    graph = WaypointGraph(mission)
    route = Router(graph).route(mission.home, 1)
    target = tmp_path / "mission.png"
    draw_mission(mission, target, graph=graph, route=(mission.home, route))
    width, height = size(target)
    assert 900 < width < 1500
    assert 400 < height < 2400


def test_what_is_outside_of_the_fence_has_room_on_the_sheet(map_sheet):
    axes = map_sheet.MapSheet([Point(0, 0), Point(50, 0), Point(0, 400)], "white").axes
    assert axes.get_ylim() == (-16.0, 416.0)
    west, east = axes.get_xlim()
    assert east - west == pytest.approx(432.0 / 1.8)  # not too tall


def test_where_robots_were_found_is_in_the_picture_of_the_track(draw_mission, tmp_path):
    picture = tmp_path / "track.svg"
    track = [Point(0, 0), Point(50, 0)]
    matplotlib = importlib.import_module("matplotlib")
    with matplotlib.rc_context({"svg.fonttype": "none"}):  # names stay text
        draw_mission(made(tmp_path), picture, track=track, meetings=[("callisto", track[1])])
    assert ">robot found<" in picture.read_text()


# One set of colours: the pages', the pictures', the report's.


def test_pictures_and_reports_have_the_pages_colours(map_sheet):
    light, dark = colours(), colours(dark=True)
    assert light.keys() == dark.keys() >= {"fence", "zone", "route", "leg", "r7"}
    assert map_sheet.Ink.FENCE == light["fence"] != dark["fence"]
    assert f"--zone: {light['zone']};" in style_sheet()
    report = resources.files("air_router.report").joinpath("flight_page.css").read_text("utf-8")
    known = set(re.findall(r"--([\w-]+):", report)) | light.keys()
    assert set(re.findall(r"var\(--([\w-]+)", report)) <= known


def test_states_have_the_same_colours_on_the_report_as_on_the_pages():
    report, page = (
        resources.files(f"air_router.{room}").joinpath(*path).read_text("utf-8")
        for room, path in (("report", ["flight_page.css"]), ("live", ["page", "live.css"]))
    )
    rules = re.findall(r"\n((?:\.chip\.[A-Z_]+[, ]*)+)\{ background: var\(--([\w-]+)\)", page)
    chips = {state: colour for names, colour in rules for state in re.findall("[A-Z_]+", names)}
    assert chips.keys() == {"HOLD", "GOTO", "HOME", "LAND", "PASSIVE"}
    drawn = dict(re.findall(r"--([A-Z_]+): var\(--([\w-]+)\)", report))
    assert {state: drawn.get(state) for state in chips} == chips
    assert not set(chips.values()) & {c for state, c in drawn.items() if state not in chips}
