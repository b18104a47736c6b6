"""The judge in the companion's seat: what was received, and what the companion made of it."""

import dataclasses
import math
from functools import lru_cache

import numpy as np
import pytest

from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind, WireMessage
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import (
    FRAME,
    MISSION,
    ROUND,
    TEXT,
    THROUGH,
    command,
    evidence,
    goto,
    heart,
    track,
)

FLOWN = track((*ROUND, *ROUND))
HOVERS = [*FLOWN[:1400], *[FLOWN[1400]] * 400, *FLOWN[1400:]]
"""Stands from 70 s to 90 s."""

BY_HAND = (82.0, "ALARM: it lasts. Pilot: take over by hand now")
LONG = track(ROUND * 5)


@lru_cache(maxsize=8)
def received(states):
    """What a vehicle sends five times a second: its position, and that all is well."""
    messages = []
    places = zip(*FRAME.degrees(*np.array([state[:2] for state in states[::4]]).T), strict=True)
    for number, (lat, lon) in zip(range(0, len(states), 4), places, strict=True):
        at_s = number * 0.05
        east, north, above, *_ = states[number]
        moved = states[max(number - 1, 0)][:2] != (east, north)
        clock = {"time_boot_ms": number * 50}
        place = {
            "lat": round(lat * 1e7),
            "lon": round(lon * 1e7),
            "alt": round((6.7 + above) * 1e3),
        }
        speed = {"vx": 500 if moved else 0, "vy": 0}
        for name, fields in (
            ("GLOBAL_POSITION_INT", {**clock, **place, **speed}),
            ("GPS_RAW_INT", {"time_usec": number * 50_000, "fix_type": 3}),
            ("SYS_STATUS", {"battery_remaining": 80}),
            ("HEARTBEAT", {"system_status": 4, "custom_mode": MISSION}),
            ("MISSION_CURRENT", {"seq": 1}),
            ("EXTENDED_SYS_STATE", {"landed_state": 2}),
        ):
            messages.append(WireMessage(at_s, 1, 1, 0, name, fields))
    return tuple(messages)


def flight(states=FLOWN, spoil=lambda message: message, **others):
    """A flight in which every received message is changed; None: it was not received."""
    messages = tuple(m for m in map(spoil, received(tuple(states))) if m is not None)
    return dataclasses.replace(evidence(states, **others), received=messages)


def between(begin_s, end_s, *names, **fields):
    """Spoils these messages in this time: other fields, or, without any, not received."""

    def spoil(message):
        if not begin_s <= message.time_s < end_s or (names and message.name not in names):
            return message
        return dataclasses.replace(message, fields={**message.fields, **fields}) if fields else None

    return spoil


def frozen(begin_s, end_s):
    """The last received place, while its clock and its velocity go on."""
    last = {}

    def spoil(message):
        if message.name != "GLOBAL_POSITION_INT":
            return message
        if not begin_s <= message.time_s < end_s:
            last.update({key: message.fields[key] for key in ("lat", "lon", "alt")})
            return message
        return dataclasses.replace(message, fields={**message.fields, **last})

    return spoil


def found(evidence):
    return {violation.kind for violation in judge(evidence).violations}


def test_a_flight_that_received_all_is_good():
    assert found(flight()) == set()


def test_a_vehicle_that_reports_no_multicopter_is_not_commanded():
    def kinds_of(kind, begin_s, end_s):
        spoil = between(begin_s, end_s, "HEARTBEAT", system_status=4, type=kind)
        flown = flight(more=[goto(60.0, 60, 0)], spoil=spoil)
        return {violation.kind for violation in judge(flown).violations} & {"vehicle"}

    assert kinds_of(1, 50.0, 80.0) == {"vehicle"}
    assert kinds_of(13, 50.0, 80.0) == set()  # a hexarotor
    assert kinds_of(1, 59.8, 80.0) == set()  # it could not be known yet
    assert kinds_of(1, 58.4, 80.0) == {"vehicle"}  # the third HEARTBEAT comes at 58.8 s
    assert kinds_of(1, 58.8, 80.0) == set()
    assert kinds_of(22, 50.0, 55.0) == set()  # it was over


