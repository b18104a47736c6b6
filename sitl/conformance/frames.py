"""MAVLink messages by name and fields: what a conversation says and what it hears.

Some of PX4's messages are not in pymavlink's dialects or lack fields there (EVENT, the plan ids in
MISSION_CURRENT); they are unpacked here.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from sitl.mavlink.mavlink_codec import DEFINITIONS, message_name
from sitl.px4sim.state.notice import Notice, Severity
from sitl.px4sim.state.px4_modes import FlightMode

_MAGIC, _HEADER, _CHECKSUM, _SIGNATURE = 0xFD, 10, 2, 13
_OWN: Final = frozenset({"MISSION_CURRENT", "MISSION_COUNT", "MISSION_ACK", "EVENT"})


@dataclass(frozen=True, slots=True)
class Frame:
    """One MAVLink 2 frame, not looked into yet.

    Attributes:
        name: Of the message.
        system_id: The sender's.
        component_id: The sender's.
        data: All of it.
    """

    name: str
    system_id: int
    component_id: int
    data: bytes

    @property
    def payload(self) -> bytes:
        """The fields, as on the wire: zeros at the end may be missing."""
        return self.data[_HEADER : _HEADER + self.data[1]]

    def fields(self) -> dict[str, Any]:
        """The fields by name; texts as str."""
        if self.name in _OWN:
            return _unpacked(self.name, self.payload)
        message = mavlink.MAVLink(None).decode(bytearray(self.data))
        return {name: getattr(message, name) for name in message.get_fieldnames()}


def frames(datagram: bytes) -> Iterator[Frame]:
    """The MAVLink 2 frames in a datagram; unknown messages are left out."""
    at = 0
    while at + _HEADER <= len(datagram) and datagram[at] == _MAGIC:
        signature = _SIGNATURE if datagram[at + 2] & 1 else 0
        end = at + _HEADER + datagram[at + 1] + _CHECKSUM + signature
        name = message_name(int.from_bytes(datagram[at + 7 : at + 10], "little"))
        if name is not None:
            yield Frame(name, datagram[at + 5], datagram[at + 6], datagram[at:end])
        at = end


class Speaker:
    """Packs messages as one sender."""

    def __init__(self, system_id: int, component_id: int) -> None:
        self._mavlink = mavlink.MAVLink(None, system_id, component_id)

    @staticmethod
    def fields(name: str) -> list[str]:
        """The names of a message's fields."""
        return list(mavlink.mavlink_map[DEFINITIONS[name].id].fieldnames)

    def pack(self, name: str, **fields: Any) -> bytes:
        """A frame; fields that are not given are zero, a MAV_CMD may be given by its name."""
        kind = mavlink.mavlink_map[DEFINITIONS[name].id]
        values = []
        for field in kind.fieldnames:
            length = kind.array_lengths[kind.ordered_fieldnames.index(field)]
            text = kind.fieldtypes[kind.fieldnames.index(field)] == "char"
            empty: Any = b"" if text else [0] * length if length else 0
            value = fields.pop(field, empty)
            if isinstance(value, str):
                value = value.encode() if text else command_number(value)
            values.append(value)
        if fields:
            raise KeyError(f"{name} has no field {', '.join(fields)}")
        return bytes(kind(*values).pack(self._mavlink))


def command_number(command: str | int) -> int:
    """The number of a MAV_CMD by its name, such as `NAV_TAKEOFF`; a number stays itself."""
    return command if isinstance(command, int) else int(getattr(mavlink, f"MAV_CMD_{command}"))


def mode_name(custom_mode: int) -> str:
    """The name of PX4's mode in a HEARTBEAT.custom_mode."""
    for mode in FlightMode:
        if mode.custom_mode == custom_mode:
            return mode.name
    return f"{custom_mode >> 16 & 0xFF}/{custom_mode >> 24 & 0xFF}"


def event_id(name: str) -> int:
    """The number by which EVENT names one of PX4's events, such as `commander_armed_by`."""
    return Notice(Severity.INFO, event=name).event_id


def _unpacked(name: str, payload: bytes) -> dict[str, Any]:
    definition = DEFINITIONS[name]
    layout: struct.Struct = definition.layout
    values = layout.unpack(payload[: layout.size].ljust(layout.size, b"\0"))
    return dict(zip(definition.fields, values, strict=True))
