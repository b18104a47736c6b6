"""What a rehearsed flight leaves behind for the judge: true track, MAVLink messages and scene.

The flyer of a scene (in one process, with the real programs, on a real PX4) fills these in; the
judge knows nothing else. Nothing here comes from the code that is judged. All times are simulated
seconds since the vehicle started, on one clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from pyproj import Proj

AUTOPILOT: Final = 1
"""MAVLink component of the autopilot."""

COMPANION: Final = 191
"""MAVLink component of the companion (MAV_COMP_ID_ONBOARD_COMPUTER)."""

WAYPOINT, RETURN, LAND, TAKEOFF = 16, 20, 21, 22  # MAV_CMD
SET_MODE, SPEED, SET_HOME, TERMINATE, REPOSITION, ARM = 176, 178, 179, 185, 192, 400
MISSION, FENCE, RALLY, EVERYTHING = 0, 1, 2, 255  # MAV_MISSION_TYPE
_MOTIONS: Final = frozenset({16, 17, 20, 21, 22, 34, 176, 192, 193, 252, 300})
_MOVING: Final = frozenset({"MISSION_SET_CURRENT", "SET_MODE", "MANUAL_CONTROL"})
_ITEMS: Final = frozenset({"MISSION_ITEM_INT", "MISSION_ITEM"})
_NOWHERE: Final = 2**31 - 1  # of DO_REPOSITION: where it is


class EvidenceError(Exception):
    """A flight that cannot be judged; the message has the reason: file, track or fault."""


@dataclass(frozen=True, slots=True)
class Sample:
    """The true state of the vehicle process at one moment; at least 20 of them a second.

    Attributes:
        time_s: Simulated seconds since the vehicle started.
        latitude_deg: True position, WGS-84.
        longitude_deg: True position, WGS-84.
        altitude_amsl_m: True height above mean sea level.
        armed: Whether the motors may turn.
        landed: Whether it really stands on the ground.
        custom_mode: The mode that it flies in, as in HEARTBEAT.custom_mode.
        failsafe: Whether a failsafe of the autopilot acts.
    """

    time_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    armed: bool
    landed: bool
    custom_mode: int
    failsafe: bool


@dataclass(frozen=True, slots=True)
class WireMessage:
    """One MAVLink message between the vehicle and a companion or station, either direction.

    Attributes:
        time_s: When it was sent.
        system: Who sent it: system id.
        component: Who sent it: component id; `AUTOPILOT` is the vehicle, `COMPANION` is ours.
        target: Target system id; 0: all.
        name: MAVLink name, `COMMAND_LONG`, `COMMAND_INT`, `MISSION_ITEM_INT`, `SET_MODE`...
        fields: All fields by their MAVLink names, degE7 and the like as on the wire.
        delivered: Whether it reached the other end; a lost one was sent all the same.
    """

    time_s: float
    system: int
    component: int
    target: int
    name: str
    fields: Mapping[str, Any]
    delivered: bool = True


class SceneEventKind(StrEnum):
    """The events of a scene that the judge has to know of; the comment has the value.

    Only done actions are recorded, when they were done: a pilot's mode that the vehicle refused
    did not happen.
    """

    MISSION_FILE = "mission file"  # the text as it is to be flown from now on, after a reload
    FILE_LEFT = "mission file left"  # (when a reload was requested, the text that it refused)
    PILOT = "pilot"  # what the pilot or a station chose: mode name, "sticks", "item", "plan" ...
    # and "mode of before": again, over an order of ours that no message had shown
    HANDED_OVER = "handed over"  # None: the pilot, who took off, chose Mission mode for us
    DISARMED = "disarmed"  # who: "pilot", "station"; also by force in the air
    REBOOTED = "rebooted"  # None: the autopilot was started anew, on the ground at home
    REQUEST = "request"  # an operator's, as typed: "hold", "seek io", "goto 39.9,-75.2 39.9,-75.1"
    KILLED = "companion killed"  # None
    STARTED = "companion started"  # None; also the first time
    ENDED = "companion ended"  # None: its program is over
    STOPPED = "companion stopped"  # None: SIGSTOP
    CONTINUED = "companion continued"  # None: SIGCONT
    FAULT = "fault begins"  # the fault's name, or a line of text
    ESTIMATE_OFF = "estimate off"  # metres that it is wrong by from now on, horizontally
    HOME_MOVED = "home moved"  # (latitude_deg, longitude_deg, altitude_amsl_m)
    FENCE_CHANGED = "fence changed"  # by another station; "deleted", "added" ...
    LIST_STORED = "list stored"  # by another station, among ours: "mission", "fence", "rally"
    BATTERY = "battery"  # seconds that it takes from full to empty from now on
    # One direction of an exchange with a robot is over: (robot, "in" to us or "out", when it began,
    # what the robot handed to us by it: a list of (robot that made it, topic, bytes)).
    SYNCED = "synced"


@dataclass(frozen=True, slots=True)
class SceneEvent:
    """Something that the scene did.

    Attributes:
        time_s: When.
        what: Which kind.
        value: As `SceneEventKind` has it.
    """

    time_s: float
    what: SceneEventKind
    value: Any = None


@dataclass(frozen=True, slots=True)
class AnnouncedLine:
    """Something that the companion announced to operator and pilot."""

    time_s: float
    text: str


@dataclass(slots=True)
class FlightRecord:
    """What has been seen of a flight so far, each in order of time.

    Attributes:
        samples: From before arming to after disarming (or the end of watching).
        messages: Of all senders.
        received: The autopilot's messages as they reached the companion, late or spoilt, in order
            of arrival; empty where they were not recorded.
        happenings: What the scene did.
        lines: What the companion announced.
    """

    samples: list[Sample] = field(default_factory=list)
    messages: list[WireMessage] = field(default_factory=list)
    received: list[WireMessage] = field(default_factory=list)
    happenings: list[SceneEvent] = field(default_factory=list)
    lines: list[AnnouncedLine] = field(default_factory=list)

    def happened(self, time_s: float, what: SceneEventKind, value: Any = None) -> None:
        """The scene did something."""
        self.happenings.append(SceneEvent(time_s, what, value))

    def events(self, *what: SceneEventKind) -> Iterator[SceneEvent]:
        """The happenings of these kinds, in order of time."""
        return (happening for happening in self.happenings if happening.what in what)

    def evidence(self, **more: Any) -> Evidence:
        """All of it, and further facts of the flight."""
        return Evidence(**{f.name: getattr(self, f.name) for f in fields(FlightRecord)}, **more)


@dataclass(slots=True, kw_only=True)
class Evidence(FlightRecord):
    """All that is known of one flight.

    Attributes:
        scene: The scene's name and seed, for the table.
        faults: Names of the faults in it; `acceptance` has a row for each.
        mission_path: The mission file as flown: files that it names are searched for beside it.
        mission_text: Its text at the start.
        exit_code: Of the companion (`air-router fly`); None: it was killed, or flies on.
        outcome: The end that the companion announced: its last line, or its status.
        report: What its `--json` prints of the flight; empty: that was not kept.
        uav: Which of several UAVs this one is.
        reaction_s: What the companion has to react, simulated seconds: more where the simulated
            time runs faster than the real programs' own.
        speed: Simulated seconds in one of the companion's own, by which it measures a silent link.
        knows_meetings: Whether `SYNCED` names the robots met; for real programs this is unknown.
        pace: How the clock of real programs was kept, for the result; empty in one process.
        epoch_s: Unix time of simulated time zero, where zones with hours are judged by it; None:
            they are judged as if they applied always.
        map_files: Texts of map files that the mission names, by their paths; of others the files
            are read.
    """

    scene: str
    faults: frozenset[str]
    mission_path: Path
    mission_text: str
    exit_code: int | None = None
    outcome: str = ""
    report: Mapping[str, Any] = field(default_factory=dict)
    uav: str | None = None
    reaction_s: float = 1.0
    speed: float = 1.0
    knows_meetings: bool = True
    pace: Mapping[str, Any] = field(default_factory=dict)
    epoch_s: float | None = None
    map_files: Mapping[str, str] = field(default_factory=dict)


# Facts from MAVLink.

_ELSEWHERE: Final = {
    "item": ("MISSION_CURRENT", ("seq",)),
    "reposition": ("POSITION_TARGET_GLOBAL_INT", ("lat_int", "lon_int")),
}
"""The message, and its fields, that show that the vehicle goes elsewhere, by the choice."""

_SHOWN_IN: Final = {
    **_ELSEWHERE,
    "plan": ("MISSION_CURRENT", ("mission_id", "fence_id", "rally_points_id")),
}
"""The same of all choices that no mode shows."""


def shown_by_target_only(choice: SceneEvent) -> bool:
    """Whether a choice shows in the vehicle's target, and in no mode."""
    return choice.value in _ELSEWHERE