@pytest.mark.parametrize(("left_s", "wrong"), [(50.0, False), (math.inf, True), (50.15, True)])
def test_a_mode_that_is_reported_after_it_was_left_may_be_taken_for_a_pilots(left_s, wrong):
    """It reports Mission mode all the time."""
    hold = 0x03040000
    states = [(*s[:5], hold if 0.05 * n >= left_s else s[5]) for n, s in enumerate(FLOWN)]
    announced = [CRUISES, (50.3, "50.3 s  WARNING: hands off: the pilot chose Mission mode")]
    texts = [violation.text for violation in judge(flight(states, announced=announced)).violations]
    assert any("but no pilot has" in text for text in texts) is wrong


CRUISES = (43.0, "43.0 s  READY -> INIT")
NEAR = ((0, 0), (17, 0), (17, 60), (0, 60), (0, 0))
"""By 3 m past the shed."""
POSITION, FIX = "GLOBAL_POSITION_INT", "GPS_RAW_INT"


@pytest.mark.parametrize(("line", "missing"), [("hands off: a", False), ("not sent: a", True)])
def test_a_vehicle_in_a_failsafe_is_left_to_it(line, missing):
    """In Hold, by our own order, only its HEARTBEAT reports the failsafe."""
    acts = between(70.0, 75.0, "HEARTBEAT", system_status=5)
    announced = [CRUISES, (71.0, f"71.0 s  {line} failsafe of the autopilot acts")]
    wrong = [
        violation.text for violation in judge(flight(spoil=acts, announced=announced)).violations
    ]
    assert any("a failsafe acted" in text for text in wrong) == missing


@pytest.mark.parametrize(
    ("spoil", "wrong", "line"),
    [
        (between(70.0, 85.0), {"report"}, "nothing received from the vehicle for 3 s"),
        (between(70.0, 74.0, POSITION), set(), ""),
        (between(70.0, 76.0, "SYS_STATUS"), set(), ""),
        (between(70.0, 85.0, "SYS_STATUS"), {"report"}, "battery not received for 5 s"),
        (
            between(70.0, 85.0, "EXTENDED_SYS_STATE"),
            {"report"},
            "landed state not received for 5 s",
        ),
        (between(70.0, 85.0, "MISSION_CURRENT"), {"report"}, "plan item not received for 5 s"),
        (
            between(70.0, 85.0, "HEARTBEAT"),
            {"report"},
            "heartbeat not received; flight mode as well",
        ),
        (between(70.0, 75.0, FIX, fix_type=1), {"report"}, "GPS has lost its fix: holding"),
        (between(70.0, 75.0, "HEARTBEAT", system_status=5), {"report"}, "hands off: a failsafe"),
    ],
)
def test_what_is_missing_is_announced(spoil, wrong, line):
    assert found(flight(spoil=spoil)) == wrong
    status = "INIT   |  3 s left | battery, GPS, item, position"
    assert found(flight(spoil=spoil, announced=[(71.0, status)])) == wrong
    assert found(flight(spoil=spoil, announced=[(73.0, line)])) == set()


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (between(69.0, 85.0, POSITION), "position not received for 2 s: holding"),
        (frozen(69.0, 85.0), "position not received for 2 s: holding"),
        (between(60.0, 85.0, FIX), "GPS status not received for 5 s"),
        (between(69.0, 85.0, FIX, fix_type=0), "GPS has lost its fix: holding"),
    ],
)
def test_what_is_announced_is_done_as_well(spoil, line):
    announced = [(68.0, line), (71.0, line), BY_HAND]
    assert found(flight(spoil=spoil, announced=announced)) == {"blind"}
    assert found(flight(HOVERS, spoil, announced=announced)) == set()


@pytest.mark.parametrize(
    ("later", "wrong"),
    [
        ((BY_HAND,), set()),
        ((), {"report"}),
        (((82.0, "WARNING: it lasts. Pilot: take over by hand now"),), {"report"}),
        (((82.0, "ALARM: it lasts. Pilot: be ready"),), {"report"}),
        (((87.0, BY_HAND[1]),), {"report"}),  # too late
        (
            (BY_HAND, *((72.0 + s, BY_HAND[1].replace("it lasts", "position")) for s in range(9))),
            {"report"},  # that drowns all other alarms
        ),
    ],
)
def test_a_vehicle_that_stands_for_a_lost_position_alarms_the_pilot(later, wrong):
    announced = [(71.0, "position not received for 2 s: holding"), *later]
    assert found(flight(HOVERS, between(69.0, 90.0, POSITION), announced=announced)) == wrong


