"""Rules that rest on the wire and on where the vehicle is: one known-bad flight for each."""

import dataclasses

import pytest

from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind, WireMessage
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import (
    PARAM2,
    ROUND,
    TEXT,
    command,
    evidence,
    goto,
    track,
    upload,
)
from tests.sitl.rehearsal.judge.test_judge_inputs import POSITION, between, flight, found

LAND = 21


def texts(flown):
    return " | ".join(str(violation) for violation in judge(flown).violations)


@pytest.mark.parametrize(("age_s", "wrong"), [(1.6, set()), (2.6, {"leg"})])
def test_a_leg_needs_a_position_of_just_now(age_s, wrong):
    spoil = between(60.0 - age_s, 60.0, POSITION)
    assert found(flight(spoil=spoil, more=[goto(59.95, 0, 60)])) == wrong


@pytest.mark.parametrize(
    ("place", "wrong"), [((13.3, 30), False), ((13.9, 30), True), ((0, 60), False)]
)
def test_a_place_that_is_flown_to_keeps_the_tracking_margin(place, wrong):
    flown = evidence(more=[goto(45.0, *place)], text=TEXT)  # from (24, 0), 20 m below the shed
    assert ("routes keep" in texts(flown)) == wrong


def test_a_vehicle_that_is_near_already_may_be_sent_as_near():
    states = track(((0, 0), (14, 0), (14, 60), (0, 60), (0, 0)))
    flown = evidence(states, more=[goto(27.4, 14, 35)])
    assert "routes keep" not in texts(flown)


def landing(at, below="", *, requested=True, others=""):
    """A flight that holds, and lands, there."""
    states = track(((0, 0), at, at))
    commanded_s = 20 * 0.05 + 40 / 2.0 + (at[0] ** 2 + at[1] ** 2) ** 0.5 / 5.0 - 0.1
    announced = [
        (commanded_s, f"{commanded_s:.1f} s  the operator: accepted: it lands where it hovers")
    ]
    requests = (SceneEvent(commanded_s - 0.1, SceneEventKind.REQUEST, "land"),) if requested else ()
    how = {"announced": announced, "happenings": requests, "faults": ("LANDED_HERE",)}
    return evidence(states, more=[command(commanded_s, LAND)], text=TEXT + below + others, **how)


@pytest.mark.parametrize(
    ("below", "wrong"),
    [
        ("", False),
        ("  - {circle: {centre: [75, 0], radius_m: 9}, altitude: {upper_m: 12}}\n", False),
        ("  - {circle: {centre: [74.4, 0], radius_m: 11}, altitude: {upper_m: 12}}\n", True),
        ("  - {circle: {centre: [75, 0], radius_m: 11}, altitude: {lower_m: 60}}\n", False),
    ],
)
def test_it_lands_into_nothing_that_is_below(below, wrong):
    assert ("which is below" in texts(landing((60, 0), below))) == wrong


def test_it_lands_elsewhere_only_if_requested():
    assert "without a request" in texts(landing((60, 0), requested=False))
    assert "without a request" not in texts(landing((60, 0)))


@pytest.mark.parametrize(("altitude_m", "wrong"), [(28, True), (52, False)])
def test_it_lands_through_no_layer_of_another(altitude_m, wrong):
    others = f"uavs: {{titan: {{}}, atlas: {{altitude_m: {altitude_m}, home: [90, 90]}}}}\n"
    assert ("layer of another" in texts(landing((60, 0), others=others))) == wrong
    assert "layer of another" not in texts(landing((1, 0), others=others))  # at home


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (upload(), ""),
        (upload(waypoints=((60, 60), (60, 0), (0, 60))), "item 3 is 60.0 m from its place"),
        (upload(waypoints=((60, 0.42), (60, 60), (0, 60))), "item 3 is 0.4"),
        (upload(z=40.4), "the file has 40.0 m"),
        (upload(param2={**PARAM2, 16: 9.0}), "counts as reached from 9.0 m"),
        (upload(param2={**PARAM2, 178: 5.5}), "the speed on board is 5.50 m/s"),
        (upload(waypoints=(*ROUND[1:-1], (0, 60))), "not speed, take-off, home and every waypoint"),
    ],
)
def test_what_is_on_board_is_in_its_order_and_exact(changed, expected):
    found_texts = texts(evidence(messages=list(changed)))
    assert expected in found_texts
    assert bool(found_texts) == bool(expected)


