"""The judge about robots: what they sent and took, and what the companion made of it."""

import dataclasses
import json

import pytest

from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind
from sitl.rehearsal.judge.mission_reader import read_mission
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import (
    FRAME,
    HOLD,
    TEXT,
    command,
    evidence,
    goto,
    heart,
)
from tests.sitl.rehearsal.judge.test_judge_inputs import HOVERS

HERE = HOVERS[1500][:2]
"""Where it stands from 70 s to 90 s."""

MORE = """
timers: {search_s: 10, communicate_s: 8}
seek: [io, europa]
goals_from: [europa]
"""


def pose(robot, at=HERE, **fields):
    latitude, longitude = FRAME.degrees(*at)
    body = {"stamp_s": 1.0, "latitude_deg": latitude, "longitude_deg": longitude, **fields}
    return robot, "/pose", json.dumps(body).encode()


def goals(robot, last=HERE, **fields):
    body = {"stamp_s": 5.0, "id": "1", "points": [FRAME.degrees(*last)], **fields}
    return robot, "/goals", json.dumps(body).encode()


def synced(at_s, way="in", began_s=None, robot="io", messages=()):
    began_s = at_s - 1.0 if began_s is None else began_s
    return SceneEvent(at_s, SceneEventKind.SYNCED, (robot, way, began_s, list(messages)))


def changes(*states, robot="io"):
    """The mission's states, and when each begins; that it seeks io is announced as well."""
    before = "READY"
    for at_s, state in states:
        yield at_s, f"  {at_s:.1f} s  {before} -> {state}"
        before = state
        if state == "SEARCH":
            yield at_s, f"  {at_s:.1f} s  SEARCH {robot}: its last position"


def found(  # noqa: PLR0913 - what a flight may differ in
    *states, happenings, robot="io", also=(), more=(), flown=HOVERS, text=TEXT + MORE
):
    announced = [*changes((10.0, "INIT"), *states, robot=robot), *also]
    flown = evidence(flown, announced=announced, more=more)
    flown = dataclasses.replace(
        flown, mission_text=text, happenings=[MET, *happenings], uav="titan"
    )
    return [str(v) for v in judge(flown).violations if v.kind in {"contact", "goals"}]


MET = synced(1.0, robot="ariel")
MEETS = ((60.0, "SEARCH"), (75.0, "COMM"), (77.5, "EXPL"))
RECEIVED = synced(75.0, messages=[pose("io")])
BOTH = (RECEIVED, synced(77.5, began_s=76.0), synced(77.4, "out", began_s=76.0))


def test_who_is_met_and_exchanged_with_is_left():
    assert not found(*MEETS, happenings=BOTH)


@pytest.mark.parametrize(
    ("states", "happenings", "expected"),
    [
        (MEETS, BOTH[1:], "COMM begins"),
        (MEETS, (synced(75.0, robot="europa", messages=[pose("io")]), *BOTH[1:]), "COMM begins"),
        (MEETS, (synced(75.0, messages=[pose("io", (0, 2e6))]), *BOTH[1:]), "COMM begins"),
        (
            MEETS,
            (synced(75.0, messages=[pose("io", stamp_s=float("nan"))]), *BOTH[1:]),
            "COMM begins",
        ),
        (MEETS, BOTH[:2], "COMM ends after 2.5 s"),
        (MEETS, (*BOTH[:2], synced(77.4, "out", began_s=70.0)), "COMM ends after 2.5 s"),
        (MEETS, (*BOTH[:2], synced(77.4, "out", robot="europa")), "COMM ends after 2.5 s"),
        ((*MEETS[:2], (80.0, "EXPL")), BOTH, "goes on"),
        ((*MEETS[:2], (88.0, "EXPL")), BOTH[:1], "goes on"),
    ],
)
def test_contact_begins_it_and_exchange_ends_it(states, happenings, expected):
    assert any(expected in text for text in found(*states, happenings=happenings))


@pytest.mark.parametrize(
    ("messages", "good"),
    [
        ([pose("io")], True),
        ([pose("io", (HERE[0] - 10.0, HERE[1]))], True),
        ([pose("io", (HERE[0] - 40.0, HERE[1]))], False),
        ([pose("io", (HERE[0] - 40.0, HERE[1])), pose("io", stamp_s=9.0)], True),
        ([pose("io", (0, 2e6))], False),
        ([], False),
    ],
)
def test_it_waits_at_the_last_position_of_the_robot_or_at_a_waypoint(messages, good):
    waits = ((60.0, "SEARCH"), (85.0, "EXPL"))
    received = [synced(50.0, robot="europa", messages=messages)]
    arrives = [(75.0, "at the search position of io")]
    assert bool(found(*waits, happenings=received, also=arrives)) is not good


