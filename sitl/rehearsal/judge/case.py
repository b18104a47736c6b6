"""A flight as the judge's rules see it: track, responsibility, announcements, messages."""

from __future__ import annotations

import bisect
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sitl.rehearsal.judge.acceptance import accepted
from sitl.rehearsal.judge.evidence import (
    COMPANION,
    LAND,
    Evidence,
    EvidenceError,
    SceneEvent,
    SceneEventKind,
    WireMessage,
    choice_received_s,
    command_of,
    is_motion,
    shown_by_target_only,
    target_of,
    uploads_of,
    was_to_land,
)
from sitl.rehearsal.judge.mission_reader import Pair, RawMission, read_mission

Floats = npt.NDArray[np.float64]

LAND_MODE: Final = 0x06040000  # HEARTBEAT.custom_mode of AUTO, LAND

_SETTLES_S: Final = 8.0
"""For so long an estimate that was wrong is still being corrected."""

_GIVEN_BACK_IN: Final = frozenset({0x03040000, 0x04040000})
"""HEARTBEAT.custom_mode of AUTO, LOITER and MISSION: in another the pilot still flies it."""

_RESUMING: Final = frozenset({"resume", "home", "goto", "seek", "explore"})
"""Requests by which an operator gives the vehicle back to the companion."""

_TOO_LOW_M, _TOO_HIGH_M = 2.0, 1.0
"""How wrong a vehicle may be about its height: at the plan's altitudes, and in a layer."""

_CROSSES_S: Final = 0.05
"""A message is on its way to the vehicle for so long at most, on a link in order."""

_SHOWS_S: Final = 2.0
"""A mode that was chosen, and not refused, shows within that time."""

_RECEIVED_S, _HEEDED_S = 2.0, 0.5
"""So long it may take until the companion receives another item or target, at most; one that it
received so long ago is known to it, whatever else is going on."""

_ANNOUNCED_S: Final = 3.0
"""What the companion has on top of each limit to announce something."""

_SETTLED_S: Final = 8.0
"""A companion that was started has so long to connect."""

_ANSWERED_S: Final = 1.0
_LANDS_HERE: Final = ": accepted: it lands where it hovers"
_STATUS: Final = re.compile(r"^[A-Z_]+ *\|")
_STATE: Final = re.compile(r"\b[A-Z_]+ -> ([A-Z_]+)$")
_DOUBTED: Final = re.compile(
    r"coming home: the altitude is in doubt|the altitude is in doubt: .*(: holding|cannot)"
)
_TRUSTED: Final = "coming home, clear of zones by PX4's altitude alone"
_LABEL: Final = re.compile(r"^( *[0-9.]+ s  )?(WARNING|ALARM): ")
_INSTRUCTION: Final = re.compile(r"\. ((?:Pilot|Operator): .+)$")
"""How a warning or alarm begins, and the instruction at its end."""


class Responsible(StrEnum):
    """Who is responsible for the vehicle's position."""

    OURS = "ours"
    AUTOPILOT = "the autopilot's"
    PILOT = "the pilot's"


@dataclass(frozen=True, slots=True)
class Violation:
    """Something that must not be.

    Attributes:
        time_s: When it was worst, or was done.
        kind: Its name in the table.
        text: What, with the numbers.
    """

    time_s: float
    kind: str
    text: str

    def __str__(self) -> str:
        return f"{self.time_s:.1f} s: {self.kind}: {self.text}"


class Announced(NamedTuple):
    """A line of the companion: its time, severity label, text and instruction.

    The label and the instruction are empty where a line has none.
    """

    time_s: float
    label: str
    text: str
    instruction: str

    @classmethod
    def of(cls, time_s: float, line: str) -> Announced:
        """Split a line of the terminal."""
        found = _LABEL.match(line)
        text = line if found is None else (found[1] or "") + line[found.end() :]
        request = _INSTRUCTION.search(text)
        if request is None:
            return cls(time_s, found[2] if found else "", text, "")
        return cls(time_s, found[2] if found else "", text[: request.start()], request[1])


class Given(NamedTuple):
    """A time in which the vehicle is not ours, whose it is, and from when we may hold it."""

    begin_s: float
    end_s: float
    by: Responsible
    handed_s: float


@dataclass(frozen=True, slots=True)
class MissionVersion:
    """A mission file, and from when to when it counts."""

    from_s: float
    until_s: float
    mission: RawMission