@pytest.mark.parametrize(
    ("h_acc", "lasts_s", "wrong"), [(2500, 15, 1), (1500, 15, 0), (2500, 3, 0)]
)
def test_a_poor_fix_is_announced(h_acc, lasts_s, wrong):
    spoil = between(62.0, 62.0 + lasts_s, FIX, fix_type=3, h_acc=h_acc)
    flown = flight(HOVERS, spoil, announced=[CRUISES])
    assert found(flown) == ({"report"} if wrong else set())


def test_a_poor_fix_is_held_for_and_not_only_announced():
    spoil = between(62.0, 85.0, FIX, fix_type=3, h_acc=2500)
    announced = [CRUISES, (65.0, "the satellites' position is good to 2.5 m only: holding")]
    assert found(flight(spoil=spoil, announced=announced)) == {"blind"}
    assert found(flight(HOVERS, spoil, announced=announced)) == set()


def test_a_fix_that_is_back_for_three_seconds_is_back():
    announced, leg = [(70.5, "GPS has lost its fix: holding")], goto(78.0, 60, 0)
    first, later = (between(s, s + 4.0, FIX, fix_type=1) for s in (70.0, 78.1))
    assert (
        found(flight(HOVERS, lambda m: later(first(m)), announced=announced, more=[leg])) == set()
    )
    flickers = [between(s, s + 2.0, FIX, fix_type=1) for s in range(70, 84, 4)]

    def spoil(message):
        for each in flickers:
            message = each(message)
        return message

    assert found(flight(HOVERS, spoil, announced=announced, more=[leg])) == {"blind"}


def test_no_leg_begins_from_a_place_that_is_not_known():
    announced = [(71.0, "position not received for 2 s: holding"), BY_HAND]
    spoil, leg = between(69.0, 85.0, POSITION), goto(80.0, 60, 0)
    assert found(flight(HOVERS, spoil, announced=announced, more=[leg])) == {"blind", "leg"}
    assert found(flight(HOVERS, announced=announced, more=[leg])) == set()


def test_without_its_battery_it_comes_home_and_does_not_only_announce_it():
    announced = [(30.0, "battery not received for 5 s: coming home at 30 s")]
    long = track(ROUND * 5)
    spoil = between(25.0, 300.0, "SYS_STATUS")
    assert found(flight(long, spoil, announced=announced)) == {"home"}


def test_at_the_reserve_it_announces_that_and_comes_home():
    spoil = between(40.0, 300.0, "SYS_STATUS", battery_remaining=24)
    long = track(ROUND * 5)
    assert found(flight(long, spoil)) == {"report", "home"}
    first = [(41.0, "coming home: battery at 24%")]  # of the first message
    assert found(flight(long, spoil, announced=first)) == {"home", "battery"}
    announced = [(43.5, "coming home: battery at 24%")]
    assert found(flight(long, spoil, announced=announced)) == {"home"}
    assert found(flight(track(ROUND), spoil, announced=announced)) == set()


@pytest.mark.parametrize(("announced_s", "late"), [(44.0, False), (46.0, True)])
def test_a_charge_that_fell_slowly_is_acted_on_at_once(announced_s, late):
    """One that jumped by 56 % may be waited for, as above; here 26 % were reported before."""

    def spoil(message):
        left = 24 if message.time_s >= 40.0 else 26
        fields = {**message.fields, "battery_remaining": left}
        battery = message.name == "SYS_STATUS" and message.time_s > 30.0
        return dataclasses.replace(message, fields=fields) if battery else message

    announced = [(announced_s, "coming home: battery at 24%")]
    assert ("report" in found(flight(track(ROUND), spoil, announced=announced))) == late


