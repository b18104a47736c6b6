"""The judge of whose it is, by hand: in a silence, over an order that shows, handed over."""

import dataclasses

import pytest

from sitl.rehearsal.judge.acceptance import End
from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind, WireMessage
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import (
    FRAME,
    HOLD,
    MISSION,
    TEXT,
    command,
    evidence,
    goto,
    heart,
    past_the_shed,
    track,
)
from tests.sitl.rehearsal.judge.test_judge_inputs import between, flight


def found(flown):
    return [v.text for v in judge(flown).violations if v.kind in {"authority", "held"}]


SPOIL = between(40.0, 55.0)


def silent(order, *, requested=None):
    """What is found of a motion in, or after, a silence of 15 s; the mode comes a second later."""

    def spoil(message):
        late = message.name == "HEARTBEAT" and 55.0 <= message.time_s < 56.0
        return None if late else SPOIL(message)

    scene = () if requested is None else (SceneEvent(50.0, SceneEventKind.REQUEST, requested),)
    return [
        text
        for text in found(flight(more=[order], spoil=spoil, happenings=scene))
        if "flight mode" in text
    ]


@pytest.mark.parametrize(
    ("at_s", "wrong"), [(42.0, False), (50.0, True), (55.4, True), (56.3, False)]
)
def test_nothing_leaves_on_a_flight_mode_from_before_a_silence(at_s, wrong):
    assert bool(silent(goto(at_s, 60, 0))) is wrong


def test_in_a_silence_only_a_requested_hold_leaves():
    hold = command(50.2, 176, param2=4.0, param3=3.0)
    assert silent(hold)
    assert silent(hold, requested="goto 39.9,-75.2")
    assert not silent(hold, requested="hold")


def test_what_is_repeated_just_after_the_silence_began_is_not_new():
    before, again = goto(43.6, 60, 0), goto(44.3, 60, 0)
    flown = flight(more=[before, again], spoil=SPOIL)
    assert not [text for text in found(flown) if "flight mode" in text]


def diverted(at_s, *, recent=False, flown=None, moves_m=40):
    """What is found of a hold at a time; another place was received at 30.4 s."""
    event = (SceneEvent(30.0, SceneEventKind.PILOT, "reposition"),)
    messages = []
    for time_s, east in ((29.0, 10), (30.4, 10 + moves_m)):
        latitude, longitude = FRAME.degrees(east, 10)
        fields = {"lat_int": round(latitude * 1e7), "lon_int": round(longitude * 1e7)}
        messages.append(WireMessage(time_s, 1, 1, 0, "POSITION_TARGET_GLOBAL_INT", fields))
    more = [command(at_s, 176, param2=4.0, param3=3.0)]
    more += [command(26.0, 176, param2=4.0, param3=3.0)] if recent else []
    texts = found(evidence(flown, more=more, happenings=event, received=tuple(messages)))
    return [text for text in texts if "over another" in text]


@pytest.mark.parametrize(("at_s", "wrong"), [(30.5, False), (31.2, True), (32.5, True)])
def test_no_hold_leaves_over_another_place_that_shows(at_s, wrong):
    assert bool(diverted(at_s)) is wrong


INTO_THE_SHED = track(((0, 0), (0, 30), (30, 30), (0, 0)))


@pytest.mark.parametrize("excuse", [{"recent": True}, {"flown": INTO_THE_SHED}, {"moves_m": 3}])
def test_a_hold_may_leave_over_what_shows_in_a_zone_or_may_be_its_own(excuse):
    assert not diverted(31.2, **excuse)


@pytest.mark.parametrize(("by_m", "wrong"), [(0.7, False), (2.0, True)])
def test_a_hold_may_leave_over_what_shows_within_a_metre_of_a_zone(by_m, wrong):
    assert bool(diverted(31.2, flown=past_the_shed(by_m))) is wrong


BREACH = "45.0 s  hands off: breach of shed is not resumed by itself"


@pytest.mark.parametrize(
    ("announced", "seconds", "wrong"),
    [((), 3.0, True), (((45.0, BREACH),), 3.0, False), ((), 0.4, False)],
)
def test_a_vehicle_that_reports_a_breach_is_given_away(announced, seconds, wrong):
    latitude, longitude = FRAME.degrees(30, 30)
    inside = {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7)}
    spoil = between(43.0, 43.0 + seconds, "GLOBAL_POSITION_INT", **inside)
    texts = found(flight(spoil=spoil, announced=announced))
    assert any("flown on with after a breach of shed" in text for text in texts) is wrong