class Case:
    """What is known of a flight; places are in metres of the first mission file's home.

    Args:
        evidence: Of it.

    Raises:
        EvidenceError: there is no track, a mission file that cannot be read, or an unknown fault.

    Attributes:
        evidence: The same.
        versions: Mission files in order of time; the first from the beginning. While the altitude
            is in doubt, by 6 m as announced, zones count whatever their height.
        mission: The first of them.
        ground_m: Of the ground at home, above mean sea level.
        time_s: Of each sample.
        places: East and north of home, m, of each sample.
        above_m: Above the ground at home.
        flying: Whether it is off the ground.
        armed: Whether its motors may turn.
        lands: Whether it flies in Land mode.
        level: Whether it is at the plan's altitudes, in its own layer.
        off_m: How wrong the estimate is, by the scene.
        commands: What the companion sent to the vehicle.
        announced: What it announced: all lines but those that show its state every few seconds.
        texts: The same with their times, without the instruction to pilot or operator.
        given: A pilot's times, and a failsafe's: until we moved the vehicle again after an
            operator requested it, both in Hold or Mission mode without a failsafe.
        by: Who is responsible in each sample.
        row: What is accepted; a pilot's choice that was refused or came too late is no fault.
        uploads: Plans that the vehicle accepted.
        legs: The commands that lead to a place, and to which.
        landing_place: Where it was when a request to land was accepted; None: never.
    """

    def __init__(self, evidence: Evidence) -> None:
        samples = evidence.samples
        if len(samples) < 2:
            raise EvidenceError("no true track")
        self.evidence = evidence
        self._first_m = samples[0].altitude_amsl_m  # home's AMSL, unless the file has it
        texts = [(-math.inf, evidence.mission_text)]
        texts += [(h.time_s, str(h.value)) for h in evidence.events(SceneEventKind.MISSION_FILE)]
        lines = (line for line in evidence.lines if not _STATUS.match(line.text))
        self.announced = [Announced.of(line.time_s, line.text) for line in lines]
        self.texts = [(each.time_s, each.text) for each in self.announced]
        self.versions = [
            piece
            for (from_s, text), (until_s, _) in pairwise([*texts, (math.inf, "")])
            for piece in self._in_doubt(MissionVersion(from_s, until_s, self.read(text)))
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
        low_m, high_m = min(self.mission.altitudes_m) - _TOO_LOW_M, self.mission.layer_top_m
        self.level = (self.above_m >= low_m) & (self.above_m <= high_m + _TOO_HIGH_M)
        self.off_m = self._estimate_off()
        self.commands = [m for m in evidence.messages if m.component == COMPANION]
        self.given = list(self._given())
        self.by = [self._responsible(sample.time_s) for sample in evidence.samples]
        pilot = any(given.by is Responsible.PILOT for given in self.given)
        self.row = accepted(evidence.faults - (set() if pilot else {"PILOT", "PAUSE"}))
        self.uploads = list(uploads_of(evidence.messages))
        requested_s = [
            at_s for at_s, text in self.texts if _LANDS_HERE in text and self._land_requested(at_s)
        ]
        self.landing_place = self.place(self.at(requested_s[0])) if requested_s else None
        targets = ((m, target_of(m, self.uploads, self.mission.frame)) for m in self.commands)
        self.legs = [(message, to) for message, to in targets if to is not None]

    def read(self, text: str) -> RawMission:
        """The mission of a file. Raises EvidenceError."""
        evidence, flown = self.evidence, None
        if evidence.epoch_s is not None:
            flown = (evidence.epoch_s, evidence.epoch_s + evidence.samples[-1].time_s)
        where = evidence.mission_path, text, evidence.uav, self._first_m
        return read_mission(*where, flown, evidence.map_files)

    def _in_doubt(self, version: MissionVersion) -> Iterator[MissionVersion]:
        """A version, in which zones count whatever their height while the altitude is in doubt.

        That ends where they leave no way home, for the battery or for an operator, and with the
        companion that doubts.
        """
        flat = version.mission.at_every_height
        begin_s = next((at_s for at_s, text in self.texts if _DOUBTED.search(text)), math.inf)
        ends_s = [at_s for at_s, text in self.texts if _TRUSTED in text]
        ends_s += [h.time_s for h in self.evidence.events(SceneEventKind.STARTED)]
        end_s = min((at_s for at_s in ends_s if at_s > begin_s), default=math.inf)
        same = flat.zones == version.mission.zones
        limits_s = [] if same else [at_s for at_s in (begin_s, end_s) if at_s < math.inf]
        within_s = [at_s for at_s in limits_s if version.from_s < at_s < version.until_s]
        for piece in pairwise([version.from_s, *within_s, version.until_s]):
            doubted = not same and begin_s <= piece[0] < end_s
            yield MissionVersion(*piece, flat if doubted else version.mission)

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

    def _land_requested(self, answered_s: float) -> bool:
        """Whether an operator had just requested a landing when the reply came."""
        request = (h for h in self.evidence.events(SceneEventKind.REQUEST) if h.value == "land")
        slack_s = _ANSWERED_S * max(self.evidence.speed, 1.0)
        return any(0.0 <= answered_s - h.time_s <= slack_s for h in request)

    def _estimate_off(self) -> Floats:
        """For each sample; an estimate that comes back is followed by a vehicle that comes back."""
        off = np.zeros(len(self.time_s))
        offs = [
            (h.time_s, float(h.value)) for h in self.evidence.events(SceneEventKind.ESTIMATE_OFF)
        ]
        for (begin_s, off_m), (end_s, _) in pairwise([*offs, (math.inf, 0.0)]):
            span = (self.time_s >= begin_s) & (self.time_s < end_s + _SETTLES_S)
            off[span] = np.maximum(off[span], off_m)
        return off

    # Responsibility.

    def _given(self) -> Iterator[Given]:
        events = self.evidence.events
        takings = [
            (h.time_s, Responsible.PILOT)
            for h in events(SceneEventKind.PILOT, SceneEventKind.DISARMED)
            if self._shows(h)
        ]
        takings += [(h.time_s, Responsible.AUTOPILOT) for h in events(SceneEventKind.REBOOTED)]
        samples = self.evidence.samples
        acted = [False, *(sample.failsafe for sample in samples)]  # of the sample before
        takings += [
            (sample.time_s, Responsible.AUTOPILOT)
            for sample, before in zip(samples, acted, strict=False)
            if sample.failsafe and not before
        ]
        # A companion that is started anew may go on with the plan that is its own, and no other.
        replaced = {h.time_s for h in events(SceneEventKind.PILOT) if h.value == "plan"}
        last: dict[Responsible, float] = {}
        for begin_s, by in sorted(takings):
            if begin_s >= last.get(by, -math.inf):
                back_s = self._given_back_s(begin_s, restarted=begin_s not in replaced)
                handed_s, flies_s = self._handed_over_s(begin_s)
                last[by] = min(back_s, flies_s)
                yield Given(begin_s, last[by], by, handed_s)

    def _shows(self, taking: SceneEvent) -> bool:
        """Whether anything changed: of two choices at once the second may undo the first.

        So may a command of ours that leaves before another item or target could be received. And no
        other plan takes a vehicle that is to land by then: a landing needs none.
        """
        if shown_by_target_only(taking):
            known_s = self._known_s(taking)
            ours = (m.time_s for m in self.commands if is_motion(m) and m.delivered)
            return not any(taking.time_s <= time_s < known_s for time_s in ours)
        if taking.value == "plan":
            known_s = self._known_s(taking) if self.evidence.received else taking.time_s
            return not was_to_land(self.commands, known_s)
        if not str(taking.value).isupper():
            return True  # the sticks
        if taking.value == "AUTO_LAND" and any(
            command_of(m) == LAND and abs(m.time_s - taking.time_s) < _CROSSES_S
            for m in self.commands
        ):
            return False  # two landings on their way at once cannot be distinguished
        samples = self.evidence.samples
        before = samples[max(self.at(taking.time_s) - 1, 0)].custom_mode
        after = samples[self.at(taking.time_s) : self.at(taking.time_s + _SHOWS_S) + 1]
        return any(sample.custom_mode != before for sample in after)

    def _known_s(self, taking: SceneEvent) -> float:
        """By when the companion knows of another item, place or plan."""
        received_s = choice_received_s(self.evidence.received, taking) + _HEEDED_S
        return min(received_s, taking.time_s + _RECEIVED_S)

    def _given_back_s(self, since_s: float, *, restarted: bool) -> float:
        """When we moved it first after an operator had requested that; infinite: never."""
        kinds = {SceneEventKind.REQUEST} | ({SceneEventKind.STARTED} if restarted else set())
        later = (h for h in self.evidence.events(*kinds) if h.time_s > since_s)
        requested_s = next((h.time_s for h in later if self._gives_back(h)), math.inf)
        moved = (m.time_s for m in self.commands if m.time_s >= requested_s and is_motion(m))
        return next((at_s for at_s in moved if self._free(at_s)), math.inf)

    def _handed_over_s(self, since_s: float) -> tuple[float, float]:
        """When a pilot chose Mission mode for us, and when we held it there, or it was level."""
        events = self.evidence.events(SceneEventKind.HANDED_OVER)
        handed_s = next((h.time_s for h in events if h.time_s > since_s), math.inf)
        sent = (m for m in self.commands if m.time_s >= handed_s and m.delivered)
        level = (self.time_s >= handed_s) & self.level
        flies_s = [m.time_s for m in sent if is_motion(m)][:1] + self.time_s[level][:1].tolist()
        return handed_s, min(flies_s, default=math.inf)

    def _gives_back(self, request: SceneEvent) -> bool:
        """Whether by this start, or request, the vehicle is to be the companion's again."""
        resumes = request.what is SceneEventKind.STARTED
        return resumes or (
            str(request.value).split()[0] in _RESUMING and self._free(request.time_s)
        )

    def _free(self, time_s: float) -> bool:
        """Whether the vehicle can be given back: its mode, no failsafe, not near a higher layer."""
        index = self.at(time_s)
        sample = self.evidence.samples[index]
        level = self.above_m[index] <= self.mission.layer_top_m + _TOO_HIGH_M
        return sample.custom_mode in _GIVEN_BACK_IN and not sample.failsafe and bool(level)

    def _responsible(self, time_s: float) -> Responsible:
        holders = [given.by for given in self.given if given.begin_s <= time_s < given.end_s]
        if Responsible.PILOT in holders:
            return Responsible.PILOT
        return Responsible.AUTOPILOT if holders else Responsible.OURS

    # In the companion's seat.

    @cached_property
    def _deaf(self) -> list[tuple[float, float]]:
        """When the companion was not running, or not yet connected."""
        ends = (SceneEventKind.KILLED, SceneEventKind.STOPPED, SceneEventKind.ENDED)
        begins = (SceneEventKind.STARTED, SceneEventKind.CONTINUED)
        found = []
        since_s = -math.inf if any(self.evidence.events(SceneEventKind.STARTED)) else None
        for happening in self.evidence.events(*ends, *begins):
            if happening.what in ends:
                since_s = happening.time_s
            elif since_s is not None:
                found.append((since_s, happening.time_s + _SETTLED_S))
                since_s = None
        return found if since_s is None else [*found, (since_s, math.inf)]

    def could_react(self, begin_s: float, end_s: float, *, ours: bool = True) -> bool:
        """Whether the companion listened, and its vehicle flew, from then to then.

        Args:
            begin_s: From.
            end_s: To.
            ours: The vehicle had to be the companion's, too.
        """
        if any(begin_s < until_s and end_s > from_s for from_s, until_s in self._deaf):
            return False
        first, last = self.at(begin_s), self.at(end_s)
        if end_s > self.time_s[-1] or not self.flying[first : last + 1].all():
            return False
        return not ours or set(self.by[first : last + 1]) <= {Responsible.OURS}

    def cruises(self, index: int) -> bool:
        """Whether it flies, as ours, and does not land."""
        ours = self.by[index] is Responsible.OURS
        return bool(self.flying[index]) and ours and not self.lands[index]

    def state(self, time_s: float) -> str:
        """The mission state that was announced last."""
        found = [m for at_s, text in self.texts if at_s <= time_s and (m := _STATE.search(text))]
        return found[-1].group(1) if found else ""

    def received(self, name: str) -> list[WireMessage]:
        """The messages of a name that reached the companion."""
        return [message for message in self.evidence.received if message.name == name]

    def has_announced(self, pattern: str, begin_s: float, end_s: float) -> bool:
        """Whether a line that matches was announced from then to then."""
        lines = (text for at_s, text in self.texts if begin_s <= at_s <= end_s)
        return any(re.search(pattern, line, re.IGNORECASE) for line in lines)

    @property
    def reacts_s(self) -> float:
        """What it has on top of each limit to announce something in this flight."""
        return _ANNOUNCED_S + self.row.notice_s + max(self.evidence.reaction_s - 1.0, 0.0)


Rule = Callable[[Case], Iterator[Violation]]
"""Sees a flight, and yields what must not be."""
