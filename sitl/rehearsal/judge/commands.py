"""Rules of the wire: what the companion commanded, whether it might, and where that leads to."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import shapely

from sitl.rehearsal.judge.case import Case, Responsible, Violation
from sitl.rehearsal.judge.evidence import (
    ARM,
    AUTOPILOT,
    REPOSITION,
    RETURN,
    SET_HOME,
    SET_MODE,
    SPEED,
    TERMINATE,
    SceneEventKind,
    WireMessage,
    command_of,
    is_motion,
    number,
    target_of,
)
from sitl.rehearsal.judge.mission_reader import Pair
from sitl.rehearsal.judge.space import DRIFT_M, leaves_low, room_m

_NEVER: Final = frozenset({SET_HOME, RETURN, TERMINATE, 16, 17, 22, 34, 252})
_ON_BOARD_M: Final = 3.0
"""How far the vehicle's own idea of mean sea level may be off."""

_LEG_M: Final = 1.0
"""How far a vehicle may be from the position that it sent, without any fault."""

_TWICE_S, _PLACE_TWICE_S = 0.9, 0.03
"""So soon after it left nothing can be known of a command: it does not leave again as it was. What
leads to a place may be decided anew with the next position, which a link may bring soon after."""

_CROSSES_S: Final = 0.05
"""An order of ours that leaves so soon before or after a choice crosses it on the link, and ends
it: no check of the mode can prevent that, and the vehicle shows that it follows us."""

_SHOWS_LATER_S: Final = 1.0
_UNSHOWN: Final = frozenset({"item", "reposition", "plan", "airframe", "mode of before"})
"""A pilot's choices that no mode shows: where the vehicle goes does, or the next HEARTBEAT."""

_HOVER: Final = frozenset({2, 3, 13, 14, 15, 29, 35})
_OTHERS: Final = 3
"""HEARTBEAT.type of multicopters; so many that name another vehicle are enough to leave it alone.
"""

_RENEWS_S: Final = 1.0
"""What is drawn across the way is held for, or flown around, within so long."""

_READ_S: Final = 0.3
"""A changed file counts for the companion so long before the scene's event, at most."""

_REPEATS_S: Final = 5.0
_FRESH_S: Final = 0.6
"""A repeat needs a HEARTBEAT that is no older."""

_BRAKING_M_S2: Final = 3.0
"""What a PX4 brakes with at its defaults; the flight reckons with less."""

_STANDS_M: Final = 0.2
_STRAIGHT_UP_M: Final = 10.0
"""A place so near is one to climb at: where a vehicle comes to rest on a hold."""

_TRANSFER_S: Final = 5.0
"""A transfer that began before is not begun once more after so long."""

_MISSION, _MISSION_MODE = (4.0, 4.0), 0x04040000  # AUTO, MISSION
_OTHER_PLAN_S: Final = 0.3
"""Within so long an order that had been decided on has left."""

_CONNECTS_S: Final = 1.0
"""A companion that was started has checked the vehicle no sooner."""


def nothing_is_commanded_that_is_anothers(case: Case) -> Iterator[Violation]:
    """No command while the vehicle is a pilot's or a failsafe's, once that can be known."""
    unshown_s = {
        h.time_s for h in case.evidence.events(SceneEventKind.PILOT) if h.value in _UNSHOWN
    }
    hearts_s = _heartbeats_s(case)
    motions = [m for m in case.commands if is_motion(m)]
    for message in filter(_commands, case.commands):
        for begin_s, end_s, by, handed_s in case.given:
            received = bisect_right(hearts_s, begin_s)
            known_s = hearts_s[received] if received < len(hearts_s) else math.inf
            known_s += case.evidence.reaction_s + case.row.notice_s
            known_s += _SHOWS_LATER_S if begin_s in unshown_s else 0.0
            if any(abs(m.time_s - begin_s) <= _CROSSES_S for m in motions):
                continue
            if known_s < message.time_s < min(end_s, handed_s) and begin_s < message.time_s:
                text = f"{_text(message)} while the vehicle is {by} since {begin_s:.1f} s"
                yield Violation(message.time_s, "authority", text)
                break


def _heartbeats_s(case: Case) -> list[float]:
    """When the vehicle's heartbeats left that reached the companion."""
    hearts = (m for m in case.evidence.messages if m.name == "HEARTBEAT" and m.delivered)
    return [heart.time_s for heart in hearts if heart.component == AUTOPILOT]


