"""`air-router convert`: every way from one format to another, and what it reports about it."""

import json
import os
import stat
import textwrap
from pathlib import Path

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from air_router.cli.cli import main
from air_router.errors import ExitCode
from air_router.files.json_document import json_from_text, json_text
from air_router.files.maps.zone_files import read_zones
from air_router.files.mission_form import MissionForm
from air_router.files.missions.placed_form import place
from air_router.files.missions.qgc_read import read_plan
from air_router.files.missions.qgc_write import ConversionWarnings, plan_of, report_settings
from air_router.files.missions.waypoint_file import read_waypoints
from air_router.files.whole_file import FileThereError, write_whole
from air_router.mission.loading import load_mission, read_placed
from geo.airspace.zone import Circle
from mocha_link.team.document import DocumentError
from tests.mocha_link.foreign import foreign_link

DATA = Path(__file__).parents[2] / "data"
FILES = DATA / "files"
MISSIONS = Path(__file__).parents[3] / "missions"
SOURCES = [
    DATA / "pennovation.plan",
    FILES / "survey.plan",
    FILES / "town.yaml",
    MISSIONS / "pennovation" / "mission.yaml",
    MISSIONS / "urban" / "mission.yaml",
]
ZONES = ["zones.geojson", "zones.kml", "geozones_ed269.json", "geozones_ed318.json"]
ZONES += ["airspace.txt", "airspace.geojson", "walk.gpx"]


def convert(*arguments):
    return main(["convert", *map(str, arguments)])


def report(capsys):
    return json.loads(capsys.readouterr().out)


def assert_same_mission(mine, theirs):
    """Of two files, wherever their frames are."""
    for name in ("waypoints", "rally_points"):
        pairs = zip(getattr(mine, name), getattr(theirs, name), strict=True)
        for spot, other in pairs:
            assert degrees(mine, spot.position) == pytest.approx(
                degrees(theirs, other.position), abs=2e-9
            )
    altitudes = [[w.altitude_m or p.form.altitude_m for w in p.waypoints] for p in (mine, theirs)]
    assert altitudes[0] == altitudes[1]
    for name in ("altitude_m", "speed_m_s"):
        assert getattr(mine.form, name) == getattr(theirs.form, name)
    assert mine.home_altitude_amsl_m == theirs.home_altitude_amsl_m


def degrees(placed, point):
    return placed.frame.to_geodetic(point)


def assert_same_areas(mine, theirs):
    for area, other in zip(mine.zones + mine.fences, theirs.zones + theirs.fences, strict=True):
        shapes = []
        for placed, each in ((mine, area), (theirs, other)):
            corners = placed.frame.to_geodetic_many(each.shape.corners)
            shapes.append(theirs.frame.to_local_many(*corners.T))
        borders = [shapely.Polygon(corners).boundary for corners in shapes]
        assert borders[0].hausdorff_distance(borders[1]) < 0.001
        assert isinstance(area.shape, Circle) == isinstance(other.shape, Circle)


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: f"{path.parent.stem}_{path.stem}")
def test_a_mission_file_of_any_mission_is_the_same_mission(tmp_path, source):
    target = tmp_path / "town.yaml"
    assert convert(source, target) == ExitCode.DONE
    (mine, found), (theirs, _) = read_placed(target), read_placed(source)
    assert found.problems == []
    assert_same_mission(mine, theirs)
    assert_same_areas(mine, theirs)
    for name in ("title", "timers", "planner", "seek", "duration_s", "battery_reserve"):
        assert getattr(mine.form, name) == getattr(theirs.form, name)
    for name in ("terms", "name"):
        assert [getattr(area, name) for area in mine.zones] == [
            getattr(area, name) for area in theirs.zones
        ]
    for mission in (source, target):
        load_mission(mission)


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: f"{path.parent.stem}_{path.stem}")
def test_a_plan_of_any_mission_flies_the_same(tmp_path, source):
    target = tmp_path / "town.plan"
    assert convert(source, target) == ExitCode.DONE
    (mine, found), (theirs, _) = read_placed(target), read_placed(source)
    assert_same_mission(mine, theirs)
    for name in ("fences", "zones"):
        found, wanted = (sorted(getattr(each, name), key=kind) for each in (mine, theirs))
        for area, other in zip(found, wanted, strict=True):
            corners = mine.frame.to_geodetic_many(area.shape.corners)
            drawn = shapely.Polygon(theirs.frame.to_local_many(*corners.T))
            # A plan's zones have no holes.
            filled = shapely.Polygon(other.shape.polygon.exterior)
            assert drawn.symmetric_difference(filled).area < 0.1
    load_mission(target)
    if source.suffix == ".plan":
        text = json_text(plan_of(theirs, ConversionWarnings()))
        form, anew = read_plan(json_from_text(text, target))
        assert_same_mission(place(form, anew), theirs)
        assert (anew.problems, anew.notes) == ([], [])
        assert json.dumps(json.loads(target.read_text())) == json.dumps(
            json.loads(source.read_text(encoding="utf-8"))
        )