@pytest.mark.parametrize(("lower_m", "good"), [(90.0, False), (20.0, True)])
def test_where_it_waits_only_what_applies_there_keeps_it_from_a_robot(lower_m, good):
    """A zone far above it does not; one at its height leaves no place near the robot."""
    circle = f"circle: {{centre: [{HERE[0] - 40.0}, {HERE[1]}], radius_m: 38}}"
    zone = f"  - {{name: sky, {circle}, altitude: {{lower_m: {lower_m}}}}}\n"
    waits = ((60.0, "SEARCH"), (85.0, "EXPL"))
    messages = [pose("io", (HERE[0] - 40.0, HERE[1]))]
    received = [synced(50.0, robot="europa", messages=messages)]
    arrives = [(75.0, "at the search position of io")]
    texts = found(*waits, happenings=received, also=arrives, text=TEXT + zone + MORE)
    assert bool(texts) is not good


@pytest.mark.parametrize(("started_s", "good"), [(40.0, False), (55.0, True)])
def test_a_companion_that_was_started_since_knows_no_earlier_positions(started_s, good):
    waits = ((60.0, "SEARCH"), (85.0, "EXPL"))
    messages = [pose("io", (HERE[0] - 40.0, HERE[1]))]
    started = SceneEvent(started_s, SceneEventKind.STARTED)
    received = [started, synced(50.0, robot="europa", messages=messages)]
    arrives = [(75.0, "at the search position of io")]
    texts = found(*waits, happenings=received, also=arrives)
    assert any("its last position" in text for text in texts) is not good


@pytest.mark.parametrize(("every_s", "bad"), [(0.4, True), (1.0, True), (1.5, False), (2.0, False)])
def test_no_robot_sends_it_about_many_times_a_second(every_s, bad):
    stays = (*MEETS[:2], (83.5, "EXPL"))
    sent = [goto(75.1 + every_s * n, HERE[0] + n % 2, HERE[1]) for n in range(6)]
    texts = found(*stays, happenings=(RECEIVED,), more=[m for m in sent if m.time_s < 83.5])
    assert any("sent to 6 places" in text for text in texts) is bad


def test_a_place_that_a_robot_cannot_have_driven_to_is_none_to_wait_at():
    waits = ((60.0, "SEARCH"), (85.0, "EXPL"))
    jumps = [pose("io"), pose("io", (HERE[0] - 60.0, HERE[1]), stamp_s=2.0)]
    received = [synced(50.0, robot="europa", messages=jumps)]
    arrives = [(75.0, "at the search position of io")]
    assert not found(*waits, happenings=received, also=arrives)


WAITS = ((60.0, "SEARCH"), (85.0, "EXPL"))
ARRIVES = [(75.0, "at the search position of io")]


def handed_over(*messages):
    """Another robot handed these messages over."""
    return [synced(50.0, robot="europa", messages=messages)]


@pytest.mark.parametrize(("away_m", "good"), [(22.0, True), (24.0, False)])
def test_over_a_robot_in_a_zone_it_hovers_as_near_as_that_allows(away_m, good):
    """3 m of the zone, 5 m of clearance, 1.5 m of margin, 8 m to drive, and 5 m of slack."""
    place = (HERE[0] + away_m, HERE[1])
    zone = f"  - {{circle: {{centre: [{place[0]}, {place[1]}], radius_m: 3}}}}\n"
    messages = handed_over(pose("io", place))
    assert (
        bool(found(*WAITS, happenings=messages, also=ARRIVES, text=TEXT + zone + MORE)) is not good
    )


@pytest.mark.parametrize(("jump_m", "believed"), [(14.0, True), (20.0, False)])
def test_a_robot_drives_six_metres_a_second_and_its_position_is_ten_off(jump_m, believed):
    """It hovers where the robot was a second ago."""
    messages = handed_over(pose("io"), pose("io", (HERE[0] - jump_m, HERE[1]), stamp_s=2.0))
    assert bool(found(*WAITS, happenings=messages, also=ARRIVES)) is believed


@pytest.mark.parametrize(("speed_m_s", "good"), [(0.8, True), (0.3, False)])
def test_what_moves_follows_a_robot(speed_m_s, good):
    moves = [
        (east + speed_m_s * (n - 1400) / 20, *rest) if 1400 <= n < 1800 else (east, *rest)
        for n, (east, *rest) in enumerate(HOVERS)
    ]
    messages = handed_over(pose("io", (HERE[0] - 40.0, HERE[1])))
    assert bool(found(*WAITS, happenings=messages, also=ARRIVES, flown=moves)) is not good


