"""MAVLink 2 frames to and from bytes.

Received frames are parsed by pymavlink. Sent ones are packed here: hundreds go out per simulated
second, and some of PX4's (EVENT; the ids in MISSION_CURRENT) are not in pymavlink's dialects.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from sitl.px4sim.state.notice import Outgoing

_MISSION_CURRENT: Final = ("seq", "total", "mission_state", "mission_mode")
_PLAN_IDS: Final = ("mission_id", "fence_id", "rally_points_id")
_MAGIC, _HEADER, _CHECKSUM, _SIGNATURE = 0xFD, 10, 2, 13  # MAVLink 2 framing, bytes
_EVENT: Final = ("id", "event_time_boot_ms", "sequence", "destination_component")


@dataclass(frozen=True, slots=True)
class Definition:
    """How one message is packed: its id, CRC seed, fields in their order, zeros of arrays."""

    name: str
    id: int
    crc_extra: int
    layout: struct.Struct
    fields: tuple[str, ...]
    arrays: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def payload(self, values: Mapping[str, Any]) -> bytes:
        """The fields as bytes; arrays are given as tuples. What is not given is 0.

        Trailing zeros are left out.
        """
        flat: list[Any] = []
        for name in self.fields:
            value = values[name] if name in values else self.arrays.get(name, 0)
            if isinstance(value, tuple):
                flat.extend(value)
            else:
                flat.append(value)
        return self.layout.pack(*flat).rstrip(b"\0") or b"\0"


_BEYOND_PYMAVLINK: Final = (
    Definition("MISSION_CURRENT", 42, 28, struct.Struct("<HHBBIII"), _MISSION_CURRENT + _PLAN_IDS),
    Definition(
        "MISSION_COUNT",
        44,
        221,
        struct.Struct("<HBBBI"),
        ("count", "target_system", "target_component", "mission_type", "opaque_id"),
    ),
    Definition(
        "MISSION_ACK",
        47,
        153,
        struct.Struct("<BBBBI"),
        ("target_system", "target_component", "type", "mission_type", "opaque_id"),
    ),
    Definition(
        "EVENT",
        410,
        160,
        struct.Struct("<IIHBBB40s"),
        (*_EVENT, "destination_system", "log_levels", "arguments"),
    ),
    Definition("CURRENT_EVENT_SEQUENCE", 411, 106, struct.Struct("<HB"), ("sequence", "flags")),
)


def _definitions() -> dict[str, Definition]:
    known = {
        message.msgname: Definition(
            message.msgname,
            message.id,
            message.crc_extra,
            message.unpacker,
            tuple(message.ordered_fieldnames),
            {
                name: (0,) * length
                for name, length in zip(
                    message.ordered_fieldnames, message.array_lengths, strict=True
                )
                if length
            },
        )
        for message in mavlink.mavlink_map.values()
    }
    return known | {definition.name: definition for definition in _BEYOND_PYMAVLINK}


DEFINITIONS: Final[Mapping[str, Definition]] = _definitions()


class Sender:
    """Packs messages of one sender on one link, which has a sequence number of its own."""

    def __init__(self, system_id: int, component_id: int = 1) -> None:
        self._system_id = system_id
        self._component_id = component_id
        self._sequence = 0  # of the next frame, 0 to 255

    def pack(self, message: Outgoing) -> bytes:
        """The frame."""
        definition = DEFINITIONS[message.name]
        payload = definition.payload(message.fields)
        identifier = definition.id
        body = (
            bytes(
                (
                    len(payload),
                    0,
                    0,
                    self._sequence,
                    self._system_id,
                    self._component_id,
                    identifier & 0xFF,
                    identifier >> 8 & 0xFF,
                    identifier >> 16,
                )
            )
            + payload
        )
        self._sequence = (self._sequence + 1) & 0xFF
        return b"\xfd" + body + _checksum(body + bytes((definition.crc_extra,)))


def _checksum(data: bytes) -> bytes:
    """MAVLink's CRC-16/MCRF4XX, as bytes on the wire.

    It is the CRC that `binascii` has, with every bit the other way round: ten times as fast as one
    in Python, and hundreds of messages go out in every simulated second.
    """
    crc = binascii.crc_hqx(data.translate(_MIRRORED), 0xFFFF)
    return bytes((crc >> 8, crc & 0xFF)).translate(_MIRRORED)


_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class MessagePacker:
    """Packs messages of a ground station or a companion from whatever fields are given."""

    def __init__(self, system_id: int, component_id: int) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self._mavlink = mavlink.MAVLink(None, system_id, component_id)

    @staticmethod
    def addressed(name: str, vehicle: int, fields: Mapping[str, Any]) -> dict[str, Any]:
        """The fields of a message to a vehicle's autopilot, unless they have another target.

        Raises:
            KeyError: the message has no such field.
        """
        known = mavlink.mavlink_map[DEFINITIONS[name].id].fieldnames
        if unknown := fields.keys() - set(known):
            raise KeyError(f"{name} has no field {', '.join(unknown)}")
        target = {"target": vehicle, "target_system": vehicle, "target_component": 1}
        return {field: value for field, value in target.items() if field in known} | dict(fields)

    def pack(self, name: str, fields: Mapping[str, Any]) -> bytes:
        """A frame; fields that are not given are zero, a MAV_CMD may be given by its name."""
        kind = mavlink.mavlink_map[DEFINITIONS[name].id]
        values = []
        for each, of in zip(kind.fieldnames, kind.fieldtypes, strict=True):
            length = kind.array_lengths[kind.ordered_fieldnames.index(each)]
            empty: Any = b"" if of == "char" else [0] * length if length else 0
            value = fields.get(each, empty) or empty
            if isinstance(value, str):
                value = value.encode() if of == "char" else command_number(value)
            elif not isinstance(value, list | tuple | bytes):
                value = float(value) if of in {"float", "double"} else int(value)
            values.append(value)
        return bytes(kind(*values).pack(self._mavlink))


def command_number(command: str | int) -> int:
    """The number of a MAV_CMD by its name, such as `NAV_TAKEOFF`; a number stays itself."""
    return command if isinstance(command, int) else int(getattr(mavlink, f"MAV_CMD_{command}"))


@dataclass(frozen=True, slots=True)
class Frame:
    """One MAVLink 2 frame, not looked into yet.

    Attributes:
        number: Of the message.
        name: Of the message; empty: it is unknown.
        system_id: The sender's.
        component_id: The sender's.
        data: All of it.
    """

    number: int
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
        own = _OWN.get(self.number)
        if own is None:
            message = mavlink.MAVLink(None).decode(bytearray(self.data))
            return {name: getattr(message, name) for name in message.get_fieldnames()}
        size = own.layout.size
        values = own.layout.unpack(self.payload[:size].ljust(size, b"\0"))
        return dict(zip(own.fields, values, strict=True))


def frames(datagram: bytes) -> Iterator[Frame]:
    """The MAVLink 2 frames in a datagram; what is none ends it."""
    at = 0
    while at + _HEADER <= len(datagram) and datagram[at] == _MAGIC:
        signature = _SIGNATURE if datagram[at + 2] & 1 else 0
        end = at + _HEADER + datagram[at + 1] + _CHECKSUM + signature
        number = int.from_bytes(datagram[at + 7 : at + 10], "little")
        name = _NAMES.get(number, "")
        yield Frame(number, name, datagram[at + 5], datagram[at + 6], datagram[at:end])
        at = end


class Receiver:
    """Parses the datagrams of one link."""

    def __init__(self) -> None:
        self._parser = self._fresh()  # pymavlink's, empty between datagrams

    def parse(self, datagram: bytes) -> list[Any]:
        """The valid messages in a datagram; a frame never goes over two datagrams."""
        try:
            messages = self._parser.parse_buffer(datagram) or []
        except (mavlink.MAVError, struct.error, ValueError, IndexError):
            messages = []
        if self._parser.buf_len():
            self._parser = self._fresh()  # the rest of a broken frame must not swallow the next
        return [message for message in messages if message.get_type() not in _NOT_MESSAGES]

    def _fresh(self) -> Any:
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        return parser


_NOT_MESSAGES: Final = frozenset({"BAD_DATA"})


def message_name(identifier: int) -> str | None:
    """The name of a message id, None if it is unknown."""
    return _NAMES.get(identifier)


_OWN: Final = {definition.id: definition for definition in _BEYOND_PYMAVLINK}
_NAMES: Final = {definition.id: name for name, definition in DEFINITIONS.items()}