@pytest.mark.parametrize("gap", [False, True])
def test_only_where_zones_leave_a_way_home_is_it_to_be_flown(gap):
    south = [[32, 32], [70 if gap else 90, 32], [70 if gap else 90, 35], [32, 35]]
    walls = [[[32, 85], [90, 85], [90, 88], [32, 88]], south]
    walls += [[[east, 32], [east + 3, 32], [east + 3, 88], [east, 88]] for east in (32, 87)]
    text = TEXT + "".join(f"  - {{name: wall {n}, polygon: {w}}}\n" for n, w in enumerate(walls))
    enclosed = SceneEvent(60.0, SceneEventKind.MISSION_FILE, text)
    spoil = between(65.0, 300.0, "SYS_STATUS", battery_remaining=24)
    hovers = [*FLOWN[:900], *[(60, 60, 40.0, True, False, MISSION)] * 3000]
    assert ("home" in found(flight(hovers, spoil, happenings=(enclosed,)))) == gap


def test_a_breach_is_announced_also_to_the_pilot_who_flies_it():
    states, taken = track(THROUGH, speed=2.0), (SceneEvent(15.0, SceneEventKind.PILOT, "sticks"),)
    breach = flight(states, faults=("PILOT",), happenings=taken, code=6)
    hands_off = (16.0, "hands off: the pilot chose Position mode")
    silent = dataclasses.replace(breach, lines=flight(announced=[hands_off]).lines)
    assert found(silent) == {"report"}
    announced = [hands_off, (43.0, "breach of shed"), (63.0, "breach of shed")]
    assert found(dataclasses.replace(breach, lines=flight(announced=announced).lines)) == set()


@pytest.mark.parametrize(
    ("taken", "announced", "wrong"), [(1, (), 1), (1, ((76.0,),), 0), (0, (), 0)]
)
def test_a_zone_that_is_drawn_over_it_is_announced_to_the_pilot_who_has_it(taken, announced, wrong):
    """A vehicle that is ours leaves such a zone, and announces that."""
    (east, north), around = HOVERS[1500][:2], ((-3, -3), (3, -3), (3, 3), (-3, 3))
    ring = [[round(east + e, 2), round(north + n, 2)] for e, n in around]
    drawn = SceneEvent(75.0, SceneEventKind.MISSION_FILE, f"{TEXT}  - {{polygon: {ring}}}\n")
    pilots = (SceneEvent(65.0, SceneEventKind.PILOT, "sticks"),) if taken else ()
    lines = [(at_s, "breach of zone 3") for (at_s,) in announced]
    flown = flight(HOVERS, faults=("PILOT",), happenings=(*pilots, drawn), announced=lines)
    assert ("a breach of zone" in str(judge(flown).violations)) == bool(wrong)


def test_an_altitude_that_nothing_can_have_flown_to_is_announced():
    def spoil(message):
        if message.name != POSITION or not 70.0 <= message.time_s < 88.0:
            return message
        fields = {**message.fields, "alt": message.fields["alt"] + 6000}
        return dataclasses.replace(message, fields=fields)

    announced = [
        CRUISES,
        (70.5, "the altitude jumped from 40 to 46 m"),
        (88.5, "the altitude jumped"),
    ]
    assert found(flight(HOVERS, spoil, announced=[CRUISES])) == {"report"}
    assert found(flight(HOVERS, spoil, announced=announced)) == set()
    assert found(flight(FLOWN, spoil, announced=announced)) == {"held"}


@pytest.mark.parametrize(
    ("up_m", "announced_s", "wrong"),
    [
        (3.5, None, set()),
        (5.0, None, {"report"}),
        (5.0, 45.0, set()),  # long before the average that the judge takes is beyond its limit
        (5.0, 20.0, {"report"}),
        (8.0, 45.0, {"home"}),
    ],
)
def test_a_drift_of_the_altitude_is_announced_once_and_ends_the_mission(up_m, announced_s, wrong):
    """Of 3.5 m from 40 s on; of more from 110 s on."""

    def drifts(message):
        if message.name != FIX:
            return message
        off_m = up_m if message.time_s >= 110.0 else 3.5 if message.time_s >= 40.0 else 0.0
        number = round(message.time_s / 0.05)
        alt = round((6.7 + LONG[number][2] + off_m) * 1e3)
        return dataclasses.replace(message, fields={**message.fields, "alt": alt})

    announced = [(21.0, "21.0 s  READY -> INIT")]
    announced += [(announced_s, "the altitude is in doubt")] if announced_s else []
    assert found(flight(LONG, drifts, announced=announced)) == wrong


