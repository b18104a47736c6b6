"""Mission, fence and rally items: which PX4 takes, what it keeps of them, and their order.

PX4 stores of an item only what its command means to it, so a download may differ from what was
uploaded: unused parameters come back as zero, frames 0 and 3 as 5 and 6, yaw as 0 to 360 degrees.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final


class MissionType(IntEnum):
    """MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2
    ALL = 255


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT, as far as PX4 uses it."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID_PARAM1 = 6
    OPERATION_CANCELLED = 15


class Command(IntEnum):
    """MAV_CMD of the items that this simulation does something about."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_LOITER_TO_ALT = 31
    NAV_VTOL_TAKEOFF = 84
    NAV_VTOL_LAND = 85
    NAV_DELAY = 93
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    FENCE_RETURN_POINT = 5000
    FENCE_POLYGON_INCLUSION = 5001
    FENCE_POLYGON_EXCLUSION = 5002
    FENCE_CIRCLE_INCLUSION = 5003
    FENCE_CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100


FRAME_MISSION: Final = 2
FRAME_AMSL: Final = 5
FRAME_RELATIVE: Final = 6
_FRAMES: Final = {0: FRAME_AMSL, 5: FRAME_AMSL, 3: FRAME_RELATIVE, 6: FRAME_RELATIVE}
_FLOAT_FRAMES: Final = {FRAME_AMSL: 0, FRAME_RELATIVE: 3}

# What PX4 keeps of param1..4: "n" the number, "b" whether it is positive, "y" a yaw, "c" a count.
_KEPT: Final[dict[int, str]] = {
    Command.NAV_WAYPOINT: "nn.y",
    Command.NAV_LOITER_UNLIM: "..ny",
    Command.NAV_LOITER_TIME: "nbnb",
    Command.NAV_LAND: ".n.y",
    Command.NAV_TAKEOFF: "...y",
    Command.NAV_LOITER_TO_ALT: "bn.b",
    Command.NAV_VTOL_TAKEOFF: "...y",
    Command.NAV_VTOL_LAND: "...y",
    Command.FENCE_POLYGON_INCLUSION: "c...",
    Command.FENCE_POLYGON_EXCLUSION: "c...",
    Command.FENCE_CIRCLE_INCLUSION: "n...",
    Command.FENCE_CIRCLE_EXCLUSION: "n...",
    Command.FENCE_RETURN_POINT: "....",
    Command.RALLY_POINT: "....",
    80: "....",  # NAV_ROI
    195: "....",  # DO_SET_ROI_LOCATION
    201: "....",  # DO_SET_ROI
    400: "....",  # COMPONENT_ARM_DISARM
    4501: "....",  # CONDITION_GATE
}
_POSITIONLESS: Final = frozenset(
    {80, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 201, 203, 204, 205, 206, 211, 214}
    | {20, 260, 400, 530, 532, 534, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000, 42600}
)
POSITION_COMMANDS: Final = frozenset(
    {
        Command.NAV_WAYPOINT,
        Command.NAV_LOITER_UNLIM,
        Command.NAV_LOITER_TIME,
        Command.NAV_LAND,
        Command.NAV_TAKEOFF,
        Command.NAV_LOITER_TO_ALT,
        Command.NAV_VTOL_TAKEOFF,
        Command.NAV_VTOL_LAND,
    }
)
_POLYGON: Final = frozenset({5001, 5002})
_FEWEST_VERTICES: Final = 3
_NOT_IN_MISSION: Final = frozenset({5001, 5002, 5003, 5004, 5100})


class RefusedItemError(Exception):
    """An uploaded item is refused.

    Attributes:
        result: What MISSION_ACK says.
        said: Whether PX4 also says so in words.
    """

    def __init__(self, result: MissionResult, *, said: bool) -> None:
        super().__init__(f"item refused: {result.name}")
        self.result = result
        self.said = said


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
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float

    @property
    def has_position(self) -> bool:
        """Whether the vehicle flies to it."""
        return self.frame != FRAME_MISSION and self.command in POSITION_COMMANDS

    @property
    def latitude_deg(self) -> float:
        """Of items with a position."""
        return self.x * 1e-7

    @property
    def longitude_deg(self) -> float:
        """Of items with a position."""
        return self.y * 1e-7

    def altitude_amsl_m(self, home_altitude_m: float, otherwise_m: float) -> float:
        """Altitude; `otherwise_m` where the item's is not a number."""
        if not math.isfinite(self.z):
            return otherwise_m
        return self.z + home_altitude_m if self.frame == FRAME_RELATIVE else self.z

    @property
    def time_inside_s(self) -> float:
        """How long to stay before the item counts as reached."""
        timed = self.command in (Command.NAV_WAYPOINT, Command.NAV_LOITER_TIME)
        return (positive(self.params[0]) or 0.0) if timed else 0.0

    def fields(self, *, as_float: bool) -> dict[str, Any]:
        """Fields of MISSION_ITEM_INT, or of MISSION_ITEM for those who ask for that."""
        param1, param2, param3, param4 = self.params
        x: float = self.x
        y: float = self.y
        frame = self.frame
        if as_float and frame != FRAME_MISSION:
            x, y, frame = self.latitude_deg, self.longitude_deg, _FLOAT_FRAMES[frame]
        return {
            "frame": frame,
            "command": self.command,
            "autocontinue": int(self.autocontinue),
            "param1": param1,
            "param2": param2,
            "param3": param3,
            "param4": param4,
            "x": x,
            "y": y,
            "z": self.z,
        }


