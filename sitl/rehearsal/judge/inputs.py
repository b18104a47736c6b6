"""Rules of the companion's seat: what it received, and whether it announced that and acted.

They work on the messages as they reached the companion, and on nothing else of the link: where
those were not written down there is nothing to judge. The limits are those of docs/vehicle.md with
some seconds on top.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from sitl.rehearsal.judge.acceptance import End
from sitl.rehearsal.judge.case import Case, Floats, Responsible, Violation
from sitl.rehearsal.judge.evidence import SceneEventKind, WireMessage, number
from sitl.rehearsal.judge.mission_reader import Area
from sitl.rehearsal.judge.reactions import Incident, announces, comes_home, stands, stops
from sitl.rehearsal.judge.space import depths_m

_EARLY: Final = 0.9
"""So early of its time it may come home: it measures how fast simulated time runs."""

_LONELY_S: Final = 1.0
"""A pause of all streams together counts as no more: then none of them is missing alone."""

_SILENT_S: Final = 4.0
_CRITICAL: Final = 5  # MAV_STATE_CRITICAL
_FIX_3D: Final = 3
_NO_FIX_S, _BREACH_S, _LOW_S = 1.0, 1.5, 2.0
_POOR_MM, _POOR_S, _POOR_HOME_S, _STANDS_S = 2000, 4.0, 33.0, 3.0
"""A GPS_RAW_INT.h_acc from here on is too poor for any mission that does not plan for it; after so
long it is announced, and the mission ends; what a vehicle has to stop."""

_AGAIN_S: Final = 10.0
"""What goes on is announced again so long after."""

_STOOD_S, _OWN_LAG_S = 1.0, 1.0
"""A standstill of so long by the companion's own clock is announced, within so long."""

_ESCALATES_S: Final = 10.0
_ALARM_S: Final = {"position": 2.0, "mode": 5.0, "satellites": 10.0}
"""From when on the vehicle stands, or is not commanded, for a lost stream: the pilot is alarmed;
and so much later an alarm requests the pilot to take the vehicle by hand."""

_CLIMB_S: Final = 60.0
"""Within that time of leaving the ground the mission has begun."""

_FLICKERS_S: Final = 2.5
"""A fix that is back for no longer is not back: 3 s are, and what stood may go on."""

_LOST_S, _KNOWN_S = 1.0, 1.0
"""A fix that was lost for so long makes no position known; nor do messages so soon after it."""

_AUTOPILOTS: Final = frozenset({2, 3, 4, 5, 6})
"""Sub-modes of AUTO in which the autopilot flies: take-off, Hold, Mission, Return, Land."""

_NAMES: Final = {3: "Hold", 5: "Return", 6: "Land"}
"""Those that a failsafe chooses."""

_SPOILT: Final = frozenset({"LOST_POSITION", "TWINS", "REBOOT", "CLAIMS"})
"""Faults in which heights reach the companion that the vehicle never sent."""

_UNKNOWN_S: Final = 4.0
"""Within this it is announced that the position is not known."""

_BREACH_M: Final = 0.5
_NEARS_S: Final = 10.0
"""Nearness to a zone is announced before the vehicle is in it; if it flickers, not each time."""

_LEAVES_S: Final = 10.0
"""What a vehicle has to leave a zone that was drawn where it is."""

_BELIEVED_S, _JUMPS, _SAGS = 3.0, 10.0, 0.04
"""So long a charge has to be sent that is more than so many percent lower than before, unless the
voltage has fallen by this share."""
_TURNS: Final = re.compile(r"coming home: battery at (\d+)%")

_SHORT_M, _SHORT_S = 1.0, 1.0
"""So much of a clearance has to be missing, for so long, that it must be noticed."""

_BACK_S: Final = 15.0
"""What a vehicle has to leave the place where a pilot gave it back."""

_MOVES_CM_S: Final = 100

_CRUISE: Final = frozenset({"INIT", "SEARCH", "COMM", "EXPL", "IDLE", "HOME"})
_LEVEL: Final = _CRUISE | {"GOTO", "HOLD"}
_GIVEN: Final = frozenset({"LAND", "PASSIVE", "DONE"})

Span = tuple[float, float]
"""From when to when."""


