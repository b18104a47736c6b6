"""The work on a mission: edits, problems, undo, and saving without a loss."""

import contextlib
import difflib
import gc
import os
import re
import signal
import stat
import tempfile
from pathlib import Path

import pytest
from shapely import LineString, Polygon, make_valid

from air_router.cli import edit as edit_command
from air_router.cli.arguments import home
from air_router.cli.cli import main
from air_router.editor import edits
from air_router.editor.editable_mission import LegKind
from air_router.editor.edits import read_edit
from air_router.editor.parts import EditError
from air_router.editor.server import EditorServer
from air_router.editor.session import (
    ChangedOnDiskError,
    EditSession,
    MissionFile,
    SaveError,
    StaleError,
    UnconfirmedError,
    write_starter,
)
from air_router.errors import ExitCode, UsageError
from air_router.files.missions.placed_form import place
from mocha_link.team.document import DocumentError
from tests.mocha_link.foreign import foreign_link

ROOT = Path(__file__).parents[3]
INSIDE_ZONE_8 = (39.9424800, -75.2005500)
FREE = (39.9426000, -75.2002000)


def waypoint(number):
    return ("waypoints", number - 1, "position")


def move(keys, to):
    return edits.Move(do="move", keys=keys, to=to)


def changed_lines(before, after):
    lines = difflib.ndiff(before.splitlines(), after.splitlines())
    return [line for line in lines if line[:1] in "+-"]


def test_a_mission_without_problems_shows_them_all_clear(session):
    view = session.view()
    assert view["problems"] == []
    assert not view["dirty"]
    assert len([place for place in view["places"] if place["kind"] == "waypoint"]) == 39
    assert {leg["way"] for leg in view["legs"]} == {"straight", "around"}
    assert len(view["areas"]) == 9
    assert all(len(area["buffers"]) == 2 for area in view["areas"])


def test_an_edit_reads_only_the_shapes_anew_that_it_touches(session):
    before = place(*session.editable.form()).zones
    corner = session.view()["areas"][1]["rings"][0]["keys"]
    session.edit(move((*corner, 0), FREE))
    after = place(*session.editable.form()).zones
    kept = [one.shape is other.shape for one, other in zip(before, after, strict=True)]
    assert kept == [False, *[True] * (len(before) - 1)]


def test_a_waypoint_in_a_zone_is_a_problem_and_so_are_its_legs(session):
    before = session.editable.text
    session.edit(move(waypoint(3), INSIDE_ZONE_8))
    view = session.view()
    (problem,) = view["problems"]
    assert problem["code"] == "waypoint-in-zone"
    assert problem["feature"] == list(waypoint(3))
    assert problem["at"] == [list(INSIDE_ZONE_8)]
    blocked = [(leg["from"], leg["to"]) for leg in view["legs"] if leg["way"] == LegKind.BLOCKED]
    assert blocked == [(2, 3), (3, 4)]
    assert [place["index"] for place in view["places"] if place["wrong"]] == [3]
    assert changed_lines(before, session.editable.text) == [
        "-   - [39.9428113, -75.2005838]",
        "+   - [39.9424800, -75.2005500]",
    ]
    session.edit(move(waypoint(3), FREE))
    assert session.view()["problems"] == []


def test_a_zone_that_crosses_itself_is_still_shown(session):
    zone = ("no_fly_zones", 7)
    session.edit(move((*zone, "polygon", 0), (39.9424000, -75.2003000)))
    view = session.view()
    assert [problem["feature"] for problem in view["problems"]] == [list(zone)]
    (area,) = [area for area in view["areas"] if area["keys"] == list(zone)]
    assert area["wrong"]
    assert area["rings"][0]["corners"][0] == [39.94240, -75.20030]
    assert area["buffers"] == []


