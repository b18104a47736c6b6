"""Every way that we know to write a mission wrong: one problem, at its place, with its code.

And whatever stands in a file: a mission, or problems with places and codes; no crash.
"""

import contextlib
import copy
import json
import re
import tempfile
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.files.json_document import value_at
from air_router.mission.loading import load_mission
from mocha_link.team.document import Document, DocumentError
from tests.air_router.files.values import values_in

MONDAY = datetime(2026, 11, 23, 10, tzinfo=UTC)
FILE = (Path(__file__).parents[2] / "data" / "files" / "every-key.yaml").read_text(encoding="utf-8")


def problems(folder, text):
    path = folder / "mission.yaml"
    path.write_text(text)
    with pytest.raises(DocumentError) as caught:
        load_mission(path, start=MONDAY)
    return caught.value.problems


def test_the_file_itself_is_in_order(tmp_path):
    path = tmp_path / "mission.yaml"
    path.write_text(FILE)
    mission = load_mission(path, start=MONDAY)
    assert len(mission.fences) == 2
    assert [len(zone.shape.holes) for zone in mission.zones[:1]] == [1]
    assert mission.notes == ()


HALL, HOLES = "[[-20, 20], [20, 20], [20, 40], [-20, 40]]", "[[[-90, 60], [-60, 60], [-60, 90]]]"
RING = "[[-99, -99], [99, -99], [99, 99], [-99, 99]]"
MAST = "{name: mast, circle: {centre: [50, -50], radius_m: 10}"