def test_a_waypoint_is_left_out_only_where_an_area_keeps_it_out():
    left_out = list(upload(waypoints=((60, 0), (0, 0), (0, 60))))
    assert "item 4" in texts(evidence(messages=left_out))
    over = TEXT + "  - {name: new, circle: {centre: [60, 62], radius_m: 6}}\n"
    assert "item 4" not in texts(evidence(messages=left_out, text=over))


@pytest.mark.parametrize(
    ("announced", "wrong"),
    [
        ("wind 6 m/s from west", set()),
        ("wind 6 m/s from north-west", {"report"}),
        ("wind 6 m/s from north", {"report"}),
        ("wind 6 m/s from east", {"report"}),
        ("wind 9 m/s from west", {"report"}),
    ],
)
def test_the_wind_is_announced_as_it_is(announced, wrong):
    blows = [
        WireMessage(50.0 + n / 2, 1, 1, 0, "WIND_COV", {"wind_x": 0.2, "wind_y": 6.0})
        for n in range(20)
    ]
    flown = flight(announced=[(55.0, f"INIT   |  3 s left | {announced}")])
    received = sorted((*flown.received, *blows), key=lambda m: m.time_s)
    assert found(dataclasses.replace(flown, received=received)) == wrong
    assert found(flown) == set()  # nothing is known of it


def low_and_moving(at, goal, speed_m_s=5.0):
    """Flown by a pilot at 12 m to the east, taken back there, and sent to climb."""
    states = track(((0, 0), (5, 0)), land=False)[:1221]
    states = [(e, n, min(z, 12.0), armed, landed, mode) for e, n, z, armed, landed, mode in states]
    at_s = len(states) * 0.05
    count = round(at / speed_m_s / 0.05)
    states += [(at * n / count, 0.0, 12.0, True, False, 0x03040000) for n in range(count)]
    back_s = len(states) * 0.05 - 0.05
    states += [(at + 0.0, 0.0, 12.0, True, False, 0x03040000)] * 100
    happenings = (
        SceneEvent(at_s - 5.0, SceneEventKind.PILOT, "AUTO_LAND"),
        SceneEvent(back_s - 0.1, SceneEventKind.REQUEST, "resume"),
    )
    climb = goto(back_s, *goal)
    return evidence(states, more=[climb], happenings=happenings, faults=("HANDED_BACK_LOW",))


@pytest.mark.parametrize(
    ("goal", "wrong"),
    [
        ((38.0, 0.0), False),
        ((33.0, 0.0), False),
        ((30.0, 0.0), True),  # where it is at 5 m/s
        ((36.0, 6.0), True),
        ((41.0, 0.0), False),  # at 2 m/s2, after 1.2 s
        ((48.0, 0.0), True),
        ((36.0, 0.8), False),  # beside its way
        ((36.0, 2.5), True),
    ],
)
def test_a_climb_begins_where_it_comes_to_rest(goal, wrong):
    assert ("from where it comes to rest" in texts(low_and_moving(30, goal))) == wrong


@pytest.mark.parametrize(("speed_m_s", "wrong"), [(1.8, False), (4.0, True)])
def test_a_slow_vehicle_may_climb_anywhere(speed_m_s, wrong):
    flown = low_and_moving(30, (30.0, 6.0), speed_m_s)
    assert ("from where it comes to rest" in texts(flown)) == wrong


@pytest.mark.parametrize("kind", [0, 1])
def test_every_item_is_read_back_before_it_is_armed(kind):
    def unread(message):
        back = message.component == 1 and message.name == "MISSION_ITEM_INT"
        return back and message.fields["mission_type"] == kind and message.fields["seq"] == 2

    assert "was not read back" not in texts(flight())
    assert f"item 2 of list {kind} on board was not read back" in texts(
        flight(messages=[m for m in upload() if not unread(m)])
    )


@pytest.mark.parametrize(
    ("altitude_m", "high_m", "wrong"), [(28, 15, True), (28, 31, False), (52, 15, False)]
)
def test_what_is_below_the_layer_of_another_is_sent_nowhere(altitude_m, high_m, wrong):
    others = f"uavs: {{titan: {{}}, atlas: {{altitude_m: {altitude_m}, home: [90, 90]}}}}\n"
    flies = True, False, 0x04040000
    for place, away in (((60, 0), True), ((1, 0), False)):  # at home it may climb
        states = [*track(((0, 0), place, place), land=False), *[(*place, high_m, *flies)] * 200]
        at_s = 0.05 * (len(states) - 100)
        flown = evidence(states, more=[goto(at_s, *place)], text=f"{TEXT}{others}")
        assert ("through the layer of another" in texts(flown)) == (wrong and away)
