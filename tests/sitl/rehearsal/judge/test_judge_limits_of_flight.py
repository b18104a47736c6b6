"""The judge's limits of plans, landings, wind and ends: just within is good, just beyond is not.

As in `test_judge_limits`; each pair lies less than a factor of three from the limit.
"""

import dataclasses

import pytest

from sitl.rehearsal.judge.acceptance import End
from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind, WireMessage
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import (
    FENCE,
    FRAME,
    MISSION,
    PARAM2,
    PILOT,
    ROUND,
    TEXT,
    command,
    evidence,
    goto,
    ours,
    past_the_shed,
    polygon,
    track,
    upload,
)
from tests.sitl.rehearsal.judge.test_judge_inputs import (
    CRUISES,
    FLOWN,
    HOVERS,
    LONG,
    between,
    flight,
)

STOP = {"param2": 4.0, "param3": 3.0}


def texts(flown):
    return " | ".join(str(violation) for violation in judge(flown).violations)


# What is on board.


@pytest.mark.parametrize(("off_m", "wrong"), [(0.8, False), (2.4, True)])
def test_a_strip_of_a_zone_may_be_open_on_board(off_m, wrong):
    """0.6 m from either side."""
    shed = polygon(5002, [(20 + off_m, 20), (40, 20), (40, 40), (20 + off_m, 40)])
    found = texts(evidence(messages=list(upload(fence=[*FENCE[:4], *shed]))))
    assert ("m2 are open" in found) == wrong


DRAWN = TEXT + "  - {name: new, polygon: [[70, 80], [90, 80], [90, 90], [70, 90]]}\n"


@pytest.mark.parametrize(("later_s", "wrong"), [(30.0, False), (70.0, True)])
def test_a_changed_file_is_on_board_within_forty_five_seconds(later_s, wrong):
    reloaded = (SceneEvent(40.0, SceneEventKind.MISSION_FILE, DRAWN),)
    fence = [*FENCE, *polygon(5002, [(70, 80), (90, 80), (90, 90), (70, 90)])]
    again = list(upload(fence=fence, at_s=40.0 + later_s))
    found = texts(evidence(LONG, more=again, happenings=reloaded))
    assert ("the fence on board" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(15.0, False), (30.0, True)])
def test_anothers_fence_is_known_to_be_one_within_twenty_seconds(later_s, wrong):
    changed = (SceneEvent(30.0, SceneEventKind.FENCE_CHANGED, "deleted"),)
    leg = goto(30.0 + later_s, 60, 60)
    assert (
        "the fence on board is another" in texts(evidence(more=[leg], happenings=changed))
    ) == wrong


@pytest.mark.parametrize(("received_s", "wrong"), [(30.06, False), (30.2, True)])
def test_what_is_received_a_tenth_of_a_second_later_was_sent_after_it(received_s, wrong):
    """The next MISSION_CURRENT comes at 35 s."""
    stored = (SceneEvent(30.0, SceneEventKind.LIST_STORED, "fence"),)
    messages = [WireMessage(s, 1, 1, 0, "MISSION_CURRENT", {"seq": 1}) for s in (received_s, 35.0)]
    begins = ours(33.0, "MISSION_COUNT", count=4, mission_type=2)
    flown = evidence(more=[begins], happenings=stored, received=tuple(messages))
    assert ("though a station stored its fence" in texts(flown)) == wrong


