"""The judge's limits of commands and announcements: just within is good, just beyond is not.

As in `test_judge_tolerances`; each pair lies less than a factor of three from the limit.
"""

import pytest

from sitl.rehearsal.judge.case import LAND_MODE
from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import (
    AFTER,
    FRAME,
    HOLD,
    PILOT,
    TEXT,
    WireMessage,
    command,
    evidence,
    goto,
    kinds,
    ours,
    track,
)
from tests.sitl.rehearsal.judge.test_judge_inputs import CRUISES, FLOWN, HOVERS, between, flight


def texts(flown):
    return " | ".join(str(violation) for violation in judge(flown).violations)


# Commands.


@pytest.mark.parametrize(("beside_m", "wrong"), [(4.5, False), (3.0, True)])
def test_a_leg_keeps_the_clearance_but_a_metre(beside_m, wrong):
    leg = goto(40.0, 40.0 + beside_m, 30)  # from (60, 35), beside the shed
    assert ("a leg that keeps" in texts(evidence(more=[leg]))) == wrong


@pytest.mark.parametrize(("at_s", "wrong"), [(34.4, False), (36.0, True)])
def test_a_leg_keeps_it_also_where_the_vehicle_brakes(at_s, wrong):
    """Northwards along the shed at 5 m/s: 4.2 m farther north it turns to the west."""
    assert ("leg" in kinds(evidence(more=[goto(at_s, -60, 10)]))) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(0.03, False), (0.1, True)])
def test_an_order_that_crosses_a_choice_ends_it(later_s, wrong):
    crosses = command(30.0 + later_s, 176, param2=4.0, param3=3.0)
    flown = evidence(more=[crosses, goto(40.0, 60, 60), *AFTER], happenings=PILOT, code=6)
    assert ("while the vehicle is the pilot's" in texts(flown)) == wrong


@pytest.mark.parametrize(("at_s", "wrong"), [(32.5, False), (34.0, True)])
def test_what_no_mode_shows_is_known_a_second_after_the_next_heartbeat(at_s, wrong):
    """The next is of 31 s, and the companion has a second to react."""
    messages = []
    for time_s, east in ((29.0, 10), (30.4, 50)):
        latitude, longitude = FRAME.degrees(east, 10)
        fields = {"lat_int": round(latitude * 1e7), "lon_int": round(longitude * 1e7)}
        messages.append(WireMessage(time_s, 1, 1, 0, "POSITION_TARGET_GLOBAL_INT", fields))
    diverted = (SceneEvent(30.0, SceneEventKind.PILOT, "reposition"),)
    stop = command(at_s, 176, param2=4.0, param3=3.0)
    flown = evidence(more=[stop, *AFTER], happenings=diverted, received=tuple(messages), code=6)
    assert ("while the vehicle is the pilot's" in texts(flown)) == wrong


WALL = TEXT + "  - {name: wall, polygon: [[30, 55], [33, 55], [33, 80], [30, 80]]}\n"
WALLED = (SceneEvent(46.5, SceneEventKind.MISSION_FILE, WALL),)
"""Drawn across the way from (60, 60) to (0, 60)."""


@pytest.mark.parametrize(("stops_s", "wrong"), [(48.0, False), (49.5, True)])
def test_a_leg_that_is_crossed_ends_within_a_second_and_the_time_to_react(stops_s, wrong):
    more = [goto(46.0, 0, 60), command(stops_s, 176, param2=4.0, param3=3.0)]
    assert ("is flown on" in texts(evidence(more=more, happenings=WALLED))) == wrong


@pytest.mark.parametrize(("sooner_s", "wrong"), [(0.2, False), (0.6, True)])
def test_a_changed_file_may_have_been_read_just_before(sooner_s, wrong):
    leg = goto(46.5 - sooner_s, 0, 60)
    assert ("is flown on" in texts(evidence(more=[leg], happenings=WALLED))) == wrong


@pytest.mark.parametrize(("speed_m_s", "wrong"), [(0.9, False), (1.5, True)])
def test_a_vehicle_that_stands_needs_no_order_to_stop(speed_m_s, wrong):
    states = track()[:920]
    east, north, height, *rest = states[-1]
    states += [(east - n * speed_m_s / 20, north, height, *rest) for n in range(200)]
    flown = evidence(states, more=[goto(45.9, 0, 60)], happenings=WALLED)
    assert ("is flown on" in texts(flown)) == wrong


