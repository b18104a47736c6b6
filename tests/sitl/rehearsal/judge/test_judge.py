"""The judge is judged: evidence made by hand, one violation of each kind, and its geometry."""

import dataclasses
import itertools
import json
import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon

from sitl.rehearsal.judge.acceptance import ACCEPTED, End, accepted
from sitl.rehearsal.judge.case import LAND_MODE
from sitl.rehearsal.judge.evidence import (
    AnnouncedLine,
    Evidence,
    Frame,
    Sample,
    SceneEvent,
    SceneEventKind,
    WireMessage,
)
from sitl.rehearsal.judge.mission_reader import Area, read_mission
from sitl.rehearsal.judge.space import room_m
from sitl.rehearsal.judge.verdict import RULES, judge
from tests.imports import imports_in

ROOT = Path(__file__).parents[4]
HOLD, MISSION, RETURN = 0x03040000, 0x04040000, 0x05040000
HOME = (39.9421523, -75.1997644)
FRAME = Frame(HOME)
TEXT = """
coordinates: local
frame: {origin: [39.9421523, -75.1997644]}
home: {position: [0, 0], altitude_amsl_m: 6.7}
altitude_m: 40
speed_m_s: 5
waypoints: [[60, 0], [60, 60], [0, 60]]
fence: [[-100, -100], [200, -100], [200, 200], [-100, 200]]
no_fly_zones:
  - {name: shed, polygon: [[20, 20], [40, 20], [40, 40], [20, 40]]}
  - {name: glider, circle: {centre: [100, 100], radius_m: 10}, altitude: {lower_m: 0, upper_m: 20}}
"""
ROUND = ((0, 0), (60, 0), (60, 60), (0, 60), (0, 0))


def place(east, north):
    latitude, longitude = FRAME.degrees(east, north)
    return {"x": round(latitude * 1e7), "y": round(longitude * 1e7)}


def track(corners=ROUND, height=40.0, *, land=True, step_s=0.05, speed=5.0):
    """A flight around the corners: east, north, height, armed, landed, mode, 20 times a second."""
    states = [(0.0, 0.0, 0.0, False, True, HOLD)] * 20
    rate = step_s * 2.0
    states += [(0.0, 0.0, n * rate, True, n == 0, MISSION) for n in range(int(height / rate))]
    for begin, end in itertools.pairwise(corners):
        steps = max(int(math.dist(begin, end) / speed / step_s), 1)
        for n in range(steps):
            east, north = (a + n / steps * (b - a) for a, b in zip(begin, end, strict=True))
            states.append((east, north, height, True, False, MISSION))
    if land:
        count = int(height / rate)
        states += [(*corners[-1], height - n * rate, True, False, LAND_MODE) for n in range(count)]
        states += [(*corners[-1], 0.0, False, True, HOLD)] * 20
    return states


def past_the_shed(by_m):
    """Along its western side, so far from it."""
    east = 20.0 - by_m
    return track(((0, 0), (east, 0), (east, 60), (0, 60), (0, 0)))


@lru_cache(maxsize=8)  # most tests have a track in common with the one before
def samples(states, failsafe=()):
    """What is written down of a flight's states, a tuple, where a failsafe acts in these times."""
    places = zip(*FRAME.degrees(*np.array([state[:2] for state in states]).T), strict=True)
    found = []
    for number, ((latitude, longitude), state) in enumerate(zip(places, states, strict=True)):
        _, _, above, armed, landed, mode = state
        at_s, acting = number * 0.05, any(a <= number * 0.05 < b for a, b in failsafe)
        found.append(Sample(at_s, latitude, longitude, 6.7 + above, armed, landed, mode, acting))
    return tuple(found)


def polygon(command, corners):
    return [(command, *corner, float(len(corners))) for corner in corners]


FENCE = [
    *polygon(5001, [(-100, -100), (200, -100), (200, 200), (-100, 200)]),
    *polygon(5002, [(20, 20), (40, 20), (40, 40), (20, 40)]),
]


