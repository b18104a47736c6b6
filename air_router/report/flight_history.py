"""The history of a flight, folded from its recorded events, for a page and for programs.

Times are seconds on the vehicle's clock; positions are meters east and north of the mission's
origin.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final, NamedTuple

from air_router.controller.model import (
    Announce,
    ChangeAltitude,
    CommandAck,
    CommandFailed,
    ControlRequest,
    Finish,
    FlightSetup,
    GoTo,
    MissionWaits,
    RobotPose,
    Seeking,
    SeekNow,
    State,
    StateChanged,
)
from air_router.errors import AirRouterError, ExitCode
from air_router.flight import FlownTrack
from air_router.mission import Mission
from air_router.record import Log, Note, RecordEntry
from air_router.report.link_history import LinkFold, LinkHistory
from air_router.vehicle import REBOOT_S, Telemetry
from mocha_link.links import LinkEvent

TRACK_S: Final = 0.5
"""Interval of the track's points and of their distances to zones and fence."""

BATTERY_STEP: Final = 0.005

_NOTHING: Final = "nothing was recorded that could be shown"
_ABOUT_ROBOTS: Final = frozenset({State.SEARCH, State.COMM})


class NothingFlownError(AirRouterError):
    """The record has nothing that could be shown."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class StateInterval:
    """A time in one state; `robot`: the robot concerned."""

    state: str
    from_s: float  # on the vehicle's clock
    to_s: float
    robot: str | None
    because: str  # the signal that led into it


@dataclass(frozen=True, slots=True)
class RequestRecord:
    """A request and its answer (None: none)."""

    t: float
    what: str  # for people
    by: str  # who requested it
    accepted: bool | None = None
    why: str = ""  # of the answer


@dataclass(frozen=True, slots=True)
class WaitInterval:
    """A time in which one row of `INTERLOCKS` blocked the mission."""

    from_s: float
    to_s: float
    interlock: str
    why: str  # for people


class TrackPoint(NamedTuple):
    """A position of the vehicle."""

    t: float
    east_m: float
    north_m: float
    altitude_m: float


class RobotFix(NamedTuple):
    """A robot's reported position, with its own stamp."""

    t: float  # time of reception, on the vehicle's clock
    east_m: float
    north_m: float
    stamp_s: float


@dataclass(frozen=True, slots=True)
class FlightHistory:
    """One flight.

    Attributes:
        setup: The setup of the flight.
        about: Versions and other facts.
        ending: The fault at the end of the record; None: complete.
        vehicle: The vehicle, from a note of the record.
        mission: The mission with its final zones and fences.
        totals: Duration, distance, clearance and closest approach, as `FlownTrack.totals`.
        closest: Distance and object of the closest approach; None without zones and fence.
        closest_at: Distance and position of the nearest recorded point.
        track: The track while armed.
        distances: (t, meters to the nearest zone or fence) in the air, while it was ours.
        battery: (t, charge 0..1) in the air.
        states: The states, in order.
        waits: The times in which an interlock blocked the mission.
        announcements: (t, severity, text).
        requests: Requests and their answers.
        failures: (t, text): commands that the vehicle did not follow.
        robots: Reported positions of robots, by name.
        painted: (t, known cells of the map).
        links: Contacts, syncs and their data.
        report: The final report; empty: there is none.
        from_s, to_s: Times of the first and the last event.
        finish: The controller's reason for the end.
        unix_offset_s: Unix time at 0.
    """

    setup: FlightSetup
    about: Mapping[str, str]
    ending: str | None
    vehicle: Mapping[str, Any]
    mission: Mission
    totals: Mapping[str, Any]
    closest: tuple[float, str] | None
    closest_at: tuple[float, float, float] | None
    track: tuple[TrackPoint, ...]
    distances: tuple[tuple[float, float], ...]
    battery: tuple[tuple[float, float], ...]
    states: tuple[StateInterval, ...]
    waits: tuple[WaitInterval, ...]
    announcements: tuple[tuple[float, str, str], ...]
    requests: tuple[RequestRecord, ...]
    failures: tuple[tuple[float, str], ...]
    robots: Mapping[str, tuple[RobotFix, ...]]
    painted: tuple[tuple[float, int], ...]
    links: LinkHistory
    report: Mapping[str, Any]
    from_s: float
    to_s: float
    finish: str | None
    unix_offset_s: float | None

    @property
    def outcome(self) -> str:
        """The outcome: of the final report, else the controller's."""
        return str(self.report.get("outcome") or self.finish or "the record ends in flight")

    @property
    def began_unix_s(self) -> float | None:
        """Unix time of the first event; None: unknown."""
        return None if self.unix_offset_s is None else self.unix_offset_s + self.from_s

    def found(self, robot: str) -> int:
        """Number of searches for a robot that found it."""
        return sum(stay.robot == robot and stay.state == State.COMM.name for stay in self.states)

    def as_json(self) -> dict[str, Any]:
        """The history as plain data."""
        return {
            "mission": self.setup.mission.name,
            "uav": self.setup.name,
            "vehicle": self.vehicle,
            "about": self.about,
            "ending": self.ending,
            "outcome": self.outcome,
            "from_s": self.from_s,
            "to_s": self.to_s,
            "began_unix_s": self.began_unix_s,
            **self.totals,
            "states": [asdict(stay) for stay in self.states],
            "waits": [asdict(wait) for wait in self.waits],
            "interactions": self.links.interactions(),
            "robots": {
                name: {"found": self.found(name), **self.links.of(name)}
                for name in self.links.names
            },
            "requests": [asdict(request) for request in self.requests],
            "announcements": [
                {"t": t, "severity": severity, "text": text}
                for t, severity, text in self.announcements
            ],
            "not_followed": [{"t": t, "text": text} for t, text in self.failures],
            "track": [[round(v, 3) for v in row] for row in self.track],
            "distance_to_zones_m": [[round(t, 3), round(d, 2)] for t, d in self.distances],
            "battery": [[round(t, 3), c] for t, c in self.battery],
            "map_cells": [[round(t, 3), cells] for t, cells in self.painted],
            "flight_report": self.report,
        }