def stored_item(message: Any, mission_type: int, *, as_float: bool) -> MissionItem:
    """What PX4 keeps of an uploaded MISSION_ITEM_INT (or MISSION_ITEM).

    Raises:
        RefusedItemError: with the result for MISSION_ACK.
    """
    raw = (message.param1, message.param2, message.param3, message.param4)
    frame = FRAME_MISSION if message.frame == FRAME_MISSION else _FRAMES.get(message.frame)
    if frame is None or (as_float and message.frame in (FRAME_AMSL, FRAME_RELATIVE)):
        raise RefusedItemError(MissionResult.UNSUPPORTED_FRAME, said=True)
    if frame == FRAME_MISSION:
        if message.command not in _POSITIONLESS:
            raise RefusedItemError(MissionResult.UNSUPPORTED, said=True)
        params, x, y = raw, _whole(message.x), _whole(message.y)
    else:
        if message.command not in _KEPT:
            raise RefusedItemError(MissionResult.UNSUPPORTED, said=True)
        params = _kept(raw, _KEPT[message.command])
        scale = 1e7 if as_float else 1.0
        x, y = _whole(message.x * scale), _whole(message.y * scale)
    few = message.command in _POLYGON and params[0] < _FEWEST_VERTICES
    stray = mission_type == MissionType.MISSION and message.command in _NOT_IN_MISSION
    if (mission_type == MissionType.FENCE and few) or stray:
        raise RefusedItemError(MissionResult.ERROR, said=False)
    return MissionItem(frame, message.command, bool(message.autocontinue), params, x, y, message.z)


def positive(value: float) -> float | None:
    """The value of a parameter that means something only above zero."""
    return value if math.isfinite(value) and value > 0 else None


def checksum(message: Any, previous: int, *, as_float: bool) -> int:
    """PX4's running CRC-32 over uploaded items; the last one is the plan's id."""
    layout = "<BHB7f" if as_float else "<BHB4fiif"
    packed = struct.pack(
        layout,
        message.frame,
        message.command,
        message.autocontinue,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        message.x,
        message.y,
        message.z,
    )
    return zlib.crc32(packed, previous ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


def _kept(raw: tuple[float, float, float, float], rule: str) -> tuple[float, float, float, float]:
    first, second, third, fourth = (_keep(value, how) for value, how in zip(raw, rule, strict=True))
    return first, second, third, fourth


def _keep(value: float, how: str) -> float:
    if how == "n":
        return value
    if how == "b":
        return 1.0 if value > 0 else 0.0
    if how == "y":
        return value % 360.0 if math.isfinite(value) else math.nan
    if how == "c":
        return float(int(value + 0.5)) if 0 <= value < 65536 else 0.0
    return 0.0


def _whole(value: float) -> int:
    if not math.isfinite(value):
        return 0
    return int(max(-(2**31), min(2**31 - 1, round(value))))


_MOST_JUMPS: Final = 10


class ItemOrder:
    """A list of items and the current one.

    Attributes:
        items: The mission.
        index: The current item; kept within the list.
    """

    def __init__(self, items: tuple[MissionItem, ...], index: int) -> None:
        self.items = items
        self.index = max(0, min(index, len(items) - 1))
        self._jumps_left = {  # by the index of its DO_JUMP
            number: _index_of(item.params[1])
            for number, item in enumerate(items)
            if item.command == Command.DO_JUMP
        }

    @property
    def at_last(self) -> bool:
        """Whether the last item is the current one."""
        return self.index + 1 == len(self.items)

    def position_from(self, index: int) -> MissionItem | None:
        """The first item with a position at or after an index."""
        return next((item for item in self.items[index:] if item.has_position), None)

    def advance(self) -> bool:
        """Go to the next item, jumps taken; False, and nothing changed, at the end."""
        index = self.index + 1
        for _ in range(_MOST_JUMPS):
            if index >= len(self.items):
                return False
            if self.items[index].command != Command.DO_JUMP:
                self.index = index
                return True
            goal = _index_of(self.items[index].params[0])
            if self._jumps_left.get(index, 0) > 0 and 0 <= goal < len(self.items):
                self._jumps_left[index] -= 1
                index = goal
            else:
                index += 1
        return False


def _index_of(value: float) -> int:
    return int(value) if math.isfinite(value) and abs(value) < 2**31 else -1