def ours(time_s, name, **fields):
    return WireMessage(time_s, 1, 191, 1, name, fields)


PARAM2 = {178: 5.0, 16: 2.0}  # of the items: the speed, and the acceptance radius


def upload(fence=FENCE, waypoints=ROUND[1:-1], z=40.0, at_s=0.1, param2=PARAM2):
    plan = [(178, 0, 0, 1.0), (22, 0, 0, 0.0), (16, 0, 0, 0.0), *((16, *w, 0.0) for w in waypoints)]
    for kind, items in ((1, fence), (0, plan)):
        yield ours(at_s, "MISSION_COUNT", count=len(items), mission_type=kind)
        sent = []
        for seq, (number, east, north, param1) in enumerate(items):
            fields = {"seq": seq, "command": number, "frame": 6, "z": z, **place(east, north)}
            more = {"param1": param1, "autocontinue": 0, "mission_type": kind}
            more |= {"param2": param2[number]} if number in param2 else {}
            sent.append({**fields, **more})
            yield ours(at_s, "MISSION_ITEM_INT", **sent[-1])
        yield WireMessage(at_s, 1, 1, 1, "MISSION_ACK", {"type": 0, "mission_type": kind})
        for fields in sent:  # read back
            yield WireMessage(at_s + 0.05, 1, 1, 1, "MISSION_ITEM_INT", fields)


def command(time_s, number, **fields):
    return ours(time_s, "COMMAND_LONG", command=number, **fields)


def goto(time_s, east, north, above=40.0):
    return ours(time_s, "COMMAND_INT", command=192, z=6.7 + above, param1=5.0, **place(east, north))


def heart(time_s, mode=MISSION):
    return WireMessage(time_s, 1, 1, 0, "HEARTBEAT", {"custom_mode": mode})


def evidence(states=None, *, messages=(), more=(), code=0, **others):
    states = track() if states is None else states
    wire = list(messages or upload()) + list(more)
    return Evidence(
        scene="by hand",
        faults=frozenset(others.pop("faults", ("NONE",))),
        mission_path=Path("mission.yaml"),
        mission_text=others.pop("text", TEXT),
        samples=samples(tuple(states), others.pop("failsafe", ())),
        messages=tuple(sorted(wire, key=lambda m: m.time_s)),
        lines=tuple(AnnouncedLine(*line) for line in others.pop("announced", ())),
        exit_code=code,
        **others,
    )


def kinds(evidence):
    return {violation.kind for violation in judge(evidence).violations}


def test_a_correct_flight_is_good():
    verdict = judge(evidence())
    assert verdict.good, verdict.violations
    assert verdict.end is End.LANDED
    assert verdict.closest_m == pytest.approx(20.0, abs=0.1)


@pytest.mark.parametrize(("highest_m", "wrong"), [(1.9, set()), (2.1, {"report"})])
def test_what_only_hopped_has_not_landed_from_a_flight(highest_m, wrong):
    hop = [(e, n, min(up, highest_m), *rest) for e, n, up, *rest in track(((0, 0), (0, 1)))]
    assert kinds(evidence(hop, code=1)) & {"report"} == wrong


def test_a_companion_that_crashes_is_a_finding_even_if_the_vehicle_holds():
    holds = track(((0, 0), (60, 0)), land=False)
    ended = [SceneEvent(len(holds) - 1.0, SceneEventKind.ENDED)]
    assert "crash" not in kinds(evidence(holds, code=5, happenings=ended))
    assert "crash" in kinds(evidence(holds, code=70, happenings=ended))
    printed = [(60.0, "Traceback (most recent call last):")]
    assert "crash" in kinds(evidence(holds, code=1, announced=printed, happenings=ended))


