"""Missions, fences and rally points on board: which items PX4 takes, what it keeps of them.

PX4 stores of an item only what its command means to it, so a download may differ from what was
uploaded: unused parameters come back as zero, frames 0 and 3 as 5 and 6, yaw as 0 to 360 degrees.
Of PX4's items this simulation takes those that it flies.
"""

import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from operator import attrgetter
from typing import Any, Final, NamedTuple


class MissionType(IntEnum):
    """MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2
    ALL = 255


class UploadResult(IntEnum):
    """MAV_MISSION_RESULT, as far as PX4 uses it."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5 = 10
    INVALID_PARAM6 = 11
    INVALID_PARAM7 = 12
    OPERATION_CANCELLED = 15


class Command(IntEnum):
    """MAV_CMD of the items that are taken."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    DO_CHANGE_SPEED = 178
    FENCE_POLYGON_INCLUSION = 5001
    FENCE_POLYGON_EXCLUSION = 5002
    FENCE_CIRCLE_INCLUSION = 5003
    FENCE_CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100


FRAME_MISSION: Final = 2
FRAME_AMSL: Final = 5
FRAME_RELATIVE: Final = 6
_FRAMES: Final = {0: FRAME_AMSL, 5: FRAME_AMSL, 3: FRAME_RELATIVE, 6: FRAME_RELATIVE}

# What PX4 keeps of param1..4: "n" the number, "y" a yaw, "c" a count, "." nothing.
_KEPT: Final[dict[int, str]] = {
    Command.NAV_WAYPOINT: "nn.y",
    Command.NAV_LOITER_UNLIM: "..ny",
    Command.NAV_LAND: ".n.y",
    Command.NAV_TAKEOFF: "...y",
    Command.FENCE_POLYGON_INCLUSION: "c...",
    Command.FENCE_POLYGON_EXCLUSION: "c...",
    Command.FENCE_CIRCLE_INCLUSION: "n...",
    Command.FENCE_CIRCLE_EXCLUSION: "n...",
    Command.RALLY_POINT: "....",
}
_POSITIONLESS: Final = frozenset({Command.NAV_RETURN_TO_LAUNCH, Command.DO_CHANGE_SPEED})
_FLOWN_TO: Final = frozenset(
    {Command.NAV_WAYPOINT, Command.NAV_LOITER_UNLIM, Command.NAV_LAND, Command.NAV_TAKEOFF}
)
_POLYGON: Final = frozenset({Command.FENCE_POLYGON_INCLUSION, Command.FENCE_POLYGON_EXCLUSION})
_FEWEST_VERTICES: Final = 3
_PARAMS: Final = attrgetter("param1", "param2", "param3", "param4")
_CHECKED: Final = attrgetter(
    *("frame", "command", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")
)


class Refusal(NamedTuple):
    """Why PX4 refuses an uploaded item: MISSION_ACK's result, and whether a text comes with it."""

    result: UploadResult
    with_text: bool = True


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One stored item.

    Attributes:
        frame: 2 (no position), 5 (AMSL) or 6 (above home).
        command: MAV_CMD.
        autocontinue: Whether the mission goes on by itself after it.
        params: param1..4.
        x: Latitude in 1e-7 degrees (param5 in frame 2).
        y: Longitude in 1e-7 degrees (param6 in frame 2).
        z: Altitude in metres (param7 in frame 2).
    """

    frame: int
    command: int
    autocontinue: bool
    params: tuple[float, ...]
    x: int
    y: int
    z: float

    @property
    def has_position(self) -> bool:
        """Whether the vehicle flies to it."""
        return self.frame != FRAME_MISSION and self.command in _FLOWN_TO

    @property
    def degrees(self) -> tuple[float, float]:
        """Latitude and longitude of an item with a position."""
        return self.x * 1e-7, self.y * 1e-7

    def altitude_amsl_m(self, home_altitude_m: float, otherwise_m: float) -> float:
        """Altitude; `otherwise_m` where the item's is not a number."""
        if not math.isfinite(self.z):
            return otherwise_m
        return self.z + home_altitude_m if self.frame == FRAME_RELATIVE else self.z

    @property
    def time_inside_s(self) -> float:
        """How long to stay before the item counts as reached."""
        timed = self.command == Command.NAV_WAYPOINT
        return (positive(self.params[0]) or 0.0) if timed else 0.0

    def fields(self) -> dict[str, Any]:
        """Fields of MISSION_ITEM_INT."""
        return {
            "frame": self.frame,
            "command": self.command,
            "autocontinue": int(self.autocontinue),
            **{f"param{number}": value for number, value in enumerate(self.params, 1)},
            "x": self.x,
            "y": self.y,
            "z": self.z,
        }


