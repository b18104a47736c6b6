"""The judge in the companion's seat: what it was told, and whether that was said and acted on.

Works on the messages as they reached the companion, and on nothing else of the link. Of each kind
of news this module knows how long the companion has to announce it, to stand still and to come
home; the limits are those of docs/vehicle.md with some seconds on top.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import shapely

from sitl.rehearsal.judge.evidence import SceneEventKind, WireMessage
from sitl.rehearsal.judge.judge_heard import INPUTS, Input, announcements, news, spans
from sitl.rehearsal.judge.judge_space import areas_in_force, leads_home, same_area
from sitl.rehearsal.judge.judge_track import (
    LAND_MODE,
    Floats,
    MissionVersion,
    Responsible,
    Track,
    Violation,
    number,
)
from sitl.rehearsal.judge.mission_reader import Area, MissionFileError

_SAID_S: Final = 3.0
"""What the companion has on top of each limit to announce something."""

_BRAKED_S: Final = 4.0
"""What the vehicle has on top of that to stand still."""

_EARLY: Final = 0.9
"""So early of its time it may come home: it measures how fast simulated time runs."""

_TURNS_S: Final = 20.0
_DETOUR: Final = 2.0
"""How much longer than straight a way home may be, and what turning there may take."""

_SETTLED_S: Final = 8.0
"""A companion that was started has so long to connect."""

_LONELY_S: Final = 1.0
"""A pause of all streams together counts as no more: then none of them is missing alone."""

_SILENT_S: Final = 4.0
_CRITICAL: Final = 5  # MAV_STATE_CRITICAL
_FIX_3D: Final = 3
_NO_FIX_S, _BREACH_S, _LOW_S = 1.0, 1.5, 2.0
_FLICKERS_S: Final = 2.5
"""A fix that is back for no longer is not back: 3 s are, and what stood may go on."""

_BREACH_M: Final = 0.5
_NEARS_S: Final = 10.0
"""What comes near to a zone is told that before it is in it; what flickers, not each time."""

_LEAVES_S: Final = 10.0
"""What a vehicle has to leave a zone that was drawn where it is."""

_JUMP_M, _CLIMB_M_S = 4.0, 6.0
_NOT_TAKEN: Final = re.compile("(refused|not (reloaded|changed)): (?!.*as they were)")
_STATE: Final = re.compile(r"\b[A-Z]+ -> ([A-Z]+)$")
_CRUISE: Final = frozenset({"INIT", "SEARCH", "COMM", "EXPL", "HOME"})
_ENDING: Final = frozenset({"HOME", "LAND", "PASSIVE", "DONE"})


@dataclass(slots=True)
class InputJudge:
    """Judges what the companion made of what it heard.

    Attributes:
        track: Of the flight.
        legs: The commands that lead to a place.
        notice_s: How much longer than usual it has.
        violations: Found so far.
    """

    track: Track
    legs: Sequence[WireMessage]
    notice_s: float = 0.0
    violations: list[Violation] = field(default_factory=list)
    _times: list[float] = field(default_factory=list)
    _clock: Floats = field(default_factory=lambda: np.zeros(0))
    _said: list[tuple[float, str]] = field(default_factory=list)
    _deaf: list[tuple[float, float]] = field(default_factory=list)
    _lost: list[tuple[float, float]] = field(default_factory=list)

    def judge(self) -> None:
        """Listen to the whole flight; where it was not written down there is nothing to judge."""
        heard = self.track.evidence.heard
        if not heard:
            return
        self._times = [m.time_s for m in heard]
        steps = np.diff(np.array([self._times[0], *self._times]))
        self._clock = np.cumsum(np.minimum(steps, _LONELY_S))
        self._said = announcements(self.track.evidence)
        self._deaf = list(self._deaf_spans())
        self._judge_silence()
        self._judge_files_left()
        for each in INPUTS:
            self._judge_stream(each, [n for n, m in enumerate(heard) if m.name in each.messages])
        positions = [m for m in heard if m.name == "GLOBAL_POSITION_INT"]
        self._judge_fix([m for m in heard if m.name == "GPS_RAW_INT"])
        self._judge_charge([m for m in heard if m.name == "SYS_STATUS"])
        self._judge_failsafe([m for m in heard if m.name == "HEARTBEAT"])
        self._judge_breaches(positions)
        self._judge_heights(positions)

    # Who had to listen.

    def _deaf_spans(self) -> Iterator[tuple[float, float]]:
        """When the companion was not running, or not yet connected."""
        evidence = self.track.evidence
        since_s = -math.inf if any(evidence.told(SceneEventKind.STARTED)) else None
        for happening in evidence.happenings:
            if happening.what in {
                SceneEventKind.KILLED,
                SceneEventKind.STOPPED,
                SceneEventKind.ENDED,
            }:
                since_s = happening.time_s
            elif (
                happening.what in {SceneEventKind.STARTED, SceneEventKind.CONTINUED}
                and since_s is not None
            ):
                yield since_s, happening.time_s + _SETTLED_S
                since_s = None
        if since_s is not None:
            yield since_s, math.inf

    def _answers(self, begin_s: float, end_s: float, *, ours: bool = True) -> bool:
        """Whether it listened, and the vehicle flew (and was its own), from then to then."""
        track = self.track
        if any(begin_s < until_s and end_s > from_s for from_s, until_s in self._deaf):
            return False
        first, last = track.at(begin_s), track.at(end_s)
        if end_s > track.time_s[-1] or not track.flying[first : last + 1].all():
            return False
        return not ours or all(by is Responsible.OURS for by in track.by[first : last + 1])

    def _state(self, time_s: float) -> str:
        """The mission state that was announced last."""
        found = [m for at_s, text in self._said if at_s <= time_s and (m := _STATE.search(text))]
        return found[-1].group(1) if found else ""

    def _has_said(self, words: str, begin_s: float, end_s: float) -> bool:
        lines = (text for at_s, text in self._said if begin_s <= at_s <= end_s)
        return any(re.search(words, line, re.IGNORECASE) for line in lines)

    def _expect(
        self, words: str, begin_s: float, due_s: float, what: str, before_s: float = 0.1
    ) -> None:
        """A line that says so has to have come by then, or so long before."""
        if not self._has_said(words, begin_s - before_s, due_s):
            self._add(due_s, "told", f"not a word about it: {what} at {begin_s:.1f} s")

    @property
    def _reacts_s(self) -> float:
        return _SAID_S + self.notice_s + max(self.track.evidence.reaction_s - 1.0, 0.0)

    def _judge_files_left(self) -> None:
        """Other zones or fences that it was asked to apply, and did not: it says why."""
        track = self.track
        for left in track.evidence.told(SceneEventKind.FILE_LEFT):
            asked_s, text = left.value
            flown = track.version_at(asked_s)
            try:
                asked = track.read(text)
            except MissionFileError:
                continue
            new = [
                a
                for a, _ in areas_in_force(MissionVersion(asked_s, asked))
                if not _is_among(a, flown)
            ]
            if not new or not self._answers(asked_s, left.time_s, ours=False):
                continue
            said = (words for at_s, words in self._said if asked_s - 0.1 <= at_s <= left.time_s)
            if not any(_NOT_TAKEN.search(words) for words in said):
                what = f"{new[0].name} of a changed file is not applied"
                self._add(left.time_s, "told", f"not a word why {what}")

    # Streams.

    def _judge_silence(self) -> None:
        for before_s, after_s in itertools.pairwise([*self._times, float(self.track.time_s[-1])]):
            due_s = before_s + _SILENT_S * self.track.evidence.speed + self._reacts_s
            if after_s > due_s and self._answers(before_s, due_s, ours=False):
                self._expect("nothing heard|silent", before_s, due_s, "nothing was heard any more")

    def _judge_stream(self, each: Input, numbers: Sequence[int]) -> None:
        heard = self.track.evidence.heard
        numbers = list(news(heard, numbers))
        for first, after in itertools.pairwise([*numbers, len(heard)]):
            if self._clock[after - 1] - self._clock[first] < each.told_s:
                continue
            began_s, end_s = self._times[first], self._times[after - 1]
            if not math.isfinite(each.home_s):
                self._lost.append((began_s, end_s))
            told_s = self._reached_s(first, after, each.told_s + self._reacts_s)
            what = f"the {each.name} was not heard any more"
            if self._answers(began_s, told_s) and self._state(began_s) != "PASSIVE":
                self._expect(each.words, began_s, told_s, what)
            stands_s = self._reached_s(first, after, each.stands_s + self._reacts_s)
            early_s = self._reached_s(first, after, each.home_s * _EARLY)
            self._judge_standing(began_s, (stands_s, min(end_s, early_s)), what)
            home_s = self._reached_s(first, after, each.home_s + self._reacts_s)
            self._judge_way_home(home_s, what)

    def _reached_s(self, first: int, after: int, age_s: float) -> float:
        """When something that was heard last then was so old; infinite if it never was."""
        number = int(np.searchsorted(self._clock[:after], self._clock[first] + age_s))
        return self._times[number] if number < after else math.inf

    def _judge_standing(self, began_s: float, span: tuple[float, float], what: str) -> None:
        """Within the span no leg begins, and some seconds later the vehicle stands."""
        track, (from_s, until_s) = self.track, span
        if from_s >= until_s or not self._answers(began_s, from_s):
            return
        for message in self.legs:
            if from_s <= message.time_s <= until_s and self._answers(began_s, message.time_s):
                self._add(message.time_s, "blind", f"a leg, though {what} at {began_s:.1f} s")
                break
        first, last = track.at(from_s + _BRAKED_S), track.at(until_s)
        limit_m_s = track.mission.speed_m_s / 2.0
        for index in range(first, last, _SECOND):
            after = min(index + _SECOND, len(track.time_s) - 1)
            seconds = float(track.time_s[after] - track.time_s[index])
            if seconds <= 0.0 or not self._cruises(index) or not self._cruises(after):
                continue
            speed_m_s = (
                math.hypot(
                    track.east_m[after] - track.east_m[index],
                    track.north_m[after] - track.north_m[index],
                )
                / seconds
            )
            if speed_m_s > limit_m_s:
                text = f"flies on at {speed_m_s:.1f} m/s, though {what} at {began_s:.1f} s"
                self._add(float(track.time_s[after]), "blind", text, speed_m_s, limit_m_s)
                return

    def _cruises(self, index: int) -> bool:
        track = self.track
        lands = track.evidence.samples[index].custom_mode == LAND_MODE
        return bool(track.flying[index]) and track.by[index] is Responsible.OURS and not lands

    def _judge_way_home(self, since_s: float, what: str) -> None:
        """From then on it flies home: within the time that the way takes it begins to land."""
        track = self.track
        if not math.isfinite(since_s) or not self._cruises(track.at(since_s)):
            return
        way_s = _DETOUR * track.from_home_m(track.at(since_s)) / track.mission.speed_m_s
        due_s = since_s + way_s + _TURNS_S + self.notice_s
        if any(begin_s < due_s and end_s > since_s for begin_s, end_s in self._lost):
            return  # home is not flown without position or mode
        if not self._answers(since_s, due_s):
            return
        there = track.at(due_s)
        if not leads_home(track.version_at(due_s), track.east_m[there], track.north_m[there]):
            return  # it hovers, and says so
        if all(self._cruises(index) for index in range(track.at(since_s), track.at(due_s))):
            self._add(due_s, "home", f"did not land within {due_s - since_s:.0f} s, though {what}")

    # What they say.

    def _judge_fix(self, messages: Sequence[WireMessage]) -> None:
        bad = [number(m.fields, "fix_type") < _FIX_3D for m in messages]
        for begin_s, end_s in spans(messages, bad, _FLICKERS_S):
            what, due_s = "GPS lost its fix", begin_s + _NO_FIX_S + self._reacts_s
            if end_s - begin_s < _NO_FIX_S or not self._cruises(self.track.at(begin_s)):
                continue
            if self._state(begin_s) in _ENDING - {"HOME"}:
                continue
            said = [text for at_s, text in self._said if at_s <= begin_s and "GPS" in text]
            flaps = said and "again" not in said[-1]  # it was not back for long enough to say so
            if self._answers(begin_s, due_s) and not flaps:
                self._expect("GPS|fix|satellite|failsafe", begin_s, due_s, what, _NEARS_S)
            self._judge_standing(begin_s, (due_s, end_s), what)

    def _judge_charge(self, messages: Sequence[WireMessage]) -> None:
        reserve = self.track.mission.battery_reserve * 100.0
        low = [0 <= number(m.fields, "battery_remaining") <= reserve for m in messages]
        for begin_s, end_s in spans(messages, low):
            what, due_s = "the battery was at its reserve", begin_s + _LOW_S + self._reacts_s
            if end_s < due_s or not self._answers(begin_s, due_s):
                continue
            if self._state(begin_s) not in _ENDING:
                self._expect("battery", begin_s, due_s, what)
            self._judge_way_home(begin_s, what)

    def _judge_failsafe(self, messages: Sequence[WireMessage]) -> None:
        acts = [number(m.fields, "system_status") >= _CRITICAL for m in messages]
        for begin_s, end_s in spans(messages, acts):
            due_s = begin_s + self._reacts_s
            known = self._state(begin_s - 0.1) in {"PASSIVE", "DONE"}
            if end_s >= due_s and not known and self._answers(begin_s, due_s, ours=False):
                self._expect("failsafe|hands off", begin_s, due_s, "a failsafe acted")

    def _judge_breaches(self, messages: Sequence[WireMessage]) -> None:
        """By its own report it was in a zone or outside of a fence, whatever flew it there."""
        track = self.track
        east_m, north_m = track.mission.frame.metres(
            np.array([m.fields["lat"] / 1e7 for m in messages]),
            np.array([m.fields["lon"] / 1e7 for m in messages]),
        )
        amsl_m = np.array([m.fields["alt"] / 1e3 for m in messages])
        times_s = np.array([m.time_s for m in messages])
        for place, version in enumerate(track.versions):
            later = track.versions[place + 1 :]
            counts = (times_s >= version.from_s) & (
                times_s < (later[0].from_s if later else math.inf)
            )
            for area, fence in areas_in_force(version):
                within = counts & (amsl_m >= area.lower_m) & (amsl_m <= area.upper_m)
                within &= _is_in(area, np.column_stack((east_m, north_m)), fence=fence)
                for begin_s, end_s in spans(messages, within):
                    due_s = begin_s + _BREACH_S + self._reacts_s
                    drawn = (
                        begin_s < version.from_s + _LEAVES_S
                    )  # over it: it leaves, and says that
                    lasts = end_s - begin_s >= _BREACH_S and not drawn
                    if lasts and self._answers(begin_s, due_s, ours=False):
                        what = f"a breach of {area.name}"
                        self._expect("breach|too near", begin_s, due_s, what, _NEARS_S)

    def _judge_heights(self, messages: Sequence[WireMessage]) -> None:
        """An altitude that no vehicle can have flown to."""
        for before, message in itertools.pairwise(messages):
            seconds = (message.fields["time_boot_ms"] - before.fields["time_boot_ms"]) / 1e3
            jump_m = abs(message.fields["alt"] - before.fields["alt"]) / 1e3
            if not 0.0 < seconds <= 1.0 or jump_m <= _JUMP_M + _CLIMB_M_S * seconds:
                continue
            begin_s, due_s = message.time_s, message.time_s + self._reacts_s
            if self._state(begin_s) in _CRUISE and self._answers(begin_s, due_s):
                what = f"the altitude jumped by {jump_m:.1f} m"
                self._expect("altitude|height", begin_s, due_s, what)

    def _add(
        self,
        time_s: float,
        kind: str,
        text: str,
        value: float = math.nan,
        limit: float = math.nan,
    ) -> None:
        self.violations.append(Violation(time_s, kind, text, value, limit))


_SECOND: Final = 25
"""Samples of a second, about."""


def _is_among(area: Area, version: MissionVersion) -> bool:
    return any(same_area(area, other) for other, _ in areas_in_force(version))


def _is_in(area: Area, places: Floats, *, fence: bool) -> Any:
    """Which places are in a zone, or outside of a fence, and not at its very border."""
    points = shapely.points(places)
    away_m = shapely.distance(area.outline, points)
    if area.radius_m:
        depth_m = away_m - area.radius_m if fence else area.radius_m - away_m
        return depth_m > _BREACH_M
    if fence:
        return away_m > _BREACH_M
    deep = shapely.distance(shapely.boundary(area.outline), points) > _BREACH_M
    return shapely.intersects(area.outline, points) & deep
