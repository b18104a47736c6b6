"""The judge: from the evidence of a flight to a verdict. Shares nothing with what it judges."""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from types import ModuleType
from typing import Any, Final

import numpy as np

from sitl.rehearsal.judge import (
    announcements,
    authority,
    commands,
    files,
    heights,
    inputs,
    obligations,
    plan,
    reactions,
    robots,
    space,
    wire,
)
from sitl.rehearsal.judge.acceptance import End
from sitl.rehearsal.judge.case import Case, Responsible, Rule, Violation
from sitl.rehearsal.judge.evidence import AUTOPILOT, Evidence, EvidenceError, SceneEventKind, number

_DONE, _OTHERWISE, _REFUSED, _TAKEN_OVER = 0, 1, 5, 6
"""Exit codes of `air-router fly`: landed at home; ended otherwise; refused, left as it is; the
pilot took over."""

_CRASHED: Final = 70
"""What the companion ends with in a simulated flight after an exception that it does not expect."""

_TRACEBACK: Final = "Traceback (most recent call last)"
"""What `air-router fly` prints then."""

_LAG_S: Final = 0.5
"""Lines are stamped by the program that reads them, happenings by the one that does them."""

_BESIDE_M: Final = 1.0
_LAND_M_S: Final = 0.7
_DETOUR, _SLACK_S = 1.5, 10.0
_GAP_S: Final = 1.0
_STALE_S: Final = 1.5
"""A mode that is received may be so old, and is believed for so long."""

_OLDEST_S: Final = 0.1
"""A message that came at once shows the vehicle as it was so long ago, at most."""

_CRUISES: Final = 0.9
"""Above so much of its altitude it does not climb any more."""

_HOP_M: Final = 2.0
"""A vehicle that never was so high had not begun its flight."""

_CRITICAL: Final = 5  # MAV_STATE_CRITICAL
_ANNOUNCES_PILOT: Final = re.compile(r"pilot (chose|took|has)", re.IGNORECASE)
_LANDED: Final = "landed at home"
_HANDS_OFF: Final = "hands off"
_HOLDER: Final = {Responsible.PILOT: End.PILOT, Responsible.AUTOPILOT: End.FAILSAFE}
_TAKEN: Final = (
    SceneEventKind.PILOT,
    SceneEventKind.DISARMED,
    SceneEventKind.FENCE_CHANGED,
    SceneEventKind.HOME_MOVED,
    SceneEventKind.REBOOTED,
)

_LAST_CHARACTERS: Final = 300


@dataclass(frozen=True, slots=True)
class Verdict:
    """The judge's findings on a flight.

    Attributes:
        scene: Its name.
        faults: That were in it.
        end: How it ended.
        violations: All that must not be, in order of time.
        closest_m: The least room to a zone or fence while the vehicle was ours; None: there was
            none.
        flown_s: For how long it was in the air.
        last_line: The companion's last line.
        pace: As in `Evidence`.
    """

    scene: str
    faults: frozenset[str]
    end: End
    violations: tuple[Violation, ...] = ()
    closest_m: float | None = None
    flown_s: float = 0.0
    last_line: str = ""
    pace: Mapping[str, Any] = field(default_factory=dict)

    @property
    def good(self) -> bool:
        """Nothing was as it must not be."""
        return not self.violations


def end_of(case: Case) -> End:
    """How it ended."""
    samples = case.evidence.samples
    if not case.flying.any():
        return End.STAYED
    if any(not s.armed and not s.landed for s in samples):
        return End.FELL
    if case.flying[-1]:
        return _left_flying(case)
    last = int(case.flying.nonzero()[0][-1])
    return _HOLDER[case.by[last]] if case.by[last] in _HOLDER else _down(case, last)


def _down(case: Case, last: int) -> End:
    """The end of a flight that was ours to its last sample in the air."""
    if case.evidence.samples[-1].armed:
        return End.NOT
    allowed_m = case.mission.acceptance_m + _BESIDE_M + case.row.home_m + case.off_m[last]
    if case.landing_place and math.dist(case.landing_place, case.place(last)) <= allowed_m:
        return End.ON_REQUEST
    return End.LANDED if case.from_home_m(last) <= allowed_m else End.ELSEWHERE