def stored_item(message: Any, mission_type: int) -> MissionItem | Refusal:
    """The part of an uploaded MISSION_ITEM_INT that PX4 stores."""
    raw: tuple[float, ...] = _PARAMS(message)
    if message.frame == FRAME_MISSION:
        frame, known, params = FRAME_MISSION, message.command in _POSITIONLESS, raw
    elif message.frame in _FRAMES:
        frame, known = _FRAMES[message.frame], message.command in _KEPT
        params = tuple(map(_keep, raw, _KEPT.get(message.command, "....")))
    else:
        return Refusal(UploadResult.UNSUPPORTED_FRAME)
    if not known:
        return Refusal(UploadResult.UNSUPPORTED)
    few = message.command in _POLYGON and params[0] < _FEWEST_VERTICES
    stray = (
        mission_type == MissionType.MISSION and message.command >= Command.FENCE_POLYGON_INCLUSION
    )
    if (mission_type == MissionType.FENCE and few) or stray:
        return Refusal(UploadResult.ERROR, with_text=False)
    x, y = message.x, message.y
    return MissionItem(frame, message.command, bool(message.autocontinue), params, x, y, message.z)


def positive(value: float) -> float | None:
    """The value of a parameter that means something only above zero."""
    return value if math.isfinite(value) and value > 0 else None


def checksum(message: Any, previous: int) -> int:
    """PX4's running CRC-32 over uploaded items; the last one is the plan's id."""
    packed = struct.pack("<BHB4fiif", *_CHECKED(message))
    return zlib.crc32(packed, previous ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


def _keep(value: float, how: str) -> float:
    if how == "n":
        return value
    if how == "y":
        return value % 360.0 if math.isfinite(value) else math.nan
    if how == "c":
        return float(int(value + 0.5)) if 0 <= value < 65536 else 0.0
    return 0.0


CAPACITY: Final[Mapping[int, int]] = {
    MissionType.MISSION: 10000,
    MissionType.FENCE: 64,
    MissionType.RALLY: 32,
}
"""PX4's space (SITL build of 1.17); a real flight controller has room for 500 mission items."""


_NONE: Final[tuple[tuple[MissionItem, ...], int]] = ((), 0)


class PlanStore:
    """The stored plans and their changes; all MAVLink links share them.

    Attributes:
        current: The mission item that was last set from outside; None after an upload in which
            no item was marked as current: PX4 then keeps the index that it has.
        active: The item that is flown, as the autopilot reports it.
        revision: Counts the changes of mission, current item, fence and rally points.
        transferring: Whether an upload is under way on any link.
    """

    def __init__(self) -> None:
        # By kind: items, and their checksum.
        self._plans: dict[int, tuple[tuple[MissionItem, ...], int]] = dict.fromkeys(CAPACITY, _NONE)
        self.current: int | None = 0
        self.active = 0
        self.revision = 0
        self.transferring = False

    def items(self, kind: int) -> tuple[MissionItem, ...]:
        """The stored items of one kind; none of one that does not exist."""
        return self._plans.get(kind, _NONE)[0]

    def identifier(self, kind: int) -> int:
        """The checksum that MISSION_CURRENT and MISSION_ACK name the plan by; 0 when empty."""
        return self._plans.get(kind, _NONE)[1]

    def store(
        self, kind: int, items: tuple[MissionItem, ...], identifier: int, current: int | None
    ) -> None:
        """Replace one kind; the very same plan again changes nothing, as in PX4."""
        if kind not in self._plans or (items and identifier == self.identifier(kind)):
            return
        self._plans[kind] = (items, identifier) if items else _NONE
        if kind == MissionType.MISSION:
            self.current = current
        self.revision += 1

    def set_current(self, sequence: int) -> None:
        """Request another mission item."""
        self.current = sequence
        self.revision += 1