def choice_received_s(received: Sequence[WireMessage], choice: SceneEvent) -> float:
    """When the companion received another target, item or plan after a choice; infinite: never."""
    name, fields = _SHOWN_IN[str(choice.value)]
    targets = [(m.time_s, [m.fields.get(f) for f in fields]) for m in received if m.name == name]
    before = next((to for time_s, to in reversed(targets) if time_s < choice.time_s), None)
    later = (time_s for time_s, to in targets if time_s >= choice.time_s and to != before)
    return next(later, math.inf)


@dataclass(frozen=True, slots=True)
class Upload:
    """A transfer that the vehicle accepted.

    Attributes:
        time_s: When it was accepted.
        kind: MAV_MISSION_TYPE.
        items: Of it, in order; none: cleared.
    """

    time_s: float
    kind: int
    items: tuple[WireMessage, ...]


def number(fields: Mapping[str, Any], name: str) -> float:
    """A field as a number; what is not there is not a number."""
    value = fields.get(name)
    return math.nan if value is None else float(value)


def command_of(message: WireMessage) -> int | None:
    """The MAV_CMD of a command; None for other messages."""
    if message.name not in {"COMMAND_LONG", "COMMAND_INT"}:
        return None
    return int(message.fields["command"])


def is_motion(message: WireMessage) -> bool:
    """Whether a message moves the vehicle or chooses its mode."""
    named = message.name in _MOVING or message.name.startswith("SET_POSITION_TARGET")
    return named or command_of(message) in _MOTIONS


