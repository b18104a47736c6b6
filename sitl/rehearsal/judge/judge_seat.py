"""The companion's seat, for the judge: what it heard and said, and what it had to do then."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from sitl.rehearsal.judge.evidence import Evidence, SceneEventKind, WireMessage
from sitl.rehearsal.judge.judge_space import leads_home
from sitl.rehearsal.judge.judge_track import LAND_MODE, Judge, Responsible

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

_MOVES_CM_S: Final = 100
_STATUS: Final = re.compile(r"^[A-Z]+ *\|")


class Input(NamedTuple):
    """A stream that a flight rests on.

    Attributes:
        name: For the verdict.
        messages: Any of these is news of it.
        words: A line that announces its loss matches this.
        told_s: It has to be announced.
        stands_s: The vehicle has to stand, and no leg may begin; infinite: never.
        home_s: The mission has to end; infinite: never.
    """

    name: str
    messages: frozenset[str]
    words: str
    told_s: float
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


@dataclass(slots=True)
class CompanionsSeat(Judge):
    """What the companion knew and said.

    Attributes:
        legs: The commands that lead to a place.
        notice_s: How much longer than usual it has.
    """

    legs: Sequence[WireMessage]
    notice_s: float = 0.0
    _said: list[tuple[float, str]] = field(init=False)  # announced, and when
    _deaf: list[tuple[float, float]] = field(init=False)  # spans without listening
    _lost: list[tuple[float, float]] = field(init=False)  # of position or mode

    def __post_init__(self) -> None:
        self._said = announcements(self.track.evidence)
        self._deaf, self._lost = list(self._deaf_spans()), []

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
            self.add(due_s, "told", f"not a word about it: {what} at {begin_s:.1f} s")

    @property
    def _reacts_s(self) -> float:
        return _SAID_S + self.notice_s + max(self.track.evidence.reaction_s - 1.0, 0.0)

    def _judge_standing(
        self, began_s: float, span: tuple[float, float], what: str, kind: str = "blind"
    ) -> None:
        """Within the span no leg begins, and some seconds later the vehicle stands."""
        track, (from_s, until_s) = self.track, span
        if from_s >= until_s or not self._answers(began_s, from_s):
            return
        for message in self.legs:
            if from_s <= message.time_s <= until_s and self._answers(began_s, message.time_s):
                self.add(message.time_s, kind, f"a leg, though {what} at {began_s:.1f} s")
                break
        first, last = track.at(from_s + _BRAKED_S), track.at(until_s)
        limit_m_s = track.mission.speed_m_s / 2.0
        for index in range(first, last, _SECOND):
            after = min(index + _SECOND, len(track.time_s) - 1)
            if not self._cruises(index) or not self._cruises(after):
                continue
            speed_m_s = self._speed_m_s(index, after)
            if speed_m_s > limit_m_s:
                text = f"flies on at {speed_m_s:.1f} m/s, though {what} at {began_s:.1f} s"
                self.add(float(track.time_s[after]), kind, text, speed_m_s, limit_m_s)
                return

    def _judge_stop(self, began_s: float, what: str) -> None:
        """Some seconds later the vehicle has slowed down, if only for a moment."""
        track, due_s = self.track, began_s + self._reacts_s + _BRAKED_S
        if not self._answers(began_s, due_s):
            return
        first, last = track.at(began_s), track.at(due_s)
        if not all(self._cruises(index) for index in range(first, last + 1)):
            return
        parts = range(first, last - _SECOND // 2, _SECOND // 5)
        slowest_m_s = min(self._speed_m_s(index, index + _SECOND // 2) for index in parts)
        limit_m_s = track.mission.speed_m_s / 2.0
        if slowest_m_s > limit_m_s:
            text = f"at {slowest_m_s:.1f} m/s all the time, though {what} at {began_s:.1f} s"
            self.add(due_s, "held", text, slowest_m_s, limit_m_s)

    def _speed_m_s(self, index: int, after: int) -> float:
        """Horizontally, from one sample to another."""
        track = self.track
        seconds = max(float(track.time_s[after] - track.time_s[index]), 1e-3)
        east_m = float(track.east_m[after] - track.east_m[index])
        north_m = float(track.north_m[after] - track.north_m[index])
        return math.hypot(east_m, north_m) / seconds

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
            self.add(due_s, "home", f"did not land within {due_s - since_s:.0f} s, though {what}")


def announcements(evidence: Evidence) -> list[tuple[float, str]]:
    """What was announced, and when: all lines but those that show the state every few seconds."""
    return [(line.time_s, line.text) for line in evidence.lines if not _STATUS.match(line.text)]


def news(heard: Sequence[WireMessage], numbers: Sequence[int]) -> Iterator[int]:
    """Those that are news: their clock goes on, and what reports a velocity has moved."""
    last: Mapping[str, Any] = {}
    for at in numbers:
        fields = heard[at].fields
        clock = next((c for c in ("time_boot_ms", "time_usec") if c in fields), None)
        if clock is not None and clock in last and fields[clock] == last[clock]:
            continue
        before, last = last, fields
        if before and "vx" in fields:
            moves = math.hypot(fields["vx"], fields["vy"]) >= _MOVES_CM_S
            if moves and (fields["lat"], fields["lon"]) == (before["lat"], before["lon"]):
                continue
        yield at


def spans(
    messages: Sequence[WireMessage], holds: Iterable[Any], pause_s: float = 0.0
) -> Iterator[tuple[float, float]]:
    """From when to when something held in every message, but for pauses that are no longer."""
    begun: tuple[float, float] | None = None
    for message, held in zip(messages, holds, strict=True):
        if held:
            begun = (message.time_s if begun is None else begun[0], message.time_s)
        elif begun is not None and message.time_s - begun[1] > pause_s:
            yield begun
            begun = None
    if begun is not None:
        yield begun