@pytest.mark.parametrize(("armed_s", "wrong"), [(1.5, True), (3.0, False)])
def test_no_plan_is_put_on_board_of_what_was_armed_as_the_companion_began_to_look(armed_s, wrong):
    """It was started at 1 s, and looks a second later at the soonest."""
    states = [(0.0, 0.0, 0.0, n * 0.05 >= armed_s, True, HOLD) for n in range(200)]
    started = (SceneEvent(1.0, SceneEventKind.STARTED),)
    count = ours(6.0, "MISSION_COUNT", count=8, mission_type=0)
    flown = evidence([*states, *track()[20:]], more=[count], happenings=started)
    assert ("that the pilot has armed" in texts(flown)) == wrong


# Changed files.


def left(text, *, requested_s=70.0, more=()):
    """What is found of a file that was not taken."""
    scene = (SceneEvent(requested_s + 4.0, SceneEventKind.FILE_LEFT, (requested_s, text)),)
    announced = [(requested_s + 2.0, "not reloaded: mission.yaml: something")]
    return texts(flight(announced=announced, happenings=scene, more=more))


@pytest.mark.parametrize(("away_m", "wrong"), [(7.2, False), (8.6, True)])
def test_a_file_is_good_that_leaves_home_its_clearance_and_a_metre(away_m, wrong):
    """5 m of clearance, and what the vehicle needs beside its way."""
    near = f"[[{away_m}, -5], [12, -5], [12, 5], [{away_m}, 5]]"
    found = left(TEXT + f"  - {{name: new, polygon: {near}}}\n")
    assert ("nothing is wrong" in found) == wrong