NEAR = ((0, 0), (16, 30), (0, 0))
THROUGH = ((0, 0), (10, 30), (50, 30), (10, 30), (0, 0))
OUT = ((0, 0), (-97, 0), (0, 0))
FLOWN = track()
TOO_LOW = [
    (e, n, min(up, 20.0) if 600 < at < 900 else up, *rest)
    for at, (e, n, up, *rest) in enumerate(FLOWN)
]
FALLS = [*track(land=False), *((0, 0, 39.0 - n, False, False, HOLD) for n in range(38))]


@pytest.mark.parametrize(
    ("states", "wrong"),
    [
        (track(NEAR), {"room"}),
        (track(THROUGH), {"room"}),
        (track(OUT), {"room"}),
        (TOO_LOW, {"altitude"}),
        (track(((0, 0), (60, 0))), {"landing", "end", "report"}),
        (track(land=False), {"end", "report"}),
        (FALLS, {"end", "report", "altitude"}),
    ],
)
def test_the_true_track(states, wrong):
    assert kinds(evidence(states)) == wrong


def test_a_corner_that_is_cut_between_two_samples_is_seen():
    states = track(((0, 0), (15, 15)), land=False)
    states += [(15, 19, 40, True, False, MISSION), (25, 45, 40, True, False, MISSION)]
    verdict = judge(evidence(states))
    worst = next(v for v in verdict.violations if v.kind == "room")
    assert "m inside of shed" in worst.text


def test_a_zone_with_altitudes_counts_between_them_only():
    over = ((0, 0), (60, 0), (90, 60), (100, 100), (90, 60), (60, 0), (0, 0))
    assert judge(evidence(track(over))).good
    text = TEXT.replace("upper_m: 20", "upper_m: 50")
    assert "room" in kinds(evidence(track(over), text=text))


def test_altitudes_that_may_be_requested_are_flown_and_commanded():
    lower = evidence(TOO_LOW, more=[goto(30.0, 60, 60, above=20.0)])
    assert kinds(lower) >= {"altitude", "height"}
    wider = dataclasses.replace(lower, mission_text=f"{TEXT}altitudes_m: [20, 40]\n")
    assert not kinds(wider) & {"altitude", "height"}


def test_a_zone_that_the_loader_lost_is_still_there():
    """The fence on board lacks the shed, and so does the route."""
    assert "plan" in kinds(evidence(messages=list(upload(fence=FENCE[:4]))))


@pytest.mark.parametrize(
    "messages",
    [
        upload(z=3.0),
        upload(waypoints=((60, 0), (60, 60))),
        upload(waypoints=((60, 0), (60, 60), (0, 70))),
        upload(fence=FENCE[:7]),
        upload(fence=[*FENCE[:4], *polygon(5002, [(20, 20), (40, 20), (40, 40)])]),
        upload(fence=[*FENCE, *polygon(5002, [(60, 60), (80, 60), (80, 80)])]),
    ],
)
def test_what_is_on_board_is_what_is_in_the_file(messages):
    assert kinds(evidence(messages=list(messages))) == {"plan"}


def test_a_leg_to_an_item_is_as_clear_as_one_to_a_place():
    states = track(((0, 0), (0, 30), (60, 30), (0, 0)))
    jump = ours(26.9, "MISSION_SET_CURRENT", seq=3)  # from (0, 30) beside the shed to (60, 0)
    assert "leg" in kinds(evidence(states, more=[jump]))


@pytest.mark.parametrize(("fails", "wrong"), [(False, {"report"}), (True, set())])
def test_a_failsafe_between_touchdown_and_disarming_ends_the_flight_too(fails, wrong):
    flown = track()
    stands = [(*flown[-1][:3], True, True, LAND_MODE)] * 40
    down_s = (len(flown) - 20) * 0.05
    given = evidence(
        [*flown[:-20], *stands, *flown[-20:]],
        code=1,
        failsafe=((down_s + 1.0, down_s + 2.0),) if fails else (),
    )
    assert kinds(given) & {"report"} == wrong


PILOT = (SceneEvent(30.0, SceneEventKind.PILOT, "sticks"),)
AFTER = [heart(float(at), HOLD) for at in range(1, 90)]


