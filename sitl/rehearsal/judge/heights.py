"""Rules of altitudes that are not true: one that jumps, one that drifts, a home that is moved."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from sitl.rehearsal.judge.case import Case, Violation
from sitl.rehearsal.judge.evidence import SceneEventKind, number
from sitl.rehearsal.judge.reactions import Incident, announces, comes_home, stops

_HOME_UP_M: Final = 3.0
"""A home that is moved up or down by so much changes what the plan's heights mean."""

_JUMP_M, _CLIMB_M_S = 4.0, 6.0
_FIX_3D: Final = 3
_DRIFTS_S, _AVERAGED_S = 8.0, 30.0
_DRIFTS_M: Final = ((4.5, False), (7.0, True))
"""So far the satellites' altitude has left the autopilot's, on an average of 8 s: announced; home.

A companion averages for longer."""

_SHOWS_M: Final = 2.0
"""From so much on a companion that averages otherwise may announce it, once for all."""

_ANNOUNCED_S: Final = 60.0
"""So long before, a jump that has led to it may have been announced."""

_TOGETHER_S: Final = 1.0
"""Two altitudes that were received so soon after each other are of the same moment."""

_SPOILT: Final = frozenset({"LOST_FIX", "BRIEF_STREAM", "OLD"})
"""The satellites' altitude itself is late, frozen or wrong."""

_CRUISE: Final = frozenset({"INIT", "SEARCH", "COMM", "EXPL", "IDLE", "HOME"})


def jumping_altitudes_are_held_for(case: Case) -> Iterator[Violation]:
    """An altitude that no vehicle can have flown to is announced, and the vehicle stops."""
    for before, message in pairwise(case.received("GLOBAL_POSITION_INT")):
        seconds = (message.fields["time_boot_ms"] - before.fields["time_boot_ms"]) / 1e3
        jump_m = abs(message.fields["alt"] - before.fields["alt"]) / 1e3
        if not 0.0 < seconds <= 1.0 or jump_m <= _JUMP_M + _CLIMB_M_S * seconds:
            continue
        begin_s, due_s = message.time_s, message.time_s + case.reacts_s
        if case.state(begin_s) in _CRUISE and case.could_react(begin_s, due_s):
            incident = Incident(begin_s, f"the altitude jumped by {jump_m:.1f} m")
            yield from announces(case, incident, "altitude|height", due_s)
            yield from stops(case, incident)


def a_home_that_is_moved_is_held_for(case: Case) -> Iterator[Violation]:
    """When a station moves home up or down, the vehicle stops."""
    before_m = case.ground_m
    for moved in case.evidence.events(SceneEventKind.HOME_MOVED) if case.evidence.received else ():
        up_m, before_m = moved.value[2] - before_m, moved.value[2]
        if abs(up_m) >= _HOME_UP_M and case.state(moved.time_s) in _CRUISE:
            incident = Incident(moved.time_s, f"home was moved by {up_m:.0f} m up or down")
            yield from stops(case, incident)


def a_drifting_altitude_is_announced_and_ends_the_mission(case: Case) -> Iterator[Violation]:
    """The satellites' altitude has left the autopilot's since the take-off, and stays away.

    A companion that is started in the air knows of nothing before.
    """
    if case.evidence.faults & _SPOILT:
        return
    started_s = [started.time_s for started in case.evidence.events(SceneEventKind.STARTED)]
    for begin_s, end_s in pairwise((-math.inf, *started_s, math.inf)):
        yield from _drifts(case, begin_s, end_s)


def _drifts(case: Case, begin_s: float, end_s: float) -> Iterator[Violation]:
    due, began_m, shows_s = list(_DRIFTS_M), math.nan, math.inf
    for at_s, mean_m in _receiver_above_m(case, begin_s, end_s):
        began_m = mean_m if math.isnan(began_m) else began_m
        drift_m = mean_m - began_m
        if abs(drift_m) >= _SHOWS_M:
            shows_s = min(shows_s, at_s)
        if due and abs(drift_m) >= due[0][0] and case.state(at_s) in _CRUISE:
            incident = Incident(at_s, f"the altitude has drifted by {drift_m:.1f} m")
            due_s, (_, ends) = at_s + case.reacts_s, due.pop(0)
            before_s = max(at_s - shows_s, _ANNOUNCED_S)
            if case.could_react(at_s, due_s):
                yield from announces(case, incident, "altitude|height", due_s, before_s)
            if ends:
                yield from comes_home(case, incident, due_s + _AVERAGED_S, [])


def _receiver_above_m(case: Case, begin_s: float, end_s: float) -> Iterator[tuple[float, float]]:
    """By how much the satellites' altitude is higher than the autopilot's, on average, in flight.

    Each pair is of one moment; after a gap the average begins anew.
    """
    latest: deque[tuple[float, float]] = deque()  # when, and by how much it is higher
    amsl_m, amsl_s = 0.0, -math.inf
    for message in case.evidence.received:
        at_s = message.time_s
        if not begin_s <= at_s < end_s:
            continue
        if message.name == "GLOBAL_POSITION_INT":
            amsl_m, amsl_s = message.fields["alt"] / 1e3, at_s
        known = message.name == "GPS_RAW_INT" and number(message.fields, "fix_type") >= _FIX_3D
        known = known and "alt" in message.fields and at_s - amsl_s <= _TOGETHER_S
        if not known or not case.flying[case.at(at_s)]:
            continue
        if latest and at_s - latest[-1][0] > _DRIFTS_S / 2:
            latest.clear()
        latest.append((at_s, message.fields["alt"] / 1e3 - amsl_m))
        if at_s - latest[0][0] < _DRIFTS_S:
            continue
        while at_s - latest[0][0] > _DRIFTS_S:
            latest.popleft()
        yield at_s, sum(off_m for _, off_m in latest) / len(latest)
