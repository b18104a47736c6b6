"""The contents of the live page: the mission, and everything that moves.

Pure: it is derived from the recorded events and actions, so a recorded flight can be shown like a
live one.
"""

import math
from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from air_router.controller import FlightStatus
from air_router.controller.model import (
    Action,
    Announce,
    CommandAck,
    Event,
    Finish,
    RobotPath,
    RobotPose,
    State,
    StateChanged,
)
from air_router.controller.targets import TargetTrack
from air_router.gossip import Interactions
from air_router.mission import HOME_NODE, Mission
from air_router.repeats import Repeats, times
from air_router.routing import Router
from air_router.vehicle import REBOOT_S, Severity, Telemetry
from air_router.web import area_beside, buffer, degrees, place_in
from air_router.words import wind_words
from geo.airspace import Shape
from geo.frame import Point
from mocha_link.links import LinkEvent

TRACK_STEP_M: Final = 0.5
"""Positions nearer than this to the last one add nothing to a line on a map."""

MAX_LOG_LINES: Final = 200
"""Log lines kept for a page that is opened later."""

MOST_ALARMS: Final = 5
"""Number of newest alarms shown: more would hide the map."""

SAMPLE_S, MOST_ROWS = 1.0, 3_600
"""Interval and number of rows of plotted values."""

_LIT_S: Final = 1.0
"""A link stays lit this long after a sync, so a short sync is visible."""

_MOST_EDGES: Final = 20_000

_WAITS_S: Final = 0.5
"""An interlock is shown only after this time: our own command is visible with a delay."""

Item = TypeVar("Item")


class History(Generic[Item]):
    """A list that forgets its oldest items beyond a limit.

    Attributes:
        count: Number of items ever added.
    """

    def __init__(self, most: int | None = None) -> None:
        self.count = 0
        self._kept: deque[Item] = deque(maxlen=most)  # newest last

    def add(self, item: Item) -> None:
        """Add an item."""
        self.count += 1
        self._kept.append(item)

    def since(self, start: int = 0) -> list[Item]:
        """The kept items from the n-th on."""
        return list(self._kept)[max(start - self.count + len(self._kept), 0) :]


@dataclass(slots=True)
class _Robot:
    track: TargetTrack  # its newest pose and path
    peer: str = ""  # the sender of that pose


def _waiting(status: FlightStatus) -> str | None:
    """The interlock that has blocked the mission for long enough to be shown."""
    waiting = status.waiting
    return None if waiting is None or status.waiting_s < _WAITS_S else waiting.why