@pytest.mark.parametrize(
    ("message", "wrong"),
    [
        (goto(40.0, 55, 55, above=3.0), "height"),
        (goto(35.0, 0, 50), "leg"),
        (command(30.0, 400, param1=0.0, param2=21196.0), "disarm"),
        (command(89.8, 400, param1=1.0), "rearm"),
        (command(30.0, 178, param2=12.0), "speed"),
        (command(30.0, 179), "stray"),
    ],
)
def test_one_command_that_must_not_be(message, wrong):
    assert wrong in kinds(evidence(more=[message]))


def test_no_command_while_the_pilot_has_it_until_the_operator_requests_it():
    late = command(61.0, 21)
    given = evidence(more=[late, *AFTER], faults=("HAND_BACK",), happenings=PILOT, code=6)
    assert "authority" in kinds(given)
    requested = (*PILOT, SceneEvent(60.0, SceneEventKind.REQUEST, "resume"))
    back = dataclasses.replace(given, happenings=requested, exit_code=0)
    assert "authority" not in kinds(back)
    unaware = dataclasses.replace(
        given, messages=tuple(m for m in given.messages if m.name != "HEARTBEAT")
    )
    assert "authority" not in kinds(unaware)  # it received nothing that shows the mode


@pytest.mark.parametrize(("later_s", "good"), [(0.03, True), (0.1, False)])
def test_a_landing_that_crosses_ours_on_its_way_is_ours(later_s, good):
    """The vehicle lands either way, and reports the same."""
    flown = track()
    begins_s = next(n for n, state in enumerate(flown) if state[5] == LAND_MODE) * 0.05
    pilot = SceneEvent(begins_s - 0.02, SceneEventKind.PILOT, "AUTO_LAND")
    ours_s = begins_s - 0.02 - later_s
    given = evidence(more=[command(ours_s, 21)], faults=("PILOT",), happenings=(pilot,))
    assert judge(given).good == good


@pytest.mark.parametrize(("choice", "good"), [(None, True), ("POSCTL", True), ("sticks", False)])
def test_a_choice_that_the_autopilot_did_not_follow_is_no_takeover(choice, good):
    happenings = () if choice is None else (SceneEvent(30.0, SceneEventKind.PILOT, choice),)
    assert judge(evidence(faults=("PILOT",), happenings=happenings)).good == good


@pytest.mark.parametrize(
    ("at_s", "received_s", "wrong"),
    [(30.5, 30.4, False), (31.5, 30.4, True), (31.5, None, False), (33.0, None, True)],
)
def test_a_place_that_our_next_command_undoes_at_once_was_never_received(at_s, received_s, wrong):
    diverted = (SceneEvent(30.0, SceneEventKind.PILOT, "reposition"),)
    ours_s = [command(at_s, 176, param2=4.0), command(61.0, 21), *AFTER]
    goes = [(29.0, 10, 10)] + ([(received_s, 50, 50)] if received_s else [])
    name = "POSITION_TARGET_GLOBAL_INT"
    messages = []
    for time_s, *to in goes:
        latitude, longitude = FRAME.degrees(*to)
        fields = {"lat_int": round(latitude * 1e7), "lon_int": round(longitude * 1e7)}
        messages.append(WireMessage(time_s, 1, 1, 0, name, fields))
    found = kinds(evidence(more=ours_s, happenings=diverted, received=tuple(messages)))
    assert ("authority" in found) == wrong


@pytest.mark.parametrize(("at_s", "wrong"), [(25.0, True), (74.0, False)])
def test_heights_are_reported_where_it_cruises_with_them(at_s, wrong):
    drifts = (SceneEvent(at_s, SceneEventKind.FAULT, "drift"),)
    assert ("report" in kinds(evidence(faults=("BAROMETER",), happenings=drifts))) == wrong


