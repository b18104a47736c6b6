"""The judge: from the evidence of a flight to a verdict. Shares nothing with what it judges."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from sitl.rehearsal.judge.acceptance import End, Row, accepted
from sitl.rehearsal.judge.evidence import AUTOPILOT, Evidence, SceneEventKind
from sitl.rehearsal.judge.judge_inputs import InputJudge
from sitl.rehearsal.judge.judge_requests import RequestJudge
from sitl.rehearsal.judge.judge_seat import announcements
from sitl.rehearsal.judge.judge_space import SpaceJudge
from sitl.rehearsal.judge.judge_track import LAND_MODE, Responsible, Track, Violation, number
from sitl.rehearsal.judge.judge_wire import WireJudge
from sitl.rehearsal.judge.mission_reader import MissionFileError

DONE, REFUSED, TAKEN_OVER = 0, 5, 6
"""Exit codes of `air-router fly`: landed at home; refused, left as it is; the pilot took over."""

_LAG_S: Final = 0.5
"""Lines are stamped by the program that reads them, happenings by the one that does them."""

_BESIDE_M: Final = 1.0
_LAND_M_S: Final = 0.7
_DETOUR, _SLACK_S = 1.5, 10.0
_STALE_S: Final = 1.5
"""A mode that is heard may be so old, and is believed for so long."""

_CRUISES: Final = 0.9
"""Above so much of its altitude it does not climb any more."""

_CRITICAL: Final = 5  # MAV_STATE_CRITICAL
_SAYS_PILOT: Final = re.compile(r"pilot (chose|took|has)", re.IGNORECASE)
_LANDED: Final = "landed at home"
_TAKEN: Final = frozenset(
    {
        SceneEventKind.PILOT,
        SceneEventKind.DISARMED,
        SceneEventKind.FENCE_CHANGED,
        SceneEventKind.HOME_MOVED,
        SceneEventKind.REBOOTED,
    }
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the judge says of a flight.

    Attributes:
        scene: Its name.
        faults: That were in it.
        end: How it ended.
        violations: All that must not be, in order of time.
        nearest_m: The least room to a zone or fence while each of them answered.
        seconds: For how long each of them answered in the air.
        said: What the companion said last.
    """

    scene: str
    faults: frozenset[str]
    end: End
    violations: tuple[Violation, ...] = ()
    nearest_m: Mapping[Responsible, float] = field(default_factory=dict)
    seconds: Mapping[Responsible, float] = field(default_factory=dict)
    said: str = ""

    @property
    def good(self) -> bool:
        """Nothing was as it must not be."""
        return not self.violations


def judge(evidence: Evidence) -> Verdict:
    """Judge a flight by its evidence alone."""
    if accepted(evidence.faults) is None:
        return _unjudged(evidence, f"acceptance.py has no row for {sorted(evidence.faults)}")
    if len(evidence.samples) < 2:
        return _unjudged(evidence, "no true track")
    try:
        track = Track(evidence)
    except MissionFileError as error:
        return _unjudged(evidence, str(error))
    row = accepted(_that_happened(track))
    assert row is not None  # noqa: S101 - fewer faults than those that have rows
    space = SpaceJudge(track, row.tolerance)
    space.judge()
    wire = WireJudge(track, row.tolerance, row.notice_s)
    wire.judge()
    inputs = InputJudge(track, wire.legs, row.notice_s)
    inputs.judge()
    requests = RequestJudge(track, wire.legs, row.notice_s)
    requests.judge()
    end = _end(track, row)
    found = [
        *space.violations,
        *wire.violations,
        *inputs.violations,
        *requests.violations,
        *_ending(track, end, row),
        *_words(track, end, row),
    ]
    return Verdict(
        evidence.scene,
        evidence.faults,
        end,
        tuple(sorted(found, key=lambda violation: violation.time_s)),
        space.nearest_m,
        space.seconds,
        _last_words(evidence),
    )


def _unjudged(evidence: Evidence, why: str) -> Verdict:
    violation = Violation(0.0, "evidence", why)
    return Verdict(evidence.scene, evidence.faults, End.NOT, (violation,))


