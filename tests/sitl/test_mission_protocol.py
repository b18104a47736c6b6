"""The mission microservice, conversation by conversation as a real PX4 1.17 had it."""

import math

import pytest

ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE = 0, 1, 2, 3, 4
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


def test_a_refused_upload_leaves_the_mission_as_it_was(good):
    before = good.onboard.last("MISSION_CURRENT").mission_id
    good.ground.clear()
    bad = [good.item(0, 0, 0, 20), good.item(1, 0, 0, 20, 9999)]
    assert good.upload(bad, link="ground")[-1] == ("ACK", UNSUPPORTED)
    good.run(1.5)
    assert good.onboard.last("MISSION_CURRENT").mission_id == before
    assert "IGN MISSION_ITEM: Invalid item" in good.ground.texts()
    assert good.onboard.said("mavlink_mission_mis_item_invalid")


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


@pytest.mark.parametrize(("sent", "comes_back"), [(0, 5), (5, 5), (3, 6), (6, 6)])
def test_frames_come_back_as_px4_stores_them(rig, sent, comes_back):
    rig.run(5)
    yaw = (0, 1.5, 7, -90)
    assert rig.upload([rig.item(0, 10, 0, 500, frame=sent, params=yaw)])[-1] == ("ACK", ACCEPTED)
    rig.send("mission_request_list", 1, 1, 0)
    assert rig.onboard.last("MISSION_COUNT").count == 1
    rig.send("mission_request_int", 1, 1, 0, 0)
    item = rig.onboard.last("MISSION_ITEM_INT")
    assert item.frame == comes_back
    assert (item.param2, item.param3, item.param4) == (1.5, 0, 270)  # param3 means nothing to it
    rig.send("mission_ack", 1, 1, 0, 0)


def test_a_download_left_open_blocks_uploads_for_five_seconds(good):
    good.send("mission_request_list", 1, 1, 0, link="ground")
    good.ground.clear()
    good.send("mission_count", 1, 1, 2, 0, link="ground")
    assert good.ground.last("MISSION_ACK").type == ERROR
    good.run(4.5)
    assert "WPM: IGN MISSION_COUNT: Busy" in good.ground.texts()
    assert "Operation timeout" not in good.ground.texts()
    good.run(1.0)
    assert "Operation timeout" in good.ground.texts()
    assert good.upload([good.item(0, 1, 1, 20)])[-1] == ("ACK", ACCEPTED)


def test_a_silent_uploader_is_asked_four_times_a_second_and_given_up_without_an_answer(good):
    good.ground.clear()
    good.send("mission_count", 1, 1, 3, 0, link="ground")
    good.run(6)
    asked = [at_s for at_s, message in good.ground.heard if "REQUEST_INT" in str(message)]
    assert len(asked) in (19, 20, 21)  # PX4: every 0.26 s for 5 s
    assert asked[-1] - asked[0] == pytest.approx(5, abs=0.3)
    assert good.ground.texts() == ["Operation timeout"]
    assert good.ground.all("MISSION_ACK") == []
    assert good.onboard.last("MISSION_CURRENT").total == 4


def test_a_wrong_sequence_is_ignored_and_asked_for_again(good):
    good.onboard.clear()
    good.send("mission_count", 1, 1, 3, 0)
    good.send("mission_item_int", *good.item(2, 0, 0, 20))
    good.run(1)
    assert {message.seq for message in good.onboard.all(REQUEST)} == {0}


def test_a_float_item_changes_the_kind_of_the_next_request(good):
    good.onboard.clear()
    good.send("mission_count", 1, 1, 3, 0)
    good.send("mission_item", 1, 1, 0, 3, 16, 0, 1, 0, 0, 0, math.nan, 47.3, 8.5, 20, 0)
    good.run(0.6)
    assert [message.seq for message in good.onboard.all("MISSION_REQUEST")] == [1, 1, 1]


def test_the_last_item_again_is_acknowledged_again(good):
    good.onboard.clear()
    good.send("mission_item_int", *good.item(3, 0, 40, 25))
    assert good.onboard.last("MISSION_ACK").type == ACCEPTED
    good.send("mission_item_int", *good.item(1, 0, 40, 25))
    assert good.onboard.last("MISSION_ACK").type == ERROR


