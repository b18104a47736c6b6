"""The judge of zones with terms of their own, and of what is on board among changed zones."""

import itertools
import math

import pytest
import yaml

from air_router.mission.loading import load_mission
from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind
from sitl.rehearsal.judge.mission_reader import read_mission
from sitl.rehearsal.judge.space import way_home_m
from sitl.rehearsal.judge.verdict import judge
from sitl.rehearsal.mission_file import MissionFile, hurried, with_room
from sitl.rehearsal.zone_terms import OVER_RALLY, with_terms
from tests.sitl.rehearsal.judge.test_judge import (
    AFTER,
    FENCE,
    MISSION,
    PILOT,
    ROOT,
    ROUND,
    TEXT,
    command,
    evidence,
    kinds,
    ours,
    polygon,
    rally_upload,
    track,
    upload,
)
from tests.sitl.rehearsal.judge.test_judge_inputs import flight

FILE = yaml.safe_load(TEXT)
PENNOVATION = ROOT / "missions" / "pennovation" / "mission.yaml"


@pytest.mark.parametrize("drawn_into", [False, True])
def test_the_zones_of_a_rehearsal_are_read_alike(tmp_path, drawn_into):
    document = hurried(PENNOVATION)
    document = with_room(document) if drawn_into else document
    text = yaml.safe_dump(with_terms(document, wide=not drawn_into))
    path = tmp_path / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    mission, raw = load_mission(path), read_mission(path)
    assert [zone.name for zone in mission.airspace.zones] == [
        area.name for area in raw.cruised if not area.fence
    ]
    assert {idle.zone.name for idle in mission.idle_zones} == {"under it", "expired", "over it"}
    assert mission.cruise.lower_m + 550.0 == raw.cruise_m[0]
    assert {zone.name for zone in mission.with_all_zones(50.0).airspace.zones} == {
        area.name for area in raw.at_every_height.cruised if not area.fence
    }
    wide = [area.name for area in raw.zones if area.clearance_m > raw.clearance_m]
    assert wide == ([] if drawn_into else ["zone 8"])


DOUBTED = "coming home: the altitude is in doubt: 40 m by the autopilot, 48 m by the satellites"
TRUSTED = "coming home, clear of zones by PX4's altitude alone: the battery is at its reserve"


@pytest.mark.parametrize(
    ("announced", "limits", "wrong"),
    [
        ([], {"lower_m": 60}, False),
        ([(30.0, DOUBTED)], {"lower_m": 60}, True),
        ([(30.0, DOUBTED)], {"upper_m": 20}, True),
        ([(30.0, DOUBTED)], {"lower_m": 96}, False),
        ([(30.0, DOUBTED), (31.0, TRUSTED)], {"lower_m": 60}, False),
        ([(58.0, DOUBTED)], {"lower_m": 60}, False),  # it has passed by
    ],
)
def test_with_the_altitude_in_doubt_room_is_kept_whatever_the_height(announced, limits, wrong):
    zone = {"name": "more", "polygon": [[57, 30], [63, 30], [63, 36], [57, 36]], "altitude": limits}
    text = yaml.safe_dump({**FILE, "no_fly_zones": [*FILE["no_fly_zones"], zone]})
    assert ("room" in kinds(evidence(text=text, announced=announced))) == wrong


def test_what_is_drawn_takes_a_rally_point(tmp_path):
    document = with_terms(with_room(hurried(PENNOVATION)))
    file = MissionFile(tmp_path / "mission.yaml", document)
    assert file.circle(file.mission.waypoints[3].position, 5.0)
    drawn = load_mission(file.path, in_flight=True)
    assert OVER_RALLY in [zone.name for zone in drawn.zones]
    assert len(drawn.landings) == len(drawn.rally_points) - 1