@pytest.mark.parametrize(
    ("out", "again"),
    [
        (SceneEventKind.KILLED, SceneEventKind.STARTED),
        (SceneEventKind.STOPPED, SceneEventKind.CONTINUED),
    ],
)
def test_a_companion_that_received_nothing_of_a_climb_has_seen_no_altitude_drift(out, again):
    """The first altitude that it receives is of the satellites, 20 m above the last before."""

    def spoil(message):
        if 8.5 <= message.time_s < 18.5 or (message.name == POSITION and message.time_s == 18.6):
            return None
        if message.name != FIX:
            return message
        alt = round((6.7 + FLOWN[round(message.time_s / 0.05)][2]) * 1e3)
        return dataclasses.replace(message, fields={**message.fields, "alt": alt})

    happenings = (SceneEvent(8.5, out), SceneEvent(18.5, again))
    announced = [(18.7, "the companion stalled for 10.0 s"), CRUISES]
    assert found(flight(spoil=spoil, happenings=happenings, announced=announced)) == set()


def test_a_clearance_that_is_lost_is_announced_and_held_for():
    early = (22.0, "22.0 s  READY -> INIT")
    near = (28.5, "too near to no-fly zone 'shed': 3.0 m, 5 m are required: holding")
    for speed_m_s, announced, wrong in (
        (5.0, [early], {"report", "held"}),
        (5.0, [early, near], {"held"}),
        (2.0, [early, (38.5, near[1])], set()),
    ):
        flown = track(NEAR, speed=speed_m_s)
        assert found(flight(flown, faults=("PUSHED",), announced=announced)) == wrong


@pytest.mark.parametrize(("up_m", "wrong"), [(-25.0, {"held"}), (1.0, set())])
def test_for_a_home_that_is_moved_up_or_down_it_is_held(up_m, wrong):
    moved = (SceneEvent(70.0, SceneEventKind.HOME_MOVED, (0.0, 0.0, 6.7 + up_m)),)
    announced = [CRUISES, (70.5, "home was moved")]
    how = {"faults": ("HOME_MOVED",), "happenings": moved, "announced": announced}
    assert found(flight(FLOWN, **how)) == wrong
    assert found(flight(HOVERS, **how)) == set()


@pytest.mark.parametrize(
    ("announced", "wrong"),
    [
        ("not reloaded: mission.yaml:9: the zone has two corners", set()),
        ("the operator: refused: zones are being changed just now; request it again", set()),
        ("not reloaded: its fences and no-fly zones are as they were", {"report"}),
        ("EXPL -> SEARCH", {"report"}),
    ],
)
def test_a_changed_file_that_is_not_taken_is_reported(announced, wrong):
    # Where home lies in a new zone the file cannot be taken, whatever is announced.
    home = "  - {name: new, polygon: [[-5, -5], [5, -5], [5, 5], [-5, 5]]}\n"
    drawn = TEXT + home

    def left(text):
        return (SceneEvent(74.0, SceneEventKind.FILE_LEFT, (70.0, text)),)

    higher = TEXT.replace("upper_m: 20", "upper_m: 50") + home
    for changed in (drawn, higher):
        assert found(flight(announced=[(72.0, announced)], happenings=left(changed))) == wrong
    assert found(flight(announced=[(72.0, announced)], happenings=left(TEXT))) == set()


@pytest.mark.parametrize(
    ("announced_s", "wrong"),
    [
        (88.5, set()),  # nothing while it stands still, and once it goes on what that was
        (60.0, {"report"}),  # of another standstill
        (96.0, {"report"}),  # too late
    ],
)
def test_a_companion_that_stood_still_announces_it_as_soon_as_it_goes_on(announced_s, wrong):
    still = (SceneEvent(69.0, SceneEventKind.STOPPED), SceneEvent(88.0, SceneEventKind.CONTINUED))
    announced = [(announced_s, "the companion stalled for 19.0 s")]
    assert found(flight(spoil=between(70.0, 88.0), happenings=still, announced=announced)) == wrong


@pytest.mark.parametrize("on_s", [69.6, 3000.0])
def test_one_that_stood_still_for_a_moment_or_for_good_need_not_announce_it(on_s):
    kinds = ((69.0, SceneEventKind.STOPPED), (on_s, SceneEventKind.CONTINUED))
    still = tuple(SceneEvent(at_s, kind) for at_s, kind in kinds)
    assert found(flight(happenings=still)) == set()