def _left_flying(case: Case) -> End:
    """The end of a flight that was watched no longer."""
    if case.by[-1] in _HOLDER:
        return _HOLDER[case.by[-1]]
    changed_s = [h.time_s for h in case.evidence.events(SceneEventKind.FENCE_CHANGED)]
    if changed_s and max(_hands_off_s(case), default=-math.inf) >= changed_s[0]:
        return End.PILOT  # a station changed the plan: what follows is its operator's
    kinds = (SceneEventKind.KILLED, SceneEventKind.STARTED, SceneEventKind.ENDED)
    lives = [h.what for h in case.evidence.events(*kinds)][-1:]
    alone = lives == [SceneEventKind.KILLED]
    # One that is started anew, and finds that it may not fly on, leaves it where it hovers.
    alone |= lives == [SceneEventKind.ENDED] and case.evidence.exit_code == _REFUSED
    return End.HOVERS if alone else End.NOT


def _hands_off_s(case: Case) -> list[float]:
    """When the companion announced that the vehicle is another's."""
    return [line.time_s for line in case.evidence.lines if _HANDS_OFF in line.text]


def ends_as_it_may(case: Case) -> Iterator[Violation]:
    """The end is one that the fault allows."""
    end = end_of(case)
    if end not in case.row.ends:
        away_m = case.from_home_m(len(case.time_s) - 1)
        allowed = ", ".join(each.value for each in case.row.ends)
        text = f"{end.value}, {away_m:.1f} m from home; this fault allows: {allowed}"
        yield Violation(float(case.time_s[-1]), "end", text)


def the_track_is_whole(case: Case) -> Iterator[Violation]:
    """No second of it is missing, but where the autopilot is started anew."""
    steps_s = np.where(case.flying[:-1], np.diff(case.time_s), 0.0)
    for moment in case.evidence.events(SceneEventKind.REBOOTED):
        begins, ends = case.time_s[:-1] - 1.0, case.time_s[1:]
        steps_s[(begins <= moment.time_s) & (moment.time_s <= ends)] = 0.0
    if steps_s.max() > _GAP_S:
        text = f"{steps_s.max():.1f} s of the track are missing"
        yield Violation(float(case.time_s[-1]), "evidence", text)


def the_battery_lasts(case: Case) -> Iterator[Violation]:
    """A battery's failsafe is bad where home could be reached after the reserve was."""
    if not any(case.evidence.events(SceneEventKind.BATTERY)):
        return
    reserve = case.mission.battery_reserve * 100.0
    statuses = (
        m for m in case.evidence.messages if m.name == "SYS_STATUS" and m.component == AUTOPILOT
    )
    low = (m for m in statuses if 0 <= number(m.fields, "battery_remaining") <= reserve)
    low_s = next((m.time_s for m in low), math.inf)
    failsafes_s = (given.begin_s for given in case.given if given.by is Responsible.AUTOPILOT)
    failsafe_s = next(failsafes_s, math.inf)
    if not low_s < failsafe_s < math.inf:
        return
    index = case.at(low_s)
    way_s = _DETOUR * case.from_home_m(index) / case.mission.speed_m_s
    needed_s = way_s + float(case.above_m[index]) / _LAND_M_S + _SLACK_S
    if failsafe_s - low_s > needed_s:
        text = f"ran down to the failsafe {failsafe_s - low_s:.0f} s after the reserve, home takes"
        yield Violation(failsafe_s, "battery", f"{text} {needed_s:.0f} s")