@pytest.mark.parametrize(
    ("terms", "counts"),
    [
        ({"altitude": {"lower_m": 60, "reference": "ground"}}, True),
        ({"altitude": {"lower_m": 60}}, False),
        ({"altitude": {"upper_m": 41, "reference": "amsl"}}, False),
        ({"altitude": {"upper_m": 42, "reference": "amsl"}}, True),
        ({"active": [{"until": "2001-01-01T00:00:00Z"}]}, False),
        ({"active": [{"from": "2001-01-01T00:00:00Z"}]}, True),
    ],
)
def test_a_zone_is_on_board_if_it_applies_where_the_mission_cruises(terms, counts):
    zone = {"name": "more", "polygon": [[60, 80], [80, 80], [80, 90], [60, 90]], **terms}
    text = yaml.safe_dump({**FILE, "no_fly_zones": [*FILE["no_fly_zones"], zone]})
    for fence in (FENCE, [*FENCE, *polygon(5002, zone["polygon"])]):
        there = fence is not FENCE
        wrong = kinds(evidence(messages=list(upload(fence=fence)), text=text))
        assert ("plan" in wrong) == (there != counts)


@pytest.mark.parametrize(("spot", "wrong"), [((30, 30), True), ((60, 60), False)])
def test_it_is_not_taken_back_in_a_zone(spot, wrong):
    states = [(*spot, *s[2:]) if 600 < n < 760 else s for n, s in enumerate(track())]
    requested = (*PILOT, SceneEvent(35.0, SceneEventKind.REQUEST, "resume"))
    back = [command(36.0, 176, param2=4.0), *AFTER]
    verdict = judge(evidence(states, more=back, faults=("HAND_BACK",), happenings=requested))
    assert any("taken back" in violation.text for violation in verdict.violations) == wrong


@pytest.mark.parametrize(("at_s", "wrong"), [(30.0, True), (72.0, False)])
def test_another_fence_waits_until_it_stands(at_s, wrong):
    hold = command(at_s, 176, param2=4.0, param3=3.0)
    count = ours(at_s + 0.5, "MISSION_COUNT", count=4, mission_type=1)
    states = [*track(land=False), *([(0.0, 0.0, 40.0, True, False, MISSION)] * 200)]
    assert ("plan" in kinds(evidence(states, more=[hold, count], code=None))) == wrong


STOP = {"param2": 4.0, "param3": 3.0}


@pytest.mark.parametrize(
    ("at_s", "order", "wrong"),
    [
        (30.1, STOP, True),  # it had been decided on, and the lists wait until it stands
        (30.5, STOP, False),  # requested meanwhile: its way was clear
        (30.5, {"param2": 4.0, "param3": 4.0}, False),  # a leg from before that had to wait
        (31.2, {"param2": 4.0, "param3": 4.0}, True),  # so late is none
    ],
)
def test_what_leaves_as_the_lists_are_begun_had_been_decided_on_before(at_s, order, wrong):
    """They begin at 30 s with a look at the items on board; a stop was commanded long before."""
    leg = [] if order is STOP else [command(29.0, 176, **STOP)]
    begun = [command(at_s, 176, **order), ours(30.0, "MISSION_REQUEST_LIST", mission_type=0)]
    count = ours(31.5, "MISSION_COUNT", count=4, mission_type=1)
    assert ("plan" in kinds(evidence(more=[*leg, *begun, count], code=None))) is wrong


def test_without_its_fence_on_board_it_comes_home():
    announced = [(32.0, "the changed fence is not on board: refused")]
    assert kinds(evidence(announced=announced)) == set()
    assert kinds(evidence(track(ROUND * 3), announced=announced)) == {"home"}


@pytest.mark.parametrize(
    ("happening", "line", "excused"),
    [
        (
            (25.0, SceneEventKind.FENCE_CHANGED, "added"),
            "hands off: another plan is on board",
            True,
        ),
        ((25.0, SceneEventKind.FENCE_CHANGED, "added"), "holding", False),
        ((95.0, SceneEventKind.FENCE_CHANGED, "added"), "hands off: another plan", False),
        ((25.0, SceneEventKind.FAULT, "reload"), "hands off: another plan is on board", False),
    ],
)
def test_what_is_left_to_the_pilot_over_anothers_fence_does_not_come_home(happening, line, excused):
    announced = [(32.0, "the changed fence is not on board: it is another's"), (33.0, line)]
    flown = evidence(track(ROUND * 3), announced=announced, happenings=(SceneEvent(*happening),))
    assert ("home" in kinds(flown)) is not excused