def kind(area):
    """A plan's file has polygons and circles apart, each in their order."""
    return type(area.shape).__name__


@pytest.mark.parametrize("name", ZONES)
@pytest.mark.parametrize("kind", ["geojson", "kml", "kmz"])
def test_zones_alone_become_maps(tmp_path, name, kind):
    target = tmp_path / f"map.{kind}"
    assert convert(FILES / name, target) == ExitCode.DONE
    mine, theirs = read_zones(target).zones, read_zones(FILES / name).zones
    for zone, other in zip(mine, theirs, strict=True):
        assert (zone.name, zone.terms.clearance_m) == (other.name, other.terms.clearance_m)
        assert (zone.terms.altitudes, zone.terms.validity) == (
            other.terms.altitudes,
            other.terms.validity,
        )
        assert kind != "geojson" or type(zone.shape) is type(other.shape)


def test_what_a_plan_cannot_contain_is_reported(tmp_path, capsys):
    assert convert(FILES / "town.yaml", tmp_path / "town.plan", "--json") == ExitCode.DONE
    printed = report(capsys)
    counts = [printed[key] for key in ("waypoints", "fences", "zones", "rally_points")]
    assert counts == [3, 2, 3, 1]
    assert {(loss["what"], loss["code"]) for loss in printed["not_carried_over"]} == {
        ("no-fly zone 'yard'", "holes-closed"),
        ("no-fly zone 'yard'", "clearance-lost"),
        ("no-fly zone 'mast & \"wires\" <1>'", "altitudes-lost"),
        ("no-fly zone 'school'", "altitudes-lost"),
        ("no-fly zone 'school'", "schedule-lost"),
        ("names of zones", "names-lost"),
        ("timers", "settings-lost"),
    }
    assert (printed["written"], printed["problems"]) == (True, [])
    assert "town.plan" in printed["to"]


IN_A_PLAN = {
    *("name", "coordinates", "frame", "home", "altitude_m", "speed_m_s", "waypoints"),
    *("fence", "fences", "no_fly_zones", "no_fly_files", "rally_points"),
}


def test_a_setting_is_in_the_plan_or_reported():
    """A new key of mission files must not get lost in silence."""
    for key in MissionForm.model_fields:
        form = MissionForm.model_construct(**{key: object()})
        warnings = ConversionWarnings()
        report_settings(form, warnings, "a plan")
        assert [loss.what for loss in warnings.entries] == ([] if key in IN_A_PLAN else [key])


def test_what_stays_in_the_plan_is_reported(tmp_path, capsys):
    assert convert(FILES / "survey.plan", tmp_path / "town.yaml", "--json") == ExitCode.DONE
    printed = report(capsys)
    assert {loss["code"] for loss in printed["not_carried_over"]} == {"item-lost"}
    assert len(printed["not_carried_over"]) == 6
    assert "survey-waypoints" in {note["code"] for note in printed["notes"]}


def test_the_report_for_people(tmp_path, capsys):
    assert convert(FILES / "town.yaml", tmp_path / "town.plan") == ExitCode.DONE
    out, err = capsys.readouterr()
    assert out == f"{tmp_path}/town.plan: 3 waypoints, 2 fences, 3 no-fly zones, 1 rally point\n"
    assert "not carried over: no-fly zone 'yard': its holes are closed" in err


