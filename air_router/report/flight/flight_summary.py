"""What happened in a flight, added up from its record: plain data for a page and for programs.

Times are seconds on the vehicle's clock since the record began to know it; positions metres east
and north of the mission's origin.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from air_router.controller.flight_setup import FlightSetup
from air_router.controller.model.actions import Announce, CommandAck, Finish, Seeking, StateChanged
from air_router.controller.model.events import (
    AirspaceChanged,
    CommandFailed,
    PlanRenewed,
    RobotPose,
)
from air_router.controller.model.requests import Asked, GoTo, SeekNow
from air_router.controller.model.states import State
from air_router.errors import AirRouterError, ExitCode
from air_router.flight.flight_stats import TRACK_STEP_M
from air_router.mission.mission import Mission
from air_router.record.log import Note, RecordEntry
from air_router.report.flight.exchanges import Exchanges
from air_router.vehicle.vehicle import Telemetry
from geo.airspace.airspace import Airspace
from geo.frame import Point
from mocha_link.links.link_events import LinkEvent

TRACK_S: Final = 0.5
"""So often the track has a point, and its distance to zones and fence is looked at."""

BATTERY_STEP: Final = 0.005

_ABOUT_ROBOTS: Final = frozenset({State.SEARCH, State.COMM})


class NothingFlownError(AirRouterError):
    """A record with nothing in it that could be shown."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class Stay:
    """A time in one state; `robot` is whom it is about."""

    state: str
    from_s: float
    to_s: float
    robot: str | None
    because: str


@dataclass(frozen=True, slots=True)
class RequestRecord:
    """Something that was asked for, and the answer (None: none)."""

    t: float
    what: str
    by: str
    accepted: bool | None = None
    why: str = ""