def only_multicopters_are_commanded(case: Case) -> Iterator[Violation]:
    """A vehicle that reports another type is not armed, moved, or given a plan."""
    hearts = case.received("HEARTBEAT")
    others_s = [m.time_s for m in hearts if m.fields.get("type", 2) not in _HOVER]
    if len(others_s) < _OTHERS:
        return
    kept_s = [m.time_s for m in hearts if m.time_s > others_s[0] and m.time_s not in others_s]
    until_s = kept_s[0] if kept_s else math.inf
    from_s = others_s[_OTHERS - 1] + case.evidence.reaction_s + case.row.notice_s
    for message in case.commands:
        uploads = message.name in {"MISSION_COUNT", "MISSION_CLEAR_ALL"}
        stops = command_of(message) == SET_MODE and not case.flying[case.at(message.time_s)]
        if from_s < message.time_s < until_s and (uploads or _commands(message)) and not stops:
            text = f"{_text(message)} to a vehicle that is no multicopter"
            yield Violation(message.time_s, "vehicle", text)
            return


def it_is_armed_once_and_not_disarmed_in_the_air(case: Case) -> Iterator[Violation]:
    """Nor armed again after it was disarmed."""
    armed = case.armed.argmax() if case.armed.any() else len(case.armed)
    lost_s = case.time_s[armed:][~case.armed[armed:]].tolist()
    disarmed_by_s = [h.time_s for h in case.evidence.events(SceneEventKind.DISARMED)]
    disarmed_s = min([*disarmed_by_s, *lost_s[:1]], default=math.inf)
    for message in case.commands:
        if command_of(message) != ARM:
            continue
        arms = number(message.fields, "param1") == 1.0
        if not arms and case.flying[case.at(message.time_s)]:
            yield Violation(message.time_s, "disarm", "disarmed in the air")
        if arms and message.time_s > disarmed_s:
            text = f"armed after it was disarmed at {disarmed_s:.1f} s"
            yield Violation(message.time_s, "rearm", text)


def nothing_strays(case: Case) -> Iterator[Violation]:
    """No command leaves that no flight sends."""
    for message in case.commands:
        stray = message.name in {"MANUAL_CONTROL", "PARAM_SET"}
        stray = stray and bool(case.flying[case.at(message.time_s)])
        never = command_of(message) in _NEVER or message.name.startswith("SET_POSITION_TARGET")
        if stray or never:
            yield Violation(message.time_s, "stray", f"{_text(message)} is no command of ours")


def speeds_and_heights_are_the_plans(case: Case) -> Iterator[Violation]:
    """No command demands more speed, or another altitude, than the mission's."""
    slack_m = _ON_BOARD_M + case.row.height_m
    for message in case.commands:
        fields, command = message.fields, command_of(message)
        if command not in {SPEED, REPOSITION}:
            continue
        mission = case.version_at(message.time_s).mission
        speed_m_s = number(fields, "param2" if command == SPEED else "param1")
        limit_m_s = mission.speed_m_s + 0.1
        if speed_m_s > limit_m_s:
            text = f"{speed_m_s:.1f} m/s, the plan has {limit_m_s:.1f}"
            yield Violation(message.time_s, "speed", text)
        above_m = number(fields, "z" if "z" in fields else "param7") - case.ground_m
        low_m, high_m = min(mission.altitudes_m) - slack_m, max(mission.altitudes_m) + slack_m
        below = above_m < low_m and not leaves_low(case, case.at(message.time_s))
        if command == REPOSITION and (below or above_m > high_m):
            text = f"sent to {above_m:.1f} m, the plan flies {mission.altitudes_m[0]:.1f} m"
            yield Violation(message.time_s, "height", text)


def nothing_leaves_twice(case: Case) -> Iterator[Violation]:
    """The same command does not leave again before anything can be known of it."""
    for before, message in pairwise(filter(_commands, case.commands)):
        seconds = message.time_s - before.time_s
        led = message.name == "MISSION_SET_CURRENT" or command_of(message) == REPOSITION
        least_s = _PLACE_TWICE_S if led else _TWICE_S
        shown = [m for m in case.received("MISSION_CURRENT") if m.time_s < before.time_s][-1:]
        known = [m.fields.get("seq") for m in shown] == [message.fields.get("seq")]
        if seconds < least_s and not known and _plain(before) == _plain(message):
            text = f"{message.name} left twice within {seconds:.2f} s"
            yield Violation(message.time_s, "repeat", text)


