"""The judge of promises: states and their times, robots, waypoints, points, charge and report."""

import dataclasses

import pytest

from sitl.rehearsal.judge.acceptance import End
from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind, WireMessage
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import FRAME, HOLD, MISSION, TEXT, evidence, goto, track
from tests.sitl.rehearsal.judge.test_judge_inputs import FLOWN, flight

TIMED = f"{TEXT}timers: {{init_s: 20, search_s: 10, explore_s: 15}}\nseek: [io, europa]\n"
ANNOUNCED = [
    (40.0, "40.0 s  READY -> INIT"),
    (60.0, "60.0 s  INIT -> SEARCH"),
    (60.0, "60.0 s  SEARCH io: never received"),
    (64.0, "64.0 s  at the search position of io"),
    (74.0, "74.0 s  SEARCH -> EXPL"),
    (89.0, "89.0 s  EXPL -> SEARCH"),
    (89.0, "89.0 s  SEARCH europa: never received"),
    (90.0, "90.0 s  SEARCH -> COMM"),
    (90.0, "90.0 s  COMM europa: found"),
]


def met(at_s, name="europa"):
    return SceneEvent(at_s, SceneEventKind.SYNCED, (name, "in", at_s, []))


MET = (met(90.0),)


def found(announced, happenings=MET, text=TIMED, **others):
    """What is found of the states and requests of a flight with these announcements."""
    verdict = judge(flight(announced=announced, happenings=tuple(happenings), text=text, **others))
    return [str(v) for v in verdict.violations if v.kind in {"state", "request"}]


def other(number, at_s, text=None):
    return [*ANNOUNCED[:number], (at_s, text or ANNOUNCED[number][1]), *ANNOUNCED[number + 1 :]]


@pytest.mark.parametrize(
    ("announced", "expected"),
    [
        (ANNOUNCED, None),
        (other(1, 75.0), "INIT lasted 35.0 s, 20.0 s are wanted"),
        (other(1, 50.0), "INIT ended 10.0 s after its time began, not 20.0 s"),
        (other(3, 60.5), "SEARCH lasted 13.5 s"),
        ([each for each in ANNOUNCED if "position" not in each[1]], "SEARCH ended 0.0 s"),
        (other(1, 60.0, "60.0 s  INIT -> COMM"), "INIT -> COMM"),
        (other(1, 60.0, "60.0 s  INIT -> HOLD"), "INIT -> HOLD without an accepted request"),
        (other(6, 89.0, "89.0 s  SEARCH io: never received"), "io is sought after io, not europa"),
    ],
)
def test_states_follow_the_table_and_last_as_in_the_file(announced, expected):
    texts = found(announced)
    assert not texts if expected is None else any(expected in text for text in texts), texts


def test_a_robot_is_found_when_it_is_received():
    assert "io was received, and is sought on" in found(ANNOUNCED, (met(66.0, "io"), met(90.0)))[0]


def test_a_way_home_for_a_fault_is_not_called_off():
    more = [
        (91.0, "91.0 s  COMM -> HOME"),
        (91.0, "91.0 s  coming home: battery not received for 30 s"),
        (93.0, "93.0 s  HOME -> GOTO"),
        (93.0, "93.0 s  the operator: accepted: it flies to the point"),
    ]
    assert "though no request had it come home" in found([*ANNOUNCED, *more])[0]
    more[1] = (91.0, "91.0 s  coming home: the operator's request")
    assert found([*ANNOUNCED, *more]) == []


def requested(verb, answer, *lines):
    announced = [*ANNOUNCED, (100.0, f"100.0 s  the operator: {answer}"), *lines]
    scene = (met(90.0), SceneEvent(100.0, SceneEventKind.REQUEST, verb))
    return found(announced, scene, more=[goto(101.0, 60, 0)])


@pytest.mark.parametrize(
    ("verb", "answer", "after", "expected"),
    [
        ("seek io", "accepted: it seeks io: never received", "COMM -> SEARCH", None),
        ("seek io", "accepted: it seeks io: never received", None, "accepted, not done"),
        ("explore", "refused: it comes home", "COMM -> EXPL", "refused and done"),
        ("explore", "is not an answer", None, "explore was not answered"),
        ("goto 1,1", "accepted: it flies to the point", "COMM -> GOTO", None),
    ],
)
def test_what_is_requested_is_answered_and_done_or_not(verb, answer, after, expected):
    lines = [] if after is None else [(100.0, f"100.0 s  {after}")]
    texts = requested(verb, answer, *lines)
    assert (
        any(expected in text for text in texts) if expected else not any("was" in t for t in texts)
    )