@pytest.mark.parametrize(
    ("at_s", "sent", "requested_s", "wrong"),
    [
        (31.0, "MISSION_COUNT", None, True),
        (31.0, "MISSION_CLEAR_ALL", None, True),
        (30.1, "MISSION_COUNT", None, False),  # it cannot be known yet
        (31.0, "MISSION_REQUEST_LIST", None, False),
        (31.0, "MISSION_COUNT", 30.5, False),  # the operator wants ours there
        (31.0, "MISSION_COUNT", 29.0, True),
    ],
)
def test_no_list_of_ours_follows_one_that_a_station_has_stored(at_s, sent, requested_s, wrong):
    scene = [SceneEvent(30.0, SceneEventKind.LIST_STORED, "fence")]
    scene += (
        [] if requested_s is None else [SceneEvent(requested_s, SceneEventKind.REQUEST, "reload")]
    )
    begins = ours(at_s, sent, count=4, mission_type=2)
    flown = flight(more=[begins], happenings=tuple(scene), reaction_s=0.004)
    texts = str(judge(flown).violations)
    assert ("a list is begun, though a station stored its fence" in texts) is wrong


def test_nothing_is_armed_over_a_list_that_a_station_has_stored():
    stored = (SceneEvent(0.2, SceneEventKind.LIST_STORED, "mission"),)
    flown = flight(more=[command(0.9, 400, param1=1.0)], happenings=stored, reaction_s=0.004)
    assert "armed, though a station stored its mission" in str(judge(flown).violations)


def test_no_rally_point_stays_in_a_zone():
    over = {"name": "over", "circle": {"centre": [150, 150], "radius_m": 2}}
    circle = [(5004, 150, 150, 2.0)]
    for zones, wrong in (([], False), ([over], True)):
        document = {**FILE, "no_fly_zones": [*FILE["no_fly_zones"], *zones]}
        sent = [*upload(fence=[*FENCE, *(circle if zones else ())]), *rally_upload(150, 150)]
        flown = evidence(messages=sent, text=yaml.safe_dump(document))
        assert ("plan" in kinds(flown)) == wrong


@pytest.mark.parametrize(
    ("place", "corners"),
    [
        ((60.0, 0.0), []),  # in sight
        ((46.0, 46.0), [(46.0, 15.0)]),  # behind the shed: around a corner of what is kept from it
        ((30.0, 41.0), [(40.0, 45.0), (45.0, 40.0), (45.0, 20.0), (40.0, 15.0)]),  # too near to it
    ],
)
def test_the_shortest_way_home_goes_around_what_is_in_the_way(tmp_path, place, corners):
    raw = read_mission(tmp_path / "mission.yaml", TEXT)
    shortest_m = way_home_m(raw, place)
    assert shortest_m >= math.hypot(*place) - 0.5
    assert way_home_m(raw, place, 2.0) >= shortest_m - 0.5
    if not corners:
        assert shortest_m == pytest.approx(math.hypot(*place), abs=0.1)
        return
    around = [place, *corners, (0.0, 0.0)]
    around_m = sum(math.dist(a, b) for a, b in itertools.pairwise(around))
    assert shortest_m <= around_m + 1.0
    assert shortest_m > math.hypot(*place) + 1.0