@pytest.mark.parametrize(
    ("count_s", "orders", "wrong"),
    [
        (50.0, [goto(29.0, 0, 0), command(35.0, 176, **STOP)], False),  # one renewal
        (75.0, [goto(29.0, 0, 0), command(35.0, 176, **STOP)], True),  # another
        (32.0, [goto(29.0, 0, 0), command(30.1, 176, **STOP)], True),  # had been decided on
        (32.0, [goto(29.0, 0, 0), command(30.3, 176, **STOP)], False),
        (34.0, [command(29.0, 176, **STOP), goto(30.6, 0, 0)], False),
        (34.0, [command(29.0, 176, **STOP), goto(32.0, 0, 0)], True),
    ],
)
def test_a_renewal_takes_thirty_seconds_and_orders_of_before_leave_at_once(count_s, orders, wrong):
    begun = ours(30.0, "MISSION_REQUEST_LIST", mission_type=0)
    count = ours(count_s, "MISSION_COUNT", count=4, mission_type=1)
    found = texts(evidence(FLOWN, more=[begun, count, *orders], code=None))
    assert ("another fence is put on board" in found) == wrong


@pytest.mark.parametrize(
    ("changed", "wrong"),
    [
        (upload(z=40.1), False),
        (upload(z=40.4), True),
        (upload(param2={**PARAM2, 178: 5.01}), False),
        (upload(param2={**PARAM2, 178: 5.04}), True),
    ],
)
def test_heights_and_speeds_on_board_are_those_of_the_file(changed, wrong):
    found = texts(evidence(messages=list(changed)))
    assert ("the file has" in found or "the speed on board is" in found) == wrong


# Legs, climbs, landings.


@pytest.mark.parametrize(("received_s", "wrong"), [(58.2, False), (58.0, True)])
def test_a_leg_leaves_on_a_position_of_the_last_two_seconds(received_s, wrong):
    """1.9 s, with a second to react."""
    spoil = between(received_s + 0.1, 60.3, "GLOBAL_POSITION_INT")
    flown = flight(spoil=spoil, more=[goto(60.05, 0, 60)])
    assert ("after the last position came" in texts(flown)) == wrong


@pytest.mark.parametrize(("keeps_m", "wrong"), [(6.5, False), (6.1, True)])
def test_of_a_tracking_margin_thirty_centimetres_may_be_missing(keeps_m, wrong):
    """6.7 m are kept with it."""
    leg = goto(45.0, 20.0 - keeps_m, 30)
    assert ("routes keep" in texts(evidence(more=[leg]))) == wrong


@pytest.mark.parametrize(("keeps_m", "wrong"), [(5.0, False), (3.0, True)])
def test_who_is_near_may_be_sent_a_metre_and_a_half_nearer(keeps_m, wrong):
    leg = goto(27.4, 20.0 - keeps_m, 35)  # 6 m from the shed
    assert ("routes keep" in texts(evidence(past_the_shed(6.0), more=[leg]))) == wrong


@pytest.mark.parametrize(("north", "wrong"), [(22, False), (35, True)])
def test_a_place_within_twelve_metres_is_one_to_stop_at(north, wrong):
    leg = goto(26.2, 14.5, north)  # from (11, 15)
    assert ("routes keep" in texts(evidence(past_the_shed(9.0), more=[leg]))) == wrong


@pytest.mark.parametrize(("home_m", "wrong"), [(4.0, False), (8.0, True)])
def test_a_landing_within_three_metres_of_where_home_is_reached_needs_no_request(home_m, wrong):
    states = track(((0, 0), (home_m, 0), (home_m, 0)))
    at_s = 21.0 + home_m / 5.0
    found = texts(evidence(states, more=[command(at_s, 21)], code=None))
    assert ("without a request" in found) == wrong


def hovering(until_s):
    """At (60, 0) from 33 s on."""
    return [*FLOWN[:660], *[FLOWN[660]] * round((until_s - 33.0) / 0.05)]


@pytest.mark.parametrize(("later_s", "wrong"), [(2.5, False), (5.0, True)])
def test_a_landing_follows_a_request_within_three_seconds(later_s, wrong):
    requested = (SceneEvent(40.0, SceneEventKind.REQUEST, "land"),)
    land = command(40.0 + later_s, 21)
    found = texts(evidence(hovering(60.0), more=[land], happenings=requested, code=None))
    assert ("without a request" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(12.0, False), (30.0, True)])