def test_nothing_is_planned_across_what_is_no_area_yet(session):
    before = session.route(15, 33)
    corner = ("no_fly_zones", 0, "polygon", 9)
    session.edit(move(corner, (39.9421300, -75.1997000)))
    (problem,) = session.view()["problems"]
    assert problem["code"] == "zone-self-intersects"
    after = session.route(15, 33)
    assert after["closest_to"] == before["closest_to"]
    assert after["length_m"] == pytest.approx(before["length_m"], abs=5)
    (area,) = [area for area in session.view()["areas"] if area["name"] == "zone 1"]
    drawn = make_valid(Polygon(area["rings"][0]["corners"]))
    at = {place["node"]: place["at"] for place in session.view()["places"]}
    joined = enumerate(session.view()["edges"])
    edges = [LineString([at[a], at[b]]) for a, others in joined for b in others]
    assert len(edges) > 50
    assert not any(drawn.intersects(edge) for edge in edges)


def test_without_a_readable_fence_nothing_is_planned(session):
    session.edit(move(("fence", "polygon", 8), (39.9429, -75.1990)))
    assert session.view()["edges"] == []
    assert "problems" in session.route(1, 2)["reason"]
    assert session.wrong


def test_steps_are_undone_and_made_again(session):
    texts = [session.editable.text]
    for edit in (
        move(waypoint(1), FREE),
        edits.AddWaypoint(do="add_waypoint", index=2, at=(39.9427, -75.2005)),
        edits.Remove(do="remove", keys=("no_fly_zones", 4)),
    ):
        session.edit(edit)
        texts.append(session.editable.text)
    assert session.view()["undo"] == "remove"
    for text in reversed(texts[:-1]):
        session.undo()
        assert session.editable.text == text
    assert not session.dirty
    with pytest.raises(EditError, match="nothing to undo"):
        session.undo()
    session.redo()
    assert session.editable.text == texts[1]
    session.edit(move(waypoint(2), FREE))
    with pytest.raises(EditError, match="nothing to redo"):
        session.redo()


def test_one_drag_is_one_step_and_a_zone_keeps_its_shape(session):
    before = session.editable.text
    origin = (39.9424, -75.2005)
    shift = {"do": "shift", "keys": ("no_fly_zones", 7), "origin": origin}
    for step in (1, 5, 11):
        to = (origin[0] + step * 3.3e-7, origin[1] - step * 1.7e-7)
        session.edit(edits.Shift(**shift, to=to), gesture="drag")
    session.edit(edits.Shift(**shift, to=origin), gesture="drag")
    assert session.editable.text == before
    session.undo()
    assert session.view()["undo"] is None


def test_what_does_not_change_anything_is_no_step(session):
    session.edit(move(waypoint(1), (39.94222941, -75.20013378)))
    assert session.view()["undo"] is None


def test_an_edit_for_another_state_is_refused(session):
    session.edit(move(waypoint(1), FREE), revision=session.revision)
    with pytest.raises(StaleError):
        session.edit(move(waypoint(2), FREE), revision=session.revision - 1)


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (move(("waypoints", 99, "position"), FREE), "no such place"),
        (move(("battery_reserve",), FREE), "no such place"),
        (edits.Remove(do="remove", keys=("home", "position")), "move it instead"),
        (edits.Remove(do="remove", keys=("fence",)), "by hand"),
        (edits.Remove(do="remove", keys=("name",)), "no such place"),
        (edits.Resize(do="resize", keys=("no_fly_zones", 0), radius_m=5.0), "no circle"),
        (edits.AddArea(do="add_area", fence=True, corners=(FREE,), radius_m=9.0), "a fence"),
        (edits.AddCorner(do="add_corner", keys=("fence", "polygon"), index=99, at=FREE), "only 16"),
        (edits.AddWaypoint(do="add_waypoint", index=99, at=FREE), "load the page again"),
        (edits.Rename(do="rename", keys=("fence",), name="x"), "no name"),
    ],
)
def test_what_cannot_be_done_changes_nothing(session, edit, why):
    text = session.editable.text
    with pytest.raises(Exception, match=why):
        session.edit(edit)
    assert session.editable.text == text
    assert not session.dirty