def test_behind_a_wall_from_fence_to_fence_there_is_no_way_home(tmp_path):
    wall = "  - {name: wall, polygon: [[48, -100], [50, -100], [50, 200], [48, 200]]}\n"
    raw = read_mission(tmp_path / "mission.yaml", f"{TEXT}{wall}")
    assert way_home_m(raw, (60.0, 0.0)) == math.inf
    assert way_home_m(raw, (30.0, 0.0)) == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize(
    ("turns_s", "others", "wrong"),
    [
        (24, "", False),
        (42, "", True),
        (42, "uavs: {titan: {}, atlas: {altitude_m: 52, home: [150, 0]}}\n", False),
        (54, "uavs: {titan: {}, atlas: {altitude_m: 52, home: [150, 0]}}\n", True),
    ],
)
def test_a_way_home_takes_what_the_shortest_clear_one_does_and_some_turns(turns_s, others, wrong):
    """From 45 m in sight of home it may take 18 s, and 25 s for turns; straight it takes 9 s.

    Of several UAVs each has corridors of others in its way, and may take 27 s instead of 18 s.
    """
    circles = [(45, 0), *[(45, 15), (45, 0)] * (turns_s // 6), (0, 0)]
    flown = track(((0, 0), (60, 0), (60, 60), (60, 0), *circles))
    announced = [(61.0, "61.0 s  coming home: the battery, as it reports")]
    found = flight(flown, announced=announced, text=f"{TEXT}{others}")
    assert ("home" in {v.kind for v in judge(found).violations}) == wrong


@pytest.mark.parametrize(
    ("zone", "again", "wrong"),
    [
        ("[[50, 50], [70, 50], [70, 70], [50, 70]]", None, True),
        ("[[50, 63], [70, 63], [70, 70], [50, 70]]", None, True),  # within the clearance
        ("[[50, 66], [70, 66], [70, 70], [50, 70]]", None, False),
        ("[[50, 50], [70, 50], [70, 70], [50, 70]]", ((60, 0), (0, 0), (0, 60)), False),
    ],
)
def test_no_waypoint_stays_on_board_that_a_zone_is_drawn_over(zone, again, wrong):
    drawn = SceneEvent(25.0, SceneEventKind.MISSION_FILE, f"{TEXT}  - {{polygon: {zone}}}\n")
    more = [] if again is None else [*upload(waypoints=again, at_s=40.0)]
    flown = evidence(track(ROUND * 2), more=more, happenings=(drawn,))
    assert ("or beside it" in str(judge(flown).violations)) == wrong


@pytest.mark.parametrize(
    ("back_s", "sent_s", "wrong"),
    [
        (35.0, None, True),
        (35.0, 76.0, False),  # when it has been ours again for less than 45 s
        (None, None, False),  # never given back
    ],
)
def test_what_is_drawn_is_on_board_once_a_pilot_has_given_it_back(back_s, sent_s, wrong):
    ring = [(50, 50), (70, 50), (70, 70), (50, 70)]
    zone = f"  - {{polygon: {[[*corner] for corner in ring]}}}\n"
    scene = [SceneEvent(25.0, SceneEventKind.MISSION_FILE, TEXT + zone)]
    scene.append(SceneEvent(27.0, SceneEventKind.PILOT, "sticks"))
    more = []
    if back_s is not None:
        scene.append(SceneEvent(back_s, SceneEventKind.REQUEST, "resume"))
        more.append(command(back_s + 1.0, 176, param2=4.0, param3=4.0))
    if sent_s is not None:
        fence, left = [*FENCE, *polygon(5002, ring)], ((60, 0), (0, 0), (0, 60))
        more += upload(fence=fence, waypoints=left, at_s=sent_s)
    flown = evidence(
        track(ROUND * 3), more=[*more, *AFTER], faults=("HAND_BACK",), happenings=scene
    )
    assert ("that the file closes" in str(judge(flown).violations)) == wrong


@pytest.mark.parametrize(("lower_m", "closest_m"), [(39.8, -0.2), (30.0, -10.0), (5.0, -15.0)])
def test_how_deep_it_is_in_a_wide_zone_is_how_far_out_of_it_is(lower_m, closest_m):
    """A vehicle that touches the floor of a zone a kilometre wide is not a kilometre deep in it."""
    edges = [[-1000, -15], [1000, -15], [1000, 15], [-1000, 15]]
    wide = {"name": "wide", "polygon": edges, "altitude": {"lower_m": lower_m}}
    text = yaml.safe_dump({**FILE, "no_fly_zones": [wide]})
    assert judge(evidence(text=text)).closest_m == pytest.approx(closest_m, abs=0.3)