def test_zones_are_added_to_a_plan_and_all_else_stays(tmp_path, capsys):
    target = tmp_path / "more.plan"
    zones = ("--zones", FILES / "zones.kml", "--zones", FILES / "geozones_ed269.json")
    assert convert(FILES / "survey.plan", target, *zones, "--allow", "PROHIBITED") == ExitCode.DONE
    text = (FILES / "survey.plan").read_text(encoding="utf-8")
    lines = iter(target.read_text(encoding="utf-8").splitlines())
    assert all(
        line in (other.rstrip(",") for other in lines)
        for line in text.replace(",\n", "\n").splitlines()
    )
    before = json.loads(text)
    after = json.loads(target.read_text(encoding="utf-8"))
    fence = after["geoFence"]
    assert len(fence["polygons"]) == len(before["geoFence"]["polygons"]) + 4
    assert len(fence["circles"]) == len(before["geoFence"]["circles"]) + 1
    for kind in ("polygons", "circles"):
        fence[kind] = fence[kind][: len(before["geoFence"][kind])]
    assert json.dumps(after) == json.dumps(before)
    assert "it cannot be flown yet: " in capsys.readouterr().err


@pytest.mark.parametrize("null", [False, True])
@pytest.mark.parametrize("lost", ["geoFence", "circles"])
def test_zones_are_added_to_a_plan_that_has_no_list_for_them(tmp_path, lost, null):
    plan = json.loads((FILES / "survey.plan").read_text(encoding="utf-8"))
    plan["geoFence"]["version"] = 1  # one of 2 has both lists
    holder = plan if lost in plan else plan["geoFence"]
    holder[lost] = None
    if not null:
        del holder[lost]
    (tmp_path / "bare.plan").write_text(json.dumps(plan, indent=4))
    target = tmp_path / "more.plan"
    zones = ("--zones", FILES / "geozones_ed269.json")
    assert convert(tmp_path / "bare.plan", target, *zones) == ExitCode.DONE
    assert len(json.loads(target.read_text(encoding="utf-8"))["geoFence"]["circles"]) == 1


def test_a_mission_that_cannot_be_flown_is_converted_and_that_is_reported(tmp_path, capsys):
    text = (FILES / "town.yaml").read_text().replace("[47.0005, 8.0]", "[47.0012, 8.0012]")
    (tmp_path / "bad.yaml").write_text(text)
    assert convert(tmp_path / "bad.yaml", tmp_path / "bad.plan", "--json") == ExitCode.DONE
    assert {problem["code"] for problem in report(capsys)["problems"]} == {"waypoint-in-zone"}


def test_a_waypoint_file_is_a_mission(tmp_path, capsys):
    target = tmp_path / "survey.yaml"
    assert convert(FILES / "survey.waypoints", target, "--json") == ExitCode.DONE
    assert [loss["code"] for loss in report(capsys)["not_carried_over"]] == [
        "item-lost",
        "comments-lost",
    ]
    mission = load_mission(target)
    assert mission.home_altitude_amsl_m == 450
    assert (mission.altitude_above_home_m, mission.speed_m_s) == (30, 4)
    assert [w.altitude_above_home_m for w in mission.waypoints] == [30, 40]


HOME = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47\t8\t450\t1\n"


@pytest.mark.parametrize(
    ("text", "place", "code"),
    [
        ("QGC WPL 100\n", "1:1", "plan-version"),
        ("QGC WPL 110\n", "1:1", "no-waypoints"),
        (HOME + "1 0 3 16 0 0\n", "3:1", "wrong-length"),
        (HOME + "\n1 0 3 16 0 0 0 0 47 nan 30 1\n", "4:21", "wrong-type"),
        (HOME + "1 0 3 1e999 0 0 0 0 47 8 30 1\n", "3:7", "wrong-type"),
        (HOME + "1 0 3 16.5 0 0 0 0 47 8 30 1\n", "3:7", "wrong-type"),
        (HOME + "1 0 3 16 0 0 0 0 97 8 30 1\n", "3:18", "not-on-earth"),
        (HOME + "1 0 3 16 0 0 0 0 47 8 0 1\n", "3:23", "out-of-range"),
        (HOME + "1 0 10 16 0 0 0 0 47 8 9 1\n", "3:5", "altitude-frame"),
        (HOME + "1 0 3 5001 4 0 0 0 47 8 9 1\n", "3:1", "wrong-form"),
    ],
)
def test_what_is_wrong_in_a_waypoint_file_has_its_place(tmp_path, capsys, text, place, code):
    source = tmp_path / "a.waypoints"
    source.write_text(text)
    assert convert(source, tmp_path / "a.yaml") == ExitCode.INVALID_FILE
    error = capsys.readouterr().err
    assert error.startswith(f"{source}:{place}: "), error
    assert f"[{code}]" in error