@pytest.mark.parametrize(
    ("east_m", "note", "zone", "wrong"),
    [
        (60, False, False, False),
        (80, False, False, True),
        (80, True, False, True),  # no zone is there, whatever the answer is
        (80, True, True, False),
        (80, False, True, True),
    ],
)
def test_all_points_are_flown_to(east_m, note, zone, wrong):
    points = [FRAME.degrees(east, north) for east, north in ((east_m, 0), (60, 60))]
    beside = "; point 1: it is too close to a zone, so 20.0 m beside it" if note else ""
    announced = [
        (40.0, "40.0 s  READY -> INIT"),
        (70.0, "70.0 s  INIT -> GOTO"),
        (70.0, f"70.0 s  the operator: accepted: it flies to 2 points{beside}"),
        (96.0, "96.0 s  at the last point"),
    ]
    verb = "goto " + " ".join(f"{lat},{lon}" for lat, lon in points)
    scene = [SceneEvent(70.0, SceneEventKind.REQUEST, verb)]
    there = "  - {circle: {centre: [80, 0], radius_m: 8}}\n" if zone else ""
    texts = found(announced, scene, TEXT + there, more=[goto(71.0, 60, 0)])
    assert any("reports the last one as reached" in text for text in texts) == wrong


def test_waypoints_are_visited_in_their_turn_or_announced_as_left_out():
    text = TEXT.replace("[0, 60]]", "[90, 90], [0, 60]]")
    left_out = (70.0, "70.0 s  waypoint 3 left out: no clear way leads there")
    over = "  - {circle: {centre: [90, 90], radius_m: 4}}\n"
    wall = "  - {polygon: [[70, -99], [76, -99], [76, 199], [70, 199]], crosses_fence: true}\n"
    several = (70.0, "70.0 s  waypoints 2, 3 left out: no clear way leads there")
    for more, drawn, good in (
        ([], over, False),
        ([left_out], "", False),  # nothing keeps it from there
        ([left_out], over, True),
        ([several], wall, True),
    ):
        announced = [(20.0, "20.0 s  READY -> INIT"), *more]
        flown = evidence(faults=("EXPLORED",), announced=announced, text=text + drawn)
        assert ("waypoint 3 was neither visited" in str(judge(flown).violations)) != good


@pytest.mark.parametrize(
    ("report", "wrong"),
    [
        ("40 s, 0 of 3 waypoints explored (by the vehicle's report)", False),
        ("40 s, 1 of 3 waypoints explored (by the vehicle's report)", False),
        ("40 s, 2 of 3 waypoints explored (by the vehicle's report)", True),
        ("40 s, 2 of 3 waypoints explored (the take-off time is not known)", True),
        ("900 s, 0 of 3 waypoints explored (the take-off time is not known)", False),
        ("39 s, 1 of 3 waypoints explored (by its record flight.mcap)", False),
        ("39 s, 2 of 3 waypoints explored (by its record flight.mcap)", True),
        ("900 s, 1 of 3 waypoints explored (by its record flight.mcap)", True),
    ],
)
def test_what_is_resumed_is_no_further_than_it_was(report, wrong):
    """It was at the first waypoint, and is on its way to the second."""
    announced = [(20.0, "20.0 s  READY -> INIT"), (40.0, f"in the air for {report}")]
    texts = str(judge(evidence(faults=("RESTART",), announced=announced)).violations)
    assert ("was at 1 of them" in texts) is wrong


def test_the_charge_covers_the_way_home():
    text = f"{TEXT}endurance_s: 200\n"

    def spoil(share):
        return lambda m: (
            m if m.name != "SYS_STATUS" else dataclasses.replace(m, fields={**m.fields, **share})
        )

    def texts(percent):
        flown = flight(
            FLOWN, spoil({"battery_remaining": percent}), announced=ANNOUNCED[:1], text=text
        )
        return str(judge(flown).violations)

    assert "stays out at 35%" in texts(35)
    assert "stays out" not in texts(60)


