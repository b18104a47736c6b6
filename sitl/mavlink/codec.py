"""MAVLink 2 frames to and from bytes.

What the vehicle receives is parsed by pymavlink. Everything else is packed and read here: hundreds
of messages go out per simulated second, and some of PX4's (EVENT; the ids in MISSION_CURRENT) are
not in pymavlink's dialects.
"""

import binascii
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

_MAGIC, _HEADER, _CHECKSUM, _SIGNATURE = 0xFD, 10, 2, 13  # MAVLink 2 framing, bytes
_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


@dataclass(frozen=True, slots=True)
class Outgoing:
    """Name and fields of one message, as in the MAVLink definitions; arrays are tuples."""

    name: str
    fields: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Definition:
    """How one message is packed.

    Attributes:
        id: Its number.
        crc_extra: The seed of its checksum.
        layout: Of the payload.
        defaults: What a field is when it is not given, in their order on the wire: 0, a tuple of
            zeros for an array, bytes for a text.
        real: The fields of floating point.
    """

    id: int
    crc_extra: int
    layout: struct.Struct
    defaults: Mapping[str, Any]
    real: frozenset[str] = frozenset()

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """The fields as bytes; trailing zeros are left out."""
        flat: list[Any] = []
        for name, default in self.defaults.items():
            value = values.get(name, default)
            if isinstance(value, tuple):
                flat.extend(value)
            else:
                flat.append(value)
        return self.layout.pack(*flat).rstrip(b"\0") or b"\0"

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """The fields of a payload, whose trailing zeros may be missing; texts as str."""
        size = self.layout.size
        flat = iter(self.layout.unpack(payload[:size].ljust(size, b"\0")))
        fields: dict[str, Any] = {}
        for name, default in self.defaults.items():
            if isinstance(default, tuple):
                fields[name] = tuple(islice(flat, len(default)))
            elif default == b"":
                fields[name] = next(flat).split(b"\0")[0].decode(errors="replace")
            else:
                fields[name] = next(flat)
        return fields

    def checksum(self, body: bytes) -> bytes:
        """MAVLink's CRC-16/MCRF4XX of a frame without its first byte, as bytes on the wire.

        It is the CRC that `binascii` has, with every bit the other way round: ten times as fast as
        one in Python.
        """
        data = body + bytes((self.crc_extra,))
        crc = binascii.crc_hqx(data.translate(_MIRRORED), 0xFFFF)
        return bytes((crc >> 8, crc & 0xFF)).translate(_MIRRORED)


def _zeros(*names: str) -> dict[str, Any]:
    return dict.fromkeys(names, 0)


_TARGET: Final = ("target_system", "target_component")
_BEYOND_PYMAVLINK: Final = {
    "MISSION_CURRENT": Definition(
        *(42, 28, struct.Struct("<HHBBIII")),
        _zeros("seq", "total", "mission_state", "mission_mode")
        | _zeros("mission_id", "fence_id", "rally_points_id"),
    ),
    "MISSION_COUNT": Definition(
        *(44, 221, struct.Struct("<HBBBI")), _zeros("count", *_TARGET, "mission_type", "opaque_id")
    ),
    "MISSION_ACK": Definition(
        *(47, 153, struct.Struct("<BBBBI")), _zeros(*_TARGET, "type", "mission_type", "opaque_id")
    ),
    "EVENT": Definition(
        *(410, 160, struct.Struct("<IIHBBB40s")),
        _zeros("id", "event_time_boot_ms", "sequence", "destination_component")
        | _zeros("destination_system", "log_levels")
        | {"arguments": bytes(40)},
    ),
    "CURRENT_EVENT_SEQUENCE": Definition(
        *(411, 106, struct.Struct("<HB")), _zeros("sequence", "flags")
    ),
}


def _of_pymavlink(message: Any) -> Definition:
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    lengths = zip(message.ordered_fieldnames, message.array_lengths, strict=True)
    return Definition(
        message.id,
        message.crc_extra,
        message.unpacker,
        {
            name: b"" if types[name] == "char" else (0,) * length if length else 0
            for name, length in lengths
        },
        frozenset(name for name, kind in types.items() if kind in {"float", "double"}),
    )