class LiveScene:
    """The vehicle, the robots, the links and the log.

    Args:
        mission: The mission, for its frame and name.
        status: Returns the flight's status, for the plots.
        router: Returns the router for the zones in force.
        name: The vehicle's name.

    Attributes:
        track: Latitude and longitude of the points of the flown track.
        log: The log lines; a repeated line has its count, and replaces the previous one on pages.
        alarms: Alarms and warnings; the newest last.
        interactions: Contacts and syncs.
        rows: The plotted values: seconds, altitude (m), speed (m/s), charge (0..1), distance to the
            nearest border (m), and for each peer the signal, whether data crossed, bytes in syncs,
            and the signal's unit.
    """

    def __init__(
        self,
        mission: Mission,
        status: Callable[[], FlightStatus],
        router: Callable[[], Router],
        name: str,
    ) -> None:
        self._frame = mission.frame  # of the page's positions
        self._home = mission.home  # distances count from it
        self._status, self._router = status, router
        self._name = name
        self._now_s = 0.0  # vehicle's clock
        self.track: History[list[float]] = History()
        self._track_end: Point | None = None  # position of its last point
        self._robots: dict[str, _Robot] = {}  # robots with a received pose or path, by name
        self.interactions = Interactions()
        self.rows: History[list[Any]] = History(MOST_ROWS)
        self._sampled_s = -math.inf  # the last row's time
        self.log: History[dict[str, Any]] = History(MAX_LOG_LINES)
        self._repeats = Repeats[tuple[str, str]]()  # lines of the log, by kind and text
        self.alarms: list[dict[str, Any]] = []

    # Events.

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """Handle an event and its actions."""
        if now_s < self._now_s - REBOOT_S:
            self._now_s, self._sampled_s = now_s, -math.inf
        self._now_s = max(self._now_s, now_s)
        match event:
            case Telemetry():
                if event.in_air:
                    self._fly(event.position)
                self._sample(event)
            case RobotPose(robot=name, position=position, stamp_s=stamp_s, peer=peer):
                robot = self._robot(name)
                if robot.track.pose_received(position, stamp_s, self._now_s):
                    robot.peer = peer
            case RobotPath(robot=name, points=points, stamp_s=stamp_s):
                self._robot(name).track.path_received(points, stamp_s, self._now_s)
            case _ if isinstance(event, LinkEvent):
                self.interactions.take(self._now_s, event)
        self._take_decided(actions)

    def _robot(self, name: str) -> _Robot:
        return self._robots.setdefault(name, _Robot(TargetTrack(name)))

    def _take_decided(self, actions: Collection[Action]) -> None:
        for action in actions:
            match action:
                case StateChanged(source=source, target=target):
                    self._add_line("state", f"{source.name} → {target.name}")
                case Announce():
                    self._announced(action)
                case CommandAck(by=by, accepted=accepted, why=why):
                    self._add_line(
                        "answer", f"{by}: {'accepted' if accepted else 'refused'}: {why}"
                    )
                case Finish(why=why):
                    self._add_line("state", why)

    def _announced(self, announcement: Announce) -> None:
        """Show an announcement; it replaces the last one about the same subject."""
        severity = None if announcement.severity is Severity.INFO else announcement.severity.value
        self._add_line("announcement", announcement.words, severity)
        if announcement.about:
            self.alarms = [alarm for alarm in self.alarms if alarm["about"] != announcement.about]
        if severity is not None:
            self.alarms.append(
                {
                    "n": self.log.count,
                    "t": round(self._now_s, 1),
                    "severity": severity,
                    "text": announcement.text,
                    "instruction": announcement.instruction,
                    "about": announcement.about,
                }
            )
            del self.alarms[:-MOST_ALARMS]

    def open_alarms(self, status: FlightStatus) -> list[dict[str, Any]]:
        """The alarms that still last."""
        if status.state is State.DONE:
            return []
        return [a for a in self.alarms if not a["about"] or a["about"] in status.alarms]

    # For the pages.

    def vehicle(self, status: FlightStatus) -> dict[str, Any]:
        """The current state of the vehicle and its mission."""
        telemetry, left_s = status.telemetry, status.left_s
        shown: dict[str, Any] = {
            "name": self._name,
            "state": status.state.name,
            "what": status.state.value,
            "robot": status.robot,
            "left_s": None if left_s is None else round(left_s, 1),
            "in_charge": status.in_charge,
            "robots": list(status.targets),
            "waypoints_left": status.waypoints_left,
            "need_home": _shown(status.need_home, 3),
            "waiting": _waiting(status),
            "refused": status.refusals,
            "at": None,
            "route": [],
        }
        if telemetry is None:
            return shown
        at = self._pair(telemetry.position)
        route = [self._pair(leg.to) for leg in status.legs]
        return {
            **shown,
            "at": at,
            "heading_deg": _shown(telemetry.heading_deg),
            "altitude_m": _shown(telemetry.altitude_m),
            "speed_m_s": _shown(math.hypot(*telemetry.velocity_m_s)),
            "battery": _shown(telemetry.battery, 3),
            "mode": telemetry.mode.value,
            "armed": telemetry.armed,
            "in_air": telemetry.in_air,
            "fix": telemetry.fix,
            "satellites": telemetry.satellites,
            "voltage_v": _shown(telemetry.voltage_v),
            "home_m": _shown(math.dist(telemetry.position, self._home), 0),
            "wind": None if telemetry.wind_m_s is None else wind_words(telemetry.wind_m_s),
            "home_moved": telemetry.home_moved is not None,
            "time_s": round(telemetry.time_s, 1),
            "route": [at, *route] if route else [],
        }

    def robots(self) -> list[dict[str, Any]]:
        """Positions of robots with their ages, and the peer that reported each."""
        return [
            {
                "name": name,
                "at": self._pair(pose.position),
                "age_s": round(self._now_s - robot.track.ours_s(pose.stamp_s), 1),
                "by": robot.peer,
                "way": [self._pair(point) for point in path.points] if path else [],
            }
            for name, robot in sorted(self._robots.items())
            for pose, path in [(robot.track.pose, robot.track.path)]
            if pose is not None
        ]

    def link_lines(self, status: FlightStatus) -> list[dict[str, Any]]:
        """The links to the peers: signal, and whether data are being transferred."""
        lines, syncs = [], self.interactions
        busy = syncs.busy
        for peer, link in sorted(status.links.items()):
            synced_s = syncs.synced_s.get(peer)
            lit = peer in busy or (synced_s is not None and self._now_s - synced_s <= _LIT_S)
            lines.append(
                {
                    "peer": peer,
                    "signal": None if link.signal is None else link.signal.value,
                    "unit": "" if link.signal is None else link.signal.unit.value,
                    "lit": lit,
                    "syncs": syncs.begun[peer],
                    "synced_ago_s": None if synced_s is None else round(self._now_s - synced_s, 1),
                    "bytes": syncs.moved[peer],
                    "newest_age_s": _shown(link.newest_age_s),
                }
            )
        return lines

    def _sample(self, telemetry: Telemetry) -> None:
        """Store a row of plotted values, once a second of the vehicle's clock."""
        if self._now_s - self._sampled_s < SAMPLE_S:
            return
        self._sampled_s = self._now_s
        airspace = self._router().graph.mission.airspace
        away_m, to = airspace.nearest(telemetry.position)
        self.rows.add(
            [
                round(self._now_s, 1),
                _shown(telemetry.altitude_m),
                _shown(math.hypot(*telemetry.velocity_m_s)),
                _shown(telemetry.battery, 3),
                _shown(away_m) if to else None,
                {
                    line["peer"]: [line["signal"], int(line["lit"]), line["bytes"], line["unit"]]
                    for line in self.link_lines(self._status())
                },
            ]
        )

    @property
    def histories(self) -> dict[str, History[Any]]:
        """The growing lists, by their names in messages to the page."""
        return {"rows": self.rows, "track": self.track, "log": self.log}

    @property
    def now_s(self) -> float:
        """The vehicle's clock at the last event."""
        return round(self._now_s, 1)

    def _fly(self, position: Point) -> None:
        if self._track_end is None or math.dist(self._track_end, position) >= TRACK_STEP_M:
            self._track_end = position
            self.track.add(self._pair(position))

    def _add_line(self, kind: str, text: str, severity: str | None = None) -> None:
        line: dict[str, Any] = {"n": self.log.count + 1, "t": round(self._now_s, 1)}
        line |= {"kind": kind, "text": text}
        if severity is not None:
            line["severity"] = severity
        if kind == "answer" or severity == Severity.ALARM.value:  # never merged
            self._repeats.clear()
        elif count := self._repeats.again((kind, text), self._now_s):
            line["again"] = times(count)
        self.log.add(line)

    def _pair(self, point: Point) -> list[float]:
        return degrees(self._frame, point)