def _last_words(evidence: Evidence) -> str:
    return "; ".join(line.text for line in evidence.lines)[-300:]


def _end(track: Track, row: Row) -> End:
    samples = track.evidence.samples
    if not track.flying.any():
        return End.STAYED
    if any(not s.armed and not s.landed for s in samples):
        return End.FELL
    holder = {Responsible.PILOT: End.PILOT, Responsible.AUTOPILOT: End.FAILSAFE}
    if track.flying[-1]:
        kinds = [h.what for h in track.evidence.happenings]
        alone = (
            SceneEventKind.KILLED in kinds
            and SceneEventKind.STARTED not in kinds[kinds.index(SceneEventKind.KILLED) :]
        )
        changed = [h.time_s for h in track.evidence.told(SceneEventKind.FENCE_CHANGED)]
        let_go = [line.time_s for line in track.evidence.lines if "hands off" in line.text]
        left = End.HOVERS if alone else End.NOT
        if changed and let_go and let_go[-1] >= changed[0]:
            left = End.PILOT  # a station changed the plan: what follows is its operator's
        return holder.get(track.by[-1], left)
    last = int(track.flying.nonzero()[0][-1])
    if track.by[last] in holder:
        return holder[track.by[last]]
    allowed_m = track.mission.acceptance_m + _BESIDE_M + row.tolerance.home_m + track.off_m[last]
    if samples[-1].armed:
        return End.NOT
    return End.LANDED if track.from_home_m(last) <= allowed_m else End.ELSEWHERE


def _ending(track: Track, end: End, row: Row) -> Iterator[Violation]:
    last_s = float(track.time_s[-1])
    last = track.from_home_m(len(track.time_s) - 1)
    if end not in row.ends:
        text = f"{end.value}, {last:.1f} m from home; this fault allows: "
        yield Violation(last_s, "end", text + ", ".join(e.value for e in row.ends))
    anew = [h.time_s for h in track.evidence.told(SceneEventKind.REBOOTED)]
    steps = zip(track.time_s, track.time_s[1:], track.flying, strict=False)
    flown = [b - a for a, b, up in steps if up and not any(a - 1.0 <= at_s <= b for at_s in anew)]
    widest_s = max(flown, default=0.0)
    if widest_s > 1.0:
        yield Violation(last_s, "evidence", f"{widest_s:.1f} s of the track are missing")
    yield from _battery(track)


def _battery(track: Track) -> Iterator[Violation]:
    """A battery's failsafe is bad where home could be reached after the reserve was."""
    evidence = track.evidence
    if not any(True for _ in evidence.told(SceneEventKind.BATTERY)):
        return
    reserve = track.mission.battery_reserve * 100.0
    low_s = next(
        (
            m.time_s
            for m in evidence.messages
            if m.name == "SYS_STATUS"
            and m.component == AUTOPILOT
            and 0 <= number(m.fields, "battery_remaining") <= reserve
        ),
        math.inf,
    )
    failsafe_s = next((b for b, _, by in track.given if by is Responsible.AUTOPILOT), math.inf)
    if not low_s < failsafe_s < math.inf:
        return
    index = track.at(low_s)
    way_s = _DETOUR * track.from_home_m(index) / track.mission.speed_m_s
    needed_s = way_s + float(track.above_m[index]) / _LAND_M_S + _SLACK_S
    if failsafe_s - low_s > needed_s:
        text = f"ran down to the failsafe {failsafe_s - low_s:.0f} s after the reserve, home takes"
        yield Violation(failsafe_s, "battery", f"{text} {needed_s:.0f} s")


def _that_happened(track: Track) -> frozenset[str]:
    """The faults of the scene, without a pilot's choice that was refused or came too late."""
    faults = track.evidence.faults
    return (
        faults
        if any(by is Responsible.PILOT for *_, by in track.given)
        else faults - {"PILOT", "PAUSE"}
    )