@pytest.mark.parametrize(("points", "wrong"), [(60, True), (70, False)])
def test_a_fence_of_more_than_sixty_four_points_cannot_be_stored(points, wrong):
    """The fence and the shed have four each."""
    zones = "".join(
        f"  - {{name: n{n}, polygon: [[300, {n * 9}], [303, {n * 9}], [303, {n * 9 + 4}]]}}\n"
        for n in range((points - 8) // 3)
    )
    assert ("nothing is wrong" in left(TEXT + zones)) == wrong


@pytest.mark.parametrize(("sooner_s", "wrong"), [(50.0, False), (80.0, True)])
def test_while_a_fence_is_on_its_way_on_board_no_file_needs_be_taken(sooner_s, wrong):
    zone = "  - {name: new, polygon: [[300, 55], [303, 55], [303, 80], [300, 80]]}\n"
    count = ours(110.0 - sooner_s, "MISSION_COUNT", count=8, mission_type=1)
    assert ("nothing is wrong" in left(TEXT + zone, requested_s=110.0, more=[count])) == wrong


# Altitudes.


def drifting(off_m, *, since_s=60.0, states=HOVERS, spoil=lambda message: message, announced=()):
    """What is found of a flight whose satellites' altitude leaves the autopilot's at a time."""

    def drifts(message):
        if message.name != "GPS_RAW_INT":
            return spoil(message)
        up_m = states[round(message.time_s / 0.05)][2]
        up_m += off_m if message.time_s >= since_s else 0.0
        fields = {**message.fields, "alt": round((6.7 + up_m) * 1e3)}
        return spoil(WireMessage(message.time_s, 1, 1, 0, message.name, fields))

    return texts(flight(states, drifts, announced=[(21.0, "21.0 s  READY -> INIT"), *announced]))


@pytest.mark.parametrize(("every_s", "later_s", "known"), [(1.0, 0.6, True), (3.0, 2.0, False)])
def test_two_altitudes_within_a_second_are_of_one_moment(every_s, later_s, known):
    """The satellites' is received so long after the autopilot's."""
    delays = {"GLOBAL_POSITION_INT": 0.0, "GPS_RAW_INT": later_s}

    def spoil(message):
        left_s = (message.time_s - delays.get(message.name, message.time_s)) % every_s
        return message if min(left_s, every_s - left_s) < 0.01 else None

    assert ("the altitude has drifted" in drifting(-6.0, spoil=spoil)) == known


def hovering(until_s):
    """Hovers at (60, 0), 60 m from home, from 33 s on, and lands there then."""
    hovers = [*FLOWN[:660], *[FLOWN[660]] * round((until_s - 33.0) / 0.05)]
    return [*hovers, *((60.0, 0.0, 40.0 - n * 0.1, True, False, LAND_MODE) for n in range(300))]


@pytest.mark.parametrize(("lands_s", "late"), [(140.0, False), (155.0, True)])
def test_a_companion_may_average_an_altitude_for_thirty_seconds_before_it_comes_home(lands_s, late):
    announced = [(65.0, "the altitude is in doubt")]
    found = drifting(9.0, states=hovering(lands_s), announced=announced)
    assert ("did not land within" in found) == late


# In the companion's seat.


@pytest.mark.parametrize(("again_s", "wrong"), [(76.4, False), (77.6, True)])
def test_a_pause_of_all_streams_counts_as_a_second_of_each(again_s, wrong):
    """The position is missing from 70 s on, and everything from 72 s to 75.2 s."""
    missing, pause = between(70.0, again_s, "GLOBAL_POSITION_INT"), between(72.0, 75.2)

    def spoil(message):
        left = missing(message)
        return None if left is None else pause(left)

    found = texts(flight(HOVERS, spoil, announced=[CRUISES]))
    assert ("not announced: the position was not received" in found) == wrong


@pytest.mark.parametrize(("lost_s", "wrong"), [(0.8, False), (2.2, True)])
def test_a_fix_that_is_lost_for_a_second_is_announced(lost_s, wrong):
    spoil = between(70.0, 70.0 + lost_s, "GPS_RAW_INT", fix_type=1)
    assert (
        "not announced: GPS lost its fix" in texts(flight(HOVERS, spoil, announced=[CRUISES]))
    ) == wrong


@pytest.mark.parametrize(("leg_s", "wrong"), [(79.0, False), (82.0, True)])
def test_a_vehicle_with_a_poor_fix_has_three_seconds_to_stop(leg_s, wrong):
    """It is announced within seven seconds, at 77 s."""
    spoil = between(70.0, 88.0, "GPS_RAW_INT", h_acc=2500)
    announced = [CRUISES, (72.0, "the satellites' position is good to 2.5 m only: holding")]
    found = texts(flight(HOVERS, spoil, announced=announced, more=[goto(leg_s, 60, 0)]))
    assert ("a leg, though GPS was good to 2 m" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(3.6, False), (5.0, True)])
def test_a_standstill_is_announced_within_a_second_and_the_time_to_react(later_s, wrong):
    still = (SceneEvent(69.0, SceneEventKind.STOPPED), SceneEvent(88.0, SceneEventKind.CONTINUED))
    announced = [(88.0 + later_s, "the companion stalled for 19.0 s")]
    found = texts(flight(spoil=between(70.0, 88.0), happenings=still, announced=announced))
    assert ("it stood still before" in found) == wrong


@pytest.mark.parametrize(("lands_s", "late"), [(125.0, False), (155.0, True)])
def test_a_mission_may_begin_a_minute_after_the_take_off(lands_s, late):
    """It lasts for 30 s: from 91 s on it comes home, in 49 s."""
    flown = flight(hovering(lands_s), text=f"{TEXT}duration_s: 30\n", announced=[CRUISES])
    assert ("though the time of the mission was over" in texts(flown)) == late


@pytest.mark.parametrize(("begins_s", "wrong"), [(70.4, False), (71.4, True)])
def test_a_position_is_known_a_second_after_its_fix_is_back(begins_s, wrong):
    """The fix is lost from 60 s to 69.8 s; before it is known where it is nothing is a breach."""
    latitude, longitude = FRAME.degrees(30, 30)
    inside = {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7)}
    lost = between(60.0, 70.0, "GPS_RAW_INT", fix_type=1)
    breach = between(begins_s, begins_s + 3.0, "GLOBAL_POSITION_INT", **inside)
    found = texts(flight(spoil=lambda message: breach(lost(message)), announced=[CRUISES]))
    assert ("not announced: a breach of shed" in found) == wrong