@dataclass(slots=True)
class FlightSummary:
    """One flight.

    Attributes:
        setup: What was flown; `mission`: with the zones and fences that it had at the end.
        about: Versions and the like.
        ending: What is wrong with the end of the record; None if it is whole.
        track: (t, east_m, north_m, altitude_m) while it was armed.
        distances: (t, metres to the nearest zone or fence) in the air, while it was ours.
        battery: (t, charge 0..1) in the air.
        states: One after the other.
        announcements: (t, text).
        requests: What was asked for.
        failures: (t, text): commands that the vehicle did not follow.
        robots: Places that robots were heard of at: name -> (t, east_m, north_m, stamp_s).
        painted: (t, cells of the map that are known).
        exchanges: What went over the links.
        report: The report at the end; empty if there is none.
        armed_s: When the vehicle was first seen armed.
    """

    setup: FlightSetup | None = None
    mission: Mission | None = None
    about: dict[str, str] = field(default_factory=dict)
    ending: str | None = None
    vehicle: dict[str, Any] = field(default_factory=dict)
    track: list[tuple[float, float, float, float]] = field(default_factory=list)
    distances: list[tuple[float, float]] = field(default_factory=list)
    battery: list[tuple[float, float]] = field(default_factory=list)
    states: list[Stay] = field(default_factory=list)
    announcements: list[tuple[float, str]] = field(default_factory=list)
    requests: list[RequestRecord] = field(default_factory=list)
    failures: list[tuple[float, str]] = field(default_factory=list)
    robots: dict[str, list[tuple[float, float, float, float]]] = field(default_factory=dict)
    painted: list[tuple[float, int]] = field(default_factory=list)
    exchanges: Exchanges = field(default_factory=Exchanges)
    report: dict[str, Any] = field(default_factory=dict)
    closest: tuple[float, str] | None = None
    closest_at: tuple[float, float, float] | None = None
    from_s: float = math.nan
    to_s: float = math.nan
    distance_m: float = 0.0
    finish: str | None = None
    unix_offset_s: float | None = None
    armed_s: float | None = None
    _open: dict[tuple[str, str], int] = field(default_factory=dict)
    _entered: tuple[State, float, str | None, str] | None = None
    _ours: bool = True
    _last: Point | None = None
    _flown: list[Point] = field(default_factory=list)
    _airspaces: list[tuple[int, Airspace]] = field(default_factory=list)
    _changed: Mission | None = None

    def take(self, entry: RecordEntry) -> None:
        """Take in what is recorded next."""
        match entry.kind:
            case "about":
                self.about = entry.value
            case "setup":
                self.setup = entry.value
                self.mission = entry.value.mission
                self._airspaces = [(0, entry.value.mission.airspace)]
                self.exchanges.own = entry.value.name
                self.exchanges.sought = entry.value.seek
            case "note":
                self._note(entry.t, entry.value)
            case "event":
                self._seen(entry.t)
                self._event(entry.t, entry.value)
            case "action":
                self._action(entry.t, entry.value)

    def end(self, ending: str | None) -> None:
        """There is no more.

        Raises:
            NothingFlownError: there was nothing.
        """
        if self.setup is None or math.isnan(self.to_s):
            raise NothingFlownError("nothing was recorded that could be shown")
        self.ending = ending
        self._leave(self.to_s)
        self.exchanges.end(self.to_s)
        begins = [begin for begin, _ in self._airspaces]
        for (begin, airspace), end in zip(self._airspaces, [*begins[1:], None], strict=True):
            closest = airspace.track_distance_m(self._flown[begin:end])
            if closest[1] and (self.closest is None or closest < self.closest):
                self.closest = closest

    def _seen(self, t: float) -> None:
        if math.isnan(self.from_s):
            self.from_s = t
            self._entered = (State.READY, t, None, "")
        self.to_s = t

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
            self._open[event.by, event.request_id] = len(self.requests)
            self.requests.append(RequestRecord(t, _wish(event), event.by))
        elif isinstance(event, AirspaceChanged) and self.mission is not None:
            self._changed = self.mission.with_areas(event.fences, event.zones)
        elif isinstance(event, PlanRenewed) and self._changed is not None:
            self.mission, self._changed = self._changed, None
            self._airspaces.append((len(self._flown), self.mission.airspace))
        elif isinstance(event, CommandFailed):
            self.failures.append((t, f"{type(event.action).__name__}: {event.reason}"))

    def _telemetry(self, t: float, telemetry: Telemetry) -> None:
        charge = telemetry.battery
        if not telemetry.armed or not all(map(math.isfinite, telemetry.position)):
            return
        if self.armed_s is None:
            self.armed_s = t
        if (
            charge is not None
            and telemetry.in_air
            and (not self.battery or abs(self.battery[-1][1] - charge) >= BATTERY_STEP)
        ):
            self.battery.append((t, charge))
        place = telemetry.position
        if telemetry.in_air:
            self._fly(place)
        if self.track and t - self.track[-1][0] < TRACK_S:
            return
        self.track.append((t, *place, telemetry.altitude_m))
        if telemetry.in_air and self._ours and self.setup is not None:
            away_m, what = self._airspaces[-1][1].nearest(place)
            if what:
                self.distances.append((t, away_m))
                if self.closest_at is None or away_m < self.closest_at[0]:
                    self.closest_at = (away_m, *place)

    def _fly(self, place: Point) -> None:
        step_m = 0.0 if self._last is None else math.dist(self._last, place)
        if self._last is None or step_m >= TRACK_STEP_M:
            self._last = place
            self.distance_m += step_m
            if self._ours:
                self._flown.append(place)

    def _action(self, t: float, action: Any) -> None:
        match action:
            case StateChanged(signal=signal, target=target, robot=robot):
                self._leave(t)
                about = robot if target in _ABOUT_ROBOTS else None
                self._entered = (target, t, about, signal.value)
                self._ours = target is not State.PASSIVE
            case Announce(text=text):
                self.announcements.append((t, text))
            case Seeking(robot=str() as robot) if self._entered is not None:
                state, from_s, _, because = self._entered  # a search finds its robot once entered
                self._entered = (state, from_s, robot, because)
            case CommandAck():
                self._answered(t, action)
            case Finish(why=why):
                self.finish = why

    def _answered(self, t: float, answer: CommandAck) -> None:
        place = self._open.pop((answer.by, answer.request_id), None)
        if place is None:
            self.requests.append(RequestRecord(t, "", answer.by, answer.accepted, answer.why))
        else:
            wish = self.requests[place]
            self.requests[place] = RequestRecord(
                wish.t, wish.what, wish.by, answer.accepted, answer.why
            )

    def _leave(self, t: float) -> None:
        if self._entered is not None:
            state, from_s, robot, because = self._entered
            self.states.append(Stay(state.name, from_s, t, robot, because))

    @property
    def duration_s(self) -> float:
        """Seconds since it was first seen armed."""
        return 0.0 if self.armed_s is None else self.to_s - self.armed_s

    def found(self, robot: str) -> int:
        """How often a search for a robot ended with its being heard."""
        return sum(stay.robot == robot and stay.state == State.COMM.name for stay in self.states)

    def as_json(self) -> dict[str, Any]:
        """Everything as plain data."""
        assert self.setup is not None  # noqa: S101 - `end` has looked
        mission = self.setup.mission
        return {
            "mission": mission.name,
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
            "duration_s": round(self.duration_s, 1),
            "distance_m": round(self.distance_m, 1),
            "clearance_m": mission.planner.clearance_m,
            "closest_approach_m": None if self.closest is None else round(self.closest[0], 2),
            "closest_approach_to": None if self.closest is None else self.closest[1],
            "states": [asdict(stay) for stay in self.states],
            "interactions": self.exchanges.interactions(),
            "robots": {
                name: {
                    "found": self.found(name),
                    **self.exchanges.of(name, self.painted),
                }
                for name in self.exchanges.names()
            },
            "requests": [asdict(wish) for wish in self.requests],
            "announcements": [{"t": t, "text": text} for t, text in self.announcements],
            "not_followed": [{"t": t, "text": text} for t, text in self.failures],
            "track": [[round(v, 3) for v in row] for row in self.track],
            "distance_to_zones_m": [[round(t, 3), round(d, 2)] for t, d in self.distances],
            "battery": [[round(t, 3), c] for t, c in self.battery],
            "map_cells": [[round(t, 3), cells] for t, cells in self.painted],
            "flight_report": self.report,
        }


def summary_of(entries: Iterable[RecordEntry]) -> FlightSummary:
    """The summary of a record; say `end` on it afterwards."""
    summary = FlightSummary()
    for entry in entries:
        summary.take(entry)
    return summary


def _wish(event: Asked) -> str:
    match event:
        case SeekNow(robot=robot):
            return f"seek {robot}"
        case GoTo(points=points):
            places = ", ".join(f"{p.east_m:.0f} m east {p.north_m:.0f} m north" for p in points)
            return f"go to {places}"
    words = {"HoldNow": "hold", "GoOn": "go on", "ExploreNow": "explore", "ComeHome": "come home"}
    words["Reload"] = "read the mission file again"
    return words.get(type(event).__name__, type(event).__name__)