def history_of(log: Log) -> FlightHistory:
    """The history of a recorded flight.

    Raises:
        LogError: It is no record of a flight, has another version, or cannot be read.
        NothingFlownError: It contains no flight.
    """
    fold: HistoryFold | None = None
    about: dict[str, str] = {}
    for entry in log:
        if entry.kind == "about":
            about = entry.value
        elif entry.kind == "setup":
            fold = HistoryFold(entry.value, about)
        elif fold is not None:
            fold.take(entry)
    if fold is None:
        raise NothingFlownError(_NOTHING)
    return fold.end(log.ending)


# The fold: takes entries in order, returns a frozen history.


@dataclass(slots=True)
class _Positions:
    """The vehicle's positions, distances and charge."""

    flown: FlownTrack
    track: list[TrackPoint] = field(default_factory=list)
    distances: list[tuple[float, float]] = field(default_factory=list)
    battery: list[tuple[float, float]] = field(default_factory=list)
    # smallest distance to each zone and fence, and its position, by name
    nearest: dict[str, tuple[float, float, float]] = field(default_factory=dict)

    def take(self, t: float, telemetry: Telemetry) -> None:
        charge = telemetry.battery
        if not telemetry.armed or not all(map(math.isfinite, telemetry.position)):
            return
        if (
            charge is not None
            and telemetry.in_air
            and (not self.battery or abs(self.battery[-1][1] - charge) >= BATTERY_STEP)
        ):
            self.battery.append((t, charge))
        place = telemetry.position
        if self.track and t - self.track[-1].t < TRACK_S:
            return
        self.track.append(TrackPoint(t, *place, telemetry.altitude_m))
        if telemetry.in_air and self.flown.ours:
            away_m, what = self.flown.mission.airspace.nearest(place)
            if what:
                self.distances.append((t, away_m))
                self.nearest[what] = min(
                    (away_m, *place), self.nearest.get(what, (math.inf, 0.0, 0.0))
                )


@dataclass(slots=True)
class _Decisions:
    """The controller's decisions and their outcomes."""

    states: list[StateInterval] = field(default_factory=list)
    waits: list[WaitInterval] = field(default_factory=list)
    announcements: list[tuple[float, str, str]] = field(default_factory=list)
    requests: list[RequestRecord] = field(default_factory=list)
    failures: list[tuple[float, str]] = field(default_factory=list)
    finish: str | None = None
    _waiting: bool = False  # the last of `waits` continues
    # indices in `requests` of unanswered ones
    _open: dict[tuple[str, str], int] = field(default_factory=dict)

    def begin(self, state: str, t: float) -> None:
        self.states = [StateInterval(state, t, t, None, "")]

    def restart(self, t: float) -> None:
        """The vehicle has rebooted: the state starts here."""
        self.states = [replace(self.states[-1], from_s=t, to_s=t)]

    def event(self, t: float, event: Any) -> None:
        if isinstance(event, ControlRequest):
            self._open[event.by, event.request_id] = len(self.requests)
            self.requests.append(RequestRecord(t, _request_text(event), event.by))
        elif isinstance(event, CommandFailed):
            self.failures.append((t, f"{type(event.action).__name__}: {event.reason}"))

    def action(self, t: float, action: Any) -> None:
        match action:
            case StateChanged(signal=signal, target=target, robot=robot):
                self._end_state(t)
                about = robot if target in _ABOUT_ROBOTS else None
                self.states.append(StateInterval(target.name, t, t, about, signal.value))
            case MissionWaits():
                self._end_wait(t)
                self._waiting = action.interlock is not None
                if action.interlock is not None:
                    since_s, row, why = action.since_s, action.interlock, action.why
                    self.waits.append(WaitInterval(since_s, t, row, why))
            case Announce():
                self.announcements.append((t, action.severity.value, action.words))
            case Seeking(robot=str() as robot) if self.states:
                # COMM means that the search found its robot.
                self.states[-1] = replace(self.states[-1], robot=robot)
            case CommandAck():
                self._answered(t, action)
            case Finish(why=why):
                self.finish = why

    def end(self, t: float) -> None:
        self._end_state(t)
        self._end_wait(t)

    def _end_state(self, t: float) -> None:
        if self.states:
            self.states[-1] = replace(self.states[-1], to_s=t)

    def _end_wait(self, t: float) -> None:
        if self._waiting:
            self.waits[-1] = replace(self.waits[-1], to_s=t)

    def _answered(self, t: float, answer: CommandAck) -> None:
        place = self._open.pop((answer.by, answer.request_id), None)
        if place is None:
            place = len(self.requests)
            self.requests.append(RequestRecord(t, "", answer.by))
        done = replace(self.requests[place], accepted=answer.accepted, why=answer.why)
        self.requests[place] = done


