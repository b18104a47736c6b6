"""Rules of whose the vehicle is where that does not show at once: in a silence, handed over."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from sitl.rehearsal.judge.case import Case, Responsible, Violation
from sitl.rehearsal.judge.evidence import (
    SceneEvent,
    SceneEventKind,
    WireMessage,
    choice_received_s,
    is_motion,
    shown_by_target_only,
)
from sitl.rehearsal.judge.inputs import near
from sitl.rehearsal.judge.space import depths_m

_SILENT_S: Final = 4.0
"""A vehicle that sends nothing for longer is silent: the companion knows that after three."""

_MODES: Final = frozenset({"HEARTBEAT", "CURRENT_MODE"})
_SHOWN_S, _SURE_S = 0.25, 2.5
"""An order that is not ours is known from its first message on; within so long it is surely so."""

_IN_M, _LASTS_S, _LEAVES_S = 0.5, 0.5, 10.0
"""So deep, and for so long, it surely is in a zone; what is drawn over it, it may leave first."""

_NEARED_S: Final = 2.0
"""Hands may go off so long before it is that deep: at the fence, or by the autopilot's failsafe."""

_RECENT_S: Final = 6.0
"""A command of ours may still be under way, or a vehicle on its way to hold brake, so long."""

_ELSEWHERE_M: Final = 6.0
_NEARLY_M: Final = 1.0

_AT_HOME_M, _HELD_S = 20.0, 2.0
"""So near to home a take-off may be led on; elsewhere a hold is sent within so long."""

_LISTS: Final = frozenset({"MISSION_COUNT", "MISSION_CLEAR_ALL"})
_ANNOUNCED_S: Final = 0.6
"""What was chosen in a standstill is announced so soon: before another HEARTBEAT would show it."""

_AGAIN_S: Final = 1.0
"""What was sent before the silence began to count may be repeated, each time so soon after."""


def nothing_leaves_on_a_mode_from_before_a_silence(case: Case) -> Iterator[Violation]:
    """After a silence no motion leaves before a flight mode is received, but a hold on request."""
    speed = case.evidence.speed
    for begin_s, end_s in pairwise(message.time_s for message in case.evidence.received):
        from_s = begin_s + _SILENT_S * speed
        if end_s <= from_s or not case.could_react(begin_s, end_s, ours=False):
            continue
        modes_s = (
            m.time_s for m in case.evidence.received if m.name in _MODES and m.time_s >= end_s
        )
        mode_s = next(modes_s, math.inf)
        sent = [m for m in case.commands if is_motion(m) and begin_s < m.time_s < mode_s]
        for number, message in enumerate(sent):
            repeats = any(_same(message, other) for other in sent[:number])
            if (
                message.time_s > from_s
                and not repeats
                and not _hold_requested(case, begin_s, message)
            ):
                text = f"{message.name}, and no flight mode was received since {begin_s:.1f} s"
                yield Violation(message.time_s, "authority", text)
                return


def a_choice_in_a_standstill_stands(case: Case) -> Iterator[Violation]:
    """A mode that a pilot chose while the companion stood still is announced, and not ended.

    Once it goes on no motion leaves, and no list is put on board, until the vehicle is given back.
    """
    events = case.evidence.events
    stops_s = [h.time_s for h in events(SceneEventKind.STOPPED)]
    goes_on_s = [h.time_s for h in events(SceneEventKind.CONTINUED)]
    for stopped_s, from_s in zip(stops_s, goes_on_s, strict=False):
        if any(given.begin_s < stopped_s < given.end_s for given in case.given):
            continue  # it was another's before
        chosen = (g for g in case.given if g.by is Responsible.PILOT)
        for choice in (g for g in chosen if stopped_s <= g.begin_s <= from_s):
            end_s = min(choice.end_s, choice.handed_s)
            for message in case.commands:
                ends = is_motion(message) or message.name in _LISTS
                if ends and from_s <= message.time_s < end_s:
                    text = f"{message.name} over a mode chosen in the standstill before"
                    yield Violation(message.time_s, "authority", text)
                    break
            announced_s = from_s + _ANNOUNCED_S + max(case.evidence.reaction_s - 1.0, 0.0)
            announced_s += case.row.notice_s
            flies = announced_s < float(case.time_s[-1]) and bool(case.flying[case.at(announced_s)])
            if flies and not case.has_announced("hands off", stopped_s, announced_s):
                text = f"a mode chosen at {choice.begin_s:.1f} s is not announced"
                yield Violation(announced_s, "report", text)