def what_is_announced_is_what_happened(case: Case) -> Iterator[Violation]:
    """Its lines and exit code report "landed at home", or a takeover, where that is so."""
    evidence, end, code = case.evidence, end_of(case), case.evidence.exit_code
    text = "\n".join([line.text for line in evidence.lines] + [evidence.outcome])
    taken_s = min((h.time_s for h in evidence.events(*_TAKEN)), default=math.inf)
    lied_to = _was_lied_to(case)
    # A companion that is started anew during a landing leaves it alone, and announces that.
    left = code == _REFUSED and len(list(evidence.events(SceneEventKind.STARTED))) > 1
    # Disarmed by a station there is nothing to take over: the flight ends with that reason.
    disarmed = any(evidence.events(SceneEventKind.DISARMED)) and "disarm" in text
    # Stopped as it left the ground it settles there, and the flight has not begun.
    hopped = float(case.above_m.max()) < _HOP_M
    over_s = max((h.time_s for h in evidence.events(SceneEventKind.ENDED)), default=math.inf)
    over = taken_s > over_s  # it had ended before that
    # Taken and brought down in one silence: the landing that was requested may have done it.
    down_s = float(case.time_s[np.flatnonzero(case.flying)[-1]]) if case.flying.any() else 0.0
    received = any(taken_s < m.time_s < down_s for m in evidence.received)
    unseen = bool(evidence.received) and taken_s < down_s and not received
    over |= unseen
    # A failsafe that acts between the touchdown and the disarming ends the flight, too.
    grounded = code == _OTHERWISE and any(
        each.failsafe and each.armed and each.landed and each.time_s > down_s
        for each in evidence.samples
    )
    claimed_s = next(
        (s.time_s for s in evidence.lines if _ANNOUNCES_PILOT.search(s.text)), math.inf
    )
    end_s, landed = float(case.time_s[-1]), end in {End.LANDED, End.ON_REQUEST}
    wrong = {
        f"exit 0, 'done': {end.value}": code == _DONE and not (landed or unseen),
        f"'{_LANDED}' was announced: {end.value}": _LANDED in text and end is not End.LANDED,
        f"exit {code}, though it landed at home by our command": (
            landed and code not in {_DONE, None} and not (lied_to or left or hopped or grounded)
        ),
        "exit 6: a pilot took over, but none did": (
            code == _TAKEN_OVER and math.isinf(taken_s) and not lied_to
        ),
        f"exit {code}, though the pilot has the vehicle": (
            end is End.PILOT and code not in {_TAKEN_OVER, None} and not (disarmed or left or over)
        ),
        f"exit {code}, though a failsafe ended it": (
            end is End.FAILSAFE and code not in {_OTHERWISE, None} and not (lied_to or left or over)
        ),
    }
    yield from (Violation(end_s, "report", text) for text, is_so in wrong.items() if is_so)
    if claimed_s < taken_s - _LAG_S and not lied_to:
        yield Violation(claimed_s, "report", "a takeover is announced, but no pilot has taken over")


def _was_lied_to(case: Case) -> bool:
    """Whether it released just after it received a mode, or failsafe, that was not the vehicle's.

    Or no longer was: a message that comes at once shows no mode that had been left by then.
    """
    let_go_s = min(_hands_off_s(case), default=math.inf)
    for message in case.evidence.received:
        named = message.component == AUTOPILOT and message.name in {"HEARTBEAT", "CURRENT_MODE"}
        if not (named and 0.0 <= let_go_s - message.time_s < _STALE_S):
            continue
        first, last = (case.at(message.time_s + seconds) for seconds in (-_STALE_S, _STALE_S))
        about = case.evidence.samples[first : last + 1]
        critical = number(message.fields, "system_status") >= _CRITICAL
        mode = number(message.fields, "custom_mode")
        now = case.evidence.samples[
            case.at(message.time_s - _OLDEST_S) : case.at(message.time_s) + 1
        ]
        if any(all(each.custom_mode != mode for each in samples) for samples in (about, now)):
            return True
        if critical and not any(sample.failsafe for sample in about):
            return True
    return False


def the_companion_does_not_crash(case: Case) -> Iterator[Violation]:
    """A program error is a finding, also where the vehicle holds safely after it."""
    evidence = case.evidence
    printed_s = next((s.time_s for s in evidence.lines if _TRACEBACK in s.text), None)
    if evidence.exit_code == _CRASHED or printed_s is not None:
        at_s = float(case.time_s[-1]) if printed_s is None else printed_s
        yield Violation(at_s, "crash", f"the companion crashed: {evidence.outcome}")