def test_a_landing_is_commanded_again_within_twenty_seconds(later_s, wrong):
    requested = (SceneEvent(40.0, SceneEventKind.REQUEST, "land"),)
    lands = [command(at_s, 21) for at_s in (40.5, 40.5 + later_s)]
    found = texts(evidence(hovering(90.0), more=lands, happenings=requested, code=None))
    assert ("without a request" in found) == wrong


@pytest.mark.parametrize(("radius_m", "wrong"), [(10.3, False), (11.0, True)])
def test_what_is_below_a_landing_keeps_its_clearance_but_half_a_metre(radius_m, wrong):
    """15 m from the middle of the zone."""
    zone = f"  - {{circle: {{centre: [75, 0], radius_m: {radius_m}}}, altitude: {{upper_m: 12}}}}\n"
    requested = (SceneEvent(40.0, SceneEventKind.REQUEST, "land"),)
    flown = evidence(
        hovering(60.0), more=[command(40.5, 21)], happenings=requested, text=TEXT + zone, code=None
    )
    assert ("which is below" in texts(flown)) == wrong


@pytest.mark.parametrize(("height_m", "wrong"), [(27.0, False), (24.5, True)])
def test_a_vehicle_is_below_a_layer_that_is_two_metres_above_it(height_m, wrong):
    others = "uavs: {titan: {}, atlas: {altitude_m: 28, home: [90, 90]}}\n"
    states = [*hovering(40.0), *[(60, 0, height_m, True, False, MISSION)] * 200]
    flown = evidence(states, more=[goto(45.0, 60, 0)], text=TEXT + others)
    assert ("through the layer of another" in texts(flown)) == wrong


# The wind.


@pytest.mark.parametrize(
    ("east_m_s", "north_m_s", "until_s", "announced", "wrong"),
    [
        (6.0, 0.0, 54.9, "5 m/s from west", False),
        (7.5, 0.0, 54.9, "5 m/s from west", True),
        (5.5, 2.5, 54.9, "6 m/s from west", False),  # by 24 degrees
        (3.0, 5.2, 54.9, "6 m/s from west", True),  # by 60 degrees
        (0.0, 1.5, 54.9, "2 m/s from west", False),  # hardly any
        (0.0, 4.0, 54.9, "4 m/s from west", True),
        (9.0, 0.0, 53.0, "5 m/s from west", True),
        (9.0, 0.0, 50.0, "5 m/s from west", False),  # it is not known any more
    ],
)
def test_the_wind_is_announced_to_a_metre_and_a_half_a_second(
    east_m_s, north_m_s, until_s, announced, wrong
):
    fields = {"wind_x": north_m_s, "wind_y": east_m_s}
    received = [WireMessage(until_s - n / 2, 1, 1, 0, "WIND_COV", fields) for n in range(9, -1, -1)]
    flown = evidence(
        announced=[(55.0, f"INIT   |  3 s left | wind {announced}")], received=tuple(received)
    )
    found = texts(flown)
    assert (" is announced, it " in found) == wrong


# Ends, and who has it.


@pytest.mark.parametrize(("sooner_s", "wrong"), [(0.3, False), (1.0, True)])
def test_a_line_may_be_stamped_half_a_second_before_its_event(sooner_s, wrong):
    announced = [(30.0 - sooner_s, "hands off: the pilot chose Position mode")]
    found = texts(evidence(happenings=PILOT, code=6, announced=announced, faults=("STICKS",)))
    assert ("a takeover is announced" in found) == wrong


