"""The companion's seat, for the judge: when it listened, what it said, what it had to do then."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from sitl.rehearsal.judge.evidence import SceneEventKind, WireMessage
from sitl.rehearsal.judge.judge_space import leads_home
from sitl.rehearsal.judge.judge_track import LAND_MODE, Responsible, Track, Violation

_SAID_S: Final = 3.0
"""What the companion has on top of each limit to announce something."""

_BRAKED_S: Final = 4.0
"""What the vehicle has on top of that to stand still."""

_TURNS_S: Final = 20.0
_DETOUR: Final = 2.0
"""How much longer than straight a way home may be, and what turning there may take."""

_SETTLED_S: Final = 8.0
"""A companion that was started has so long to connect."""

_STATE: Final = re.compile(r"\b[A-Z]+ -> ([A-Z]+)$")
_SECOND: Final = 25
"""Samples of a second, about."""


@dataclass(slots=True)
class CompanionsSeat:
    """What the companion knew and said.

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
    _said: list[tuple[float, str]] = field(default_factory=list)  # announced, and when
    _deaf: list[tuple[float, float]] = field(default_factory=list)  # spans without listening
    _lost: list[tuple[float, float]] = field(default_factory=list)  # of position or mode

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

    def _add(
        self,
        time_s: float,
        kind: str,
        text: str,
        value: float = math.nan,
        limit: float = math.nan,
    ) -> None:
        self.violations.append(Violation(time_s, kind, text, value, limit))
