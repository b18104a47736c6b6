"""Numbers that are legal and improbable are noted, with the unit that they are likely to be in."""

import dataclasses
import json
import shutil
import typing
from pathlib import Path

import pytest
from pydantic import BaseModel

from air_router.cli.cli import main
from air_router.editor.editable_mission import EditableMission
from air_router.files.mission_form import MissionForm
from air_router.files.missions.mission_file import read_mission
from air_router.files.usual_values import MISSION, OPTIONS, WORLD
from air_router.mission.loading import load_mission, read_placed
from mocha_link.team.document import Document, DocumentError
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.radio import RadioModel
from sitl.world.towns.terrain import Camera
from sitl.world.world_file import load_world

ROOT = Path(__file__).parents[3]
PENNOVATION = ROOT / "missions" / "pennovation"
FILE = (ROOT / "tests" / "data" / "files" / "every-key.yaml").read_text(encoding="utf-8")

PLACES = {"position", "origin", "centre", "polygon", "holes", "days"}
"""Keys whose numbers are coordinates, or days."""


def fields_of(annotation):
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {name: field.annotation for name, field in annotation.model_fields.items()}
    if dataclasses.is_dataclass(annotation):
        return typing.get_type_hints(annotation, include_extras=True)
    return {}


def numbers_of(annotation, path=""):
    """The ways to all numbers of a form, as the table of usual values writes them."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if annotation in (float, int):
        yield path
    elif origin is typing.Annotated:
        yield from numbers_of(arguments[0], path)
    elif origin is list:
        yield from numbers_of(arguments[0], f"{path}[]")
    elif origin is dict:
        yield from numbers_of(arguments[1], f"{path}.*")
    elif origin is not typing.Literal:
        for each in arguments:
            yield from numbers_of(each, path)
    for name, each in fields_of(annotation).items():
        if name not in PLACES:
            yield from numbers_of(each, f"{path}.{name}" if path else name)


def test_every_number_of_a_file_has_its_band():
    known = [band.field for band in (*MISSION, *WORLD, *OPTIONS)]
    assert len(known) == len(set(known))
    assert set(numbers_of(MissionForm)) == {b.field for b in MISSION}
    world = {"radio": RadioModel, "camera": Camera, "explore": ExplorerSettings}
    there = {f"{part}.{name}" for part, form in world.items() for name in numbers_of(form)}
    others = {"terrain.margin_m", "terrain.roads[].width_m"}
    others |= {"robots.*.speed_m_s", "robots.*.start_m"}
    assert there | others == {band.field for band in WORLD}


@pytest.mark.parametrize("band", [*MISSION, *WORLD, *OPTIONS], ids=lambda band: band.field)
def test_a_band_holds_what_is_usual_and_a_unit_leads_into_it(band):
    assert band.low < band.high
    assert band.holds(band.low)
    assert band.holds(band.high)
    middle = (band.low + band.high) / 2
    assert not band.guess(middle)
    for unit in band.below:
        assert unit.in_ours(band.low / 2) > band.low
    for unit in band.above:
        assert unit.in_ours(abs(band.high) * 2) < abs(band.high) * 2


SLIPS = [  # what is changed, the message, at the mark (§)
    ("altitude_m: 30", "altitude_m: §400", "is 400 m", "the sea? then write 100 (in feet: 122)"),
    ("altitude_m: 30", "altitude_m: §1200", "is 1200 m", "given in feet? then write 366"),
    ("altitude_m: 30", "altitude_m: §1.5", "is 1.5 m", "correct it if it is not meant"),
    ("speed_m_s: 4", "speed_m_s: §40", "is 40 m/s", "given in km/h? then write 11.1"),
    ("altitude_m: 25", "altitude_m: §250", "'waypoints[1].altitude_m'", "then write 76.2"),
    ("amsl_m: 300", "amsl_m: §7000", "'home.altitude_amsl_m'", "feet? then write 2130"),
    ("speed_m_s: 4", "altitudes_m: [30, §300]", "'altitudes_m[1]'", "feet? then write 91.4"),
    ("speed_m_s: 4", "timers: {init_s: §3}", "is 3 s", "given in minutes? then write 180"),
    ("speed_m_s: 4", "timers: {search_s: §45000}", "is 45000 s", "milliseconds? then write 45"),
    ("clearance_m: 5,", "clearance_m: §0.005,", "is 0.005 m", "given in km? then write 5"),
    ("clearance_m: 5,", "clearance_m: §500,", "is 500 m", "given in cm? then write 5"),
    ("max_edge_m: 100", "max_edge_m: §0.1", "is 0.1 m", "given in km? then write 100"),
    ("clearance_m: 4\n", "clearance_m: §0.004\n", "'no_fly_zones[0].clearance_m'", "write 4"),
    ("upper_m: 100", "upper_m: §0.1", "'no_fly_zones[0].altitude.upper_m'", "km? then write 100"),
    ("radius_m: 150", "radius_m: §0.15", "'fences[1].circle.radius_m'", "km? then write 150"),
    ("radius_m: 10}", "radius_m: §0.25}", "'no_fly_zones[1].circle.radius_m'", "then write 250"),
    ("duration_s: 600", "duration_s: §25", "is 25 s", "given in minutes? then write 1500"),
    ("duration_s: 600", "duration_s: §0.4", "is 0.4 s", "given in hours? then write 1440"),
    ("battery_reserve: 0.3", "battery_reserve: §0.9", "is 0.9;", "correct it if it is not meant"),
    ("battery_reserve: 0.3", "battery_reserve: §0", "is 0;", "correct it if it is not meant"),
]


@pytest.mark.parametrize(("before", "after", "what", "unit"), SLIPS)
def test_an_improbable_number_of_a_mission_is_one_note(before, after, what, unit):
    begin, _, end = FILE.replace(before, after).partition("§")
    _, findings = read_mission(Document.from_text(begin + end, Path("mission.yaml")))
    assert not findings.problems
    (note,) = findings.notes
    assert note.code == "unusual-value"
    assert (note.line, note.column) == (begin.count("\n") + 1, len(begin.rpartition("\n")[2]) + 1)
    assert what in note.message
    assert unit in note.message


REFUSED = [
    (
        "altitude_m: 30",
        "altitude_m: 0.035",
        "at least 1.0, found 0.035; given in km? then",
    ),
    ("altitude_m: 30", "altitude_m: 30000", "at most 10000.0, found 30000; change it"),
    ("speed_m_s: 4", "speed_m_s: 80", "at most 50.0, found 80; given in km/h? then write 22.2"),
    ("battery_reserve: 0.3", "battery_reserve: 25", "found 25; given in percent? then write 0.25"),
    ("speed_m_s: 4", "timers: {init_s: 180000}", "given in milliseconds? then write 180"),
    ("speed_m_s: 4", "timers: {init_s: -180}", "'timers.init_s' must be greater than 0"),
]


@pytest.mark.parametrize(("before", "after", "message"), REFUSED)
def test_a_number_that_cannot_be_meant_is_refused_with_its_likely_unit(before, after, message):
    text = FILE.replace(before, after)
    _, findings = read_mission(Document.from_text(text, Path("mission.yaml")))
    (problem,) = findings.problems
    assert problem.code == "out-of-range"
    assert message in problem.message
    assert not findings.notes


def test_a_thousand_numbers_of_a_kind_are_one_note():
    spots = "\n".join(f"  - {{position: [{n}, 0], altitude_m: 400}}" for n in range(1, 9))
    text = FILE.replace("  - [50, 0]", spots)
    _, findings = read_mission(Document.from_text(text, Path("mission.yaml")))
    (note,) = findings.notes
    assert "'waypoints[0].altitude_m' (and 7 more) is 400 m" in note.message


def test_the_edit_page_notes_what_is_typed():
    text = FILE.replace("altitude_m: 30", "altitude_m: 405")
    _, findings = EditableMission.read(text, Path("mission.yaml")).form()
    assert [note.code for note in findings.notes] == ["unusual-value"]


@pytest.mark.parametrize("path", sorted(ROOT.glob("missions/*/mission.yaml")), ids=str)
def test_shipped_missions_are_usual(path):
    assert "unusual-value" not in [note.code for note in load_mission(path).notes]


def test_a_plan_is_looked_at_too(tmp_path):
    plan = json.loads((ROOT / "tests" / "data" / "pennovation.plan").read_text(encoding="utf-8"))
    path = tmp_path / "town.plan"
    for item in plan["mission"]["items"]:
        if item["command"] == 16:
            item["params"][6] = 1300
        if item["command"] == 178:
            item["params"][1] = 36
    plan["mission"]["hoverSpeed"] = 36
    path.write_text(json.dumps(plan), encoding="utf-8")
    _, findings = read_placed(path)
    notes = {note.message for note in findings.notes if note.code == "unusual-value"}
    assert any("the altitude of waypoint 1 (and" in note and "1300 m" in note for note in notes)
    assert any("the speed is 36 m/s" in note and "km/h? then write 10" in note for note in notes)


WORLD_NOTES = [
    ("radio: {tx_power_dbm: 50}", "given in mW? then write 17"),
    ("camera: {fov_across_deg: 1.3}", "given in radians? then write 74.5"),
]
WORLDS_REFUSED = [
    ("radio: {sensitivity_dbm: 76}", "given in dBm without its minus? then write -76"),
    ("radio: {carrier_ghz: 2400}", "found 2400; given in MHz? then write 2.4"),
    ("robots: {io: {patrol: [[39.942, -75.2]], speed_m_s: 5}}", "km/h? then write 1.39"),
]


@pytest.mark.parametrize(("text", "message"), WORLD_NOTES)
def test_a_world_file_has_bands_too(tmp_path, capsys, text, message):
    shutil.copytree(PENNOVATION, tmp_path, dirs_exist_ok=True)
    (tmp_path / "world.yaml").write_text(text, encoding="utf-8")
    assert main(["check", str(tmp_path / "mission.yaml")]) == 0
    (note,) = (line for line in capsys.readouterr().out.splitlines() if "unusual-value" in line)
    assert "world.yaml:1:" in note
    assert message in note


@pytest.mark.parametrize(("text", "message"), WORLDS_REFUSED)
def test_what_a_world_file_cannot_mean_is_explained(tmp_path, text, message):
    (tmp_path / "world.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(DocumentError) as caught:
        load_world(tmp_path / "world.yaml", load_mission(PENNOVATION / "mission.yaml"), ["io"], 1)
    assert message in str(caught.value)


OPTIONED = [
    ("new yard --home 47.3977,8.5456 --altitude 400", "--altitude is 400 m; usual is 2 to 150 m"),
    ("cover {m} --camera 60x45deg --speed 30", "--speed is 30 m/s"),
    ("cover {m} --camera 60x45deg --every 0.05", "--every is 0.05 m; usual is 1 to 1000 m"),
    ("convert {walk} walk.yaml --altitude 400", "given in feet? then write 122"),
]


@pytest.mark.parametrize(("line", "message"), OPTIONED)
def test_options_of_the_same_kind_are_noted(tmp_path, monkeypatch, capsys, line, message):
    monkeypatch.chdir(tmp_path)
    mission = ROOT / "missions" / "urban" / "mission.yaml"
    walk = ROOT / "tests" / "data" / "files" / "walk.gpx"
    main(line.format(m=mission, walk=walk).split())
    (note,) = (text for text in capsys.readouterr().err.splitlines() if text.startswith("note: -"))
    assert message in note