WRONG = [
    ("altitude_m: 30", "altitude_m: §high", "wrong-type"),
    ("altitude_m: 30", "altitude_m: §-3", "out-of-range"),
    ("altitude_m: 30", "altitude_m: §.nan", "wrong-value"),
    ("altitude_m: 30", "altitude_m: 30\n§altitude_m: 31", "repeated-key"),
    ("speed_m_s: 4", "speed_m_s: §400", "out-of-range"),
    ("speed_m_s: 4", "speed_m_s: §0.9", "out-of-range"),
    ("speed_m_s: 4", "§sped_m_s: 4", "unknown-key"),
    ("speed_m_s: 4", "altitudes_m: §[30]", "wrong-length"),
    ("speed_m_s: 4", "altitudes_m: [30, §0]", "out-of-range"),
    ("speed_m_s: 4", "altitudes_m: §[60, 30]", "out-of-range"),
    ("duration_s: 600", "duration_s: §0", "out-of-range"),
    ("coordinates: local", "coordinates: §metres", "unknown-word"),
    ("frame: {origin: [38.5, -98.5]}", "frame: §{}", "missing-key"),
    ("frame: {origin: [38.5, -98.5]}", "frame: {origin: §[38.5]}", "wrong-length"),
    ("frame: {origin: [38.5, -98.5]}", "frame: {origin: §[98.5, 38]}", "not-on-earth"),
    ("local\nframe: {origin: [38.5, -98.5]}", "§local", "frame-missing"),
    ("altitude_amsl_m: 300", "altitude_amsl_m: §30000", "out-of-range"),
    ("battery_reserve: 0.3", "battery_reserve: §30", "out-of-range"),
    ("kind: waypoints", "kind: §fastest", "unknown-word"),
    ("battery_reserve: 0.3", "accepts: [§rtl_crosses]", "unknown-word"),
    ("tracking_margin_m: 1.5", "tracking_margin_m: §0", "out-of-range"),
    ("max_edge_m: 100", "vertical_margin_m: §1", "out-of-range"),
    ("  - [50, 0]", "  - §[50]", "wrong-length"),
    ("  - [50, 0]", "  - §{altitude_m: 20}", "missing-key"),
    ("  - [50, 0]", "  - §[1e308, 0]", "not-on-earth"),
    ("[[-99, -99]", "[§[-99e9, -99]", "not-on-earth"),
    ("{position: [50, 50]", "{position: §[50, 0]", "same-place"),
    ("  - [50, 0]", "  - §[15, 30]", "waypoint-in-zone"),
    ("  - [50, 0]", "  - §[120, 0]", "waypoint-outside-fence"),
    ("  - [50, 0]", "  - §[-65, 65]", "waypoint-outside-fence"),
    ("  - [50, 0]", "  - §[95, 0]", "waypoint-too-near"),
    ("altitude_m: 25", "altitude_m: §0", "out-of-range"),
    ("[-50, -50]]", "§[50, -50]]", "rally-point-in-zone"),
    ("[-50, -50]]", "§[50, -66]]", "rally-point-too-near"),
    ("[-50, -50]]", "§[-150, -50]]", "rally-point-outside-fence"),
    ("position: [0, 0]", "position: §[0, 17]", "home-too-near"),
    ("position: [0, 0]", "position: §[50, -50]", "home-in-zone"),
    ("radius_m: 150", "radius_m: §0", "out-of-range"),
    ("fences:\n  ", "fence: null\nfences:\n  §", "one-fence-key"),
    (RING, "§[[-99, -99], [99, -99], [-99, 99], [99, 99]]", "zone-self-intersects"),
    (HOLES, "§[[[-90, 60], [-60, 160], [-60, 90]]]", "holes-touch"),
    (HOLES, "§[[[200, 200], [210, 200], [210, 210]]]", "hole-outside-ring"),
    (HALL, "§[[-20, 20], [20, 20]]", "zone-too-few-corners"),
    (HALL, "§[[-20, 20], [20, 20], [30, 20]]", "zone-no-area"),
    (HALL, "§[[-20, 20], [20, 40], [20, 20], [-20, 40]]", "zone-self-intersects"),
    ("[[[-10, 25], [10, 25], [10, 35]]]", "§[[[-10, 25], [10, 25], [10, 45]]]", "holes-touch"),
    ("clearance_m: 4\n", "clearance_m: §-4\n", "out-of-range"),
    ("{name: mast", "§{name: hall", "same-name"),
    ("{name: mast", "§{name: fence", "same-name"),
    ("{name: mast", "§{name: mast, polygon: [[1, 2], [3, 4], [5, 9]]", "one-shape"),
    (MAST, "§{name: mast", "one-shape"),
    (MAST, "§{name: mast, circle: {centre: [50, -95], radius_m: 10}", "zone-crosses-fence"),
    ("{centre: [50, -50], radius_m: 10", "§{radius_m: 10", "missing-key"),
    (MAST, f"§{MAST}, holes: [[[1, 2], [2, 2], [2, 3]]]", "one-shape"),
    ("{name: m", "§{altitude: {lower_m: 2, upper_m: 1}, name: m", "zone-altitudes-inverted"),
    ("reference: ground", "reference: §sea", "unknown-word"),
    ('from: "2026-01-01T00:00:00Z"', 'from: §"2026-01-01"', "not-a-time"),
    ('from: "2026-01-01T00:00:00Z"', 'from: §"2026-01-01T00:00:00"', "not-a-time"),
    ('from: "2026-01-01T00:00:00Z"', "from: §2026", "not-a-time"),
    ('{from: "2026-01-01T00:00:00Z"', '§{from: "2100-01-01T00:00:00Z"', "ends-before-start"),
    ("[{days: [mon]", "[{days: [§moon]", "not-a-day"),
    ('between: ["08:00", "18:00"]', 'between: [§"8:00", "18:00"]', "not-a-time"),
    ('between: ["08:00", "18:00"]', 'between: ["08:00", §"24:30"]', "not-a-time"),
    ('between: ["08:00", "18:00"]', 'between: §["08:00"]', "wrong-length"),
    ('[{days: [mon], between: ["08:00", "18:00"]}]', "§[]", "wrong-length"),
    ("battery_reserve: 0.3", "no_fly_files: [§nowhere.geojson]", "no-such-file"),
    ("battery_reserve: 0.3", "no_fly_files: [§{allow: [x]}]", "missing-key"),
    ("battery_reserve: 0.3", "team: §nowhere.yaml", "no-such-file"),
    ("battery_reserve: 0.3", f"team: §{'far' * 100}.yaml", "no-such-file"),
    ("battery_reserve: 0.3", f"world: §{'far' * 100}.yaml", "no-such-file"),
    ("battery_reserve: 0.3", f"no_fly_files: [§{'far' * 100}.kml]", "no-such-file"),
    ("battery_reserve: 0.3", "no_fly_files: [§.]", "no-such-file"),
    ("battery_reserve: 0.3", 'name: §"\\udc00"', "wrong-value"),
    ("battery_reserve: 0.3", "seek: §[a, a]", "named-twice"),
]
"""What is changed into what, with a mark (§) at the problem's place, and its code."""


@pytest.mark.parametrize(("before", "after", "code"), WRONG)
def test_one_mistake_is_one_problem(tmp_path, before, after, code):
    assert FILE.count(before) == 1
    begin, mark, end = FILE.replace(before, after).partition("§")
    (problem,) = problems(tmp_path, begin + end)
    assert problem.code == code
    if mark:
        place = (begin.count("\n") + 1, len(begin.rpartition("\n")[2]) + 1)
        assert (problem.line, problem.column) == place
    else:  # the problem is in another file, the one that is named
        assert problem.path.name in after
    assert problem.message[0].islower() or problem.message[0] == "'"
    assert not problem.message.endswith(".")


def test_far_off_places_are_reported_once_each(tmp_path):
    text = FILE.replace("  - [50, 0]", "  - [99e3, 0]").replace("[-50, -50]]", "[0, -70e3]]")
    text = text.replace("centre: [50, -50]", "centre: [50e3, -50e3]")
    found = [(p.line, p.column, p.code) for p in problems(tmp_path, text)]
    assert found == [(*place, "far-from-home") for place in ((8, 5), (21, 5), (22, 16))]


