"""The judge's limits of duties, ways home and true tracks: just within is good, beyond is not.

As in `test_judge_limits`; each pair lies less than a factor of three from the limit.
"""

import pytest

from sitl.rehearsal.judge.case import LAND_MODE
from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind, WireMessage
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import (
    AFTER,
    FRAME,
    MISSION,
    PILOT,
    ROUND,
    TEXT,
    command,
    evidence,
    goto,
    track,
)
from tests.sitl.rehearsal.judge.test_judge_files import MONDAY
from tests.sitl.rehearsal.judge.test_judge_inputs import FLOWN, HOVERS, between, flight

CRUISE = (33.0, "33.0 s  READY -> INIT")
HARMLESS = TEXT + "  - {name: new, polygon: [[300, 55], [303, 55], [303, 80], [300, 80]]}\n"


def texts(flown):
    return " | ".join(str(violation) for violation in judge(flown).violations)


def hovering(until_s, *, lands=False):
    """At (60, 0) from 33 s on; it may land there then."""
    states = [*FLOWN[:660], *[FLOWN[660]] * round((until_s - 33.0) / 0.05)]
    down = [(60.0, 0.0, 40.0 - n * 0.1, True, False, LAND_MODE) for n in range(300)]
    return states + down if lands else states


def coming_home(lands_s, **others):
    """What is found of a way home that it announced at 40 s, 60 m from there, and does not fly."""
    announced = [CRUISE, (40.0, "40.0 s  coming home: battery at 25%")]
    return "it announced that it comes home" in texts(
        flight(hovering(lands_s, lands=True), announced=announced, **others)
    )


# Ways home.


@pytest.mark.parametrize(("lands_s", "late"), [(84.0, False), (100.0, True)])
def test_a_way_home_takes_twice_its_time_and_some_turns(lands_s, late):
    assert coming_home(lands_s) == late


@pytest.mark.parametrize(("lands_s", "late"), [(150.0, False), (175.0, True)])
def test_where_no_way_home_is_known_it_is_four_times_as_long_as_straight(lands_s, late):
    """A wall that may begin to count within the hour is in the way, and ends no way home."""
    hours = 'active: [{between: ["15:00", "18:00"]}]'
    wall = "polygon: [[28, -100], [32, -100], [32, 200], [28, 200]], crosses_fence: true"
    text = f"{TEXT}  - {{name: wall, {wall}, {hours}}}\n"
    assert coming_home(lands_s, text=text, epoch_s=MONDAY) == late


@pytest.mark.parametrize(("gap_m", "late"), [(12.5, False), (16.0, True)])
def test_a_way_home_keeps_two_metres_more_than_the_clearance(gap_m, late):
    """Through the gap in the wall it is 60 m long, around its end more than 300 m."""
    walls = (
        f"[[28, -100], [32, -100], [32, {-gap_m / 2}], [28, {-gap_m / 2}]]",
        f"[[28, {gap_m / 2}], [32, {gap_m / 2}], [32, 150], [28, 150]]",
    )
    zones = "".join(f"  - {{polygon: {each}, crosses_fence: true}}\n" for each in walls)
    text = TEXT.replace(
        "{name: shed, polygon: [[20, 20], [40, 20], [40, 40], [20, 40]]}",
        "{name: shed, circle: {centre: [150, 0], radius_m: 3}}",
    )
    assert coming_home(110.0, text=text + zones) == late


@pytest.mark.parametrize(("silent_s", "late"), [(3.0, True), (8.0, False)])
def test_a_companion_that_receives_nothing_for_five_seconds_brings_nothing_home(silent_s, late):
    assert coming_home(100.0, spoil=between(46.0, 46.0 + silent_s)) == late


@pytest.mark.parametrize(("lands_s", "late"), [(115.0, False), (135.0, True)])
def test_a_changed_file_is_on_board_within_thirty_seconds_and_the_way_goes_on(lands_s, late):
    changed = (SceneEvent(45.0, SceneEventKind.MISSION_FILE, HARMLESS),)
    assert coming_home(lands_s, happenings=changed) == late


# Requests and announcements.


def requested(verb, answer, *, later_s=0.1, states=HOVERS, more=()):
    """What is found of a flight with this request: at 70 s, or at 40 s of others."""
    at_s = 70.0 if states is HOVERS else 40.0
    request = (SceneEvent(at_s, SceneEventKind.REQUEST, verb),)
    lines = [CRUISE, (at_s + later_s, f"the operator: {answer}")]
    lines += [(at_s + 0.2, f"{at_s + 0.2} s  INIT -> HOLD")] if verb == "hold" else []
    return texts(flight(states, happenings=request, announced=lines, more=more))


@pytest.mark.parametrize(("later_s", "wrong"), [(0.6, False), (2.0, True)])
def test_a_request_is_answered_within_a_second(later_s, wrong):
    found = requested("hold", "accepted: it stops and hovers", later_s=later_s)
    assert ("hold was not answered" in found) == wrong