def a_fault_is_announced(case: Case) -> Iterator[Violation]:
    """A line announces the fault as its row demands, once it has begun to show."""
    evidence, row = case.evidence, case.row
    if not row.announcement or not case.flying.any():
        return
    # Lines from before the fault, such as the pre-flight card's, do not count.
    flies_s = float(case.time_s[int(np.argmax(case.flying))])
    begun_s = min((h.time_s for h in evidence.events(SceneEventKind.FAULT)), default=flies_s)
    if row.shows_s and _cruised_s(case, begun_s) < row.shows_s:
        return
    since = [text for time_s, text in case.texts if time_s >= begun_s]
    if not re.search(row.announcement, "\n".join([*since, evidence.outcome]), re.IGNORECASE):
        text = f"it was not announced: no line has '{row.announcement}'"
        yield Violation(float(case.time_s[-1]), "report", text)


def _cruised_s(case: Case, since_s: float) -> float:
    """For how long it flew level from then on, until an offset was taken back."""
    offs_s = [h.time_s for h in case.evidence.events(SceneEventKind.FAULT) if h.value == "off"]
    until_s = offs_s[1] if len(offs_s) > 1 else math.inf
    level = case.flying & ~case.lands
    level &= case.above_m > _CRUISES * case.mission.altitudes_m[0]
    times_s = case.time_s[level & (case.time_s >= since_s) & (case.time_s < until_s)]
    return float(np.ptp(times_s)) if len(times_s) else 0.0


def _rules_of(module: ModuleType) -> list[Rule]:
    """Its public generators of violations that take a case alone, in their order."""
    return [
        rule
        for name, rule in vars(module).items()
        if inspect.isgeneratorfunction(rule) and rule.__module__ == module.__name__
        if not name.startswith("_") and len(inspect.signature(rule).parameters) == 1
        if inspect.signature(rule).return_annotation == "Iterator[Violation]"
    ]


_MODULES: Final = (
    *(space, plan, commands, authority, inputs, heights, announcements, reactions, robots),
    *(wire, files, obligations),
)
RULES: Final = tuple(chain.from_iterable(map(_rules_of, (*_MODULES, sys.modules[__name__]))))
"""All that a flight is judged by; each rule sees the whole flight, and knows of no other."""


def judge(evidence: Evidence) -> Verdict:
    """Judge a flight by its evidence alone."""
    try:
        case = Case(evidence)
    except EvidenceError as error:
        violation = Violation(0.0, "evidence", str(error))
        return Verdict(evidence.scene, evidence.faults, End.NOT, (violation,))
    found = [violation for rule in RULES for violation in rule(case)]
    return Verdict(
        evidence.scene,
        evidence.faults,
        end_of(case),
        tuple(sorted(found, key=lambda violation: violation.time_s)),
        _closest_m(case),
        float(np.diff(case.time_s)[case.flying[:-1]].sum()),
        "; ".join(line.text for line in evidence.lines)[-_LAST_CHARACTERS:],
        evidence.pace,
    )


def _closest_m(case: Case) -> float | None:
    """The least room to a zone or fence while the vehicle was ours; None: there was none.

    Inside of a zone it is how far out of it is, sideways, up or down.
    """
    ours = np.array([by is Responsible.OURS for by in case.by])
    amsl_m = case.above_m + case.ground_m
    closest_m = math.inf
    for each in space.rooms_of(case):
        until = each.first + len(each.metres)
        heights_m, counts = amsl_m[each.first : until], ours[each.first : until]
        edge_m = np.minimum(heights_m - each.area.lower_m, each.area.upper_m - heights_m)
        # A way from one sample to the next may begin outside of it, below or above.
        edge_m = np.maximum(np.maximum(edge_m, np.append(edge_m[1:], -math.inf)), 0.0)
        rooms_m = np.maximum(each.metres, -edge_m) if not each.area.fence else each.metres
        closest_m = min(closest_m, float(rooms_m[counts].min(initial=math.inf)))
    return closest_m if math.isfinite(closest_m) else None