class Input(NamedTuple):
    """A stream that a flight rests on.

    Attributes:
        name: For the verdict.
        messages: Any of these updates it.
        pattern: A line that announces its loss matches this.
        announced_s: It has to be announced.
        stands_s: The vehicle has to stand, and no leg may begin; infinite: never.
        home_s: The mission has to end; infinite: never.
    """

    name: str
    messages: frozenset[str]
    pattern: str
    announced_s: float
    stands_s: float = math.inf
    home_s: float = math.inf


INPUTS: Final = (
    Input("position", frozenset({"GLOBAL_POSITION_INT"}), "position", 2.0, 2.0),
    Input("mode", frozenset({"HEARTBEAT", "CURRENT_MODE"}), "mode|heartbeat", 5.0),
    Input("heartbeat", frozenset({"HEARTBEAT"}), "heartbeat", 5.0, math.inf, 30.0),
    Input("satellites", frozenset({"GPS_RAW_INT"}), "GPS", 5.0, 10.0, 30.0),
    Input("battery", frozenset({"SYS_STATUS"}), "battery", 5.0, math.inf, 30.0),
    Input("item", frozenset({"MISSION_CURRENT"}), "item", 5.0, math.inf, 60.0),
    Input("landed state", frozenset({"EXTENDED_SYS_STATE"}), "landed", 5.0, math.inf, 60.0),
)


class Gap(NamedTuple):
    """A time in which a stream brought no update.

    Attributes:
        of: The stream.
        began_s: When it was received last.
        times_s: When anything was received, until the stream was received again.
        clock_s: The same, pauses of all streams together left out.
        since_s: By that clock, when it was received last.
    """

    of: Input
    began_s: float
    times_s: Floats
    clock_s: Floats
    since_s: float

    def reached_s(self, age_s: float) -> float:
        """When the last message was so old; infinite if it never was."""
        at = int(np.searchsorted(self.clock_s, self.since_s + age_s))
        return float(self.times_s[at]) if at < len(self.clock_s) else math.inf


# Streams.


def silence_is_announced(case: Case) -> Iterator[Violation]:
    """When the vehicle falls silent, that is announced, and again while it goes on."""
    times_s = [message.time_s for message in case.evidence.received]
    for before_s, after_s in itertools.pairwise([*times_s, *map(float, case.time_s[-1:])]):
        due_s = before_s + _SILENT_S * case.evidence.speed + case.reacts_s
        if after_s > due_s and case.could_react(before_s, due_s, ours=False):
            incident = Incident(before_s, "nothing was received any more")
            yield from announces(case, incident, "nothing received|silent", due_s)
            again_s = due_s + _AGAIN_S * case.evidence.speed + case.reacts_s
            if after_s > again_s and case.could_react(before_s, again_s, ours=False):
                more = Incident(due_s + 0.1, "nothing was received for long")
                yield from announces(case, more, "nothing received|silent", again_s, 0.0)


def lost_streams_are_acted_on(case: Case) -> Iterator[Violation]:
    """A stream that is lost or frozen is announced; then the vehicle stands, or comes home."""
    found = list(gaps(case))
    for gap in found:
        each, began_s = gap.of, gap.began_s
        incident = Incident(began_s, f"the {each.name} was not received any more")
        announced_s, stands_s, home_s = (
            gap.reached_s(age_s + case.reacts_s)
            for age_s in (each.announced_s, each.stands_s, each.home_s)
        )
        if case.could_react(began_s, announced_s) and case.state(began_s) != "PASSIVE":
            yield from announces(case, incident, each.pattern, announced_s)
        until_s = min(float(gap.times_s[-1]), gap.reached_s(each.home_s * _EARLY))
        yield from stands(case, incident, (stands_s, until_s))
        yield from comes_home(case, incident, home_s, blind(found))