@pytest.mark.parametrize(
    ("leg_s", "wrong"), [(70.7, False), (72.0, True), (81.0, True), (83.0, False)]
)
def test_a_hold_is_sent_within_a_second_and_looked_at_for_twelve(leg_s, wrong):
    found = requested("hold", "accepted: it stops and hovers", more=[goto(leg_s, 60, 0)])
    assert ("a leg, though a hold was accepted" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(4.0, False), (8.0, True)])
def test_a_way_home_is_begun_within_five_seconds(later_s, wrong):
    found = requested("home", "accepted: it comes home", more=[goto(70.0 + later_s, 0, 0)])
    assert ("though a way was accepted" in found) == wrong


@pytest.mark.parametrize(
    ("there_s", "off_m", "wrong"),
    [(56.0, 0.0, False), (63.0, 0.0, True), (50.0, 1.2, False), (50.0, 3.0, True)],
)
def test_another_altitude_is_flown_at_within_six_seconds_and_the_climb(there_s, off_m, wrong):
    """10 m higher, requested at 40 s: within 18.5 s, to 1.5 m."""
    flies = True, False, MISSION
    states = [*hovering(there_s), *[(60.0, 0.0, 50.0 - off_m, *flies)] * 1600]
    found = requested("altitude 50", "accepted: it climbs", states=states)
    assert ("though 50.0 m was accepted" in found) == wrong


def at_the_last_point(away_m, note="", text=TEXT):
    """What is found of two points of which the first is so far beside the way."""
    points = [FRAME.degrees(east, north) for east, north in ((60 + away_m, 0), (60, 60))]
    verb = "goto " + " ".join(f"{lat},{lon}" for lat, lon in points)
    announced = [
        (40.0, "40.0 s  READY -> INIT"),
        (70.0, "70.0 s  INIT -> GOTO"),
        (70.0, f"70.0 s  the operator: accepted: it flies to 2 points{note}"),
        (96.0, "96.0 s  at the last point"),
    ]
    scene = (SceneEvent(70.0, SceneEventKind.REQUEST, verb),)
    found = texts(
        flight(announced=announced, happenings=scene, text=text, more=[goto(71.0, 60, 0)])
    )
    return "reports the last one as reached" in found


@pytest.mark.parametrize(("away_m", "wrong"), [(4.0, False), (8.0, True)])
def test_a_point_is_flown_to_within_five_metres(away_m, wrong):
    assert at_the_last_point(away_m) == wrong


@pytest.mark.parametrize(("away_m", "wrong"), [(24.0, False), (28.0, True)])
def test_a_point_in_a_zone_is_flown_to_as_near_as_that_allows(away_m, wrong):
    """It lies 2 m deep, 5 m are the clearance, and 1.5 m the margin: twice that, and 8 m."""
    zone = f"  - {{circle: {{centre: [{60 + away_m}, 0], radius_m: 2}}}}\n"
    note = "; point 1: it is too close to a zone, so 40.0 m beside it"
    assert at_the_last_point(away_m, note, TEXT + zone) == wrong


@pytest.mark.parametrize(("speed_m_s", "wrong"), [(1.2, False), (3.0, True)])
def test_a_vehicle_stands_where_it_is_commanded_to_land(speed_m_s, wrong):
    flies = 40.0, True, False, MISSION
    states = hovering(39.0) + [(60.0, n * speed_m_s / 20, *flies) for n in range(200)]
    found = requested("land", "accepted: it lands where it hovers", states=states)
    assert ("a landing was commanded at" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(0.6, False), (2.0, True)])
def test_an_announcement_is_sent_within_a_second(later_s, wrong):
    sent = {"text": "air_router: coming home: it is late", "severity": 6}
    more = [WireMessage(50.0 + later_s, 1, 191, 0, "STATUSTEXT", sent)]
    found = texts(flight(announced=[(50.0, "    50.0 s  coming home: it is late")], more=more))
    assert ("was not sent to the ground station" in found) == wrong


@pytest.mark.parametrize(
    ("deep_m", "lasts_s", "speed_m_s", "wrong"),
    [
        (0.3, 40.0, 0.0, False),
        (0.8, 40.0, 0.0, True),
        (5.0, 20.0, 0.0, False),
        (5.0, 40.0, 0.0, True),
        (5.0, 32.0, 0.09, True),  # by 3 m
        (5.0, 32.0, 0.25, False),  # by 8 m
    ],
)
def test_a_vehicle_that_hovers_in_a_zone_alarms_the_pilot(deep_m, lasts_s, speed_m_s, wrong):
    """Within 28 s, unless it moves by more than 4 m."""
    assert ("without an alarm" in in_the_shed(deep_m, lasts_s, speed_m_s)) == wrong


@pytest.mark.parametrize(("sooner_s", "wrong"), [(8.0, False), (20.0, True)])
def test_an_alarm_counts_for_twelve_seconds(sooner_s, wrong):
    announced = [(40.0 - sooner_s, "ALARM: too near. Pilot: take over")]
    assert ("without an alarm" in in_the_shed(5.0, 32.0, 0.0, announced)) == wrong