@pytest.mark.parametrize(("after_s", "wrong"), [(80.0, False), (92.0, True)])
def test_a_battery_lasts_for_the_way_home_and_the_landing(after_s, wrong):
    """At 35 s it is at its reserve, 61 m from home: 18 s, 57 s to land, and 10 s."""
    charge = [
        WireMessage(float(t), 1, 1, 0, "SYS_STATUS", {"battery_remaining": 60 - t})
        for t in range(60)
    ]
    states = track(ROUND * 5)
    flown = evidence(
        states,
        more=charge,
        faults=("BATTERY",),
        happenings=(SceneEvent(20.0, SceneEventKind.BATTERY, 300.0),),
        code=1,
        failsafe=((35.0 + after_s, len(states) * 0.05),),
    )
    assert ("ran down to the failsafe" in texts(flown)) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(1.0, False), (2.5, True)])
def test_a_mode_that_was_received_is_believed_for_a_second_and_a_half(later_s, wrong):
    """It was never flown."""
    lie = between(70.0, 70.1, "HEARTBEAT", custom_mode=7)
    announced = [(70.0 + later_s, "hands off: the pilot chose Hold mode")]
    assert (
        "a pilot took over, but none did" in texts(flight(spoil=lie, announced=announced, code=6))
    ) == wrong


@pytest.mark.parametrize(("height_m", "wrong"), [(24.0, False), (38.0, True)])
def test_a_vehicle_cruises_at_nine_tenths_of_its_altitude(height_m, wrong):
    """What shows in cruise only need not be announced below."""
    drifts = (SceneEvent(25.0, SceneEventKind.FAULT, "drift"),)
    flown = evidence(track(height=height_m), faults=("BAROMETER",), happenings=drifts)
    assert ("it was not announced" in texts(flown)) == wrong


@pytest.mark.parametrize(("later_s", "end"), [(0.6, End.ON_REQUEST), (2.0, End.ELSEWHERE)])
def test_an_answer_follows_a_request_to_land_within_a_second(later_s, end):
    states = track(((0, 0), (60, 0), (60, 0), (60, 0)))
    announced = [(32.8, "32.8 s  the operator: accepted: it lands where it hovers")]
    requested = (SceneEvent(32.8 - later_s, SceneEventKind.REQUEST, "land"),)
    flown = evidence(states, announced=announced, faults=("LANDED_HERE",), happenings=requested)
    assert judge(flown).end is end


@pytest.mark.parametrize(("sooner_s", "wrong"), [(6.0, False), (12.0, True)])
def test_a_companion_that_goes_on_has_eight_seconds_to_connect(sooner_s, wrong):
    """A landing was accepted, and is not sent."""
    scene = (
        SceneEvent(72.0 - sooner_s, SceneEventKind.STOPPED),
        SceneEvent(75.0 - sooner_s, SceneEventKind.CONTINUED),
        SceneEvent(75.0, SceneEventKind.REQUEST, "land"),
    )
    announced = [
        (50.0, "50.0 s  INIT -> EXPL"),
        (58.0, "58.0 s  EXPL -> HOLD"),
        (75.1, "75.1 s  the operator: accepted: it lands where it hovers"),
    ]
    found = texts(flight(HOVERS, happenings=scene, announced=announced))
    assert ("no landing was commanded" in found) == wrong


# By its own report.


@pytest.mark.parametrize(("deep_m", "wrong"), [(0.3, False), (0.8, True)])
def test_half_a_metre_deep_it_is_a_breach(deep_m, wrong):
    assert ("not announced: a breach of shed" in texts(reporting(deep_m, 3.0))) == wrong


@pytest.mark.parametrize(("lasts_s", "wrong"), [(0.8, False), (2.2, True)])
def test_a_clearance_that_is_lost_for_a_second_is_announced(lasts_s, wrong):
    found = texts(reporting(-3.0, lasts_s))
    assert ("not announced: it came too near to shed" in found) == wrong


@pytest.mark.parametrize(("missing_m", "wrong"), [(0.6, False), (2.0, True)])
def test_of_a_clearance_a_metre_may_be_missing_without_an_announcement(missing_m, wrong):
    found = texts(reporting(-5.0 + missing_m, 3.0))
    assert ("not announced: it came too near to shed" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(8.0, False), (25.0, True)])