@pytest.mark.parametrize("announced", [True, False])
def test_a_fence_that_did_not_get_on_board_is_reported(announced):
    drawn = TEXT + "  - {name: new, polygon: [[70, 80], [90, 80], [90, 90], [70, 90]]}\n"
    lines = [(32.0, "the changed fence is not on board: coming home")] if announced else []
    reloaded = (SceneEvent(30.0, SceneEventKind.MISSION_FILE, drawn),)
    assert ("plan" in kinds(evidence(happenings=reloaded, announced=lines))) != announced


def test_no_command_is_repeated_over_a_choice():
    twice = [command(29.0, 176, param2=4.0), command(32.0, 176, param2=4.0)]
    assert "repeat" in kinds(evidence(more=[*twice, heart(29.5)], happenings=PILOT, code=6))
    received = [*twice, heart(31.5)]
    assert "repeat" not in kinds(evidence(more=received, happenings=PILOT, code=6))


def test_no_command_leaves_twice_at_once():
    raised = [command(30.0, 176, param2=4.0, confirmation=n) for n in range(2)]
    assert "repeat" not in kinds(evidence(more=raised))
    assert "repeat" in kinds(evidence(more=raised[:1] * 2))
    jumps = [ours(at_s, "MISSION_SET_CURRENT", seq=3) for at_s in (25.0, 25.01, 25.2)]
    assert "repeat" in kinds(evidence(more=jumps))
    assert "repeat" not in kinds(evidence(more=jumps[1:]))  # decided anew with a position


def test_a_vehicle_in_a_mode_of_the_pilots_is_not_given_back_by_a_request():
    requested = (*PILOT, SceneEvent(60.0, SceneEventKind.REQUEST, "resume"))
    states = [(*s[:5], RETURN if n > 30.0 / 0.05 else s[5]) for n, s in enumerate(track())]
    given = evidence(
        states, more=[command(61.0, 176), *AFTER], faults=("HAND_BACK",), happenings=requested
    )
    assert "authority" in kinds(given)


def test_a_leg_that_a_changed_file_crosses_is_not_flown_on():
    wall = TEXT + "  - {name: wall, polygon: [[30, 55], [33, 55], [33, 80], [30, 80]]}\n"
    happen = (SceneEvent(46.5, SceneEventKind.MISSION_FILE, wall),)  # on its way to (0, 60)
    leg = goto(46.0, 0, 60)
    assert "leg" in kinds(evidence(more=[leg], happenings=happen))
    stopped = command(46.6, 176, param2=4.0, param3=3.0)
    assert "leg" not in kinds(evidence(more=[leg, stopped], happenings=happen))


def test_a_failsafe_is_the_autopilots_and_reported_apart():
    states = track(THROUGH)
    verdict = judge(evidence(states, failsafe=((22.0, 999.0),), faults=("BATTERY",), code=1))
    assert verdict.closest_m > 0.0
    assert {v.kind for v in verdict.violations} <= {"room"}
    assert verdict.end is End.FAILSAFE


def test_a_battery_that_ran_down_though_home_was_near_is_bad():
    charge = [
        WireMessage(float(t), 1, 1, 0, "SYS_STATUS", {"battery_remaining": 60 - t})
        for t in range(60)
    ]
    states = track((*ROUND, *ROUND, *ROUND, *ROUND, *ROUND))
    scene = (SceneEvent(20.0, SceneEventKind.BATTERY, 300.0),)
    end_s = len(states) * 0.05
    late = evidence(
        states,
        more=charge,
        faults=("BATTERY",),
        happenings=scene,
        code=1,
        failsafe=((150.0, end_s),),
    )
    assert kinds(late) == {"battery"}
    soon = dataclasses.replace(late, samples=samples(tuple(states), ((60.0, end_s),)))
    assert kinds(soon) == set()


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"code": 6}, "report"),
        ({"code": 1}, "report"),
        ({"announced": [(30.0, "hands off: the pilot chose Hold mode")]}, "report"),
        ({"faults": ("HOME_MOVED",)}, "report"),  # not announced
        ({"faults": ("UNKNOWN",)}, "evidence"),
    ],
)
def test_what_is_announced_has_to_be_what_happened(change, wrong):
    assert wrong in kinds(evidence(**change))