@pytest.mark.parametrize(
    "shape",
    ["polygon: [[46, 6], [48, 8], [46, 10]]", "circle: {centre: [48.0, 8.0], radius_m: 112000}"],
)
def test_a_zone_that_may_cross_the_fence_may_be_large_but_not_far(tmp_path, shape):
    text = (
        "home: [47.0, 8.0]\naltitude_m: 20\nwaypoints: [[47.001, 8.0]]\nfence: null\n"
        f"no_fly_zones: [{{{shape}, crosses_fence: true}}]\n"
    )
    assert "far-from-home" not in [problem.code for problem in problems(tmp_path, text)]
    far = text.replace("46, ", "49, ").replace("radius_m: 11", "radius_m: 1")
    assert [problem.code for problem in problems(tmp_path, far)] == ["far-from-home"]


def test_a_frame_whose_origin_is_far_is_refused(tmp_path):
    text = (
        "frame: {origin: [60.0, 8.0]}\nhome: [47.0, 8.0]\naltitude_m: 20\n"
        "waypoints: [[47.001, 8.0]]\nfence: [[46.9, 7.9], [47.1, 7.9], [47.1, 8.1], [46.9, 8.1]]\n"
        "no_fly_zones: []\n"
    )
    (problem,) = problems(tmp_path, text)
    assert (problem.line, problem.code) == (1, "far-from-home")
    assert "origin is 1447 km from home" in problem.message


@pytest.mark.parametrize(("latitude", "away"), [(60.0, 0.5), (80.0, 0.25), (-80.0, 0.25)])
def test_near_a_pole_the_origin_has_to_be_nearer(tmp_path, latitude, away):
    text = (
        f"frame: {{origin: [{latitude}, 8.0]}}\nhome: [{latitude + away}, 8.0]\naltitude_m: 20\n"
        f"waypoints: [[{latitude + away + 0.001}, 8.0]]\nfence: null\nno_fly_zones: []\n"
    )
    assert [problem.code for problem in problems(tmp_path, text)] == ["far-from-home"]


def test_in_degrees_a_crossing_is_reported_in_degrees(tmp_path):
    found = problems(
        tmp_path,
        "home: [47.0, 8.0]\naltitude_m: 20\nwaypoints: [[47.001, 8.0]]\nfence: null\n"
        "no_fly_zones: [[[47.01, 8.01], [47.02, 8.02], [47.01, 8.02], [47.02, 8.01]]]\n",
    )
    assert [problem.code for problem in found] == ["zone-self-intersects"]
    assert "(self-intersection) near 47.015" in found[0].message


def test_while_the_planner_cannot_be_read_no_distance_is_made_up(tmp_path):
    text = FILE.replace("clearance_m: 5,", "clearance_m: five,").replace("- [50, 0]", "- [15, 30]")
    inside, unread = problems(tmp_path, text)
    assert (inside.code, unread.code) == ("waypoint-in-zone", "wrong-type")
    assert inside.message.endswith("; move it out")


def test_with_home_and_the_first_waypoint_wrong_the_others_are_looked_at(tmp_path):
    text = "altitude_m: 20\nwaypoints: [47.0, [47.001, 8.0], [47.001, 8.0]]\nfence: null\n"
    found = problems(tmp_path, f"home: [47.0]\n{text}no_fly_zones: []\n")
    assert [problem.code for problem in found] == ["wrong-length", "wrong-type", "same-place"]


GOOD = Document.from_text(FILE, Path("mission.yaml")).data

numbers = st.sampled_from([0, -1, 1e-9, 89.9999, 181, 1e7, 1e18, 1e308, -1e308, 5e-324])
texts = st.sampled_from(
    ["", "x", "fence", "home", "null", "2026-11-20T08:00:00Z", "08:00", "é\n#: [", "ground"]
)
junk = st.recursive(
    st.none() | st.booleans() | numbers | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=2),
    max_leaves=6,
)


SPOTS = [keys for keys, _ in values_in(GOOD) if keys]


@given(st.lists(st.tuples(st.sampled_from(SPOTS), st.booleans(), junk), min_size=1, max_size=3))
def test_any_value_in_any_place_is_read_or_refused(changes):
    data = copy.deepcopy(GOOD)
    for keys, drop, value in changes:
        with contextlib.suppress(TypeError, LookupError):  # an earlier change took it away
            parent = value_at(data, keys[:-1])
            parent[keys[-1]] = value
            if drop:
                del parent[keys[-1]]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mission.yaml"
        path.write_text(json.dumps(data, ensure_ascii=False), encoding="utf-8")
        mission, problems = None, ()
        try:
            mission = load_mission(path, start=MONDAY)
        except DocumentError as error:
            problems = error.problems
    for problem in problems:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", problem.code)
        assert (problem.line, problem.column) >= (1, 1)
    if mission is None:
        assert problems
        return
    margin_m = mission.planner.tracking_margin_m
    for waypoint in mission.waypoints:
        assert mission.planning_airspace.point_clear(waypoint.position)
    assert mission.climb_airspace.with_margin(margin_m).point_clear(mission.home)