class HistoryFold:
    """Folds a flight's record into its history.

    Args:
        setup: The setup of the flight.
        about: Versions and other facts.
    """

    def __init__(self, setup: FlightSetup, about: Mapping[str, str]) -> None:
        self._setup, self._about = setup, about
        self._positions = _Positions(FlownTrack(setup.mission))
        self._decisions = _Decisions()
        self._links = LinkFold(setup.name, setup.seek)
        self._robots: dict[str, list[RobotFix]] = {}
        self._painted: list[tuple[float, int]] = []
        self._vehicle: dict[str, Any] = {}
        self._report: dict[str, Any] = {}
        self._from_s = self._to_s = math.nan  # of the events
        self._unix_offset_s: float | None = None

    def take(self, entry: RecordEntry) -> None:
        """Handle the next entry."""
        flown = self._positions.flown
        match entry.kind:
            case "note":
                self._note(entry.t, entry.value)
            case "event":
                self._clock(entry.t)
                flown.event(entry.value, entry.t)
                self._event(entry.t, entry.value)
            case "action":
                flown.action(entry.value)
                self._decisions.action(entry.t, entry.value)

    def end(self, ending: str | None) -> FlightHistory:
        """Finish the history; `ending`: the fault at the end of the record.

        Raises:
            NothingFlownError: There was no event.
        """
        if math.isnan(self._to_s):
            raise NothingFlownError(_NOTHING)
        where, decided, flown = self._positions, self._decisions, self._positions.flown
        decided.end(self._to_s)
        closest = flown.closest_approach()
        return FlightHistory(
            setup=self._setup,
            about=self._about,
            ending=ending,
            vehicle=self._vehicle,
            mission=flown.mission,
            totals=flown.totals(closest),
            closest=closest,
            closest_at=None if closest is None else where.nearest.get(closest[1]),
            track=tuple(where.track),
            distances=tuple(where.distances),
            battery=tuple(where.battery),
            states=tuple(decided.states),
            waits=tuple(decided.waits),
            announcements=tuple(decided.announcements),
            requests=tuple(decided.requests),
            failures=tuple(decided.failures),
            robots={name: tuple(fixes) for name, fixes in self._robots.items()},
            painted=tuple(self._painted),
            links=self._links.end(self._to_s, self._painted),
            report=self._report,
            from_s=self._from_s,
            to_s=self._to_s,
            finish=decided.finish,
            unix_offset_s=self._unix_offset_s,
        )

    def _clock(self, t: float) -> None:
        if math.isnan(self._from_s):
            self._from_s = t
            self._decisions.begin(State.READY.name, t)
        elif t < self._to_s - REBOOT_S and self._positions.flown.armed_s is None:
            self._from_s = self._to_s = t  # the vehicle has rebooted before take-off
            self._decisions.restart(t)
            self._unix_offset_s = None
        self._to_s = max(t, self._from_s)

    def _note(self, t: float, note: Note) -> None:
        fields = note.fields
        match note.name:
            case "Vehicle":
                self._vehicle = fields
            case "Report":
                self._report = fields
            case "Map":
                self._painted.append((t, int(fields["known_cells"])))
            case "MapPublished":
                self._links.published.append((t, int(fields["known_cells"])))
            case "Held":
                self._links.holds(t, fields["peer"], fields["held"])
            case "Clock" if self._unix_offset_s is None:
                self._unix_offset_s = float(fields["unix_s"]) - t

    def _event(self, t: float, event: Any) -> None:
        if isinstance(event, Telemetry):
            self._positions.take(t, event)
        elif isinstance(event, LinkEvent):
            self._links.take(t, event)
        elif isinstance(event, RobotPose):
            fix = RobotFix(t, *event.position, event.stamp_s)
            self._robots.setdefault(event.robot, []).append(fix)
        else:
            self._decisions.event(t, event)


def _request_text(event: ControlRequest) -> str:
    match event:
        case SeekNow(robot=robot):
            return f"seek {robot}"
        case GoTo(points=points):
            places = ", ".join(f"{p.east_m:.0f} m east {p.north_m:.0f} m north" for p in points)
            return f"go to {places}"
        case ChangeAltitude(altitude_m=altitude_m):
            return f"hold at {altitude_m:g} m"
    texts = {"HoldNow": "hold", "GoOn": "resume", "ExploreNow": "explore", "ComeHome": "home"}
    texts |= {"LandNow": "land here", "Reload": "reload the mission file"}
    return texts.get(type(event).__name__, type(event).__name__)