def test_too_many_and_unknown_kinds_find_no_space(good):
    for count, kind in ((20000, 0), (2, 7), (65, 1)):
        good.onboard.clear()
        good.send("mission_count", 1, 1, count, kind)
        assert good.onboard.last("MISSION_ACK").type == NO_SPACE


def test_requests_without_a_list_are_ignored(good):
    good.onboard.clear()
    for sequence in (99, 1):
        good.send("mission_request_int", 1, 1, sequence, 0)
    good.send("mission_request", 1, 1, 1, 0)
    assert not [name for name in good.onboard.names() if name.startswith("MISSION_ITEM")]


def test_set_current_has_no_answer_but_mission_current(good):
    good.onboard.clear()
    good.send("mission_set_current", 1, 1, 2)
    good.run(1.1)
    current = good.onboard.last("MISSION_CURRENT")
    assert (current.seq, current.total, current.state) == (2, 4, 2)
    assert set(good.onboard.names()) & {"MISSION_ACK", "COMMAND_ACK"} == set()


def test_set_current_out_of_range_is_only_said(good):
    good.ground.clear()
    good.send("mission_set_current", 1, 1, 77, link="ground")
    good.run(0.1)
    assert good.ground.texts() == ["WPM: WP CURR CMD: Not in list"]
    assert good.onboard.said("mavlink_mission_seq_out_of_bounds")
    assert good.command(224, 1) == [3]  # DO_SET_MISSION_CURRENT comes after 1.17


def test_set_current_is_dropped_while_the_same_link_downloads(good):
    good.send("mission_request_list", 1, 1, 0)
    good.onboard.clear()
    good.send("mission_set_current", 1, 1, 2)
    good.run(1.1)
    assert good.onboard.last("MISSION_CURRENT").seq == 0
    assert good.onboard.said("mavlink_mission_state_busy")
    good.send("mission_ack", 1, 1, 0, 0)
    good.send("mission_set_current", 1, 1, 2)
    good.run(0.1)
    assert good.onboard.last("MISSION_CURRENT").seq == 2


@pytest.mark.parametrize("how", ["clear", "count"])
def test_clear(good, how):
    good.onboard.clear()
    if how == "clear":
        good.send("mission_clear_all", 1, 1, 0)
    else:
        good.send("mission_count", 1, 1, 0, 0)
    assert good.onboard.last("MISSION_ACK").type == ACCEPTED
    good.run(1.1)
    current = good.onboard.last("MISSION_CURRENT")
    assert (current.seq, current.total, current.state) == (0, 65535, 1)
    good.send("mission_request_list", 1, 1, 0)
    good.send("mission_request_list", 1, 1, 1)
    assert [message.count for message in good.onboard.all("MISSION_COUNT")] == [0, 0]


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


def test_a_fence_goes_up_and_comes_back(rig):
    rig.run(5)
    corners = [(40, -20), (40, 20), (60, 20), (60, -20)]
    assert rig.upload(rig.fence(corners), 1) == [*requests(4), ("ACK", ACCEPTED)]
    rig.run(1.5)
    assert rig.onboard.last("MISSION_CURRENT").fence_id != 0
    rig.send("mission_request_list", 1, 1, 1)
    assert rig.onboard.last("MISSION_COUNT").count == 4
    rig.send("mission_request_int", 1, 1, 0, 1)
    vertex = rig.onboard.last("MISSION_ITEM_INT")
    assert (vertex.command, vertex.param1, vertex.mission_type) == (5002, 4, 1)


def test_a_polygon_of_two_is_refused_and_an_inconsistent_one_is_not(rig):
    rig.run(5)
    assert rig.upload(rig.fence([(40, 0), (60, 0)]), 1) == [(REQUEST, 0), ("ACK", ERROR)]
    corners = [(40, -20), (40, 20), (60, 20), (60, -20)]
    assert rig.upload(rig.fence(corners, count=7), 1)[-1] == ("ACK", ACCEPTED)


def test_time_outs_are_on_the_wall_clock_when_the_simulation_is_fast(make_rig):
    rig = make_rig(speed=10)
    rig.run(5)
    rig.onboard.clear()
    rig.send("mission_count", 1, 1, 3, 0)
    rig.run(20)  # two wall seconds
    assert len(rig.onboard.all(REQUEST)) in (8, 9)