DEFINITIONS: Final[Mapping[str, Definition]] = {
    message.msgname: _of_pymavlink(message) for message in mavlink.mavlink_map.values()
} | _BEYOND_PYMAVLINK
NAMES: Final = {definition.id: name for name, definition in DEFINITIONS.items()}
"""Of the messages, by their numbers."""


def command_number(command: str | int) -> int:
    """The number of a MAV_CMD by its name, such as `NAV_TAKEOFF`; a number stays itself."""
    return command if isinstance(command, int) else int(getattr(mavlink, f"MAV_CMD_{command}"))


class Sender:
    """Packs messages of one sender on one link, which has a sequence number of its own.

    Attributes:
        system_id: The sender's.
        component_id: The sender's.
    """

    def __init__(self, system_id: int, component_id: int = 1) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self._sequence = 0  # of the next frame, 0 to 255

    def pack(self, message: Outgoing) -> bytes:
        """The frame."""
        definition = DEFINITIONS[message.name]
        payload = definition.pack(message.fields)
        sender = (self._sequence, self.system_id, self.component_id)
        number = definition.id.to_bytes(3, "little")
        body = bytes((len(payload), 0, 0, *sender)) + number + payload
        self._sequence = (self._sequence + 1) & 0xFF
        return b"\xfd" + body + definition.checksum(body)

    def pack_values(self, name: str, fields: Mapping[str, Any]) -> bytes:
        """The frame, from whatever numbers are given; a MAV_CMD may be given by its name."""
        definition = DEFINITIONS[name]
        values: dict[str, Any] = {}
        for each, value in fields.items():
            default = definition.defaults.get(each)
            if isinstance(value, str):
                values[each] = value.encode() if default == b"" else command_number(value)
            elif isinstance(value, list | tuple):
                values[each] = tuple(value)
            elif isinstance(value, bytes):
                values[each] = value
            else:
                values[each] = float(value) if each in definition.real else int(value)
        return self.pack(Outgoing(name, values))


def addressed(name: str, vehicle: int, fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a message to a vehicle's autopilot, unless they have another target.

    Raises:
        KeyError: the message has no such field.
    """
    known = DEFINITIONS[name].defaults
    if unknown := fields.keys() - known.keys():
        raise KeyError(f"{name} has no field {', '.join(unknown)}")
    target = {"target": vehicle, "target_system": vehicle, "target_component": 1}
    return {field: value for field, value in target.items() if field in known} | dict(fields)


@dataclass(frozen=True, slots=True)
class Frame:
    """One MAVLink 2 frame, with its payload still packed.

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

    @property
    def intact(self) -> bool:
        """Whether it is a known message with the checksum that it should have."""
        if self.name not in DEFINITIONS:
            return False
        end = _HEADER + self.data[1]
        checksum = DEFINITIONS[self.name].checksum(self.data[1:end])
        return checksum == self.data[end : end + _CHECKSUM]

    def fields(self) -> dict[str, Any]:
        """The fields of a known message by name; texts as str."""
        return DEFINITIONS[self.name].unpack(self.payload)


def frames(datagram: bytes) -> Iterator[Frame]:
    """The MAVLink 2 frames in a datagram, up to the first bytes that are none."""
    at = 0
    while at + _HEADER <= len(datagram) and datagram[at] == _MAGIC:
        signature = _SIGNATURE if datagram[at + 2] & 1 else 0
        end = at + _HEADER + datagram[at + 1] + _CHECKSUM + signature
        number = int.from_bytes(datagram[at + 7 : at + 10], "little")
        name = NAMES.get(number, "")
        yield Frame(number, name, datagram[at + 5], datagram[at + 6], datagram[at:end])
        at = end


class Receiver:
    """Parses the datagrams of one link, of MAVLink 1 and 2."""

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
        return [message for message in messages if message.get_type() != "BAD_DATA"]

    def _fresh(self) -> Any:
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        return parser
