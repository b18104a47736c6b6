"""The judge in the companion's seat: what it was told, and whether that was said and acted on.

Works on the messages as they reached the companion, and on nothing else of the link. Of each kind
of news this module knows how long the companion has to announce it, to stand still and to come
home; the limits are those of docs/vehicle.md with some seconds on top.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely

from sitl.rehearsal.judge.evidence import COMPANION, SceneEventKind, WireMessage
from sitl.rehearsal.judge.judge_seat import (
    INPUTS,
    CompanionsSeat,
    Input,
    news,
    spans,
)
from sitl.rehearsal.judge.judge_space import areas_in_force, same_area
from sitl.rehearsal.judge.judge_track import Floats, MissionVersion, number
from sitl.rehearsal.judge.mission_reader import Area, MissionFileError

_EARLY: Final = 0.9
"""So early of its time it may come home: it measures how fast simulated time runs."""

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

_SHORT_M, _SHORT_S = 1.0, 1.0
"""So much of a clearance has to be missing, for so long, that it must be noticed."""

_BACK_S: Final = 15.0
"""What a vehicle has to leave the place where a pilot gave it back."""

_HOME_UP_M: Final = 3.0
"""A home that is moved up or down by so much changes what the plan's heights mean."""

_JUMP_M, _CLIMB_M_S = 4.0, 6.0
_ANNOUNCED: Final = re.compile(
    r" *[0-9.]+ s  (?!nothing heard|.*: (?:accepted|refused): |[A-Z]+ -> )(.+)"
)
_SENT, _SENT_S = 24, 1.0
"""So many letters of it are looked for, and so far from the line in time."""

_NOT_TAKEN: Final = re.compile("(refused|not (reloaded|changed)): (?!.*as they were)")
_CRUISE: Final = frozenset({"INIT", "SEARCH", "COMM", "EXPL", "HOME"})
_LEVEL: Final = _CRUISE | {"GOTO", "HOLD"}
_ENDING: Final = frozenset({"HOME", "LAND", "PASSIVE", "DONE"})


class InputJudge(CompanionsSeat):
    """Judges what the companion made of what it heard."""

    _times: list[float]  # of all that was heard
    _clock: Floats  # the same, without the pauses of all streams together

    def judge(self) -> None:
        """Listen to the whole flight; where it was not written down there is nothing to judge."""
        heard = self.track.evidence.heard
        if not heard:
            return
        self._times = [m.time_s for m in heard]
        steps = np.diff(np.array([self._times[0], *self._times]))
        self._clock = np.cumsum(np.minimum(steps, _LONELY_S))
        self._judge_silence()
        self._judge_files_left()
        self._judge_announcements()
        for each in INPUTS:
            self._judge_stream(each, [n for n, m in enumerate(heard) if m.name in each.messages])
        positions = [m for m in heard if m.name == "GLOBAL_POSITION_INT"]
        self._judge_fix([m for m in heard if m.name == "GPS_RAW_INT"])
        self._judge_charge([m for m in heard if m.name == "SYS_STATUS"])
        self._judge_failsafe([m for m in heard if m.name == "HEARTBEAT"])
        self._judge_breaches(positions)
        self._judge_heights(positions)
        self._judge_home_moved()

    def _judge_announcements(self) -> None:
        """What the operator is told, the pilot reads in the ground station as well."""
        texts = [
            (m.time_s, str(m.fields["text"]))
            for m in self.track.evidence.messages
            if m.name == "STATUSTEXT" and m.component == COMPANION
        ]
        for at_s, line in self._said:
            announced = _ANNOUNCED.match(line)
            if announced is None or not self._answers(at_s, at_s + _SENT_S, ours=False):
                continue
            sent = "".join(text for sent_s, text in texts if abs(sent_s - at_s) <= _SENT_S)
            if announced[1][:_SENT] not in sent:
                self.add(at_s, "told", f"'{announced[1]}' was not sent to the ground station")
                return

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
                self.add(left.time_s, "told", f"not a word why {what}")

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
            places = np.column_stack((east_m, north_m))
            for area, fence in areas_in_force(version):
                level = counts & (amsl_m >= area.lower_m) & (amsl_m <= area.upper_m)
                deep_m = _depths_m(area, places, fence=fence)
                short = level & (-deep_m < area.clearance_m - _SHORT_M)
                self._judge_room(version, area, list(spans(messages, short)))
                for begin_s, end_s in spans(messages, level & (deep_m > _BREACH_M)):
                    due_s = begin_s + _BREACH_S + self._reacts_s
                    drawn = (
                        begin_s < version.from_s + _LEAVES_S
                    )  # over it: it leaves, and says that
                    lasts = end_s - begin_s >= _BREACH_S and not drawn
                    if lasts and self._answers(begin_s, due_s, ours=False):
                        what = f"a breach of {area.name}"
                        self._expect("breach|too near", begin_s, due_s, what, _NEARS_S)

    def _judge_room(
        self, version: MissionVersion, area: Area, too_near: Sequence[tuple[float, float]]
    ) -> None:
        """By its own report it was nearer to a zone or fence than it may be, in cruise."""
        for begin_s, end_s in too_near:
            if end_s - begin_s < _SHORT_S or self._state(begin_s) not in _LEVEL:
                continue
            appears = begin_s < version.from_s + _LEAVES_S
            given = any(from_s < begin_s < to_s + _BACK_S for from_s, to_s, _ in self.track.given)
            due_s = begin_s + 2 * _SHORT_S + self.notice_s + self.track.evidence.reaction_s
            if appears or given or not self._answers(begin_s, due_s):
                continue
            what = f"it came too near to {area.name}"
            self._expect("breach|too near", begin_s, due_s, what, _NEARS_S)
            self._judge_stop(begin_s, what)

    def _judge_home_moved(self) -> None:
        """By a station, up or down."""
        before_m = self.track.ground_m
        for moved in self.track.evidence.told(SceneEventKind.HOME_MOVED):
            up_m, before_m = moved.value[2] - before_m, moved.value[2]
            if abs(up_m) >= _HOME_UP_M and self._state(moved.time_s) in _CRUISE:
                self._judge_stop(moved.time_s, f"home was moved by {up_m:.0f} m up or down")

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
                self._judge_stop(begin_s, what)


def _is_among(area: Area, version: MissionVersion) -> bool:
    return any(same_area(area, other) for other, _ in areas_in_force(version))


def _depths_m(area: Area, places: Floats, *, fence: bool) -> Floats:
    """How deep each place is in a zone, or outside of a fence; negative: how far from there."""
    points = shapely.points(places)
    if area.radius_m:
        beyond_m = shapely.distance(area.outline, points) - area.radius_m
    else:
        border_m = shapely.distance(shapely.boundary(area.outline), points)
        beyond_m = np.where(shapely.intersects(area.outline, points), -border_m, border_m)
    return np.asarray(beyond_m if fence else -beyond_m)
