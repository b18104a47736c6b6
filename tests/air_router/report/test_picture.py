"""Pictures: what is drawn for missions of all shapes."""

import dataclasses
import importlib
import itertools
import re
import struct
import xml.etree.ElementTree as ET
from importlib import resources

import pytest

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
    draw_mission(made(tmp_path), picture, track=track, meetings=[("callisto", track[1])])
    assert ">robot found<" in picture.read_text()


def test_the_same_mission_gives_the_same_picture(draw_mission, tmp_path):
    pictures = [tmp_path / "a.svg", tmp_path / "b.svg"]
    for picture in pictures:
        draw_mission(made(tmp_path), picture)
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


@pytest.mark.parametrize("name", ["$x_1$ and $", "木星 🛰", "a\x1bb\u202e", "<b>"])
def test_a_mission_may_have_any_name(draw_mission, tmp_path, name):
    picture = tmp_path / "track.svg"
    draw_mission(dataclasses.replace(made(tmp_path), name=name), picture)
    ET.parse(picture)  # noqa: S314 - our own


def test_names_at_one_place_stand_beside_each_other(map_sheet):
    sheet = map_sheet.MapSheet([Point(-200, -200), Point(200, 200)], "white")
    here = [(0.0, 0.0)]
    sheet.marks(here, "o", 60, "red")
    for name in ("callisto", "europa", "io"):
        sheet.name(name, *here, ("black", "white"), below=True, z=9)
    sheet.name("callisto", *here, ("black", "white"), below=True, z=9)  # is there already
    sheet.number("12", *here, 0.0)
    names = [text for text in sheet.axes.texts if text.get_text()]
    assert [name.get_text() for name in names] == ["callisto", "europa", "io", "12"]
    boxes = [name.get_window_extent() for name in names]
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)
    (east, north) = sheet.axes.transData.transform((0.0, 0.0))
    assert not any(box.contains(east, north) for box in boxes)


@pytest.mark.parametrize("side_m", [90, 400, 4000])
def test_the_scale_takes_a_fifth_of_the_sheet_at_most(map_sheet, tmp_path, side_m):
    sheet = map_sheet.MapSheet([Point(0, 0), Point(side_m, side_m)], "white")
    west, east = sheet.axes.get_xlim()
    sheet.marks([(0.0, 0.0)], "o", 60, "red", "home")
    sheet.save(tmp_path / "sheet.svg", "title", "subtitle")
    (text,) = (each.get_text() for each in sheet.axes.texts if each.get_text().endswith(" m"))
    length_m = float(text.removesuffix(" m"))
    assert (east - west) / 12.5 < length_m <= (east - west) / 5


# One set of colours: the pages', the pictures', the report's.


def test_pictures_have_the_pages_colours():
    style = importlib.import_module("air_router.report.figure_style")
    light, dark = style.colours(), style.colours(dark=True)
    assert light.keys() >= {"fence", "zone", "route", "leg", "r7"}
    assert style.Ink.FENCE == light["fence"] != dark["fence"]


def test_states_have_the_same_colours_on_the_report_as_on_the_pages():
    charts = importlib.import_module("air_router.report.charts")
    page = resources.files("air_router.live").joinpath("page", "live.css").read_text("utf-8")
    rules = re.findall(r"\n((?:\.chip\.[A-Z_]+[, ]*)+)\{ background: var\(--([\w-]+)\)", page)
    chips = {state: colour for names, colour in rules for state in re.findall("[A-Z_]+", names)}
    assert chips.keys() == {"HOLD", "GOTO", "HOME", "LAND", "PASSIVE"}
    drawn = {state.name: colour for state, colour in charts.STATE_COLOURS.items()}
    assert {state: drawn.get(state) for state in chips} == chips
    assert not set(chips.values()) & {c for state, c in drawn.items() if state not in chips}