def _was_lied_to(track: Track, at_s: float) -> bool:
    """Whether the companion had just heard a mode, or a failsafe, that the vehicle was not in."""
    for message in track.evidence.heard:
        named = message.component == AUTOPILOT and message.name in {"HEARTBEAT", "CURRENT_MODE"}
        if not (named and 0.0 <= at_s - message.time_s < _STALE_S):
            continue
        first, last = (track.at(message.time_s + seconds) for seconds in (-_STALE_S, _STALE_S))
        about = track.evidence.samples[first : last + 1]
        critical = number(message.fields, "system_status") >= _CRITICAL
        mode = number(message.fields, "custom_mode")
        if all(sample.custom_mode != mode for sample in about):
            return True
        if critical and not any(sample.failsafe for sample in about):
            return True
    return False


def _words(track: Track, end: End, row: Row) -> Iterator[Violation]:
    """What was announced against what happened."""
    evidence = track.evidence
    given_s = [line.time_s for line in evidence.lines if "hands off" in line.text]
    lied_to = bool(given_s) and _was_lied_to(track, given_s[0])
    last_s = float(track.time_s[-1])
    code = evidence.exit_code
    text = "\n".join([line.text for line in evidence.lines] + [evidence.outcome])
    taken = [h.time_s for h in evidence.happenings if h.what in _TAKEN]
    if code == DONE and end is not End.LANDED:
        yield Violation(last_s, "told", f"exit 0, 'done': {end.value}")
    if end is not End.LANDED and _LANDED in text:
        yield Violation(last_s, "told", f"'{_LANDED}' was said: {end.value}")
    # A companion that is started anew while it lands leaves it to do so, and says that.
    left = code == REFUSED and len(list(evidence.told(SceneEventKind.STARTED))) > 1
    if end is End.LANDED and code not in {DONE, None} and not (lied_to or left):
        yield Violation(last_s, "told", f"exit {code}, though it landed at home by our command")
    if code == TAKEN_OVER and not taken:
        yield Violation(last_s, "told", "exit 6: a pilot took over, but none did")
    claims = [line.time_s for line in evidence.lines if _SAYS_PILOT.search(line.text)]
    if claims and not lied_to and claims[0] < min(taken, default=math.inf) - _LAG_S:
        yield Violation(claims[0], "told", "a pilot is said to have taken over, but none had")
    # Disarmed by a station there is nothing to take over: the flight ends, and says why.
    disarmed = (
        any(h.what is SceneEventKind.DISARMED for h in evidence.happenings) and "disarm" in text
    )
    over_s = max((h.time_s for h in evidence.told(SceneEventKind.ENDED)), default=math.inf)
    before = min(taken, default=math.inf) > over_s  # it had ended before that
    if end is End.PILOT and code not in {TAKEN_OVER, None} and not (disarmed or left or before):
        yield Violation(last_s, "told", f"exit {code}, though the pilot has the vehicle")
    if not (row.says and track.flying.any()):
        return
    # What was said before it went wrong, as by the pre-flight card, is not said of it.
    flies_s = float(track.time_s[int(np.argmax(track.flying))])
    begun_s = min((h.time_s for h in evidence.told(SceneEventKind.FAULT)), default=flies_s)
    if row.shows_s and _cruised_s(track, begun_s) < row.shows_s:
        return
    since = [text for time_s, text in announcements(evidence) if time_s >= begun_s]
    if not re.search(row.says, "\n".join([*since, evidence.outcome]), re.IGNORECASE):
        yield Violation(last_s, "told", f"nothing was said of it: no line has '{row.says}'")


def _cruised_s(track: Track, since_s: float) -> float:
    """For how long it flew level from then on, until an offset was taken back."""
    offs_s = [h.time_s for h in track.evidence.told(SceneEventKind.FAULT) if h.value == "off"]
    until_s = offs_s[1] if len(offs_s) > 1 else math.inf
    level = track.flying & (track.above_m > _CRUISES * track.mission.altitudes_m[0])
    level &= np.array([s.custom_mode != LAND_MODE for s in track.evidence.samples])
    times_s = track.time_s[level & (track.time_s >= since_s) & (track.time_s < until_s)]
    return float(np.ptp(times_s)) if len(times_s) else 0.0