def nothing_leaves_over_an_order_that_shows(case: Case) -> Iterator[Violation]:
    """While another item or place shows, and is not surely a pilot's yet, no motion leaves.

    In a zone, or outside of a fence, it is held.
    """
    requested_s = [h.time_s for h in case.evidence.events(SceneEventKind.REQUEST)]
    motions = [m for m in case.commands if is_motion(m)]
    for choice in filter(shown_by_target_only, case.evidence.events(SceneEventKind.PILOT)):
        received_s = choice_received_s(case.evidence.received, choice)
        from_s, until_s = received_s + _SHOWN_S, received_s + _SURE_S
        recent = any(choice.time_s - _RECENT_S < m.time_s < from_s for m in motions)
        requested = any(choice.time_s < at_s < until_s for at_s in requested_s)
        if recent or requested or not _leads_elsewhere(case, choice, received_s):
            continue
        for message in motions:
            inside = _is_inside(case, case.at(message.time_s))
            if from_s < message.time_s < until_s and not inside:
                text = f"{message.name} over another {choice.value}, received at {received_s:.1f} s"
                yield Violation(message.time_s, "authority", text)
                break


def a_breach_is_given_away(case: Case) -> Iterator[Violation]:
    """What is in a zone by its own report, and has not been drawn over it, is the pilot's."""
    for area, drawn_s, spans in near(case, -_IN_M):
        for begin_s, end_s in spans:
            due_s = begin_s + _LASTS_S + case.reacts_s
            short = end_s - begin_s < _LASTS_S or begin_s < drawn_s + _LEAVES_S
            if short or not case.could_react(begin_s, begin_s + _LASTS_S):
                continue
            if not case.has_announced("hands off", begin_s - _NEARED_S, due_s):
                text = f"flown on with after a breach of {area.name} at {begin_s:.1f} s"
                yield Violation(due_s, "authority", text)


def _leads_elsewhere(case: Case, choice: SceneEvent, received_s: float) -> bool:
    """Whether the target that was received leads farther away than the companion's own may show."""
    if choice.value == "item" or not math.isfinite(received_s):
        return math.isfinite(received_s)
    messages = case.received("POSITION_TARGET_GLOBAL_INT")
    targets = [m for m in messages if m.time_s <= received_s][-2:]
    degrees = [(m.fields["lat_int"] / 1e7, m.fields["lon_int"] / 1e7) for m in targets]
    places = [case.mission.frame.metres(*place) for place in degrees]
    return len(places) > 1 and math.dist(*places) > _ELSEWHERE_M


def _is_inside(case: Case, index: int) -> bool:
    """Whether it is in a zone, or outside of a fence, or nearly."""
    height_m = float(case.above_m[index]) + case.ground_m
    areas = case.version_at(float(case.time_s[index])).mission.areas
    here = case.places[index : index + 1]
    near = (
        float(depths_m(area, here)[0]) > -_NEARLY_M
        for area in areas
        if area.meets(height_m, height_m)
    )
    return any(near)


def what_is_handed_over_elsewhere_is_held(case: Case) -> Iterator[Violation]:
    """Mission mode chosen low and away from home, or in another's layer, begins no mission there.

    It is held at once, until the pilot or the operator wants something else, or it is level.
    """
    events = case.evidence.events
    for handed in events(SceneEventKind.HANDED_OVER):
        from_s, index = handed.time_s, case.at(handed.time_s)
        away_m, above_m = case.from_home_m(index), float(case.above_m[index])
        if case.level[index] or away_m < _AT_HOME_M:
            continue
        others_s = [h.time_s for h in events(SceneEventKind.PILOT, SceneEventKind.REQUEST)]
        levels_s = case.time_s[case.level & (case.time_s >= from_s)][:1].tolist()
        until_s = min((at_s for at_s in [*others_s, *levels_s] if at_s > from_s), default=math.inf)
        where = f"{away_m:.0f} m from home at {above_m:.1f} m, where Mission mode was chosen"
        sent = [m.time_s for m in case.commands if is_motion(m) and m.time_s > from_s]
        if min(sent, default=math.inf) > min(from_s + _HELD_S, until_s):
            yield Violation(from_s + _HELD_S, "held", f"no hold was commanded {where}")
        for message, _ in case.legs:
            if from_s < message.time_s < until_s:
                yield Violation(message.time_s, "authority", f"a leg {where}")
                break


def _same(message: WireMessage, before: WireMessage) -> bool:
    """Whether a message may be a repetition of one from just before."""
    plain, other = (
        {name: repr(value) for name, value in each.fields.items() if name != "confirmation"}
        for each in (message, before)
    )
    again = message.name == before.name and plain == other
    return again and message.time_s - before.time_s < _AGAIN_S


def _hold_requested(case: Case, begin_s: float, message: WireMessage) -> bool:
    """Whether the operator requested a hold, and nothing else has left since."""
    requested = [
        h for h in case.evidence.events(SceneEventKind.REQUEST) if h.time_s <= message.time_s
    ]
    return bool(requested) and requested[-1].time_s > begin_s and str(requested[-1].value) == "hold"
