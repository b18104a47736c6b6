"""Plans come back as they were, and a change changes one thing."""

import copy
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.files.conversion_warnings import ConversionWarnings
from air_router.files.json_document import json_from_text, json_text, load_json
from air_router.files.qgc.qgc_edit import PlanEdit, PlanEditError
from air_router.files.qgc.qgc_read import plan_draft
from air_router.files.qgc.qgc_write import plan_of
from geo.airspace.zone import Circle
from geo.frame import Geodetic

DATA = Path(__file__).parents[3] / "data"
PLANS = [DATA / "pennovation.plan", DATA / "files" / "survey.plan"]
PLACE = Geodetic(47.00123456789, 8.00234567891)
WRITTEN = [47.0012345679, 8.0023456789]


def same(data, other):
    """Equal in values, in the order of keys and in what is a whole number."""
    return json.dumps(data) == json.dumps(other)


def changes(before, after, keys=()):
    """The key paths at which two plans differ."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in before.keys() | after.keys():
            yield from changes(before.get(key), after.get(key), (*keys, key))
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for index, pair in enumerate(zip(before, after, strict=True)):
            yield from changes(*pair, (*keys, index))
    elif before != after:
        yield keys


@pytest.fixture
def survey():
    return load_json(PLANS[1])


@pytest.mark.parametrize("path", PLANS, ids=lambda path: path.stem)
def test_nothing_is_lost(path):
    document = load_json(path)
    before = copy.deepcopy(document.data)
    draft = plan_draft(document)
    assert same(document.data, before)  # reading changes nothing
    assert draft.problems == []
    text = PlanEdit(document.data).text()
    assert same(json.loads(text), json.loads(path.read_text(encoding="utf-8")))
    again = plan_draft(json_from_text(text, path))
    assert again.waypoints == draft.waypoints
    assert again.zones == draft.zones
    assert [note.message for note in again.notes] == [note.message for note in draft.notes]


@given(data=st.data())
def test_plans_with_anything_in_them_come_back(data):
    values = st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False)
        | st.text(max_size=5).filter(lambda text: text.isprintable()),
        lambda inner: st.lists(inner, max_size=3)
        | st.dictionaries(st.text("abc", max_size=3), inner, max_size=3),
        max_leaves=6,
    )  # fmt: skip
    plan = load_json(PLANS[1]).data
    items = plan["mission"]["items"]
    for _ in range(data.draw(st.integers(0, 4))):
        item = {"type": "ComplexItem", "complexItemType": "unheard of", "x": data.draw(values)}
        items.insert(data.draw(st.integers(0, len(items) - 1)), item)
    plan["extra"] = data.draw(values)
    text = json_text(plan)
    document = json_from_text(text, Path("any.plan"))
    draft = plan_draft(document)
    assert [problem.code for problem in draft.problems] == []
    assert len(draft.waypoints) == 11
    assert PlanEdit(document.data).text() == text


def test_moving_changes_two_numbers(survey):
    draft = plan_draft(survey)
    last = draft.waypoints[-1].keys
    corner = ("geoFence", "polygons", 1, "polygon", 2)
    circle = ("geoFence", "circles", 0)
    for keys, changed in (
        (draft.waypoints[0].keys, (*draft.waypoints[0].keys[:-1], 4)),
        (last, (*last[:-1], 4)),
        (draft.rally_points[1].keys, (*draft.rally_points[1].keys, 0)),
        (draft.home.keys, (*draft.home.keys, 0)),
        (corner, (*corner, 0)),
        (circle, (*circle, "circle", "center", 0)),
    ):
        edit = PlanEdit(survey.data)
        edit.move(keys, PLACE)
        found = sorted(changes(survey.data, edit.data), key=str)
        assert found == [changed, (*changed[:-1], changed[-1] + 1)]
        assert [at(edit.data, path) for path in found] == WRITTEN
        assert list(edit.data) == list(survey.data)


def at(data, keys):
    for key in keys:
        data = data[key]
    return data


def test_a_moved_waypoint_is_read_where_it_was_put(survey):
    draft = plan_draft(survey)
    edit = PlanEdit(survey.data)
    edit.move(draft.waypoints[0].keys, PLACE)
    edit.set_altitude(draft.waypoints[-1].keys, 35)
    again = plan_draft(json_from_text(edit.text(), survey.path))
    assert again.frame.to_geodetic(again.waypoints[0].position) == pytest.approx(PLACE, abs=1e-9)
    assert again.waypoints[-1].altitude_m == 35
    assert again.waypoints[1:-1] == draft.waypoints[1:-1]
    found = set(changes(survey.data, edit.data))
    item = draft.waypoints[-1].keys[:3]
    assert {keys[3:] for keys in found if keys[:3] == item} == {
        ("params", 6), ("frame",), ("AltitudeMode",), ("AMSLAltAboveTerrain",)
    }  # fmt: skip


def test_what_a_survey_made_is_not_moved(survey):
    draft = plan_draft(survey)
    edit = PlanEdit(survey.data)
    with pytest.raises(PlanEditError, match="belongs to a survey"):
        edit.move(draft.waypoints[1].keys, PLACE)
    assert edit.data == survey.data


@pytest.mark.parametrize(
    "change",
    [
        lambda edit: edit.move(("mission", "items", 99, "params", 4), PLACE),
        lambda edit: edit.move(("rallyPoints", "points", 7), PLACE),
        lambda edit: edit.move(("geoFence", "circles", 7), PLACE),
        lambda edit: edit.move(("mission",), PLACE),
        lambda edit: edit.set_altitude(("mission", "items", 2, "params", 4), 30),
        lambda edit: edit.remove(("mission", "items", 99)),
        lambda edit: edit.remove(("mission", "plannedHomePosition")),
        lambda edit: edit.remove(("geoFence",)),
    ],
)
def test_what_is_not_there_is_not_changed(survey, change):
    edit = PlanEdit(survey.data)
    with pytest.raises(PlanEditError):
        change(edit)
    assert edit.data == survey.data


def test_adding_and_removing(survey):
    draft = plan_draft(survey)
    edit = PlanEdit(survey.data)
    keys = edit.add_waypoint(PLACE, 33)
    assert keys[2] == len(survey.data["mission"]["items"]) - 1  # before the return
    edit.add_polygon([PLACE, Geodetic(47.004, 8.002), Geodetic(47.004, 8.003)], inclusion=False)
    edit.add_circle(Geodetic(47.004, 8.001), 12, inclusion=False)
    edit.add_rally_point(PLACE)
    again = plan_draft(json_from_text(edit.text(), survey.path))
    assert (len(again.waypoints), len(again.rally_points)) == (12, 3)
    assert again.waypoints[-1].keys == keys
    assert isinstance(again.zones[-1].shape, Circle)
    assert again.zones[-1].shape.radius_m == 12
    numbers = [item.get("doJumpId") for item in edit.data["mission"]["items"]]
    assert numbers[keys[2]] == 1 + numbers[-1]
    edit = PlanEdit(survey.data)
    edit.remove(draft.waypoints[0].keys)
    edit.remove(("mission", "items", 1))  # the whole survey
    edit.remove(("rallyPoints", "points", 0))
    again = plan_draft(json_from_text(edit.text(), survey.path))
    assert (len(again.waypoints), len(again.rally_points)) == (4, 1)


def test_sections_that_are_not_there_are_made():
    plan = {"fileType": "Plan", "mission": {"items": []}}
    edit = PlanEdit(plan)
    edit.add_circle(PLACE, 5, inclusion=True)
    edit.add_rally_point(PLACE, 3)
    assert edit.data["geoFence"]["version"] == edit.data["rallyPoints"]["version"] == 2
    assert edit.data["rallyPoints"]["points"] == [[*WRITTEN, 3]]
    assert "geoFence" not in plan


@pytest.mark.parametrize("path", PLANS, ids=lambda path: path.stem)
def test_a_plan_that_is_written_anew_flies_the_same(path):
    draft = plan_draft(load_json(path))
    warnings = ConversionWarnings()
    text = json_text(plan_of(draft, warnings))
    again = plan_draft(json_from_text(text, path))
    assert again.problems == []
    assert again.notes == []
    assert (again.altitude_m, again.speed_m_s) == (draft.altitude_m, draft.speed_m_s)
    assert again.home_altitude_amsl_m == draft.home_altitude_amsl_m
    for name in ("waypoints", "rally_points"):
        for mine, theirs in zip(getattr(again, name), getattr(draft, name), strict=True):
            assert mine.position == pytest.approx(theirs.position, abs=1e-4)
            assert mine.altitude_m == theirs.altitude_m
    for name in ("fences", "zones"):
        shapes = [[area.shape for area in getattr(each, name)] for each in (again, draft)]
        for mine, theirs in zip(*(sorted(s, key=kind) for s in shapes), strict=True):
            assert mine.polygon.symmetric_difference(theirs.polygon).area < 0.1
    assert warnings.entries == []


def kind(shape):
    return type(shape).__name__, shape.polygon.area