@given(st.lists(st.lists(st.sampled_from(["0", "16", "3", "47", "8", "1e9", "x"]), max_size=13)))
def test_no_waypoint_file_crashes_its_reader(rows):
    text = "QGC WPL 110\n" + "\n".join("\t".join(row) for row in rows)
    try:
        _, findings = read_waypoints(text, Path("a.waypoints"))
        problems = findings.problems
    except DocumentError as error:
        problems = error.problems
    assert all(problem.line <= len(rows) + 1 for problem in problems)


def test_an_old_fence_becomes_a_plan_whose_home_is_its_return_point(tmp_path, capsys):
    corners = ((47.001, 8.001), (47.001, 7.999), (46.999, 7.999), (46.999, 8.001))
    source, target = tmp_path / "yard.fen", tmp_path / "yard.plan"
    places = ((47.0, 8.0), *corners, corners[0])
    source.write_text("#saved by hand\n" + "".join(f"{lat} {lon}\n" for lat, lon in places))
    assert convert(source, target, "--json") == ExitCode.DONE
    note = report(capsys)["notes"][0]
    assert (note["code"], note["line"]) == ("home-assumed", 2)
    plan = json.loads(target.read_text())
    assert plan["mission"]["plannedHomePosition"][:2] == pytest.approx([47.0, 8.0])
    (fence,) = plan["geoFence"]["polygons"]
    assert len(fence["polygon"]) == len(corners)


def test_a_walk_becomes_a_mission(tmp_path, capsys):
    target, source = tmp_path / "walk.yaml", FILES / "walk.gpx"
    arguments = (source, target, "--altitude", "30", "--zones", source, "--json")
    assert convert(*arguments) == ExitCode.DONE
    codes = [note["code"] for note in report(capsys)["notes"]]
    assert codes == ["waypoint-twice", "not-flown", "not-a-zone"]
    mission = load_mission(target)
    assert mission.frame.origin == pytest.approx((47, 8))
    assert [(w.number, w.altitude_above_home_m) for w in mission.waypoints] == [
        (1, 30), (2, 30), (3, 30)
    ]  # fmt: skip
    assert [zone.name for zone in mission.zones] == ["around the barn"]


def test_a_track_becomes_waypoints_where_it_turns(tmp_path):
    points = [(47.0, 8.0 + i * 1e-5) for i in range(50)]
    points += [(47.0 + i * 1e-5, 8.0005) for i in range(50)]
    track = "".join(f'<trkpt lat="{lat:.6f}" lon="{lon:.6f}"/>' for lat, lon in points)
    source, target = tmp_path / "track.gpx", tmp_path / "track.yaml"
    source.write_text(f"<gpx><trk><trkseg>{track}</trkseg></trk></gpx>")
    assert convert(source, target, "--altitude", "30") == ExitCode.DONE
    assert len(load_mission(target).waypoints) == 3