@pytest.mark.parametrize(
    ("announced_s", "wrong"), [(42.0, False), (39.0, True), (46.4, False), (47.0, True)]
)
def test_a_breach_is_given_away_two_seconds_before_it_at_the_earliest(announced_s, wrong):
    """It is half a metre deep at 43 s, surely so at 43.5 s, and is announced within three more."""
    latitude, longitude = FRAME.degrees(30, 30)
    inside = {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7)}
    spoil = between(43.0, 46.0, "GLOBAL_POSITION_INT", **inside)
    texts = found(flight(spoil=spoil, announced=((announced_s, BREACH),)))
    assert any("flown on with after a breach of shed" in text for text in texts) is wrong


@pytest.mark.parametrize(("earlier_s", "wrong"), [(5.0, False), (20.0, True)])
def test_what_is_drawn_over_the_vehicle_it_may_leave_for_ten_seconds(earlier_s, wrong):
    """It is in the zone from 43 s to 46 s, and the zone was drawn so much earlier."""
    latitude, longitude = FRAME.degrees(90, 90)
    inside = {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7)}
    drawn = TEXT + "  - {name: new, polygon: [[80, 80], [100, 80], [100, 100], [80, 100]]}\n"
    reloaded = (SceneEvent(43.0 - earlier_s, SceneEventKind.MISSION_FILE, drawn),)
    spoil = between(43.0, 46.0, "GLOBAL_POSITION_INT", **inside)
    texts = found(flight(spoil=spoil, happenings=reloaded))
    assert any("flown on with after a breach of new" in text for text in texts) is wrong


def low_and_away(*, away=60, above=10.0):
    """A pilot takes off, and flies away low; Mission mode is chosen at 22 s."""
    states = [(0.0, 0.0, 0.0, False, True, HOLD)] * 20
    states += [(0.0, 0.0, n * above / 100, True, n == 0, HOLD) for n in range(101)]
    states += [(away * n / 300, 0.0, above, True, False, HOLD) for n in range(301)]
    return states + [(away, 0.0, above, True, False, MISSION)] * 400


def handed_over(*more, states=None, heights=()):
    scene = [
        SceneEvent(1.0, SceneEventKind.PILOT, "sticks"),
        SceneEvent(22.0, SceneEventKind.HANDED_OVER),
        *heights,
    ]
    hearts = [heart(float(at)) for at in range(1, 40)]
    flown = evidence(
        low_and_away() if states is None else states,
        more=[*hearts, *more],
        happenings=tuple(scene),
        faults=("MISPLACED",),
    )
    return found(flown)


HELD = command(22.2, 176, param2=4.0, param3=3.0)


def test_mission_mode_chosen_low_and_away_is_held():
    assert handed_over(HELD) == []
    assert any("no hold was commanded" in text for text in handed_over())


@pytest.mark.parametrize(("after_s", "late"), [(1.5, False), (4.0, True)])
def test_it_is_held_within_two_seconds_of_mission_mode(after_s, late):
    hold = dataclasses.replace(HELD, time_s=22.0 + after_s)
    assert any("no hold was commanded" in text for text in handed_over(hold)) is late


def test_where_it_is_held_no_mission_begins_before_another_wants_that():
    climb = goto(28.0, 60, 0)
    assert any("a leg 60 m from home at 10.0 m" in text for text in handed_over(HELD, climb))
    wanted = SceneEvent(26.0, SceneEventKind.REQUEST, "home")
    assert not [t for t in handed_over(HELD, climb, heights=[wanted]) if "a leg" in t]


@pytest.mark.parametrize("where", [{"away": 10}, {"above": 40.0}])
def test_above_home_or_level_the_mission_may_begin(where):
    states = low_and_away(**where)
    assert not [t for t in handed_over(goto(22.2, 10, 0), states=states) if "a leg" in t]


@pytest.mark.parametrize(("below_m", "wrong"), [(1.2, False), (4.0, True)])
def test_it_is_level_to_two_metres_below_the_missions_altitudes(below_m, wrong):
    states = low_and_away(above=40.0 - below_m)
    texts = handed_over(goto(22.2, 10, 0), states=states)
    assert any("a leg" in text for text in texts) is wrong


def test_what_is_lost_of_the_hold_leaves_the_vehicle_to_the_pilot_and_may_be_repeated():
    lost = dataclasses.replace(HELD, delivered=False)
    again = [dataclasses.replace(lost, time_s=22.2 + 3.0 * n) for n in range(4)]
    assert handed_over(*again) == []


