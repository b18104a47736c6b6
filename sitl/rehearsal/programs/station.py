"""What is sent to vehicle and companion in a rehearsal: by a ground station, and by strangers."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

from sitl.rehearsal.judge.evidence import COMPANION, WireMessage
from sitl.rehearsal.judge.mission_reader import Pair
from sitl.rehearsal.programs.relay import LossyRelay

_FLOOD = 300


def intrusion(kind: str, dice: random.Random) -> list[bytes]:
    """The datagrams of one kind; see `scenes`."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    if kind == "noise":
        return [dice.randbytes(dice.randrange(1, 300)) for _ in range(20)]
    if kind == "truncated":
        whole = _packed(sender, sender.heartbeat_encode(2, 12, 0, 0x06040000, 4))
        return [whole[:length] for length in range(1, len(whole))]
    if kind == "flood":
        return [_packed(sender, sender.ping_encode(0, n, 0, 0)) for n in range(_FLOOD)]
    if kind == "other vehicle":
        other = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
        return [_packed(other, other.heartbeat_encode(2, 12, 0, 0x06040000, 6))]
    home = (399421523, -751997644)
    return [  # as a vehicle that has just been started
        _packed(sender, sender.system_time_encode(0, 1000)),
        _packed(sender, sender.global_position_int_encode(1000, *home, 0, 0, 0, 0, 0, 0)),
        _packed(sender, sender.attitude_encode(1000, 0, 0, 0, 0, 0, 0)),
    ]


def _packed(sender: Any, message: Any) -> bytes:
    return bytes(message.pack(sender))


MODES: Final[Mapping[str, int]] = {
    "HOLD": 0x03040000,
    "MISSION": 0x04040000,
    "RETURN": 0x05040000,
    "LAND": 0x06040000,
    "ALTCTL": 0x00020000,
    "POSCTL": 0x00030000,
}
"""HEARTBEAT.custom_mode of PX4's modes."""

_SET_MODE, _ARM, _SPEED, _SET_HOME = 176, 400, 178, 179  # MAV_CMD
_FORCED: Final = 21196.0
_FENCE, _MISSION, _REAL32 = 1, 0, 9


class Station:
    """Sends as a ground station does; the vehicle hears it through the relay.

    Args:
        relay: Passes it on.
        system: Of the station.
        vehicle: System id of the vehicle.
    """

    def __init__(self, relay: LossyRelay, system: int = 255, vehicle: int = 1) -> None:
        self._relay = relay
        self._sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self._vehicle = vehicle
        self._plan: Sequence[Mapping[str, Any]] = ()  # items of the last upload
        self._kind = _MISSION  # their MAV_MISSION_TYPE
        self._stored: Callable[[], object] = lambda: None  # called at their MISSION_ACK

    def beat(self) -> None:
        """A station's HEARTBEAT."""
        self._send(self._sender.heartbeat_encode(6, 8, 0, 0, 4))

    def choose(self, mode: str) -> None:
        """DO_SET_MODE."""
        number = MODES[mode]
        self._command(_SET_MODE, 1, number >> 16 & 0xFF, number >> 24)

    def disarm(self, *, forced: bool) -> None:
        """As it is: refused in the air, unless it is forced."""
        self._command(_ARM, 0, _FORCED if forced else 0.0)

    def change_speed(self, speed_m_s: float) -> None:
        """DO_CHANGE_SPEED over ground."""
        self._command(_SPEED, 1, speed_m_s, -1)

    def move_home(self, place: Pair, altitude_amsl_m: float) -> None:
        """DO_SET_HOME to a place."""
        latitude, longitude = (round(degrees * 1e7) for degrees in place)
        target = (self._vehicle, 1, 0, _SET_HOME, 0, 0, 0, 0, 0, 0)
        self._send(self._sender.command_int_encode(*target, latitude, longitude, altitude_amsl_m))

    def sticks(self, pitch: int, throttle: int = 500) -> None:
        """MANUAL_CONTROL, -1000 to 1000; throttle 0 to 1000."""
        self._send(self._sender.manual_control_encode(self._vehicle, pitch, 0, throttle, 0, 0))

    def set_parameter(self, name: str, value: float) -> None:
        """PARAM_SET of a real number."""
        self._send(self._sender.param_set_encode(self._vehicle, 1, name.encode(), value, _REAL32))

    def clear(self, kind: int) -> None:
        """Take mission (0) or fence (1) off board."""
        self._send(self._sender.mission_clear_all_encode(self._vehicle, 1, kind))

    def upload(
        self,
        items: Sequence[Mapping[str, Any]],
        kind: int = _MISSION,
        stored: Callable[[], object] = lambda: None,
    ) -> None:
        """Begin to put a plan on board: the vehicle asks for its items until it has `stored` it."""
        self._plan, self._kind, self._stored = items, kind, stored
        self._relay.answers = self._answer
        self._send(self._sender.mission_count_encode(self._vehicle, 1, len(items), kind))

    def _answer(self, message: WireMessage) -> None:
        if message.name == "MISSION_ACK" and message.target == self._sender.srcSystem:
            self._stored()
        asked = message.name in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}
        if not asked or message.target != self._sender.srcSystem:
            return
        seq = int(message.fields["seq"])
        if seq < len(self._plan):
            item = self._plan[seq]
            values = [item[name] for name in ("frame", "command", "current", "autocontinue")]
            values += [item[name] for name in ("param1", "param2", "param3", "param4")]
            values += [item[name] for name in ("x", "y", "z")]
            target = (self._vehicle, 1, seq)
            self._send(self._sender.mission_item_int_encode(*target, *values, self._kind))

    def _command(self, command: int, *parameters: float) -> None:
        values = [*parameters, *[0.0] * (7 - len(parameters))]
        self._send(self._sender.command_long_encode(self._vehicle, 1, command, 0, *values))

    def _send(self, message: Any) -> None:
        self._relay.inject(bytes(message.pack(self._sender)))


def items_of(messages: Sequence[WireMessage], kind: int) -> list[dict[str, Any]]:
    """What the companion has put on board, as a station would download and send it again."""
    items = {
        int(m.fields["seq"]): dict(m.fields)
        for m in messages
        if m.name == "MISSION_ITEM_INT"
        and m.component == COMPANION
        and m.fields.get("mission_type", 0) == kind
    }
    return [items[seq] for seq in sorted(items)]