def nothing_is_repeated_over_a_choice(case: Case) -> Iterator[Violation]:
    """A motion is not sent again after a pilot's choice, unless the old mode was received since."""
    hearts_s = _heartbeats_s(case)
    fresh_s = _FRESH_S + case.evidence.reaction_s + case.row.notice_s
    motions = [m for m in case.commands if is_motion(m)]
    for choice in case.evidence.events(SceneEventKind.PILOT):
        before = [m for m in motions if m.time_s < choice.time_s]
        for message in motions:
            received = bisect_right(hearts_s, message.time_s)
            stale = message.time_s - (hearts_s[received - 1] if received else 0.0) > fresh_s
            recent = [m for m in before if message.time_s - m.time_s < _REPEATS_S]
            plain = _plain(message, "confirmation")
            again = any(_plain(m, "confirmation") == plain for m in recent)
            if message.time_s > choice.time_s and stale and again:
                text = f"{message.name} sent again over a choice"
                yield Violation(message.time_s, "repeat", text)


def legs_are_clear(case: Case) -> Iterator[Violation]:
    """What a leg sweeps while the vehicle brakes is clear; one that is too near may get away."""
    for message, target in case.legs:
        index = case.at(message.time_s)
        short = _falls_short(case, index, message.time_s, target)
        if short and case.flying[index]:
            yield Violation(message.time_s, "leg", f"a leg that {short}")


def no_leg_begins_low(case: Case) -> Iterator[Violation]:
    """A vehicle below the plan's altitudes, as one that was given back low, climbs where it is."""
    mission = case.mission
    low_m = min(mission.altitudes_m) - mission.vertical_margin_m - case.row.height_m
    for message, target in case.legs:
        index = case.at(message.time_s)
        above_m, off_m = float(case.above_m[index]), float(case.off_m[index])
        on_m = math.dist(case.place(index), target) - off_m
        away = on_m > _STRAIGHT_UP_M + case.row.room_m and not leaves_low(case, index)
        if case.flying[index] and above_m < low_m and away:
            text = f"a leg of {on_m:.0f} m at {above_m:.1f} m, {low_m:.1f} m and more are flown"
            yield Violation(message.time_s, "altitude", text)
            return


def nothing_is_put_on_board_of_an_armed_vehicle(case: Case) -> Iterator[Violation]:
    """One that a pilot has armed on the ground is not prepared for a flight."""
    for started in case.evidence.events(SceneEventKind.STARTED):
        index = case.at(started.time_s + _CONNECTS_S)
        if not case.armed[index] or case.flying[index]:
            continue
        for message in case.commands:
            uploads = message.name == "MISSION_COUNT" and message.time_s >= started.time_s
            if uploads and case.armed[case.at(message.time_s)]:
                text = "a plan is put on board of a vehicle that the pilot has armed"
                yield Violation(message.time_s, "authority", text)
                return


def nothing_is_put_on_board_of_anothers(case: Case) -> Iterator[Violation]:
    """No list is sent to a vehicle that a pilot, or a failsafe, flies, but what is under way."""
    requested_s = [
        h.time_s for h in case.evidence.events(SceneEventKind.REQUEST, SceneEventKind.STARTED)
    ]
    for message in case.commands:
        if message.name not in {"MISSION_COUNT", "MISSION_CLEAR_ALL"}:
            continue
        for begin_s, end_s, by, _ in case.given:
            from_s = begin_s + _TRANSFER_S + case.row.notice_s
            again = any(begin_s < at_s <= message.time_s for at_s in requested_s)
            flies = bool(case.flying[case.at(message.time_s)])
            if from_s < message.time_s < end_s and flies and not again:
                text = f"a list is put on board while the vehicle is {by} since {begin_s:.1f} s"
                yield Violation(message.time_s, "authority", text)
                break


