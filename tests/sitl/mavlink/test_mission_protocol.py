"""The mission microservice beyond the recorded conversations (test_conformance)."""

import math

import pytest

ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED = 0, 1, 2, 3
REQUEST = "MISSION_REQUEST_INT"


def requests(count):
    return [(REQUEST, number) for number in range(count)]


@pytest.fixture
def good(rig):
    rig.run(5)
    items = [
        rig.item(0, 0, 0, 20, 22, current=1),
        rig.item(1, 40, 0, 20),
        rig.item(2, 40, 40, 25),
        rig.item(3, 0, 40, 25),
    ]
    assert rig.upload(items) == [*requests(4), ("ACK", ACCEPTED)]
    rig.run(1.5)
    return rig


def test_an_upload_shows_in_mission_current_within_a_second(good):
    current = good.onboard.last("MISSION_CURRENT")
    assert (current.seq, current.total, current.state, current.mode) == (0, 4, 2, 2)
    assert current.mission_id != 0
    assert current.fence_id == current.rally_id == 0


def test_the_plan_id_is_the_checksum_that_px4_made_of_the_same_items(rig):
    nan = math.nan
    recorded = [
        (0, 6, 22, 1, 1, 0, 0, 0, nan, 473977457, 85455930, 20),
        (1, 6, 16, 0, 1, 0, 0, 0, nan, 473981050, 85455930, 20),
        (2, 6, 16, 0, 1, 2, 0, 0, nan, 473981050, 85461238, 25),
        (3, 6, 16, 0, 1, 0, 0, 0, nan, 473977457, 85461238, 25),
        (4, 6, 16, 0, 1, 0, 0, 0, nan, 473975660, 85458584, 20),
        (5, 2, 20, 0, 1, 0, 0, 0, 0, 0, 0, 0),
    ]
    rig.run(3)
    assert rig.upload([(1, 1, *item, 0) for item in recorded])[-1] == ("ACK", ACCEPTED)
    rig.run(1.5)
    assert rig.onboard.last("MISSION_CURRENT").mission_id == 3270227217


TAKEN = [*requests(2), ("ACK", ACCEPTED)]


def second(result):
    """Refused at the second item."""
    return [*requests(2), ("ACK", result)]


@pytest.mark.parametrize(
    ("up_m", "command", "changes", "expected"),
    [
        pytest.param(20, 16, {"frame": 10}, second(UNSUPPORTED_FRAME), id="terrain frame"),
        pytest.param(20, 16, {"frame": 1}, second(UNSUPPORTED_FRAME), id="local frame"),
        pytest.param(20, 9999, {}, second(UNSUPPORTED), id="unknown command"),
        pytest.param(20, 82, {}, second(UNSUPPORTED), id="spline"),
        pytest.param(20, 16, {"frame": 2}, second(UNSUPPORTED), id="waypoint without a place"),
        pytest.param(20, 16, {"x": 2_000_000_000}, TAKEN, id="lat 200 deg"),
        pytest.param(20, 16, {"x": 0, "y": 0}, TAKEN, id="lat/lon 0,0"),
        pytest.param(math.nan, 16, {}, TAKEN, id="alt nan"),
        pytest.param(-50, 16, {}, TAKEN, id="alt -50"),
        pytest.param(20, 17, {}, TAKEN, id="loiter"),
        pytest.param(0, 178, {"frame": 2}, TAKEN, id="speed"),
        pytest.param(0, 93, {"frame": 2}, TAKEN, id="delay"),
        pytest.param(20, 195, {}, TAKEN, id="region of interest"),
        pytest.param(20, 5002, {}, second(ERROR), id="fence vertex in a mission"),
    ],
)
def test_items_taken_and_refused(rig, up_m, command, changes, expected):
    rig.run(5)
    first = rig.item(0, 0, 0, 20, 22)
    assert rig.upload([first, rig.item(1, 40, 0, up_m, command, **changes)]) == expected


@pytest.mark.parametrize(
    ("items", "event"),
    [
        (lambda rig: [rig.item(0, 40, 0, 20), rig.item(1, 0, 0, 20, 22)], "takeoff_not_first"),
        (lambda rig: [rig.item(0, 0, 0, 0, 21)], "starts_w_landing"),
        (lambda rig: [rig.item(0, 0, 0, -3, 22)], "takeoff_too_low"),
    ],
)
def test_a_mission_that_cannot_be_flown_is_accepted_and_only_an_event_tells(rig, items, event):
    rig.run(5)
    assert rig.upload(items(rig))[-1] == ("ACK", ACCEPTED)
    rig.ground.clear()
    rig.run(1.5)
    assert rig.onboard.said(f"navigator_mis_{event}")
    assert rig.onboard.last("MISSION_CURRENT").state == 1
    assert rig.ground.texts() == []


def test_two_links_cannot_upload_at_once(good):
    good.send("mission_count", 1, 1, 2, 0)
    good.ground.clear()
    good.send("mission_count", 1, 1, 2, 0, link="ground")
    assert good.ground.last("MISSION_ACK").type == ERROR


def test_another_vehicles_plan_is_not_ours(good):
    good.onboard.clear()
    for target in ((2, 1), (0, 0), (1, 33)):
        good.send("mission_request_list", *target, 0)
    assert good.onboard.all("MISSION_COUNT") == []


def test_time_outs_are_on_the_wall_clock_when_the_simulation_is_fast(make_rig):
    rig = make_rig(speed=10)
    rig.run(5)
    rig.onboard.clear()
    rig.send("mission_count", 1, 1, 3, 0)
    rig.run(20)  # two wall seconds
    assert len(rig.onboard.all(REQUEST)) in (8, 9)