@pytest.mark.parametrize(
    ("at_s", "delivered", "end"),
    [(68.9, True, "PILOT"), (69.1, True, "LANDED"), (69.1, False, "PILOT")],
)
def test_a_landing_that_we_have_ordered_needs_no_plan(at_s, delivered, end):
    order = dataclasses.replace(command(69.0, 21), delivered=delivered)
    replaced = (SceneEvent(at_s, SceneEventKind.PILOT, "plan"),)
    flown = evidence(more=[order], happenings=replaced, faults=("PLAN_DELETED",))
    assert judge(flown).end is End[end]


@pytest.mark.parametrize(
    ("ordered_s", "received_s", "end"),
    [
        (69.01, 70.9, "LANDED"),  # it had been decided on
        (70.8, 70.9, "LANDED"),
        (70.8, 69.2, "PILOT"),
        (71.2, 90.0, "PILOT"),  # whatever is late: so late is nothing
    ],
)
def test_a_landing_of_before_another_plan_could_be_received_needs_none(ordered_s, received_s, end):
    def spoil(message):
        fields = {**message.fields, "mission_id": 7 if message.time_s < received_s else 8}
        current = message.name == "MISSION_CURRENT"
        return dataclasses.replace(message, fields=fields) if current else message

    replaced = (SceneEvent(69.0, SceneEventKind.PILOT, "plan"),)
    order, faults = command(ordered_s, 21), ("PLAN_DELETED",)
    flown = flight(spoil=spoil, more=[order], happenings=replaced, faults=faults)
    assert judge(flown).end is End[end]


RETURN = 0x05040000
STANDS = (
    SceneEvent(40.0, SceneEventKind.STOPPED, None),
    SceneEvent(41.0, SceneEventKind.PILOT, "AUTO_RTL"),
    SceneEvent(41.5, SceneEventKind.CONTINUED, None),
)


CHOSE = (41.6, "hands off: the pilot chose Return mode")


def stood_still(*messages, announced=CHOSE, scene=STANDS, **others):
    """What is found of a flight whose pilot chose Return at 41 s, in a standstill to 41.5 s."""
    states = [
        (*state[:5], RETURN if n * 0.05 >= 41.0 else state[5]) for n, state in enumerate(track())
    ]
    others |= {"happenings": scene, "reaction_s": 0.0}
    flown = evidence(states, more=messages, code=6, announced=(announced,), **others)
    return [v.text for v in judge(flown).violations if "standstill" in v.text or "41.0" in v.text]


def test_a_choice_in_a_standstill_that_is_announced_and_left_alone_is_good():
    assert stood_still() == []


@pytest.mark.parametrize(
    "message",
    [
        command(41.51, 176, param2=4.0, param3=3.0),
        goto(41.6, 60, 0),
        dataclasses.replace(goto(45.0, 60, 0), name="MISSION_SET_CURRENT", fields={"seq": 2}),
        dataclasses.replace(goto(45.0, 60, 0), name="MISSION_COUNT", fields={"mission_type": 1}),
    ],
)
def test_what_leaves_over_a_choice_in_a_standstill_is_found(message):
    assert any("chosen in the standstill before" in text for text in stood_still(message))


@pytest.mark.parametrize(
    ("fails_s", "wrong"),
    [(None, True), (39.0, False)],  # a vehicle that a failsafe has is another's already
)
def test_a_choice_of_the_moment_in_which_it_stops_counts_if_the_vehicle_was_ours(fails_s, wrong):
    chosen = dataclasses.replace(STANDS[1], time_s=40.0)
    failsafe = () if fails_s is None else ((fails_s, 45.0),)
    hold = command(41.51, 176, param2=4.0, param3=3.0)
    texts = stood_still(hold, scene=(STANDS[0], chosen, STANDS[2]), failsafe=failsafe)
    assert any("chosen in the standstill before" in text for text in texts) is wrong


@pytest.mark.parametrize("announced", [(43.0, "hands off: late"), (41.6, "it holds")])
def test_a_choice_in_a_standstill_that_is_not_announced_at_once_is_found(announced):
    assert stood_still(announced=announced) == ["a mode chosen at 41.0 s is not announced"]


def test_a_choice_outside_of_a_standstill_is_another_rules():
    ends = SceneEvent(40.5, SceneEventKind.CONTINUED, None)
    assert "is not announced" not in str(stood_still(scene=(*STANDS[:1], ends, STANDS[1])))