def test_a_ring_keeps_three_corners_and_a_mission_one_waypoint(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(
        "home: [39.0, -75.0]\naltitude_m: 40\nwaypoints: [[39.0005, -75.0]]\nfence: null\n"
        "no_fly_zones: [[[39.001, -75.0], [39.001, -75.001], [39.002, -75.0]]]\n"
    )
    session = EditSession(MissionFile(path))
    for keys in (("no_fly_zones", 0, "polygon", 1), waypoint(1)):
        with pytest.raises(EditError, match="needs"):
            session.edit(edits.Remove(do="remove", keys=keys))
    session.edit(edits.AddArea(do="add_area", fence=True, corners=(FREE,), radius_m=500.0))
    assert "fence:\n  circle:\n    centre: [39.9426000, -75.2002000]\n    radius_m: 500\n" in (
        session.editable.text
    )
    session.edit(edits.Rename(do="rename", keys=("no_fly_zones", 0), name="hall"))
    assert "no_fly_zones: [{polygon: [[39.001, -75.0]," in session.editable.text
    assert session.view()["areas"][-1]["name"] == "hall"


def test_metres_are_edited_as_metres(tmp_path):
    path = tmp_path / "local.yaml"
    path.write_text(
        "coordinates: local\nframe: {origin: [39.94, -75.2]}\nhome: [0, 0]\naltitude_m: 40\n"
        "waypoints:\n  - [10, 20]  # east, north\nfence: null\nno_fly_zones: []\n"
    )
    session = EditSession(MissionFile(path))
    (place,) = [place for place in session.view()["places"] if place["kind"] == "waypoint"]
    latitude_deg, longitude_deg = place["at"]
    session.edit(move(waypoint(1), (latitude_deg + 1e-4, longitude_deg)))
    assert "  - [10, 31.1]  # east, north\n" in session.editable.text
    assert session.view()["problems"] == []


def test_circles_of_other_files_are_shown_round(path):
    (path.parent / "mast.geojson").write_text(
        '{"type": "Feature", "properties": {"name": "mast", "radius_m": 30},'
        ' "geometry": {"type": "Point", "coordinates": [-75.2030, 39.9400]}}'
    )
    path.write_text(path.read_text() + "no_fly_files: [mast.geojson]\n")
    mast = EditSession(MissionFile(path)).view()["areas"][-1]
    assert (mast["name"], mast["keys"]) == ("mast", None)
    ((ring,),) = mast["outline"]
    apart_deg = [abs(place[0] - 39.94) for place in ring]
    assert len(ring) > 100
    assert max(apart_deg) * 111_035 == pytest.approx(30, abs=0.1)


def test_a_mission_on_the_antimeridian_is_drawn_in_one_place(tmp_path):
    path = tmp_path / "fiji.yaml"
    path.write_text(
        "home: [-16.5000, 179.9999]\naltitude_m: 40\nwaypoints:\n  - [-16.4990, -179.9995]\n"
        "fence:\n  polygon: [[-16.51, 179.99], [-16.51, -179.99], [-16.49, -179.99], "
        "[-16.49, 179.99]]\n"
        "no_fly_zones:\n  - circle: {centre: [-16.4980, -179.9990], radius_m: 20}\n"
    )
    session = EditSession(MissionFile(path))
    view = session.view()
    fence, zone = view["areas"]
    drawn = [place["at"] for place in view["places"]]
    drawn += [*fence["rings"][0]["corners"], zone["circle"]["centre"]]
    drawn += [place for area in (fence, zone) for place in area["buffers"][0][0][0]]
    drawn += [place for leg in view["legs"] for place in leg["points"]]
    assert all(179.98 < longitude_deg < 180.02 for _, longitude_deg in drawn)
    added = '{"do": "add_waypoint", "index": 1, "at": [-16.4985, 180.0002]}'
    session.edit(read_edit(added))
    assert "  - [-16.4985000, -179.9998000]\n" in session.editable.text


def test_numbers_and_altitudes(session):
    session.edit(edits.SetValue(do="set_value", name="clearance_m", value=9.5))
    assert "clearance_m: 9.5 " in session.editable.text
    assert session.view()["settings"]["clearance_m"] == 9.5
    assert session.wrong
    session.undo()
    altitude = {"do": "set_altitude", "keys": waypoint(5)}
    session.edit(edits.SetAltitude(**altitude, altitude_m=30.0))
    line = "  - {position: [39.9427630, -75.2016829], altitude_m: 30}  # 5\n"
    assert line in session.editable.text
    session.edit(edits.SetAltitude(**altitude, altitude_m=None))
    assert "  - {position: [39.9427630, -75.2016829]}  # 5\n" in session.editable.text


def test_waypoints_take_another_order_with_their_altitudes_and_remarks_stay(tmp_path):
    path = tmp_path / "field.yaml"
    waypoints = (
        "  - [39.9424, -75.1998]  # first",
        "  - {position: [39.9423, -75.1999], altitude_m: 31.0}  # second",
        "  - [39.9422, -75.1996]  # third",
    )
    write_starter(path, (39.9421, -75.1998))
    text = path.read_text()
    head, _, rest = text.partition("waypoints:\n")
    path.write_text("\n".join([f"{head}waypoints:", *waypoints, *rest.splitlines()[1:], ""]))
    session = EditSession(MissionFile(path))
    before = session.editable.text
    session.edit(edits.Reorder(do="reorder", keys=waypoint(3), index=0))
    shown = [p for p in session.view()["places"] if p["kind"] == "waypoint"]
    assert [(p["at"][0], p["altitude_m"]) for p in shown] == [
        (39.9422, None),
        (39.9424, None),
        (39.9423, 31.0),
    ]
    assert re.findall("# (first|second|third)", session.editable.text) == [
        "first",
        "second",
        "third",
    ]
    session.undo()
    assert session.editable.text == before
    session.edit(edits.Reverse(do="reverse"))
    shown = [p["at"][0] for p in session.view()["places"] if p["kind"] == "waypoint"]
    assert shown == [39.9422, 39.9423, 39.9424]
    for keys, index, why in (
        (waypoint(1), 3, "only 3 waypoints"),
        (("home", "position"), 0, "order"),
    ):
        with pytest.raises(EditError, match=why):
            session.edit(edits.Reorder(do="reorder", keys=keys, index=index))


def test_the_waypoints_of_a_plan_change_places_and_what_is_between_stays(plan):
    def kinds():
        items = plan.editable.document.data["mission"]["items"]
        return [item.get("command", item["type"]) for item in items]

    places = [h.pair for h in plan.editable.parts.waypoints]
    before = kinds()
    plan.edit(edits.Reverse(do="reverse"))
    assert [h.pair for h in plan.editable.parts.waypoints] == places[::-1]
    assert kinds() == before


def test_a_plan_is_edited_in_place(plan):
    before = plan.editable.text
    places = [place for place in plan.view()["places"] if place["kind"] == "waypoint"]
    plan.edit(move(tuple(places[4]["keys"]), (39.9427001, -75.2016)))
    lines = changed_lines(before, plan.editable.text)
    assert [line[1:].strip() for line in lines if line[0] == "+"] == ["39.9427001,", "-75.2016,"]
    plan.edit(edits.AddWaypoint(do="add_waypoint", index=5, at=FREE))
    plan.edit(edits.AddArea(do="add_area", corners=(FREE,), radius_m=4.0))
    plan.edit(edits.Remove(do="remove", keys=("geoFence", "circles", 0)))
    plan.edit(edits.AddRallyPoint(do="add_rally_point", at=FREE))
    keys = tuple(places[0]["keys"])
    plan.edit(edits.SetAltitude(do="set_altitude", keys=keys, altitude_m=31.5))
    view = plan.view()
    assert len([place for place in view["places"] if place["kind"] == "waypoint"]) == 40
    assert view["places"][1]["altitude_m"] == 31.5
    assert view["problems"] == []
    plan.save()
    assert EditSession(MissionFile(plan.editable.path)).view()["places"] == view["places"]


def test_every_part_of_a_plan_can_be_taken_hold_of(plan):
    handles = list(plan.editable.parts.handles())
    assert len(handles) > 90
    for handle in handles[::20]:
        plan.edit(move(handle.keys, FREE))
        (moved,) = [h for h in plan.editable.parts.handles() if h.keys == handle.keys]
        assert moved.pair == FREE


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "[]",
        '{"do": "move"}',
        '{"do": "format disk"}',
        '{"do": "move", "keys": ["home"], "to": [91, 0]}',
        '{"do": "move", "keys": ["home"], "to": [NaN, 0]}',
        '{"do": "move", "keys": ["home"], "to": ["1", "2"]}',
        '{"do": "move", "keys": ["home"], "to": [1, 2], "more": 1}',
        '{"do": "remove", "keys": []}',
        '{"do": "set_value", "name": "shape", "value": 1}',
        '{"do": "add_area", "corners": []}',
        "not json",
    ],
)
def test_what_is_no_edit_is_refused(text):
    with pytest.raises(EditError, match="not an edit"):
        read_edit(text)