def test_a_plan_that_a_station_changed_may_be_left_to_it_if_that_is_announced():
    scene = (SceneEvent(30.0, SceneEventKind.FENCE_CHANGED, "deleted"),)
    hovers = track(land=False)
    announced = [(31.0, "hands off: another plan is on board (the fence)")]
    left = evidence(
        hovers, faults=("FENCE_DELETED",), happenings=scene, announced=announced, code=None
    )
    assert judge(left).end is End.PILOT
    assert kinds(left) == set()
    assert "end" in kinds(dataclasses.replace(left, lines=()))


def test_an_estimate_that_jumps_excuses_as_much_and_no_more():
    scene = (SceneEvent(15.0, SceneEventKind.ESTIMATE_OFF, 4.0),)
    near, nearer = (track(((0, 0), (x, 30), (0, 0))) for x in (17.5, 19.5))
    assert kinds(evidence(near, happenings=scene)) == set()
    assert kinds(evidence(nearer, happenings=scene)) == {"room"}


def test_what_is_drawn_where_it_cannot_stop_is_left_and_counts_from_then_on():
    drawn = TEXT.replace(
        "  - {name: glider",
        "  - {name: new, polygon: [[30, -9], [45, -9], [45, 9], [30, 9]]}\n  - {name: glider",
    )
    scene = (SceneEvent(26.0, SceneEventKind.MISSION_FILE, drawn),)
    stops = ((0, 0), (33, 0), (0, 0))
    assert "room" not in kinds(evidence(track(stops), happenings=scene))
    again = ((0, 0), (33, 0), (0, 0), (33, 0), (0, 0))
    assert "room" in kinds(evidence(track(again), happenings=scene))


@pytest.mark.parametrize(
    ("at_s", "requested", "wrong"), [(22.0, False, False), (35.0, False, True), (35.0, True, False)]
)
def test_no_list_is_begun_for_a_vehicle_that_the_pilot_flies(at_s, requested, wrong):
    scene = [SceneEvent(20.0, SceneEventKind.PILOT, "sticks")]
    scene += [SceneEvent(30.0, SceneEventKind.REQUEST, "resume upload")] if requested else []
    count = ours(at_s, "MISSION_COUNT", count=1, mission_type=1)
    flown = evidence(track(), more=[count], happenings=tuple(scene), faults=("STICKS",))
    assert any("a list is put" in v.text for v in judge(flown).violations) is wrong


def test_no_rule_is_lost():
    names = [rule.__name__ for rule in RULES]
    assert len(names) == len(set(names)) >= 60
    assert {"keeps_its_room", "legs_are_clear", "contact_begins_it", "ends_as_it_may"} <= {*names}


def test_every_row_can_be_combined():
    both = accepted(("BATTERY", "KILL", "TWO"))
    assert both.ends == {End.LANDED, End.FAILSAFE, End.HOVERS}
    assert all(row.ends for row in ACCEPTED.values())


CORNERS = st.lists(
    st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=3, max_size=7, unique=True
)
ENDS = st.tuples(st.floats(-80, 80), st.floats(-80, 80))


@given(corners=CORNERS, begin=ENDS, end=ENDS, radius=st.floats(1, 40))
def test_its_geometry_agrees_with_many_points(corners, begin, end, radius):
    shape = Polygon(corners)
    if not shape.is_valid or shape.area < 1.0:
        return
    way = LineString([begin, end])
    points = [way.interpolate(n / 200, normalized=True) for n in range(201)]
    step = way.length / 200 + 1e-6
    outside = [
        shape.distance(p) if not shape.covers(p) else -shape.exterior.distance(p) for p in points
    ]
    room = room_m(Area("zone", shape), way)
    if min(outside) > 0:
        assert min(outside) - step <= room <= min(outside) + 1e-6
    else:
        assert room <= 0.0
        assert room >= min(outside) - 1e-6
    assert (room_m(Area("fence", shape, fence=True), way) >= 0) == shape.covers(way)
    round_m = min(p.distance(Point(0, 0)) for p in points) - radius
    circle = Area("circle", Point(0, 0), radius)
    assert abs(room_m(circle, way) - round_m) <= step
    inner_m = radius - max(p.distance(Point(0, 0)) for p in points)
    assert room_m(dataclasses.replace(circle, fence=True), way) == pytest.approx(inner_m, abs=1e-6)