def lost_streams_are_alarmed_of(case: Case) -> Iterator[Violation]:
    """A vehicle that stands for a lost stream raises an alarm; later the pilot is to take over.

    The alarm does not come so often that it drowns all others.
    """
    for gap in gaps(case):
        stands_s = _ALARM_S.get(gap.of.name)
        if stands_s is None:
            continue
        due_s = gap.reached_s(stands_s + _ESCALATES_S + case.reacts_s)
        given = {case.state(gap.began_s), case.state(due_s)} & _GIVEN  # it is flown, or lands
        if given or not case.could_react(gap.began_s, due_s):
            continue
        alarmed_s = [
            each.time_s
            for each in case.announced
            if each.label == "ALARM" and gap.began_s <= each.time_s <= float(gap.times_s[-1])
            if re.search(gap.of.pattern, each.text, re.IGNORECASE)
        ]
        by_hand = any(
            "by hand" in each.instruction
            for each in case.announced
            if each.label == "ALARM" and gap.began_s <= each.time_s <= due_s
        )
        if not by_hand:
            incident = Incident(gap.began_s, f"the {gap.of.name} was not received any more")
            yield Violation(due_s, "report", f"no alarm requested the pilot: {incident}")
        most = 3 + (float(gap.times_s[-1]) - gap.began_s) / _AGAIN_S
        if len(alarmed_s) > most:
            text = f"{len(alarmed_s)} alarms of the {gap.of.name} in one loss of it"
            yield Violation(alarmed_s[-1], "report", text)


def gaps(case: Case) -> Iterator[Gap]:
    """Of all streams, those that have to be announced."""
    received = case.evidence.received
    times_s = np.array([message.time_s for message in received])
    clock_s = np.cumsum(np.minimum(np.diff(times_s, prepend=times_s[:1]), _LONELY_S))
    for each in INPUTS:
        mine = [at for at, message in enumerate(received) if message.name in each.messages]
        for first, after in itertools.pairwise([*updates(received, mine), len(received)]):
            if clock_s[after - 1] - clock_s[first] >= each.announced_s:
                began_s, since_s = float(times_s[first]), float(clock_s[first])
                yield Gap(each, began_s, times_s[:after], clock_s[:after], since_s)


def blind(found: Iterable[Gap]) -> list[Span]:
    """Times without position or mode."""
    return [(g.began_s, float(g.times_s[-1])) for g in found if not math.isfinite(g.of.home_s)]


def updates(received: Sequence[WireMessage], numbers: Sequence[int]) -> Iterator[int]:
    """The updates among them: their clock goes on, and what reports a velocity has moved."""
    last: Mapping[str, Any] = {}
    for at in numbers:
        fields = received[at].fields
        clock = next((c for c in ("time_boot_ms", "time_usec") if c in fields), None)
        if clock is not None and clock in last and fields[clock] == last[clock]:
            continue
        before, last = last, fields
        if before and "vx" in fields:
            moves = math.hypot(fields["vx"], fields["vy"]) >= _MOVES_CM_S
            if moves and (fields["lat"], fields["lon"]) == (before["lat"], before["lon"]):
                continue
        yield at


# Values that were received.


def _spans(
    messages: Sequence[WireMessage], holds: Iterable[Any], pause_s: float = 0.0
) -> Iterator[Span]:
    """From when to when something held in every message, but for pauses that are no longer."""
    begun: Span | None = None
    for message, held in zip(messages, holds, strict=True):
        if held:
            begun = (message.time_s if begun is None else begun[0], message.time_s)
        elif begun is not None and message.time_s - begun[1] > pause_s:
            yield begun
            begun = None
    if begun is not None:
        yield begun


def a_lost_fix_is_held_for(case: Case) -> Iterator[Violation]:
    """Without a fix of its GPS the vehicle stands, and that is announced."""
    messages = case.received("GPS_RAW_INT")
    bad = [number(m.fields, "fix_type") < _FIX_3D for m in messages]
    for begin_s, end_s in _spans(messages, bad, _FLICKERS_S):
        incident, due_s = Incident(begin_s, "GPS lost its fix"), begin_s + _NO_FIX_S + case.reacts_s
        if end_s - begin_s < _NO_FIX_S or not case.cruises(case.at(begin_s)):
            continue
        if case.state(begin_s) in _GIVEN:
            continue
        texts = [text for at_s, text in case.texts if at_s <= begin_s and "GPS" in text]
        flaps = texts and "again" not in texts[-1]  # it was not back for long enough to announce it
        if case.could_react(begin_s, due_s) and not flaps:
            yield from announces(case, incident, "GPS|fix|satellite|failsafe", due_s, _NEARS_S)
        yield from stands(case, incident, (due_s, end_s))