@pytest.mark.parametrize(("later_s", "good"), [(0.6, True), (1.6, False)])
def test_contact_begins_within_a_second_of_a_robots_position(later_s, good):
    meets = (MEETS[0], (75.0 + later_s, "COMM"), MEETS[2])
    texts = found(*meets, happenings=BOTH)
    assert any("COMM begins" in text for text in texts) is not good


@pytest.mark.parametrize(("away_m", "good"), [(5e3, True), (20e3, False)])
def test_no_robot_is_farther_away_than_ten_kilometres(away_m, good):
    received = synced(75.0, messages=[pose("io", (0, away_m))])
    texts = found(*MEETS, happenings=(received, *BOTH[1:]))
    assert any("COMM begins" in text for text in texts) is not good


@pytest.mark.parametrize(("until_s", "good"), [(78.6, True), (80.5, False)])
def test_contact_ends_within_a_second_and_a_half_of_the_exchange(until_s, good):
    texts = found(*MEETS[:2], (until_s, "EXPL"), happenings=BOTH)
    assert any("goes on" in text for text in texts) is not good


@pytest.mark.parametrize(("lasts_s", "good"), [(20.0, True), (30.0, False)])
def test_contact_lasts_for_twenty_seconds_without_a_time_in_the_file(lasts_s, good):
    """What is exchanged just before its end would end it as well."""
    over_s = 75.0 + lasts_s - 0.1
    exchanged = [synced(over_s, way, began_s=76.0) for way in ("in", "out")]
    text = TEXT + MORE.replace(", communicate_s: 8", "")
    texts = found(
        *MEETS[:2], (75.0 + lasts_s, "EXPL"), happenings=(RECEIVED, *exchanged), text=text
    )
    assert any("goes on" in text for text in texts) is not good


@pytest.mark.parametrize(("later_s", "good"), [(8.0, True), (20.0, False)])
def test_goals_are_flown_to_within_twelve_seconds(later_s, good):
    goes = ((59.9 + later_s, "GOTO"), (88.0, "EXPL"))
    texts = found(*goes, happenings=[synced(59.9, messages=[goals("europa")])])
    assert any("not flown to" in text for text in texts) is not good


GOES = ((60.0, "GOTO"), (88.0, "EXPL"))


@pytest.mark.parametrize(
    ("states", "message", "expected"),
    [
        (GOES, goals("europa"), ""),
        (GOES, goals("io"), "no robot that may send it"),
        (GOES, goals("europa", to="another"), "no robot that may send it"),
        (GOES, goals("europa", until_s=4.0), "no robot that may send it"),
        (GOES, goals("europa", (-30.0, 0.0)), "from the last of the points"),
        (((60.0, "SEARCH"),), goals("europa"), "not flown to"),
        (((60.0, "SEARCH"),), goals("io"), ""),
    ],
)
def test_only_goals_of_named_robots_are_flown_to(states, message, expected):
    wrong = found(*states, happenings=[synced(59.9, messages=[message])])
    assert expected in "".join(wrong)
    assert bool(wrong) is bool(expected)


TWO = """
uavs:
  titan: {}
  zephyr: {altitude_m: 52, home: [150, 0]}
"""


def test_several_uavs_have_layers_and_climb_corridors(tmp_path):
    low = read_mission(tmp_path / "m.yaml", TEXT + TWO, "titan")
    assert low.layer_top_m == pytest.approx(46.0)
    corridor = low.zones[-1]
    assert corridor.radius_m == pytest.approx(10.0)
    assert corridor.polygon.centroid.x == pytest.approx(150.0, abs=0.5)
    high = read_mission(tmp_path / "m.yaml", TEXT + TWO, "zephyr")
    assert high.layer_top_m == float("inf")
    assert len(high.zones) == len(low.zones) - 1


@pytest.mark.parametrize(("up_m", "good"), [(44.0, True), (49.0, False)])
def test_above_its_layer_a_vehicle_is_not_given_back(up_m, good):
    states = [
        (e, n, up_m if 1400 <= at < 1800 else up, armed, landed, HOLD if at >= 1400 else mode)
        for at, (e, n, up, armed, landed, mode) in enumerate(HOVERS)
    ]
    happenings = [
        SceneEvent(70.0, SceneEventKind.PILOT, "AUTO_LOITER"),
        SceneEvent(80.0, SceneEventKind.REQUEST, "resume"),
    ]
    hearts = [heart(at_s, HOLD) for at_s in (71.0, 79.0)]
    flown = evidence(states, more=[*hearts, command(81.0, 176)], faults=("HAND_BACK",))
    flown = dataclasses.replace(flown, mission_text=TEXT + TWO, happenings=happenings, uav="titan")
    assert ("authority" in {v.kind for v in judge(flown).violations}) is not good