@pytest.mark.parametrize(
    "case",
    [
        (["town.yaml", "x.txt"], 2, "unknown kind of file"),
        (["town.yaml", "there.kml"], 2, "is already there; --force replaces it"),
        (["town.yaml", "town.yaml", "--force"], 2, "is the file that is read"),
        (["flight.mcap", "./flight.mcap", "--force"], 2, "is the file that is read"),
        (["town.yaml", "x.kml", "--altitude", "9"], 2, "--altitude is for a FROM in GPX"),
        (["walk.gpx", "x.yaml"], 2, "add --altitude M, above home"),
        (["walk.gpx", "x.yaml", "--altitude", "0"], 2, "0 is not an altitude above 0 meters"),
        (["zones.kml", "x.plan"], 2, "give the mission as FROM and these with --zones"),
        (["town.yaml", "no/x.kml"], 1, "No such file or directory"),
        (["nowhere.yaml", "x.kml"], 3, "cannot read the file"),
        (["nowhere.kml", "x.geojson"], 3, "cannot read the file"),
        (["far.geojson", "x.kml"], 3, "[not-on-earth]"),
        (["zones.kml", "x.kml", "--zones", "bad.geojson"], 3, "[wrong-type]"),
        (["town.yaml", "x.kml", "--zones", "bad.geojson"], 3, "[wrong-type]"),
        (["bad.plan", "x.yaml"], 3, "[missing-key]"),
        (["town.yaml"], 2, "TO"),
    ],
)
def test_refusals_write_nothing(tmp_path, capsys, monkeypatch, case):
    arguments, code, message = case
    for name in ("town.yaml", "zones.kml", "walk.gpx"):
        (tmp_path / name).write_bytes((FILES / name).read_bytes())
    for name, corners in (("far", [[8, 47], [8, 97]]), ("bad", "8,47 8,48")):
        polygon = {"type": "Polygon", "coordinates": [corners]}
        (tmp_path / f"{name}.geojson").write_text(json.dumps(polygon))
    (tmp_path / "bad.plan").write_text('{"fileType": "Plan", "version": 1}')
    (tmp_path / "there.kml").write_text("mine")
    (tmp_path / "flight.mcap").write_text("a record")
    before = sorted(path.name for path in tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    assert convert(*arguments) == code
    out, err = capsys.readouterr()
    assert (out, message in err) == ("", True), err
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "there.kml").read_text() == "mine"
    assert (tmp_path / "flight.mcap").read_text() == "a record"
    assert (tmp_path / "town.yaml").read_bytes() == (FILES / "town.yaml").read_bytes()


def test_an_invalid_file_is_reported_to_scripts(tmp_path, capsys):
    (tmp_path / "bad.plan").write_text('{"fileType": "Plan", "version": 1}')
    assert convert(tmp_path / "bad.plan", tmp_path / "x.yaml", "--json") == ExitCode.INVALID_FILE
    printed = report(capsys)
    assert (printed["written"], printed["problems"][0]["code"]) == (False, "missing-key")


def test_zones_all_over_the_earth(tmp_path):
    coordinates = [
        [[[lon, lat], [lon + 0.01, lat], [lon, lat + 0.01], [lon, lat]]]
        for lon in range(-180, 180, 120)
        for lat in (-85, 0, 85)
    ]
    source = tmp_path / "all.geojson"
    source.write_text(json.dumps({"type": "MultiPolygon", "coordinates": coordinates}))
    assert convert(source, tmp_path / "all.kml") == ExitCode.DONE
    assert len(read_zones(tmp_path / "all.kml").zones) == len(coordinates)


def test_force_replaces_and_keeps_the_rights(tmp_path):
    target = tmp_path / "there.kml"
    target.write_text("mine")
    target.chmod(0o640)
    assert convert(FILES / "town.yaml", target, "--force") == ExitCode.DONE
    assert target.read_text().startswith("<?xml")
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert [path.name for path in tmp_path.iterdir()] == ["there.kml"]


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "real.txt", tmp_path / "link.txt"
    target.write_text("old")
    link.symlink_to(target)
    write_whole(link, "new", replace=True)
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_a_link_of_another_user_is_not_written_through(tmp_path, monkeypatch):
    """In a folder that others may write to, they choose where it leads."""
    victim, link = tmp_path / "victim", tmp_path / "link.txt"
    victim.write_text("precious")
    foreign_link(link, victim, monkeypatch)
    with pytest.raises(PermissionError, match="is a link of another user"):
        write_whole(link, "new", replace=True)
    assert victim.read_text() == "precious"
    assert link.is_symlink()