def a_poor_fix_is_held_for(case: Case) -> Iterator[Violation]:
    """Satellites too poor to keep the clearance are announced; the vehicle stands.

    For half a minute: then it comes home all the same.
    """
    messages = case.received("GPS_RAW_INT")
    poor = [number(m.fields, "h_acc") >= _POOR_MM for m in messages]
    for begin_s, end_s in _spans(messages, poor, _FLICKERS_S):
        incident = Incident(begin_s, f"GPS was good to {_POOR_MM / 1e3:g} m or less only")
        due_s, home_s = begin_s + _POOR_S + case.reacts_s, begin_s + _POOR_HOME_S
        announced_s = due_s if due_s < end_s else math.inf
        if not all(case.state(at_s) in _LEVEL for at_s in (begin_s, min(announced_s, end_s))):
            continue
        if case.could_react(begin_s, announced_s):
            yield from announces(case, incident, "satellites", due_s)
        if any(case.state(at_s) == "HOME" for at_s in (begin_s, min(due_s, end_s))):
            continue  # that is what it would do
        if case.could_react(begin_s, announced_s):
            yield from stands(case, incident, (due_s + _STANDS_S, min(end_s, home_s - 1.0)))
        late_s = home_s + case.reacts_s
        yield from comes_home(
            case, incident, late_s if late_s < end_s else math.inf, blind(gaps(case))
        )


def the_reserve_is_for_the_way_home(case: Case) -> Iterator[Violation]:
    """A battery that is at its reserve is announced, and the vehicle comes home."""
    messages, reserve = case.received("SYS_STATUS"), case.mission.battery_reserve * 100.0
    low = [0 <= number(m.fields, "battery_remaining") <= reserve for m in messages]
    lost = blind(gaps(case))
    for begin_s, end_s in _spans(messages, low):
        incident, due_s = Incident(begin_s, "the battery was at its reserve"), begin_s + _LOW_S
        due_s += case.reacts_s + (_BELIEVED_S if _jumps(messages, begin_s) else 0.0)
        if end_s < due_s or not case.could_react(begin_s, due_s):
            continue
        if case.state(begin_s) not in _GIVEN | {"HOME"}:
            yield from announces(case, incident, "battery", due_s)
        yield from comes_home(case, incident, begin_s, lost)


def _jumps(messages: Sequence[WireMessage], at_s: float) -> bool:
    """Whether a charge came from much higher within the seconds before: it may be believed later.

    Not where the voltage has fallen with it.
    """
    recent = [m for m in messages if at_s - _BELIEVED_S < m.time_s <= at_s]
    percents = [number(m.fields, "battery_remaining") for m in recent]
    volts = [v for m in recent if math.isfinite(v := number(m.fields, "voltage_battery"))]
    sags = bool(volts) and volts[-1] < max(volts) * (1.0 - _SAGS)
    return max(percents) - percents[-1] > _JUMPS and not sags


def a_moment_of_no_charge_ends_nothing(case: Case) -> Iterator[Violation]:
    """It comes home for a charge that was sent for some seconds, or came with less voltage."""
    messages = case.received("SYS_STATUS")
    for at_s, text in case.texts:
        found = _TURNS.search(text)
        if found is None:
            continue
        recent = [m for m in messages if at_s - _BELIEVED_S < m.time_s <= at_s + 0.1]
        percents = [number(m.fields, "battery_remaining") for m in recent]
        volts = [v for m in recent if math.isfinite(v := number(m.fields, "voltage_battery"))]
        sags = bool(volts) and volts[-1] < max(volts) * (1.0 - _SAGS)
        jumped = any(before - after > _JUMPS for before, after in itertools.pairwise(percents))
        if jumped and max(percents) > float(found[1]) + _JUMPS and not sags:
            wrong = f"comes home at {found[1]} %, {max(percents):.0f} % were reported just before"
            yield Violation(at_s, "battery", wrong)


def the_time_is_over_as_in_the_file(case: Case) -> Iterator[Violation]:
    """The mission's duration counts from the take-off, also where a pilot has had the vehicle."""
    if End.NOT in case.row.ends or not case.flying.any():
        return
    begin_s = float(case.time_s[int(case.flying.argmax())])
    over_s = begin_s + _CLIMB_S + case.mission.duration_s
    held_s = [given.end_s + _LOW_S for given in case.given if given.begin_s < over_s < given.end_s]
    since_s = max([over_s, *held_s])
    if since_s < case.time_s[-1]:
        incident = Incident(over_s, "the time of the mission was over")
        yield from comes_home(case, incident, since_s, blind(gaps(case)))