@pytest.mark.parametrize(
    ("lands_at", "end"), [((60, 0), End.ON_REQUEST), ((60, 60), End.ELSEWHERE)]
)
def test_it_may_land_where_requested(lands_at, end):
    states = track(((0, 0), (60, 0), (60, 0), lands_at))
    announced = [(32.8, "32.8 s  the operator: accepted: it lands where it hovers")]
    requested = (SceneEvent(32.7, SceneEventKind.REQUEST, "land"),)
    how = {"announced": announced, "faults": ("LANDED_HERE",)}
    flown = judge(evidence(states, **how, happenings=requested))
    assert judge(evidence(states, **how)).end is End.ELSEWHERE  # it was not requested
    assert flown.end is end
    assert "landing" in {violation.kind for violation in flown.violations}  # it moved: 5 m/s


def test_a_vehicle_that_a_pilot_has_armed_is_not_prepared():
    started = SceneEvent(1.0, SceneEventKind.STARTED)
    states = [(*s[:3], True, *s[4:]) for s in [track()[0]] * 200]
    count = WireMessage(3.0, 1, 191, 1, "MISSION_COUNT", {"count": 3, "mission_type": 0})
    flown = evidence(states, more=[count], happenings=(started,), faults=("READY_TAKEN",), code=5)
    assert "authority" in {violation.kind for violation in judge(flown).violations}


def test_a_failsafe_is_no_success():
    states = track(land=False)[:1200] + [(60, 60, 0.0, False, True, MISSION)] * 20
    flown = evidence(states, failsafe=((50.0, 99.0),), faults=("NO_FIX",), code=6)
    assert "though a failsafe ended it" in str(judge(flown).violations)


@pytest.mark.parametrize(
    ("state", "flagged"), [("SEARCH -> COMM", False), ("SEARCH -> EXPL", True)]
)
def test_a_robot_is_hovered_over_already_in_comm_only(state, flagged):
    announced = [
        (60.0, f"60.0 s  {state}"),
        (61.0, "61.0 s  me: accepted: it hovers over io already"),
    ]
    assert any("hovers over io already" in text for text in found(announced)) is flagged


@pytest.mark.parametrize(
    ("at_s", "flagged"), [(40.0, True), (5.0, True), (2.1, False), (0.5, False)]
)
def test_running_motors_are_not_announced_as_stopped(at_s, flagged):
    announced = [
        (at_s, f"{at_s} s  ALARM: hands off: disarmed in the air at 30 m above home. Pilot: go")
    ]
    verdict = judge(flight(announced=announced))
    assert any("its motors run" in str(v) for v in verdict.violations) is flagged


@pytest.mark.parametrize(("alarmed_s", "flagged"), [(50.0, False), (58.0, True), (None, True)])
def test_a_vehicle_that_no_pilot_takes_is_alarmed_of(alarmed_s, flagged):
    """Hands are off at 40 s, and it hovers in Hold."""
    announced = [(40.0, "40.0 s  ALARM: hands off: another plan is on board. Pilot: take over")]
    if alarmed_s is not None:
        announced.append((alarmed_s, f"{alarmed_s} s  ALARM: it hovers, and is not flown by hand"))
    states = [(*state[:5], HOLD) for state in track(land=False)]
    states += [states[-1]] * 400
    verdict = judge(flight(states, announced=announced))
    assert any("no pilot takes it" in str(v) for v in verdict.violations) is flagged


@pytest.mark.parametrize(("fault", "flagged"), [("NONE", True), ("GUSTS", False)])
def test_in_a_calm_flight_no_leg_is_kept_back(fault, flagged):
    line = (70.0, "70.0 s  not sent: the leg was no longer clear when it was due")
    verdict = judge(flight(announced=[line], faults=frozenset({fault})))
    texts = [str(each) for each in verdict.violations if "without a disturbance" in str(each)]
    assert bool(texts) is flagged


# Its limits: each pair lies less than a factor of three from one.


@pytest.mark.parametrize(("lasts_s", "wrong"), [(20.0, False), (30.0, True)])
def test_points_are_held_at_for_twenty_seconds_without_another_time(lasts_s, wrong):
    requested = SceneEvent(60.0, SceneEventKind.REQUEST, "goto 1,1")
    announced = [
        (40.0, "40.0 s  READY -> INIT"),
        (60.0, "60.0 s  INIT -> GOTO"),
        (60.0, "60.0 s  the operator: accepted: it flies to the point"),
        (64.0, "64.0 s  at the last point"),
        (64.0 + lasts_s, f"{64.0 + lasts_s} s  GOTO -> EXPL"),
    ]
    texts = found(announced, (requested,), TEXT, more=[goto(60.5, 60, 0)])
    assert any("GOTO lasted" in text for text in texts) is wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(40.0, False), (15.0, True)])