def test_a_new_mission_has_no_problems_and_overwrites_nothing(tmp_path):
    path = tmp_path / "field.yaml"
    for where in ("39.9421,-75.1998", "-77.85,166.7", "0,-180"):
        path.unlink(missing_ok=True)
        write_starter(path, home(where))
        assert EditSession(MissionFile(path)).view()["problems"] == []
    with pytest.raises(UsageError, match="already"):
        write_starter(path, home("1,2"))
    with pytest.raises(UsageError, match=r"field\.yaml"):
        write_starter(tmp_path / "field.plan", home("1,2"))
    for where in ("1", "91,2", "x,y"):
        assert main(["edit", str(tmp_path / "a.yaml"), "--new", where]) == ExitCode.USAGE
    assert [entry.name for entry in tmp_path.iterdir()] == ["field.yaml"]


# Saving


def test_saving_changes_only_what_was_edited(path, session):
    before = path.read_bytes()
    path.chmod(0o640)
    session.edit(move(waypoint(1), FREE))
    session.save()
    assert not session.dirty
    after = path.read_bytes()
    assert after == before.replace(b"[39.9422294, -75.2001338]", b"[39.9426000, -75.2002000]")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert [entry.name for entry in path.parent.iterdir() if "mission" in entry.name] == [path.name]