def a_failsafe_is_announced(case: Case) -> Iterator[Violation]:
    """When a failsafe of the autopilot acts, that is announced, and the vehicle is left to it."""
    messages = case.received("HEARTBEAT")
    acts = [number(m.fields, "system_status") >= _CRITICAL for m in messages]
    for begin_s, end_s in _spans(messages, acts):
        due_s = begin_s + case.reacts_s
        known = case.state(begin_s - 0.1) in {"PASSIVE", "DONE"}
        if end_s >= due_s and not known and case.could_react(begin_s, due_s, ours=False):
            incident = Incident(begin_s, "a failsafe acted")
            flies = case.state(begin_s - 0.1) in _LEVEL
            yield from announces(
                case, incident, "hands off" if flies else "failsafe|hands off", due_s
            )


def a_failsafe_that_goes_on_to_another_mode_is_announced(case: Case) -> Iterator[Violation]:
    """PX4 holds for a while, then returns or lands: that is announced, also in a pilot's flight."""
    messages = case.received("HEARTBEAT")
    acts = [number(m.fields, "system_status") >= _CRITICAL for m in messages]
    for begin_s, end_s in _spans(messages, acts):
        during = [m for m in messages if begin_s <= m.time_s <= end_s]
        modes = [int(number(m.fields, "custom_mode")) for m in during]
        for at, (before, mode) in enumerate(itertools.pairwise(modes), 1):
            name, from_s = _NAMES.get(mode >> 24), during[at].time_s
            due_s = from_s + case.reacts_s
            if before == mode or name is None or due_s > end_s or set(modes[at:]) != {mode}:
                continue
            if case.could_react(from_s, due_s, ours=False):
                incident = Incident(from_s, f"the failsafe went on to {name}")
                yield from announces(case, incident, f"failsafe .*{name} mode", due_s, _NEARS_S)


def _lost_fixes(case: Case) -> list[Span]:
    """When its satellites made no position known, by the messages it received."""
    messages = case.received("GPS_RAW_INT")
    clearance_mm = case.mission.clearance_m * 1e3
    bad = [
        number(m.fields, "fix_type") < _FIX_3D or number(m.fields, "h_acc") > clearance_mm
        for m in messages
    ]
    return [(begin_s + _LOST_S, end_s) for begin_s, end_s in _spans(messages, bad)]


def no_breach_is_claimed_without_a_position(case: Case) -> Iterator[Violation]:
    """Without satellites it is unknown whether it is in a zone: it announces just that."""
    lost = _lost_fixes(case)
    for at_s, text in case.texts:
        if "breach of" in text and any(begin_s <= at_s <= end_s for begin_s, end_s in lost):
            yield Violation(at_s, "report", f"'{text.strip()}', and its position is not known")


def an_unknown_position_is_alarmed_of(case: Case) -> Iterator[Violation]:
    """While the autopilot flies a vehicle that is not ours, without knowing where it is."""
    for lost_s, end_s in _lost_fixes(case):
        given_s = [g.begin_s for g in case.given if g.begin_s < end_s and g.end_s > lost_s]
        begin_s = max([lost_s, *given_s])
        due_s = begin_s + _UNKNOWN_S + case.reacts_s
        about = case.evidence.samples[case.at(begin_s) : case.at(due_s) + 1]
        auto = all(
            (s.custom_mode >> 16) & 0xFF == 4 and s.custom_mode >> 24 in _AUTOPILOTS for s in about
        )
        if (
            not given_s
            or due_s > end_s
            or not auto
            or not case.could_react(begin_s, due_s, ours=False)
        ):
            continue
        if case.by[case.at(begin_s)] is Responsible.OURS:
            continue
        yield from announces(
            case,
            Incident(begin_s, "its position is not known"),
            "position is not known",
            due_s,
            _NEARS_S,
        )


