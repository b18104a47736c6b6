"""The true track of a flight in metres, and who answers for each moment of it."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sitl.rehearsal.judge.evidence import (
    AUTOPILOT,
    COMPANION,
    Evidence,
    SceneEvent,
    SceneEventKind,
    WireMessage,
)
from sitl.rehearsal.judge.mission_reader import RawMission, read_mission

Floats = npt.NDArray[np.float64]

LAND_MODE: Final = 0x06040000
"""HEARTBEAT.custom_mode of AUTO, LAND."""

GIVEN_BACK_IN: Final = frozenset({0x03040000, 0x04040000})
"""HEARTBEAT.custom_mode of AUTO, LOITER and MISSION: in another the pilot still flies it."""

RESUMING: Final = frozenset({"resume", "home", "goto", "seek", "explore"})
"""Requests by which an operator gives the vehicle back to the companion."""

SETTLES_S: Final = 8.0
"""For so long an estimate that was wrong is still being corrected."""

_SHOWS_S: Final = 2.0
"""A mode that was chosen, and not refused, shows within that time."""

_HEARD_S: Final = 2.0
"""So long it may take until the companion hears of another item or place, at most."""

_HEEDED_S: Final = 0.5
"""What has been heard for longer is known, whatever else is going on."""

_TELLS: Final = {
    "item": ("MISSION_CURRENT", ("seq",)),
    "reposition": ("POSITION_TARGET_GLOBAL_INT", ("lat_int", "lon_int")),
}
"""Which message, and which of its fields, tells that the vehicle goes elsewhere."""

_BRAKING_M_S2: Final = 3.0
"""What a PX4 brakes with at its defaults; the flight reckons with less."""

_MOTIONS: Final = frozenset({16, 17, 20, 21, 22, 34, 176, 192, 193, 252, 300})
_MOVING: Final = frozenset({"MISSION_SET_CURRENT", "SET_MODE", "MANUAL_CONTROL"})


class Responsible(StrEnum):
    """Who answers for where the vehicle is."""

    OURS = "ours"
    AUTOPILOT = "the autopilot's"
    PILOT = "the pilot's"


@dataclass(frozen=True, slots=True)
class Violation:
    """Something that must not be.

    Attributes:
        time_s: When it was worst, or was done.
        kind: One word for the table.
        text: What, with the numbers.
        value: The number, if there is one.
        limit: What it should have kept to.
    """

    time_s: float
    kind: str
    text: str
    value: float = math.nan
    limit: float = math.nan

    def __str__(self) -> str:
        return f"{self.time_s:.1f} s: {self.kind}: {self.text}"


@dataclass(frozen=True, slots=True)
class MissionVersion:
    """A mission file and from when on it counts."""

    from_s: float
    mission: RawMission


class Track:
    """The true track in metres of the first mission file's home.

    Args:
        evidence: Of the flight; it has samples.

    Attributes:
        versions: Mission files in order of time; the first from the beginning.
        mission: The first of them.
        ground_m: Of the ground at home, above mean sea level.
        time_s: Of each sample.
        east_m: Of home.
        north_m: Of home.
        above_m: Above the ground at home.
        flying: Whether it is off the ground.
        armed: Whether its motors may turn.
        off_m: How wrong the estimate is, by the scene.
        by: Who answers.
        given: From when to when the vehicle was not ours: a pilot's, a failsafe's; until we moved
            it again after an operator asked for it, both in Hold or Mission mode without a
            failsafe.
    """

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence
        samples = evidence.samples
        first_m = samples[0].altitude_amsl_m
        texts = [(-math.inf, evidence.mission_text)]
        texts += [(h.time_s, str(h.value)) for h in evidence.told(SceneEventKind.MISSION_FILE)]
        self._first_m = first_m  # where the vehicle was started: home's AMSL, unless the file says
        self.versions = [MissionVersion(at_s, self.read(text)) for at_s, text in texts]
        self.mission = self.versions[0].mission
        self.ground_m = first_m
        if self.mission.ground_amsl_m is not None:
            self.ground_m = self.mission.ground_amsl_m
        self.time_s: Floats = np.array([s.time_s for s in samples])
        latitudes, longitudes = (
            np.array([getattr(s, name) for s in samples])
            for name in ("latitude_deg", "longitude_deg")
        )
        self.east_m, self.north_m = self.mission.frame.metres(latitudes, longitudes)
        self.above_m: Floats = np.array([s.altitude_amsl_m for s in samples]) - self.ground_m
        self.flying = np.array([not s.landed for s in samples], dtype=bool)
        self.armed = np.array([s.armed for s in samples], dtype=bool)
        self.off_m = self._estimate_off()
        self.given = list(self._given())
        self.by = [self._answers(s.time_s) for s in samples]

    def read(self, text: str) -> RawMission:
        """The mission of a file. Raises MissionFileError."""
        evidence = self.evidence
        return read_mission(evidence.mission_path, text, evidence.uav, self._first_m)

    def at(self, time_s: float) -> int:
        """The sample that was taken last before."""
        return max(bisect.bisect_right(self.time_s, time_s) - 1, 0)

    def version_at(self, time_s: float) -> MissionVersion:
        """The mission file that counted then."""
        return next(version for version in reversed(self.versions) if version.from_s <= time_s)

    def rest(self, index: int) -> tuple[float, float]:
        """Where it comes to rest, east and north, if it brakes at 3 m/s2 from a sample on."""
        before = max(index - 1, 0)
        seconds = max(float(self.time_s[index] - self.time_s[before]), 1e-3)
        east_m_s = float(self.east_m[index] - self.east_m[before]) / seconds
        north_m_s = float(self.north_m[index] - self.north_m[before]) / seconds
        brakes_s = math.hypot(east_m_s, north_m_s) / (2 * _BRAKING_M_S2)
        return (
            float(self.east_m[index]) + east_m_s * brakes_s,
            float(self.north_m[index]) + north_m_s * brakes_s,
        )

    def from_home_m(self, index: int) -> float:
        """How far a sample is from home, horizontally."""
        return math.hypot(self.east_m[index], self.north_m[index])

    def between_m(self, index: int, other: int) -> float:
        """How far two samples are from each other, horizontally."""
        east_m = self.east_m[other] - self.east_m[index]
        return math.hypot(east_m, self.north_m[other] - self.north_m[index])

    def commands(self) -> Iterator[WireMessage]:
        """What the companion sent to the vehicle."""
        return (m for m in self.evidence.messages if m.component == COMPANION)

    def _estimate_off(self) -> Floats:
        """For each sample; an estimate that comes back is followed by a vehicle that comes back."""
        off = np.zeros(len(self.time_s))
        told = list(self.evidence.told(SceneEventKind.ESTIMATE_OFF))
        for number, happening in enumerate(told):
            end_s = told[number + 1].time_s if number + 1 < len(told) else math.inf
            span = (self.time_s >= happening.time_s) & (self.time_s < end_s + SETTLES_S)
            off[span] = np.maximum(off[span], float(happening.value))
        return off

    def _given(self) -> Iterator[tuple[float, float, Responsible]]:
        takings = [
            (h.time_s, Responsible.PILOT)
            for h in self.evidence.happenings
            if h.what in {SceneEventKind.PILOT, SceneEventKind.DISARMED} and self._shows(h)
        ]
        takings += [
            (h.time_s, Responsible.AUTOPILOT) for h in self.evidence.told(SceneEventKind.REBOOTED)
        ]
        acting = False
        for sample in self.evidence.samples:
            if sample.failsafe and not acting:
                takings.append((sample.time_s, Responsible.AUTOPILOT))
            acting = sample.failsafe
        # A companion that is started anew may go on with the plan that is its own, and no other.
        told = self.evidence.told(SceneEventKind.PILOT)
        replaced = {happening.time_s for happening in told if happening.value == "plan"}
        last: dict[Responsible, float] = {}
        for begin_s, by in sorted(takings):
            if begin_s >= last.get(by, -math.inf):
                last[by] = self._given_back_s(begin_s, restarted=begin_s not in replaced)
                yield begin_s, last[by], by

    def _shows(self, taking: SceneEvent) -> bool:
        """Whether anything changed: of two choices at once the second may undo the first.

        So may a command of ours that leaves before another item or place could be heard of.
        """
        if taking.value in _TELLS:
            known_s = min(self._heard_of_s(taking) + _HEEDED_S, taking.time_s + _HEARD_S)
            ours = (m.time_s for m in self.commands() if is_motion(m))
            return not any(taking.time_s <= time_s < known_s for time_s in ours)
        if not str(taking.value).isupper():
            return True  # no mode: sticks, another plan
        samples = self.evidence.samples
        before = samples[max(self.at(taking.time_s) - 1, 0)].custom_mode
        after = samples[self.at(taking.time_s) : self.at(taking.time_s + _SHOWS_S) + 1]
        return any(sample.custom_mode != before for sample in after)

    def _heard_of_s(self, taking: SceneEvent) -> float:
        """When the companion heard that the vehicle goes elsewhere; infinite: never."""
        name, fields = _TELLS[str(taking.value)]
        told = [
            (message.time_s, [message.fields.get(field) for field in fields])
            for message in self.evidence.heard
            if message.name == name and message.component == AUTOPILOT
        ]
        before = next((to for time_s, to in reversed(told) if time_s < taking.time_s), None)
        later = (time_s for time_s, to in told if time_s >= taking.time_s and to != before)
        return next(later, math.inf)

    def _given_back_s(self, since_s: float, *, restarted: bool) -> float:
        """When we moved it first after an operator had asked for that; infinite: never."""
        asked = [
            h.time_s
            for h in self.evidence.happenings
            if h.time_s > since_s
            if (_resumes(h) and self._free(h.time_s))
            or (restarted and h.what is SceneEventKind.STARTED)
        ]
        if not asked:
            return math.inf
        moved = (m.time_s for m in self.commands() if m.time_s >= asked[0] and is_motion(m))
        return next((at_s for at_s in moved if self._free(at_s)), math.inf)

    def _free(self, time_s: float) -> bool:
        """Whether the vehicle is in a mode, and in no failsafe, that it can be given back in."""
        sample = self.evidence.samples[self.at(time_s)]
        return sample.custom_mode in GIVEN_BACK_IN and not sample.failsafe

    def _answers(self, time_s: float) -> Responsible:
        holders = [by for begin_s, end_s, by in self.given if begin_s <= time_s < end_s]
        if Responsible.PILOT in holders:
            return Responsible.PILOT
        return Responsible.AUTOPILOT if holders else Responsible.OURS


@dataclass(slots=True)
class Judge:
    """Looks at one side of a flight.

    Attributes:
        track: Of the flight.
        violations: Found so far.
    """

    track: Track
    violations: list[Violation] = field(default_factory=list, init=False)

    def add(
        self,
        time_s: float,
        kind: str,
        text: str,
        value: float = math.nan,
        limit: float = math.nan,
    ) -> None:
        """Something that must not be."""
        self.violations.append(Violation(time_s, kind, text, value, limit))


def _resumes(happening: SceneEvent) -> bool:
    return happening.what is SceneEventKind.REQUEST and str(happening.value).split()[0] in RESUMING


def command_of(message: WireMessage) -> int | None:
    """The MAV_CMD of a command; None for other messages."""
    if message.name not in {"COMMAND_LONG", "COMMAND_INT"}:
        return None
    return int(message.fields["command"])


def is_motion(message: WireMessage) -> bool:
    """Whether a message moves the vehicle or chooses its mode."""
    named = message.name in _MOVING or message.name.startswith("SET_POSITION_TARGET")
    return named or command_of(message) in _MOTIONS


def number(fields: Mapping[str, Any], name: str) -> float:
    """A field as a number; what is not there is not a number."""
    value = fields.get(name)
    return math.nan if value is None else float(value)