def test_a_read_only_file_stays_as_it_is(tmp_path):
    path = tmp_path / "approved.yaml"
    path.write_text("approved")
    path.chmod(0o444)
    with pytest.raises(PermissionError, match="is read-only; allow writing"):
        write_whole(path, "new", replace=True)
    assert path.read_text() == "approved"
    assert stat.S_IMODE(path.stat().st_mode) == 0o444


def test_a_device_is_written_to_and_stays_a_device():
    """`-o /dev/null` of root replaced it, for all programs of the machine."""
    reader, screen = os.openpty()
    with os.fdopen(reader, "rb", buffering=0) as reads, os.fdopen(screen, "wb"):
        device = Path(os.ttyname(screen))
        write_whole(device, "page", replace=True)
        assert device.is_char_device()
        assert reads.read(10) == b"page"


def test_a_file_that_appears_meanwhile_stays(tmp_path, monkeypatch):
    target = tmp_path / "new.txt"
    real = os.fsync

    def appear(descriptor):
        target.write_text("theirs")
        real(descriptor)

    monkeypatch.setattr(os, "fsync", appear)
    with pytest.raises(FileThereError):
        write_whole(target, "mine", replace=False)
    assert target.read_text() == "theirs"
    assert [path.name for path in tmp_path.iterdir()] == ["new.txt"]


def test_the_error_of_a_missing_folder_names_the_requested_file(tmp_path):
    target = tmp_path / "none" / "new.txt"
    with pytest.raises(FileNotFoundError) as caught:
        write_whole(target, "mine", replace=False)
    assert caught.value.filename == str(target)


def test_nothing_of_a_mission_file_is_lost_in_another(tmp_path):
    extra = """
        timers: {init_s: 1, explore_s: 2, search_s: 3, communicate_s: 4, hold_s: 5, revisit_s: 6}
        planner: {clearance_m: 6, tracking_margin_m: 1, max_edge_m: 90, acceptance_radius_m: 3,
                  vertical_margin_m: 7, terrain_relief_m: 8, vertical_separation_m: 9,
                  home_separation_m: 11, kind: shortest}
        altitudes_m: [20, 70]
        duration_s: 900
        endurance_s: 1200
        battery_reserve: 0.3
        accepts: [rtl_type, fence_action]
        uav: titan
        seek: {robots: [io, callisto], policy: freshest}
        when_explored: hover
        goals_from: [europa]
        team: team.yaml
        world: world.yaml
        """
    text = (FILES / "town.yaml").read_text().replace("timers: {search_s: 50}\n", "")
    source = tmp_path / "one" / "mission.yaml"
    source.parent.mkdir()
    source.write_text(text + textwrap.dedent(extra))
    for name in ("team", "world"):
        beside = MISSIONS / "pennovation" / f"{name}.yaml"
        (source.parent / f"{name}.yaml").write_text(beside.read_text())
    target = tmp_path / "two" / "mission.yaml"
    target.parent.mkdir()
    assert convert(source, target) == ExitCode.DONE
    (mine, found), (theirs, wanted) = read_placed(target), read_placed(source)
    assert_same_mission(mine, theirs)
    assert_same_areas(mine, theirs)
    assert mine.form.team_file.resolve() == theirs.form.team_file.resolve()
    moved = {"home", "waypoints", "fence", "fences", "no_fly_zones", "rally_points"}
    for name in MissionForm.model_fields.keys() - moved - {"name", "team", "world"}:
        assert getattr(mine.form, name) == getattr(theirs.form, name), name
    assert [note.message for note in found.notes] == [note.message for note in wanted.notes]
    unsaid = MissionForm.model_fields.keys() - theirs.form.model_fields_set
    # Of the rest one excludes the other, or is tested in tests/air_router/mission/test_fleet.py
    assert unsaid <= {"coordinates", "frame", "uavs", "no_fly_files", "fence", "fences"}


@pytest.mark.parametrize("seek", ["[io]", "rendezvous"])
def test_whom_to_seek_is_written_as_short_as_can_be(tmp_path, seek):
    source = tmp_path / "mission.yaml"
    source.write_text((FILES / "town.yaml").read_text() + f"seek: {seek}\n")
    assert convert(source, tmp_path / "other.yaml") == ExitCode.DONE
    assert f"seek: {seek}\n" in (tmp_path / "other.yaml").read_text()
