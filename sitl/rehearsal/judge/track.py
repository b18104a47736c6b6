"""The true track of a flight in metres of home, and the mission files that counted for it."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from sitl.rehearsal.judge.evidence import Evidence, EvidenceError, SceneEventKind
from sitl.rehearsal.judge.mission_reader import Pair, RawMission, read_mission

Floats = npt.NDArray[np.float64]

LAND_MODE: Final = 0x06040000
"""HEARTBEAT.custom_mode of AUTO, LAND."""

_SETTLES_S: Final = 8.0
"""For so long an estimate that was wrong is still being corrected."""

_BRAKING_M_S2: Final = 3.0
"""What a PX4 brakes with at its defaults; the flight reckons with less."""


@dataclass(frozen=True, slots=True)
class MissionVersion:
    """A mission file, and from when to when it counts."""

    from_s: float
    until_s: float
    mission: RawMission


class Track:
    """The true track in metres of the first mission file's home.

    Args:
        evidence: Of the flight.

    Raises:
        EvidenceError: there is no track, or a mission file that cannot be read.

    Attributes:
        evidence: The same.
        versions: Mission files in order of time; the first from the beginning.
        mission: The first of them.
        ground_m: Of the ground at home, above mean sea level.
        time_s: Of each sample.
        places: East and north of home, m, of each sample.
        above_m: Above the ground at home.
        flying: Whether it is off the ground.
        armed: Whether its motors may turn.
        lands: Whether it flies in Land mode.
        off_m: How wrong the estimate is, by the scene.
    """

    def __init__(self, evidence: Evidence) -> None:
        samples = evidence.samples
        if len(samples) < 2:
            raise EvidenceError("no true track")
        self.evidence = evidence
        self._first_m = samples[0].altitude_amsl_m  # home's AMSL, unless the file says
        texts = [(-math.inf, evidence.mission_text)]
        texts += [(h.time_s, str(h.value)) for h in evidence.told(SceneEventKind.MISSION_FILE)]
        self.versions = [
            MissionVersion(from_s, until_s, self.read(text))
            for (from_s, text), (until_s, _) in pairwise([*texts, (math.inf, "")])
        ]
        self.mission = self.versions[0].mission
        stated_m = self.mission.ground_amsl_m
        self.ground_m = self._first_m if stated_m is None else stated_m
        columns = zip(*((s.time_s, s.latitude_deg, s.longitude_deg) for s in samples), strict=True)
        self.time_s, latitudes, longitudes = map(np.array, columns)
        self.places: Floats = np.column_stack(self.mission.frame.metres(latitudes, longitudes))
        self.above_m: Floats = np.array([s.altitude_amsl_m for s in samples]) - self.ground_m
        self.flying = np.array([not s.landed for s in samples], dtype=bool)
        self.armed = np.array([s.armed for s in samples], dtype=bool)
        self.lands = np.array([s.custom_mode == LAND_MODE for s in samples], dtype=bool)
        self.off_m = self._estimate_off()

    def read(self, text: str) -> RawMission:
        """The mission of a file. Raises EvidenceError."""
        evidence = self.evidence
        return read_mission(evidence.mission_path, text, evidence.uav, self._first_m)

    def at(self, time_s: float) -> int:
        """The sample that was taken last before."""
        return max(bisect.bisect_right(self.time_s, time_s) - 1, 0)

    def version_at(self, time_s: float) -> MissionVersion:
        """The mission file that counted then."""
        return next(version for version in self.versions if time_s < version.until_s)

    def place(self, index: int) -> Pair:
        """East and north of home at a sample, m."""
        return float(self.places[index, 0]), float(self.places[index, 1])

    def from_home_m(self, index: int) -> float:
        """How far a sample is from home, horizontally."""
        return math.hypot(*self.place(index))

    def speed_m_s(self, index: int, after: int) -> float:
        """Horizontally, from one sample to another."""
        seconds = max(float(self.time_s[after] - self.time_s[index]), 1e-3)
        return math.dist(self.place(index), self.place(after)) / seconds

    def rest(self, index: int) -> Pair:
        """Where it comes to rest, east and north, if it brakes at 3 m/s2 from a sample on."""
        before = max(index - 1, 0)
        seconds = max(float(self.time_s[index] - self.time_s[before]), 1e-3)
        share = self.speed_m_s(before, index) / (2 * _BRAKING_M_S2) / seconds
        (east_m, north_m), (east_before_m, north_before_m) = self.place(index), self.place(before)
        return (
            east_m + share * (east_m - east_before_m),
            north_m + share * (north_m - north_before_m),
        )

    def _estimate_off(self) -> Floats:
        """For each sample; an estimate that comes back is followed by a vehicle that comes back."""
        off = np.zeros(len(self.time_s))
        told = [(h.time_s, float(h.value)) for h in self.evidence.told(SceneEventKind.ESTIMATE_OFF)]
        for (begin_s, off_m), (end_s, _) in pairwise([*told, (math.inf, 0.0)]):
            span = (self.time_s >= begin_s) & (self.time_s < end_s + _SETTLES_S)
            off[span] = np.maximum(off[span], off_m)
        return off