def no_station_is_blamed_for_home(case: Case) -> Iterator[Violation]:
    """Home that no station has moved was set by PX4 itself, and is not announced as moved."""
    spoilt = case.evidence.faults & _SPOILT or not case.evidence.received
    if any(case.evidence.events(SceneEventKind.HOME_MOVED)) or spoilt:
        return
    for at_s, text in case.texts:
        if "home was moved" in text:
            yield Violation(at_s, "report", f"'{text.strip()}', and no station has moved it")


def a_companion_that_stood_still_announces_it(case: Case) -> Iterator[Violation]:
    """It measures that itself: what it then decides on is old."""
    events = case.evidence.events
    ends_s = [h.time_s for h in events(SceneEventKind.CONTINUED)]
    for stop in events(SceneEventKind.STOPPED) if case.evidence.received else ():
        on_s = next((s for s in ends_s if s > stop.time_s), math.inf)
        due_s = on_s + _OWN_LAG_S + case.reacts_s
        first, last = case.at(stop.time_s), case.at(due_s)
        flies = due_s < case.time_s[-1] and case.flying[first : last + 1].all()
        over = any(on_s <= h.time_s <= due_s for h in events(SceneEventKind.ENDED))
        stood_s = (on_s - stop.time_s) / case.evidence.speed
        if stood_s >= _STOOD_S and flies and not over:
            yield from announces(case, Incident(on_s, "it stood still before"), "stalled", due_s)


def breaches_are_announced(case: Case) -> Iterator[Violation]:
    """By its own report it was in a zone or outside of a fence, whatever flew it there."""
    lost = _lost_fixes(case)
    for area, drawn_s, spans in near(case, -_BREACH_M):
        for begin_s, end_s in spans:
            due_s = begin_s + _BREACH_S + case.reacts_s
            # Over ours: it leaves, and announces that; a pilot has to be warned.
            ours = case.by[case.at(begin_s)] is Responsible.OURS
            drawn = ours and begin_s < drawn_s + _LEAVES_S
            lasts = end_s - begin_s >= _BREACH_S and not drawn
            # Without satellites it announces that its position is not known.
            lasts &= not any(
                since_s - _LOST_S < due_s and until_s + _KNOWN_S > begin_s
                for since_s, until_s in lost
            )
            if lasts and case.could_react(begin_s, due_s, ours=False):
                incident = Incident(begin_s, f"a breach of {area.name}")
                yield from announces(case, incident, "breach|too near", due_s, _NEARS_S)


def a_lost_clearance_is_held_for(case: Case) -> Iterator[Violation]:
    """By its own report it was nearer to a zone or fence than it may be, in cruise."""
    for area, drawn_s, spans in near(case, None):
        for begin_s, end_s in spans:
            if end_s - begin_s < _SHORT_S or case.state(begin_s) not in _LEVEL:
                continue
            appears = begin_s < drawn_s + _LEAVES_S
            given = any(g.begin_s < begin_s < g.end_s + _BACK_S for g in case.given)
            due_s = begin_s + 2 * _SHORT_S + case.row.notice_s + case.evidence.reaction_s
            if appears or given or not case.could_react(begin_s, due_s):
                continue
            incident = Incident(begin_s, f"it came too near to {area.name}")
            yield from announces(case, incident, "breach|too near", due_s, _NEARS_S)
            yield from stops(case, incident)


def near(case: Case, room_m: float | None) -> Iterator[tuple[Area, float, list[Span]]]:
    """Each area, when it was drawn, and when the vehicle reported less room from it than this.

    None: than the clearance, by far.
    """
    messages = case.received("GLOBAL_POSITION_INT")
    if not messages:
        return
    times_s = np.array([m.time_s for m in messages])
    degrees = [np.array([m.fields[name] / 1e7 for m in messages]) for name in ("lat", "lon")]
    places = np.column_stack(case.mission.frame.metres(*degrees))
    amsl_m = np.array([m.fields["alt"] / 1e3 for m in messages])
    for version in case.versions:
        counts = (times_s >= version.from_s) & (times_s < version.until_s)
        for area in version.mission.areas:
            level = counts & (amsl_m >= area.lower_m) & (amsl_m <= area.upper_m)
            least_m = area.clearance_m - _SHORT_M if room_m is None else room_m
            near = level & (depths_m(area, places) > -least_m)
            yield area, version.from_s, list(_spans(messages, near))