def what_is_drawn_across_a_leg_ends_it(case: Case) -> Iterator[Violation]:
    """A leg under way across what a changed file has drawn there is not flown on."""
    motions = [m for m in case.commands if is_motion(m)]
    for version in case.versions[1:]:
        from_s, index = version.from_s, case.at(version.from_s)
        end_s = from_s + _RENEWS_S + case.evidence.reaction_s + case.row.notice_s
        currents = [m for m in motions if m.delivered and m.time_s < from_s - _READ_S]
        at_once = [m for m in motions if from_s - _READ_S <= m.time_s <= end_s]
        ours = set(case.by[index : case.at(end_s) + 1]) == {Responsible.OURS}
        target = target_of(currents[-1], case.uploads, case.mission.frame) if currents else None
        stands = math.dist(_rest(case, index), case.place(index)) < _STANDS_M
        if target is None or at_once or stands or not ours or not case.flying[index]:
            continue
        short = _falls_short(case, index, from_s, target)
        if short:
            text = f"a leg is flown on, and nothing commanded, that now {short}"
            yield Violation(from_s, "leg", text)


def mission_mode_is_not_chosen_over_anothers_plan(case: Case) -> Iterator[Violation]:
    """Once MISSION_CURRENT has shown the plan that a station stored, the companion never begins it.

    This holds until the operator requests something, on the ground, too, where PX4 takes off by it.
    """
    currents = case.received("MISSION_CURRENT")
    for stored in case.evidence.events(SceneEventKind.PILOT):
        if stored.value != "plan":
            continue
        before = [m.fields.get("mission_id") for m in currents if m.time_s < stored.time_s][-1:]
        later = (m for m in currents if m.time_s > stored.time_s)
        received_s = next(
            (m.time_s for m in later if [m.fields.get("mission_id")] != before), math.inf
        )
        requested_s = (h.time_s for h in case.evidence.events(SceneEventKind.REQUEST))
        until_s = next((at_s for at_s in requested_s if at_s > stored.time_s), math.inf)
        for message in case.commands:
            if received_s + _OTHER_PLAN_S < message.time_s < until_s and _begins_plan(message):
                text = f"Mission mode, though another plan was on board since {stored.time_s:.1f} s"
                yield Violation(message.time_s, "authority", text)
                break


def _begins_plan(message: WireMessage) -> bool:
    """Whether a message chooses Mission mode."""
    fields = message.fields
    mode = number(fields, "param2"), number(fields, "param3")
    by_command = command_of(message) == SET_MODE and mode == _MISSION
    return by_command or (message.name == "SET_MODE" and fields.get("custom_mode") == _MISSION_MODE)


def _rest(case: Case, index: int) -> Pair:
    """Where it comes to rest, east and north, if it brakes at 3 m/s2 from a sample on."""
    before = max(index - 1, 0)
    seconds = max(float(case.time_s[index] - case.time_s[before]), 1e-3)
    share = case.speed_m_s(before, index) / (2 * _BRAKING_M_S2) / seconds
    (east_m, north_m), (east_before_m, north_before_m) = case.place(index), case.place(before)
    return (
        east_m + share * (east_m - east_before_m),
        north_m + share * (north_m - north_before_m),
    )


def _falls_short(case: Case, index: int, time_s: float, target: Pair) -> str:
    """How what is swept of a leg from a sample on is too near to something; empty: it is not."""
    here, rest = case.place(index), _rest(case, index)
    swept = shapely.MultiPoint([here, rest, target]).convex_hull
    stops = shapely.LineString([here, rest])
    height_m = float(case.above_m[index]) + case.ground_m
    slack_m = _LEG_M + case.row.room_m + float(case.off_m[index])
    mission = case.version_at(time_s).mission
    low_m, high_m = mission.cruise_m
    # Where it cruises a zone counts at every altitude if it does at one.
    level_m = (low_m, high_m) if low_m <= height_m <= high_m else (height_m, height_m)
    for area in mission.areas:
        if not area.meets(*level_m):
            continue
        kept_m = room_m(area, swept)
        limit_m = min(area.clearance_m - slack_m, room_m(area, stops) - DRIFT_M)
        if kept_m < limit_m:
            return f"keeps {kept_m:.2f} m of {area.name}, not {limit_m:.2f} m"
    return ""


def _commands(message: WireMessage) -> bool:
    """Whether a message arms, moves, or changes a speed."""
    return command_of(message) in {ARM, SPEED} or is_motion(message)


def _text(message: WireMessage) -> str:
    command = command_of(message)
    return message.name if command is None else f"{message.name} {command}"


def _plain(message: WireMessage, *but: str) -> dict[str, str]:
    """A message as text, in which what is not a number is equal to itself."""
    fields = {name: repr(value) for name, value in message.fields.items() if name not in but}
    return {"": message.name, **fields}
