"""What happened in a flight, added up from its record: plain data for a page and for programs.

Times are seconds on the vehicle's clock since the record began to know it; positions metres east
and north of the mission's origin.
"""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

from air_router.controller.model import (
    Announce,
    Asked,
    ChangeAltitude,
    CommandAck,
    CommandFailed,
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
from air_router.record import Note, RecordEntry
from air_router.report.exchanges import Exchanges
from air_router.vehicle import REBOOT_S, Telemetry
from mocha_link.links import LinkEvent

TRACK_S: Final = 0.5
"""So often the track has a point, and its distance to zones and fence is looked at."""

BATTERY_STEP: Final = 0.005

_NOTHING: Final = "nothing was recorded that could be shown"
_ABOUT_ROBOTS: Final = frozenset({State.SEARCH, State.COMM})


class NothingFlownError(AirRouterError):
    """A record with nothing in it that could be shown."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(slots=True)
class StateInterval:
    """A time in one state; `robot` is whom it is about."""

    state: str
    from_s: float  # on the vehicle's clock
    to_s: float
    robot: str | None
    because: str  # the signal that led into it


@dataclass(slots=True)
class RequestRecord:
    """A request, and the answer (None: none)."""

    t: float
    what: str  # in words
    by: str  # who asked
    accepted: bool | None = None
    why: str = ""  # of the answer


@dataclass(slots=True)
class WaitInterval:
    """A time in which one row of `INTERLOCKS` kept the mission waiting."""

    from_s: float
    to_s: float
    interlock: str
    why: str  # in words


@dataclass(slots=True)
class FlightSummary:
    """One flight.

    Attributes:
        setup: What was flown.
        about: Versions and the like.
        flown: Where, how far and how near to what; with the mission's zones at the end.
        ending: What is wrong with the end of the record; None if it is whole.
        track: (t, east_m, north_m, altitude_m) while it was armed.
        distances: (t, metres to the nearest zone or fence) in the air, while it was ours.
        battery: (t, charge 0..1) in the air.
        states: One after the other.
        waits: What kept the mission waiting, and when.
        announcements: (t, severity, text).
        requests: Requests and their answers.
        failures: (t, text): commands that the vehicle did not follow.
        robots: Where robots were heard: name -> (t, east_m, north_m, stamp_s).
        painted: (t, cells of the map that are known).
        exchanges: What went over the links.
        report: The report at the end; empty if there is none.
    """

    setup: FlightSetup
    about: dict[str, str]
    flown: FlownTrack = field(init=False)
    ending: str | None = None
    vehicle: dict[str, Any] = field(default_factory=dict)  # who answered: a note of the record
    track: list[tuple[float, float, float, float]] = field(default_factory=list)
    distances: list[tuple[float, float]] = field(default_factory=list)
    battery: list[tuple[float, float]] = field(default_factory=list)
    states: list[StateInterval] = field(default_factory=list)
    waits: list[WaitInterval] = field(default_factory=list)
    announcements: list[tuple[float, str, str]] = field(default_factory=list)
    closest: tuple[float, str] | None = field(default=None, init=False)  # metres, what to
    requests: list[RequestRecord] = field(default_factory=list)
    failures: list[tuple[float, str]] = field(default_factory=list)
    robots: dict[str, list[tuple[float, float, float, float]]] = field(default_factory=dict)
    painted: list[tuple[float, int]] = field(default_factory=list)
    exchanges: Exchanges = field(default_factory=Exchanges)
    report: dict[str, Any] = field(default_factory=dict)
    closest_at: tuple[float, float, float] | None = None  # metres, place
    from_s: float = math.nan  # time of the first event
    to_s: float = math.nan  # time of the last event
    finish: str | None = None  # as the controller said
    unix_offset_s: float | None = None  # Unix time at 0
    _waits: bool = False  # the last of `waits` goes on
    _open: dict[tuple[str, str], RequestRecord] = field(default_factory=dict)  # not answered yet

    def __post_init__(self) -> None:
        self.flown = FlownTrack(self.setup.mission)
        self.exchanges.own, self.exchanges.sought = self.setup.name, self.setup.seek

    def take(self, entry: RecordEntry) -> None:
        """Take in what is recorded next."""
        match entry.kind:
            case "note":
                self._note(entry.t, entry.value)
            case "event":
                self._seen(entry.t)
                self.flown.event(entry.value, entry.t)
                self._event(entry.t, entry.value)
            case "action":
                self.flown.action(entry.value)
                self._action(entry.t, entry.value)

    def end(self, ending: str | None) -> None:
        """There is no more.

        Raises:
            NothingFlownError: there was nothing.
        """
        if math.isnan(self.to_s):
            raise NothingFlownError(_NOTHING)
        self.ending = ending
        self.states[-1].to_s = self.to_s
        if self._waits:
            self.waits[-1].to_s = self.to_s
        self.exchanges.end(self.to_s)
        self.closest = self.flown.closest_approach()

    def _seen(self, t: float) -> None:
        if math.isnan(self.from_s):
            self.from_s = t
            self.states = [StateInterval(State.READY.name, t, t, None, "")]
        elif t < self.to_s - REBOOT_S and self.flown.armed_s is None:
            self.from_s = self.to_s = t  # the vehicle has rebooted before take-off
            self.states = [replace(self.states[-1], from_s=t, to_s=t)]
            self.unix_offset_s = None
        self.to_s = max(t, self.from_s)

    def _note(self, t: float, note: Note) -> None:
        fields = note.fields
        match note.name:
            case "Vehicle":
                self.vehicle = fields
            case "Report":
                self.report = fields
            case "Map":
                self.painted.append((t, int(fields["known_cells"])))
            case "MapPublished":
                self.exchanges.published.append((t, int(fields["known_cells"])))
            case "Held":
                self.exchanges.holds(t, fields["peer"], fields["held"])
            case "Clock" if self.unix_offset_s is None:
                self.unix_offset_s = float(fields["unix_s"]) - t

    def _event(self, t: float, event: Any) -> None:
        if isinstance(event, Telemetry):
            self._telemetry(t, event)
        elif isinstance(event, LinkEvent):
            self.exchanges.take(t, event)
        elif isinstance(event, RobotPose):
            self.robots.setdefault(event.robot, []).append((t, *event.position, event.stamp_s))
        elif isinstance(event, Asked):
            request = RequestRecord(t, _request_words(event), event.by)
            self._open[event.by, event.request_id] = request
            self.requests.append(request)
        elif isinstance(event, CommandFailed):
            self.failures.append((t, f"{type(event.action).__name__}: {event.reason}"))

    def _telemetry(self, t: float, telemetry: Telemetry) -> None:
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
        if self.track and t - self.track[-1][0] < TRACK_S:
            return
        self.track.append((t, *place, telemetry.altitude_m))
        if telemetry.in_air and self.flown.ours:
            away_m, what = self.flown.mission.airspace.nearest(place)
            if what:
                self.distances.append((t, away_m))
                if self.closest_at is None or away_m < self.closest_at[0]:
                    self.closest_at = (away_m, *place)

    def _action(self, t: float, action: Any) -> None:
        match action:
            case StateChanged(signal=signal, target=target, robot=robot):
                for stay in self.states[-1:]:
                    stay.to_s = t
                about = robot if target in _ABOUT_ROBOTS else None
                self.states.append(StateInterval(target.name, t, t, about, signal.value))
            case MissionWaits():
                self._waited(t, action)
            case Announce():
                self.announcements.append((t, action.severity.value, action.words))
            case Seeking(robot=str() as robot) if self.states:
                self.states[-1].robot = robot  # a search finds its robot once entered
            case CommandAck():
                self._answered(t, action)
            case Finish(why=why):
                self.finish = why

    def _waited(self, t: float, change: MissionWaits) -> None:
        if self._waits:
            self.waits[-1].to_s = t
        self._waits = change.interlock is not None
        if change.interlock is not None:
            self.waits.append(WaitInterval(change.since_s, t, change.interlock, change.why))

    def _answered(self, t: float, answer: CommandAck) -> None:
        request = self._open.pop((answer.by, answer.request_id), None)
        if request is None:
            request = RequestRecord(t, "", answer.by)
            self.requests.append(request)
        request.accepted, request.why = answer.accepted, answer.why

    @property
    def mission(self) -> Mission:
        """With the zones and fences that it had at the end."""
        return self.flown.mission

    def found(self, robot: str) -> int:
        """How often a search for a robot ended with its being heard."""
        return sum(stay.robot == robot and stay.state == State.COMM.name for stay in self.states)

    def as_json(self) -> dict[str, Any]:
        """Everything as plain data."""
        return {
            "mission": self.setup.mission.name,
            "uav": self.setup.name,
            "vehicle": self.vehicle,
            "about": self.about,
            "ending": self.ending,
            "outcome": self.report.get("outcome") or self.finish or "the record ends in flight",
            "from_s": self.from_s,
            "to_s": self.to_s,
            "began_unix_s": None
            if self.unix_offset_s is None
            else self.unix_offset_s + self.from_s,
            **self.flown.totals(self.closest),
            "states": [asdict(stay) for stay in self.states],
            "waits": [asdict(wait) for wait in self.waits],
            "interactions": self.exchanges.interactions(),
            "robots": {
                name: {
                    "found": self.found(name),
                    **self.exchanges.of(name, self.painted),
                }
                for name in self.exchanges.names
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


def summary_of(entries: Iterable[RecordEntry]) -> FlightSummary:
    """The summary of a record; say `end` on it afterwards.

    Raises:
        NothingFlownError: there is no setup in it.
    """
    summary: FlightSummary | None = None
    about: dict[str, str] = {}
    for entry in entries:
        if entry.kind == "about":
            about = entry.value
        elif entry.kind == "setup":
            summary = FlightSummary(entry.value, about)
        elif summary is not None:
            summary.take(entry)
    if summary is None:
        raise NothingFlownError(_NOTHING)
    return summary


def _request_words(event: Asked) -> str:
    match event:
        case SeekNow(robot=robot):
            return f"seek {robot}"
        case GoTo(points=points):
            places = ", ".join(f"{p.east_m:.0f} m east {p.north_m:.0f} m north" for p in points)
            return f"go to {places}"
        case ChangeAltitude(altitude_m=altitude_m):
            return f"hold at {altitude_m:g} m"
    words = {"HoldNow": "hold", "GoOn": "resume", "ExploreNow": "explore", "ComeHome": "home"}
    words |= {"LandNow": "land here", "Reload": "reload the mission file"}
    return words.get(type(event).__name__, type(event).__name__)