def test_its_reader_takes_files_of_zones(tmp_path):
    zones = {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": {"name": "mast", "radius_m": 12, "upper_m": 90, "reference": "amsl"},
                "geometry": {"type": "Point", "coordinates": [HOME[1], HOME[0] + 0.001]},
            }
        ],
    }
    (tmp_path / "zones.geojson").write_text(json.dumps(zones), encoding="utf-8")
    path = tmp_path / "mission.yaml"
    path.write_text(TEXT + "no_fly_files: [zones.geojson]\n", encoding="utf-8")
    mission = read_mission(path)
    mast = mission.zones[-1]
    assert (mast.name, mast.radius_m, mast.upper_m) == ("mast", 12.0, 90.0)
    assert mast.outline.y == pytest.approx(111.0, abs=0.2)
    glider = mission.zones[1]
    assert (glider.lower_m, glider.upper_m) == pytest.approx((6.7, 26.7))


def test_the_judge_imports_nothing_of_what_it_judges():
    """Beside the few lines with which a door is opened late."""
    waiting, seen = ["sitl.rehearsal.judge.verdict"], set()
    while waiting:
        module = waiting.pop()
        path = ROOT.joinpath(*module.split(".")).with_suffix(".py")
        path = path if path.exists() else path.with_suffix("") / "__init__.py"
        if module in seen or not path.exists():
            continue
        seen.add(module)
        found = list(imports_in(path.read_text(encoding="utf-8"), deep=True))
        found = [(source, name) for source, name in found if source != "mocha_link.lazy"]
        names = {each for source, name in found for each in (source, f"{source}.{name}")}
        assert not {n for n in names if n.split(".")[0] in {"air_router", "geo", "mocha_link"}}
        packages = {".".join(n.split(".")[:k]) for n in names for k in (1, 2)}
        waiting += [n for n in names | packages if n.split(".")[0] == "sitl"]
    assert len(seen) >= 8


@pytest.mark.parametrize(("off_east_m", "wrong"), [(0.0, False), (20.0, True)])
def test_what_is_read_back_is_what_was_sent(off_east_m, wrong):
    def read_back(item):
        number, spot = item.fields["seq"], {}
        if item.fields["mission_type"] == 0 and number == 4:
            spot = place(60 + off_east_m, 60)
        return WireMessage(0.2, 1, 1, 1, item.name, {**item.fields, **spot})

    back = [read_back(m) for m in upload() if m.name == "MISSION_ITEM_INT"]
    assert ("plan" in kinds(evidence(more=back))) == wrong


def rally_upload(east, north):
    yield ours(0.2, "MISSION_COUNT", count=1, mission_type=2)
    point = {"seq": 0, "command": 5100, "mission_type": 2, **place(east, north)}
    yield ours(0.2, "MISSION_ITEM_INT", **point)
    yield WireMessage(0.2, 1, 1, 1, "MISSION_ACK", {"type": 0, "mission_type": 2})


@pytest.mark.parametrize(("at", "wrong"), [(None, True), ((90, 150), True), ((150, 150), False)])
def test_a_place_to_land_in_need_is_on_board(at, wrong):
    more = [] if at is None else [*rally_upload(*at)]
    for rally, missing in (("[150, 150]", wrong), ("[43, 30]", False)):  # the other is by the shed
        flown = evidence(more=more, text=f"{TEXT}rally_points: [{rally}]\n")
        assert ("plan" in kinds(flown)) == missing