def test_a_mission_with_problems_is_saved_only_when_that_is_confirmed(path, session):
    before = path.read_text()
    session.edit(move(waypoint(3), INSIDE_ZONE_8))
    with pytest.raises(UnconfirmedError, match="1 problem and cannot be flown"):
        session.save()
    assert path.read_text() == before
    session.save(confirmed=True)
    assert "[39.9424800, -75.2005500]" in path.read_text()


def test_what_others_wrote_is_not_lost(path, session):
    session.edit(move(waypoint(1), FREE))
    path.write_text(path.read_text() + "# by hand\n")
    assert session.file.changed()
    with pytest.raises(ChangedOnDiskError):
        session.save()
    assert path.read_text().endswith("# by hand\n")
    session.reload()
    assert not session.dirty
    assert session.editable.text.endswith("# by hand\n")
    session.edit(move(waypoint(1), FREE))
    path.unlink()
    with pytest.raises(ChangedOnDiskError):
        session.save()
    session.save(overwrite=True)
    assert "[39.9426000, -75.2002000]  # 1" in path.read_text()


def test_an_unreadable_file_is_not_taken_over_and_not_overwritten(path, session):
    session.edit(move(waypoint(1), FREE))
    path.write_text("home: [1,\n")
    with pytest.raises(DocumentError):
        session.reload()
    assert session.dirty
    with pytest.raises(ChangedOnDiskError):
        session.save()