def test_what_a_pilot_gave_back_has_fifteen_seconds_to_leave(later_s, wrong):
    """It is given back at 61 s."""
    scene = (*PILOT, SceneEvent(60.0, SceneEventKind.REQUEST, "resume"))
    back = [command(61.0, 176, param2=4.0, param3=4.0)]
    found = texts(reporting(-3.0, 3.0, begins_s=61.0 + later_s, more=back, happenings=scene))
    assert ("not announced: it came too near to shed" in found) == wrong


@pytest.mark.parametrize(("speed_cm_s", "wrong"), [(60, False), (150, True)])
def test_a_place_that_stays_while_the_vehicle_moves_is_no_update(speed_cm_s, wrong):
    spoil = between(72.0, 82.0, "GLOBAL_POSITION_INT", vx=speed_cm_s)
    found = texts(flight(HOVERS, spoil, announced=[CRUISES]))
    assert ("not announced: the position was not received" in found) == wrong


def reporting(deep_m, lasts_s, *, begins_s=50.0, **others):
    """A vehicle that reports to be so deep in the shed, from the west, for some seconds."""
    latitude, longitude = FRAME.degrees(20.0 + deep_m, 30)
    place = {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7)}
    spoil = between(begins_s, begins_s + lasts_s, "GLOBAL_POSITION_INT", **place)
    return flight(spoil=spoil, announced=[CRUISES], **others)


@pytest.mark.parametrize(
    ("percent", "volts", "late"),
    [(30, 12.0, True), (44, 12.0, False), (44, 11.76, False), (44, 11.04, True)],
)
def test_a_charge_is_believed_at_once_that_fell_slowly_or_with_its_voltage(percent, volts, late):
    """At 40 s it falls to 24 %, from 12 V; that is announced at 46 s, a second late if at once."""

    def spoil(message):
        low = message.time_s >= 40.0
        fields = {"battery_remaining": 24 if low else percent}
        fields |= {"voltage_battery": 1e3 * (volts if low else 12.0)}
        battery = message.name == "SYS_STATUS"
        return dataclasses.replace(message, fields=fields) if battery else message

    announced = [(21.0, "21.0 s  READY -> INIT"), (46.0, "coming home: battery at 24%")]
    found = texts(flight(track(ROUND), spoil, announced=announced))
    assert ("not announced: the battery was at its reserve" in found) == late


# What a mission file leaves to the planner.


@pytest.mark.parametrize(("speed_m_s", "wrong"), [(3.5, False), (5.0, True)])
def test_a_mission_flies_at_three_and_a_half_metres_a_second_without_another_speed(
    speed_m_s, wrong
):
    request = command(40.0, 178, param1=1.0, param2=speed_m_s)
    flown = evidence(more=[request], text=TEXT.replace("speed_m_s: 5\n", ""))
    assert ("m/s, the plan has" in texts(flown)) == wrong


@pytest.mark.parametrize(
    ("file", "keeps_m", "wrong"),
    [
        ("", 6.43, False),  # at 5 m/s: 1.68 m
        ("", 6.3, True),
        ("planner: {wind_m_s: 10}\n", 7.6, False),  # gusts: a metre more
        ("planner: {wind_m_s: 10}\n", 7.0, True),
        ("speed_m_s: 1\n", 6.3, False),  # 1.5 m at least
        ("speed_m_s: 1\n", 6.1, True),
    ],
)
def test_places_keep_the_tracking_margin_of_the_speed_and_the_wind(file, keeps_m, wrong):
    """5 m are the clearance; 0.3 m may be missing."""
    text = (TEXT.replace("speed_m_s: 5\n", "") if "speed" in file else TEXT) + file
    leg = goto(45.0, 20.0 - keeps_m, 30)
    assert ("routes keep" in texts(evidence(more=[leg], text=text))) == wrong