@pytest.mark.parametrize(("speed", "wrong"), [(1.0, {"report"}), (5.0, set())])
def test_a_companion_measures_its_standstill_by_its_own_clock(speed, wrong):
    """Two seconds of a vehicle that is simulated five times as fast are 0.4 s of its own."""
    still = (SceneEvent(69.0, SceneEventKind.STOPPED), SceneEvent(71.0, SceneEventKind.CONTINUED))
    assert found(dataclasses.replace(flight(happenings=still), speed=speed)) == wrong


@pytest.mark.parametrize("states", [track(land=False), FLOWN[:20]])
def test_landed_at_home_is_announced_only_of_a_landing_there(states):
    assert "report" in found(flight(states, announced=[(10.0, "landed at home")], code=1))


def test_a_silent_link_and_the_way_home_are_measured_by_the_companions_own_clock():
    announced = [(84.0, "nothing received from the vehicle for 3 s")]
    silent = flight(spoil=between(70.0, 100.0), announced=announced)
    assert found(silent) == {"report"}
    assert found(dataclasses.replace(silent, speed=5.0)) == set()
    announced = [(46.0, "GPS status not received for 5 s: holding at 10 s"), (61.0, BY_HAND[1])]
    spoil = between(41.0, 73.0, FIX)
    for leg_s, wrong in ((60.0, {"blind"}), (68.5, set())):
        stands = [*FLOWN[:950], *[FLOWN[950]] * 460, *FLOWN[950:]]
        assert found(flight(stands, spoil, announced=announced, more=[goto(leg_s, 60, 0)])) == wrong


@pytest.mark.parametrize(("lie_s", "wrong"), [(None, True), (20.0, True), (70.0, False)])
def test_a_mode_that_was_received_and_was_not_flown_may_be_believed_at_once(lie_s, wrong):
    spoil = (
        (lambda m: m) if lie_s is None else between(lie_s, lie_s + 3.0, "HEARTBEAT", custom_mode=7)
    )
    announced = [(71.0, "hands off: the pilot chose Hold mode")]
    for code in (1, 6):
        assert ("report" in found(flight(spoil=spoil, announced=announced, code=code))) == wrong


@pytest.mark.parametrize(("again", "wrong"), [(False, set()), (True, {"report"})])
def test_a_fix_that_comes_and_goes_is_announced_once(again, wrong):
    def spoil(message):
        message = between(70.0, 72.0, FIX, fix_type=1)(message)
        return between(84.0, 89.0, FIX, fix_type=1)(message)

    announced = [(71.0, "GPS has lost its fix: holding")]
    announced += [(73.0, "GPS has its fix again")] if again else []
    assert found(flight(HOVERS, spoil, announced=announced)) == wrong


@pytest.mark.parametrize(
    ("sent", "severity", "wrong"),
    [
        (["air_router: hands off: the pilot chose Posi", "tion mode. Pilot: fly it"], 4, set()),
        (
            ["air_router: hands off: the pilot chose Posi", "tion mode. Pilot: fly it"],
            6,
            {"report"},
        ),
        (["air_router: hands off: the pilot chose Position mode"], 4, {"report"}),
        (["air_router: coming home"], 4, {"report"}),
        ([], 4, {"report"}),
    ],
)
def test_what_is_announced_is_sent_to_the_ground_station(sent, severity, wrong):
    taken = (SceneEvent(15.0, SceneEventKind.PILOT, "sticks"),)
    line = "    16.0 s  WARNING: hands off: the pilot chose Position mode. Pilot: fly it"
    announced = [(16.0, line)]
    fields = [{"text": text, "severity": severity} for text in sent]
    texts = [WireMessage(16.0, 1, 191, 0, "STATUSTEXT", each) for each in fields]
    how = {"faults": ("PILOT",), "happenings": taken, "code": 6}
    how |= {"announced": announced, "more": texts}
    assert found(flight(**how)) == wrong


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("    16.0 s  ALARM: the position is lost. Pilot: take over", set()),
        ("ALARM: the position is lost", {"report"}),
        ("WARNING: the position is lost", {"report"}),
        ("    16.0 s  the position is lost", set()),
    ],
)
def test_a_warning_has_an_instruction(line, wrong):
    assert found(evidence(FLOWN, announced=[(16.0, line)])) == wrong