def test_line_breaks_and_marks_stay(path):
    text = path.read_text()
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    session = EditSession(MissionFile(path))
    session.edit(edits.AddWaypoint(do="add_waypoint", index=39, at=FREE))
    session.save()
    raw = path.read_bytes()
    assert raw.startswith(b"\xef\xbb\xbf#")
    assert raw.count(b"\r\n") == raw.count(b"\n") == text.count("\n") + 1


def test_a_failed_save_leaves_file_and_folder_as_they_were(path, session, monkeypatch):
    before = path.read_bytes()
    session.edit(move(waypoint(1), FREE))

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    names = sorted(path.parent.iterdir())
    with pytest.raises(SaveError, match="No space left"):
        session.save()
    assert path.read_bytes() == before
    assert sorted(path.parent.iterdir()) == names
    assert session.dirty


def test_a_read_only_file_is_not_saved_over(path, session):
    """It was made read-only for a reason: an approved mission, or another's."""
    before = path.read_text()
    path.chmod(0o444)
    session.edit(move(waypoint(1), FREE))
    with pytest.raises(SaveError, match=r"is read-only; allow writing \(chmod u\+w\)"):
        session.save()
    assert path.read_text() == before
    assert session.dirty
    path.chmod(0o644)
    session.save()
    assert path.read_text() != before


def test_nothing_is_saved_through_a_link_of_another_user(path, tmp_path, monkeypatch):
    foreign_link(tmp_path / "theirs.yaml", path, monkeypatch)
    before = path.read_text()
    file = MissionFile(tmp_path / "theirs.yaml")
    with pytest.raises(SaveError, match="is a link of another user"):
        file.write("name: other\n", overwrite=True)
    assert path.read_text() == before


def test_what_was_not_saved_is_kept_aside(path, session):
    session.edit(move(waypoint(1), FREE))
    kept = MissionFile(path).keep_aside(session.editable.text)
    assert kept.name == "mission.yaml.unsaved"
    assert kept.read_text() == session.editable.text


def test_where_the_folder_is_gone_work_is_kept_in_the_temporary_one(
    path, session, tmp_path, monkeypatch
):
    """A stick that was pulled out, or a disk that is full."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    gone = MissionFile(path.parent / "gone" / "mission.yaml")
    kept = gone.keep_aside(session.editable.text)
    assert kept == tmp_path / "mission.yaml.unsaved"
    assert kept.read_text() == session.editable.text
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    with pytest.raises(SaveError, match=re.escape(str(path.parent / "gone"))):
        gone.keep_aside(session.editable.text)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_work_is_kept_however_the_program_is_ended(path, session, monkeypatch, number, capsys):
    """SIGHUP: the terminal was closed."""
    monkeypatch.setattr(edit_command, "EditSession", lambda _: session)
    monkeypatch.setattr(gc, "freeze", lambda: None)
    monkeypatch.setattr(gc, "set_threshold", lambda _: None)
    before = signal.signal(signal.SIGHUP, lambda *_: pytest.fail("it would have been killed"))

    @contextlib.asynccontextmanager
    async def serving(server, say):
        session.edit(move(waypoint(1), FREE))
        signal.raise_signal(number)
        yield ""

    monkeypatch.setattr(EditorServer, "serving", serving)
    try:
        assert main(["edit", str(path), "--port", "0", "--no-open"]) == 0
    finally:
        signal.signal(signal.SIGHUP, before)
    assert "what was not saved is in" in capsys.readouterr().err
    assert path.with_name("mission.yaml.unsaved").read_text() == session.editable.text


def test_what_was_kept_aside_before_stays(path, session):
    """Of another page on the same file, or of the last time."""
    before = path.with_name("mission.yaml.unsaved")
    before.write_text("hours of work")
    kept = MissionFile(path).keep_aside(session.editable.text)
    assert kept.name == "mission.yaml.unsaved-2"
    assert MissionFile(path).keep_aside(session.editable.text).name == "mission.yaml.unsaved-3"
    assert before.read_text() == "hours of work"