def test_a_robot_is_sought_again_after_thirty_seconds_without_a_time_in_the_file(later_s, wrong):
    """Everything is explored at 57 s."""
    exchange = [
        SceneEvent(60.0, SceneEventKind.SYNCED, ("io", way, 59.0, [])) for way in ("in", "out")
    ]
    announced = [(20.0, "20.0 s  READY -> INIT"), (60.0 + later_s, "SEARCH io: its last position")]
    texts = found(announced, exchange, f"{TEXT}seek: [io]\n")
    assert any("is sought again" in text for text in texts) is wrong


@pytest.mark.parametrize(
    ("less_s", "by", "wrong"),
    [
        (40.0, "by its record flight.mcap", False),
        (100.0, "by its record flight.mcap", True),
        (5.0, "by the vehicle's report", False),
        (15.0, "by the vehicle's report", True),
        (-1.5, "by the vehicle's report", False),
        (-5.0, "by the vehicle's report", True),
    ],
)
def test_what_is_resumed_is_known_to_have_flown_as_long_as_it_did(less_s, by, wrong):
    """It flies since 1 s."""
    report = f"in the air for {130.0 - 1.0 - less_s:.0f} s, 0 of 3 waypoints explored ({by})"
    flown = evidence(FLOWN, faults=("RESTART",), announced=[(130.0, report)])
    assert ("but it flew" in str(judge(flown).violations)) is wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(0.3, False), (0.9, True)])
def test_an_answer_comes_within_half_a_second_of_what_it_begins(later_s, wrong):
    announced = [
        (40.0, "40.0 s  READY -> INIT"),
        (60.0, "60.0 s  INIT -> HOLD"),
        (60.0 + later_s, "the operator: accepted: it stops and hovers"),
    ]
    texts = found(announced, (), TEXT)
    assert any("without an accepted request" in text for text in texts) is wrong


@pytest.mark.parametrize(
    ("at_s", "wrong"), [(59.4, False), (58.0, True), (61.5, False), (65.0, True)]
)
def test_a_state_ends_no_second_early_and_no_two_and_a_half_late(at_s, wrong):
    announced = [(40.0, "40.0 s  READY -> INIT"), (at_s, f"{at_s} s  INIT -> SEARCH")]
    texts = found(announced, (), f"{TEXT}timers: {{init_s: 20}}\n")
    assert any("INIT lasted" in text or "INIT ended" in text for text in texts) is wrong


@pytest.mark.parametrize(("beside_m", "wrong"), [(2.6, False), (4.5, True)])
def test_a_waypoint_is_visited_to_a_metre_beyond_the_acceptance_radius(beside_m, wrong):
    text = TEXT.replace("[[60, 0], [60, 60]", f"[[{60 + beside_m}, 0], [60, 60]")
    flown = evidence(faults=("EXPLORED",), announced=[(20.0, "20.0 s  READY -> INIT")], text=text)
    assert ("waypoint 1 was neither visited" in str(judge(flown).violations)) is wrong


LASTS = f"{TEXT}endurance_s: 1000\n"


def charged(percent, announced=()):
    """What is found of a flight with this charge all the time: 60 to 85 m away, from 33 s on."""

    def spoil(message):
        fields = {**message.fields, "battery_remaining": percent}
        battery = message.name == "SYS_STATUS"
        return dataclasses.replace(message, fields=fields) if battery else message

    announced = [(33.0, "33.0 s  READY -> INIT"), *announced]
    return str(judge(flight(FLOWN, spoil, announced=announced, text=LASTS)).violations)


@pytest.mark.parametrize(("percent", "wrong"), [(15, False), (10, True)])
def test_it_turns_with_ten_percent_left_beyond_the_way_home_and_the_landing(percent, wrong):
    """The way takes 1.4 %, the landing 5.7 %; 4 % are slack."""
    assert ("stays out" in charged(percent)) is wrong


@pytest.mark.parametrize(("percent", "wrong"), [(31, False), (36, True)])
def test_it_does_not_turn_with_more_than_twice_the_way_home(percent, wrong):
    """Twice 7.2 %, 4 % for the corners, 10 % left, and 4 % are slack."""
    assert ("are enough" in charged(percent, [(33.1, "coming home: battery")])) is wrong