def in_the_shed(deep_m, lasts_s, speed_m_s, announced=()):
    """What is found of a vehicle that is in the shed from 40 s on, at its western side."""
    flies = 40.0, True, False, MISSION
    inside = [
        (20.0 + deep_m, 25.0 + n * speed_m_s / 20, *flies) for n in range(round(lasts_s * 20))
    ]
    return texts(evidence(hovering(40.0) + inside, announced=announced))


@pytest.mark.parametrize(
    ("sooner_s", "later_s", "wrong"),
    [(30.0, 3.0, False), (60.0, 3.0, True), (30.0, 8.0, True)],
)
def test_over_anothers_fence_the_vehicle_is_left_to_the_pilot_at_once(sooner_s, later_s, wrong):
    """Within 45 s of that fence, and within 5 s of its own that is not on board."""
    announced = [
        (80.0, "the changed fence is not on board: it is another's"),
        (80.0 + later_s, "hands off: another plan is on board"),
    ]
    changed = (SceneEvent(80.0 - sooner_s, SceneEventKind.FENCE_CHANGED, "added"),)
    found = texts(evidence(track(ROUND * 5), announced=announced, happenings=changed))
    assert ("though its fence is not on board" in found) == wrong


# The true track.


@pytest.mark.parametrize(("deep_m", "wrong"), [(8.0, False), (15.0, True)])
def test_what_is_drawn_within_twelve_metres_may_be_left_first(deep_m, wrong):
    """Drawn 3 m north of the vehicle, that comes from the west and turns there at 33 s."""
    box = "[[40, 3], [80, 3], [80, 60], [40, 60]]"
    drawn = (SceneEvent(33.0, SceneEventKind.MISSION_FILE, f"{TEXT}  - {{polygon: {box}}}\n"),)
    states = track(((0, 0), (60, 0), (60, 3 + deep_m), (60, -6), (0, -6), (0, 0)))
    assert ("m are required" in texts(evidence(states, happenings=drawn))) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(4.0, False), (10.0, True)])
def test_what_is_drawn_counts_six_seconds_later_at_the_latest(later_s, wrong):
    """Drawn 8 m north of it at 40 s; later it comes as near as 3 m."""
    box = "[[40, 8], [80, 8], [80, 60], [40, 60]]"
    drawn = (SceneEvent(40.0, SceneEventKind.MISSION_FILE, f"{TEXT}  - {{polygon: {box}}}\n"),)
    flies = 40.0, True, False, MISSION
    states = hovering(40.0 + later_s) + [(60.0, min(n * 0.25, 5.0), *flies) for n in range(100)]
    assert ("m are required" in texts(evidence(states, happenings=drawn))) == wrong


RESUMED = (*PILOT, SceneEvent(60.0, SceneEventKind.REQUEST, "resume"))
"""Flown by hand from 30 s to 61 s."""


def given_back(*after, at, height=40.0):
    """What is found of a vehicle that is given back there."""
    places = [(10.0, 0.0), *[at] * 619, *after]
    flown = [*FLOWN[:600], *((*place, height, True, False, MISSION) for place in places)]
    more = [command(61.0, 176, param2=4.0, param3=4.0), *AFTER]
    return texts(evidence(flown, more=more, happenings=RESUMED, faults=("HAND_BACK",)))


@pytest.mark.parametrize(("keeps_m", "wrong"), [(2.5, False), (1.0, True)])
def test_given_back_too_near_to_a_zone_it_may_drift_two_metres_nearer(keeps_m, wrong):
    """It was 4 m from the shed."""
    nearer = [(16.0 + (4.0 - keeps_m) * n / 40, 30.0) for n in range(41)]
    assert ("m are required" in given_back(*nearer, at=(16.0, 30.0))) == wrong


@pytest.mark.parametrize(("on_m", "wrong"), [(8.0, False), (20.0, True)])
def test_given_back_low_it_may_drift_for_twelve_metres(on_m, wrong):
    drifts = [(60.0, on_m * n / 100) for n in range(101)]
    found = given_back(*drifts, at=(60.0, 0.0), height=20.0)
    assert ("where it was given back" in found) == wrong


@pytest.mark.parametrize(("deep_m", "wrong"), [(0.6, False), (2.0, True)])
def test_it_is_not_taken_back_a_metre_deep_in_a_zone(deep_m, wrong):
    at = (20.0 + deep_m, 30.0)
    assert ("taken back" in given_back(*[at] * 100, at=at)) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(0.3, False), (1.0, True)])
def test_a_file_may_be_flown_by_half_a_second_before_it_is_seen_to_count(later_s, wrong):
    """What a zone is drawn over, and is low, may be led away."""
    over = f"{TEXT}  - {{circle: {{centre: [60, 0], radius_m: 5}}}}\n"
    drawn = (SceneEvent(45.0 + later_s, SceneEventKind.MISSION_FILE, over),)
    low = [(60.0, 0.0, 20.0, True, False, MISSION)] * 300
    flown = evidence(hovering(40.0) + low, more=[goto(45.0, 0, 0)], happenings=drawn)
    assert ("m and more are flown" in texts(flown)) == wrong