def _shown(value: float | None, digits: int = 1) -> float | None:
    """A number for the page; None if it is not finite."""
    return None if value is None or not math.isfinite(value) else round(value, digits)


def scenery(mission: Mission, router: Router) -> dict[str, Any]:
    """The parts of a mission that the page draws, in degrees."""
    frame = mission.frame
    idle = {entry.zone.name: entry.reason for entry in mission.idle_zones}
    planner = mission.planner

    def area(
        name: str, shape: Shape, clearance_m: float, notes: Sequence[str] = (), sign: int = 1
    ) -> dict[str, Any]:
        is_fence = sign < 0
        kept_m = (clearance_m, clearance_m + mission.tracking.planned_m)
        buffers = [buffer(frame, shape, sign * distance_m) for distance_m in kept_m]
        outline = buffer(frame, shape, 0.0)
        drawn = area_beside(name, outline, buffers, [*notes], is_fence=is_fence)
        return {**drawn, "label": None if is_fence else degrees(frame, place_in(shape))}

    areas = [area("fence", fence, planner.clearance_m, sign=-1) for fence in mission.fences]
    for zone in (*mission.zones, *mission.climb_corridors):
        own_m = zone.clearance_m
        notes = [] if own_m is None else [f"clearance {own_m:g} m"]
        notes += [idle[zone.name]] if zone.name in idle else []
        clearance_m = planner.clearance_m if own_m is None else own_m
        areas.append(area(zone.name, zone.shape, clearance_m, notes))
    graph = router.graph
    positions = {node: degrees(frame, place) for node, place in graph.positions.items()}
    places: list[dict[str, Any]] = [
        {"kind": "home" if node == HOME_NODE else "waypoint", "node": node, "at": at}
        for node, at in sorted(positions.items())
    ]
    places += [
        {"kind": "rally", "node": None, "at": degrees(frame, place)}
        for place in mission.rally_points
    ]
    edges = [
        [
            degrees(frame, point)
            for point in (graph.position(a), *graph.via(a, b), graph.position(b))
        ]
        for a, b in list(graph.graph.edges)[:_MOST_EDGES]
    ]
    return {
        "name": mission.name,
        "file": mission.path.name,
        "altitudes_m": mission.altitudes_m,
        "areas": areas,
        "places": places,
        "edges": edges,
    }