# What an operator requested.


def found_of(states, verb, answer, *, more=(), later=()):
    """What is found of a flight with this request at 70 s."""
    requested = SceneEvent(70.0, SceneEventKind.REQUEST, verb)
    announced = [CRUISES, (70.0, f"70.0 s  the operator: {answer}")]
    return found(evidence(states, more=more, happenings=(requested, *later), announced=announced))


def test_a_hold_that_was_accepted_is_flown():
    assert found_of(FLOWN, "hold", "accepted: it stops and hovers") == {"request"}
    assert found_of(HOVERS, "hold", "accepted: it stops and hovers") == set()
    leg = [goto(75.0, 60, 60)]
    assert "request" in found_of(HOVERS, "hold", "accepted: it stops and hovers", more=leg)


@pytest.mark.parametrize("answer", ["refused: it comes home", "accepted: it holds already"])
def test_what_was_refused_or_is_so_already_needs_not_follow(answer):
    assert found_of(FLOWN, "hold", answer) == set()


def test_after_a_way_home_was_accepted_something_is_sent():
    accepted = "accepted: it comes home"
    assert found_of(FLOWN, "home", accepted) == {"request"}
    assert found_of(FLOWN, "home", accepted, more=[command(71.0, 176)]) == set()
    assert found_of(FLOWN, "home", f"{accepted} as soon as its position is known") == set()


def test_the_next_request_is_another_wish():
    later = (SceneEvent(72.0, SceneEventKind.REQUEST, "explore"),)
    assert found_of(FLOWN, "hold", "accepted: it stops and hovers", later=later) == set()
    assert found_of(FLOWN, "home", "accepted: it comes home", later=later) == set()


def test_a_companion_that_is_started_anew_has_no_claim_to_another_plan():
    happenings = [
        SceneEvent(30.0, SceneEventKind.KILLED),
        SceneEvent(32.0, SceneEventKind.PILOT, "plan"),
        SceneEvent(40.0, SceneEventKind.STARTED),
    ]
    faults, more = ("RESTARTED_ON_ANOTHER",), [heart(45.0), command(50.0, 176)]
    for value, wrong in (("plan", True), ("sticks", False)):
        happenings[1] = SceneEvent(32.0, SceneEventKind.PILOT, value)
        flown = evidence(more=more, faults=faults, happenings=tuple(happenings))
        assert ("authority" in {v.kind for v in judge(flown).violations}) == wrong


@pytest.mark.parametrize(
    ("at_s", "requested_s", "wrong"),
    [
        (51.0, math.inf, True),
        (50.6, math.inf, False),  # it had been decided on
        (52.0, 51.5, False),  # the operator wants that
        (49.0, math.inf, False),
    ],
)
def test_mission_mode_is_not_chosen_over_a_plan_that_was_reported(at_s, requested_s, wrong):
    happenings = [SceneEvent(50.0, SceneEventKind.PILOT, "plan")]
    if math.isfinite(requested_s):
        happenings.append(SceneEvent(requested_s, SceneEventKind.REQUEST, "resume upload"))

    def spoil(message):
        number = 7 if message.time_s < 50.3 else 8
        fields = {**message.fields, "mission_id": number}
        current = message.name == "MISSION_CURRENT"
        return dataclasses.replace(message, fields=fields) if current else message

    begins = [command(at_s, 176, param2=4.0, param3=4.0)]
    flown = flight(spoil=spoil, more=begins, faults=("START_LOST",), happenings=tuple(happenings))
    texts = [violation.text for violation in judge(flown).violations]
    assert any("another plan was on board" in text for text in texts) is wrong


@pytest.mark.parametrize("stands", [False, True])
def test_given_back_low_it_climbs_before_it_flies_on(stands):
    states = [(*s[:2], 20.0, *s[3:]) if 900 <= n < 1600 else s for n, s in enumerate(track())]
    if stands:
        states[1200:1600] = [(*states[1200][:2], *s[2:]) for s in states[1200:1600]]
    happenings = (
        SceneEvent(30.0, SceneEventKind.PILOT, "sticks"),
        SceneEvent(60.0, SceneEventKind.REQUEST, "resume"),
    )
    back = [command(61.0, 176, param2=4.0, param3=4.0)]
    verdict = judge(evidence(states, more=back, faults=("HANDED_BACK_LOW",), happenings=happenings))
    assert ("altitude" in {violation.kind for violation in verdict.violations}) != stands