def was_to_land(commands: Iterable[WireMessage], time_s: float) -> bool:
    """Whether the last motion that reached the vehicle by then was to land."""
    moved = [each for each in commands if each.time_s <= time_s and each.delivered]
    motions = [command_of(each) for each in moved if is_motion(each)]
    return motions[-1:] == [LAND]


def uploads_of(messages: Sequence[WireMessage]) -> Iterator[Upload]:
    """Transfers of the companion that the vehicle accepted, in order of time."""
    begun: dict[int, dict[int, WireMessage]] = {}  # items by their number, by kind
    for message in messages:
        if not message.name.startswith("MISSION_"):
            continue
        kind = int(message.fields.get("mission_type", MISSION))
        if message.component == COMPANION and message.delivered:
            if message.name in {"MISSION_COUNT", "MISSION_CLEAR_ALL"}:
                begun[kind] = {}
            elif message.name in _ITEMS and kind in begun:
                begun[kind][int(message.fields["seq"])] = message
            continue
        accepts = message.component == AUTOPILOT and message.name == "MISSION_ACK"
        if accepts and int(message.fields["type"]) == 0 and kind in begun:
            items = begun.pop(kind)
            yield Upload(message.time_s, kind, tuple(items[seq] for seq in sorted(items)))


class Frame:
    """Metres east and north of a place, on the ellipsoid.

    Args:
        origin: Latitude and longitude in degrees.
    """

    def __init__(self, origin: tuple[float, float]) -> None:
        self._project = Proj(proj="aeqd", lat_0=origin[0], lon_0=origin[1], datum="WGS84")

    def metres(self, latitude_deg: Any, longitude_deg: Any) -> tuple[Any, Any]:
        """East and north of places: numbers or arrays."""
        east, north = self._project(longitude_deg, latitude_deg)
        return east, north

    def item_place(self, fields: Mapping[str, Any]) -> tuple[float, float]:
        """East and north of what has its latitude and longitude in `x` and `y`, as plans do."""
        east, north = self.metres(fields["x"] / 1e7, fields["y"] / 1e7)
        return float(east), float(north)

    def degrees(self, east_m: Any, north_m: Any) -> tuple[Any, Any]:
        """Latitude and longitude of places: numbers or arrays."""
        longitude, latitude = self._project(east_m, north_m, inverse=True)
        return latitude, longitude


def target_of(
    message: WireMessage, uploads: Sequence[Upload], frame: Frame
) -> tuple[float, float] | None:
    """Where a command leads to, in metres; None: to no place."""
    fields = message.fields
    if command_of(message) == REPOSITION:
        if "x" in fields:
            return None if int(fields["x"]) == _NOWHERE else frame.item_place(fields)
        degrees = number(fields, "param5"), number(fields, "param6")
        return frame.metres(*degrees) if all(map(math.isfinite, degrees)) else None
    if message.name != "MISSION_SET_CURRENT":
        return None
    at_s, seq = message.time_s, int(fields["seq"])
    plans = [u for u in uploads if u.kind == MISSION and u.time_s <= at_s and u.items]
    items = plans[-1].items if plans else ()
    if seq >= len(items) or items[seq].fields["command"] not in {WAYPOINT, TAKEOFF}:
        return None
    return frame.item_place(items[seq].fields)
