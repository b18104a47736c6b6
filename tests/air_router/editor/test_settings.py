"""Settings and outlines that are changed on the page: what was requested, and nothing else."""

import json

import pytest

from air_router.editor import edits
from air_router.editor.edits import read_edit
from air_router.editor.parts import EditError
from air_router.editor.session import EditSession, MissionFile
from air_router.files.mission_form import DEFAULT_SEEK_POLICY
from tests.air_router.editor.test_session import FREE, changed_lines

ZONE_1, ZONE_4 = ["no_fly_zones", 0], ["no_fly_zones", 3]


@pytest.mark.parametrize(
    ("do", "fields", "lines"),
    [
        ("set_value", {"name": "search_s", "value": 30.0}, "-   search_s: 45 |+   search_s: 30 "),
        ("set_value", {"name": "duration_s", "value": None}, "- duration_s: 1500"),
        ("set_value", {"name": "endurance_s", "value": 1800.0}, "+ |+ endurance_s: 1800"),
        ("set_value", {"name": "uav", "value": "io"}, "- uav: titan|+ uav: io"),
        ("seek", {"robots": ["io"]}, "- seek: [callisto, europa, io]|+ seek: [io]"),
        ("set_crossing", {"keys": ZONE_4, "crosses": False}, "-     crosses_fence: true "),
        ("set_crossing", {"keys": ZONE_1, "crosses": True}, "+     crosses_fence: true"),
    ],
)
def test_a_setting_changes_its_line_and_no_other(session, do, fields, lines):
    before = session.editable.text
    session.edit(read_edit(json.dumps({"do": do, **fields})))
    changed = changed_lines(before, session.editable.text)
    for line, begin in zip(changed, lines.split("|"), strict=True):
        assert line.startswith(begin)
    session.undo()
    assert session.editable.text == before


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("battery_reserve", 1.0, "less than 1"),
        ("altitude_m", 0.5, "greater than or equal to 1"),
        ("search_s", 0.0, "greater than 0"),
        ("speed_m_s", "fast", "valid number"),
        ("team", 3.0, "valid string"),
    ],
)
def test_a_setting_is_checked_by_the_form_of_the_file(session, name, value, why):
    before = session.editable.text
    with pytest.raises(EditError, match=f"{name} cannot be '{value}': .*{why}"):
        session.edit(edits.SetValue(do="set_value", name=name, value=value))
    assert session.editable.text == before


@pytest.mark.parametrize(
    "seek", ["", "seek: []", "seek: freshest", "seek: {policy: freshest}", "seek:\n- io\n- ariel"]
)
def test_whom_to_seek_is_written_whatever_stood_there(path, seek):
    text = path.read_text().replace("seek: [callisto, europa, io]", seek)
    path.write_text(text)
    session = EditSession(MissionFile(path))
    session.edit(edits.Seek(do="seek", robots=("io", "europa")))
    form, _ = session.editable.form()
    assert (form.seek.robots, form.seek.policy) == (
        ["io", "europa"],
        "freshest" if "freshest" in seek else DEFAULT_SEEK_POLICY,
    )
    with pytest.raises(EditError, match="at least one"):
        session.edit(edits.Seek(do="seek", robots=()))


@pytest.mark.parametrize(
    "fence",
    [
        "fence: {circle: {centre: [39.942, -75.2], radius_m: 150}}  # round",
        "fence:\n  circle: {centre: [39.942, -75.2], radius_m: 150}  # round",
        "fence: [[39.94, -75.2], [39.94, -75.19], [39.95, -75.19]]  # round",
        "fence:  # round\n  - [39.94, -75.2]\n  - [39.94, -75.19]\n  - [39.95, -75.19]",
    ],
)
def test_a_fence_gets_another_outline(tmp_path, fence):
    path = tmp_path / "mission.yaml"
    head = "home: [39.942, -75.2]\naltitude_m: 40\nwaypoints: [[39.9421, -75.2]]\n"
    path.write_text(f"{head}{fence}\nno_fly_zones: []\n")
    session = EditSession(MissionFile(path))
    corners = ((39.941, -75.201), (39.943, -75.201), (39.943, -75.199), (39.941, -75.199))
    session.edit(edits.Redraw(do="redraw", keys=("fence",), corners=corners))
    (region,) = session.editable.parts.regions
    assert region.circle is None
    assert tuple(corner.pair for corner in region.rings[0].corners) == corners
    text = session.editable.text
    assert text.startswith(head)
    assert text.endswith("\nno_fly_zones: []\n")
    assert "# round" in text
    assert session.view()["problems"] == []


def test_a_plan_s_round_fence_becomes_a_polygon(plan):
    circle = edits.AddArea(do="add_area", fence=True, corners=(FREE,), radius_m=400.0)
    plan.edit(circle)
    fences = [r for r in plan.editable.parts.regions if r.is_fence and r.circle]
    corners = ((39.95, -75.21), (39.95, -75.19), (39.93, -75.19), (39.93, -75.21))
    plan.edit(edits.Redraw(do="redraw", keys=fences[0].keys, corners=corners))
    after = plan.editable.parts.regions
    assert not [r for r in after if r.is_fence and r.circle]
    assert corners in [tuple(c.pair for c in r.rings[0].corners) for r in after if r.rings]
    with pytest.raises(EditError, match="QGroundControl"):
        plan.edit(edits.SetValue(do="set_value", name="speed_m_s", value=1.0))