FAILSAFE_S, RETURNS_S = 60.0, 65.0


def acting(*modes):
    """HEARTBEATs of a failsafe: these sub-modes of AUTO, and from when on each."""

    def spoil(message):
        mode = next((mode for from_s, mode in modes if message.time_s >= from_s), None)
        if message.name != "HEARTBEAT" or mode is None:
            return message
        changed = {"system_status": 5, "custom_mode": mode << 24 | 4 << 16}
        return dataclasses.replace(message, fields={**message.fields, **changed})

    return spoil


@pytest.mark.parametrize(
    ("announced", "wrong"),
    [
        ((), True),
        (((66.0, "an autopilot failsafe changed from Hold to Return mode"),), False),
        (((66.0, "an autopilot failsafe changed from Hold to Land mode"),), True),
        (((80.0, "an autopilot failsafe changed from Hold to Return mode"),), True),
    ],
)
def test_that_a_failsafe_goes_on_to_another_mode_is_announced(announced, wrong):
    spoil = acting((RETURNS_S, 5), (FAILSAFE_S, 3))
    lines = ((60.2, "hands off: an autopilot failsafe chose Hold mode"), *announced)
    texts = [v.text for v in judge(flight(spoil=spoil, announced=lines)).violations]
    assert any("went on to Return" in text for text in texts) is wrong


def without_satellites(begin_s, end_s, **more):
    return between(begin_s, end_s, "GPS_RAW_INT", **{"fix_type": 1, **more})


@pytest.mark.parametrize(
    ("spoil", "at_s", "wrong"),
    [
        (without_satellites(60.0, 80.0), 70.0, True),
        (without_satellites(60.0, 80.0), 60.5, False),
        (without_satellites(60.0, 80.0), 81.0, False),
        (without_satellites(60.0, 80.0, fix_type=3, h_acc=7000), 70.0, True),
        (without_satellites(60.0, 80.0, fix_type=3, h_acc=3000), 70.0, False),
    ],
)
def test_no_breach_is_claimed_while_the_position_is_not_known(spoil, at_s, wrong):
    flown = flight(spoil=spoil, announced=((at_s, "breach of zone 1"),))
    texts = [v.text for v in judge(flown).violations]
    assert any("and its position is not known" in text for text in texts) is wrong


@pytest.mark.parametrize(
    ("announced", "mode", "wrong"),
    [
        ((), 0x05040000, True),
        (((67.0, "the vehicle's position is not known: GPS has no fix"),), 0x05040000, False),
        (((70.0, "the vehicle's position is not known: GPS has no fix"),), 0x05040000, True),
        ((), 0x00030000, False),  # flown by hand: by sight
    ],
)
def test_an_unknown_position_is_alarmed_of_while_the_autopilot_flies(announced, mode, wrong):
    states = [
        (*s[:5], mode, *s[6:]) if n * 0.05 >= FAILSAFE_S else s for n, s in enumerate(track())
    ]
    taken = (SceneEvent(FAILSAFE_S, SceneEventKind.PILOT, "AUTO_RTL"),)
    lines = ((60.2, "hands off: the pilot chose a mode"), *announced)
    spoil = without_satellites(FAILSAFE_S, 90.0)
    flown = flight(states, spoil=spoil, announced=lines, happenings=taken, faults=("PILOT",))
    texts = [v.text for v in judge(flown).violations]
    assert any("its position is not known" in text for text in texts) is wrong


@pytest.mark.parametrize("moved", [False, True])
def test_no_station_is_blamed_for_a_home_that_none_has_moved(moved):
    scene = (SceneEvent(60.0, SceneEventKind.HOME_MOVED, (40.0, -75.0, 590.0)),) if moved else ()
    flown = flight(announced=((61.0, "home was moved: 40 m up"),), happenings=scene)
    texts = [v.text for v in judge(flown).violations]
    assert any("no station has moved it" in text for text in texts) is not moved
