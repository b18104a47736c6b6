"""MAVLink frames as bytes: cut out of a datagram, and whose they are.

No payload is looked into: what is in a message is for MAVSDK.
"""

import binascii
from collections.abc import Iterator
from functools import cache
from typing import Final, NamedTuple

from air_router.vehicle.px4.mavlink_values import (
    MAVLINK_1,
    MAVLINK_2,
    SHORTEST_1_BYTES,
    SHORTEST_2_BYTES,
    SIGNATURE_BYTES,
    SIGNED,
)

_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class Header(NamedTuple):
    """Whose message a frame is, and which."""

    system_id: int
    component_id: int
    message_id: int


def header_of(frame: bytes) -> Header:
    """Of a whole frame."""
    if frame[0] == MAVLINK_1:
        return Header(*frame[3:6])
    return Header(frame[5], frame[6], int.from_bytes(frame[7:10], "little"))


def is_signed(frame: bytes) -> bool:
    """Whether a whole frame has a signature, a right one or not."""
    return frame[0] == MAVLINK_2 and bool(frame[2] & SIGNED)


def length_at(data: bytes | bytearray, at: int) -> int | None:
    """How long the frame is that begins there, as far as its first bytes say.

    Returns:
        Bytes; 0 if no frame begins there, None if more bytes are needed to know.
    """
    if data[at] == MAVLINK_1:
        return None if at + 2 > len(data) else data[at + 1] + SHORTEST_1_BYTES
    if data[at] == MAVLINK_2:
        if at + 3 > len(data):
            return None
        return data[at + 1] + SHORTEST_2_BYTES + SIGNATURE_BYTES * bool(data[at + 2] & SIGNED)
    return 0


def frames_of(datagram: bytes) -> Iterator[bytes]:
    """The whole frames in a datagram, in order; what is none ends it."""
    at = 0
    while at < len(datagram):
        length = length_at(datagram, at)
        if not length or at + length > len(datagram):
            return
        yield datagram[at : at + length]
        at += length


def without_signature(frame: bytes) -> bytes:
    """A signed frame as it was before it was signed."""
    return _flipped(frame[:-SIGNATURE_BYTES])


def is_intact(frame: bytes, crc_extra: int) -> bool:
    """Whether a frame without a signature has its checksum; `crc_extra`: its message's seed."""
    return _checksum(frame[1:-2] + bytes((crc_extra,)), 0xFFFF) == frame[-2:]


def flagged(frame: bytes) -> bytes:
    """A MAVLink 2 frame without a signature that reports that it has one: what is signed."""
    return _flipped(frame)


def _flipped(frame: bytes) -> bytes:
    """A frame without a signature, with that flag flipped, and the checksum that goes with it."""
    body = bytes((frame[1], frame[2] ^ SIGNED)) + frame[3:-2]
    change = _change_of_checksum(len(body) + 1)
    return frame[:1] + body + bytes((frame[-2] ^ change[0], frame[-1] ^ change[1]))


@cache
def _change_of_checksum(length: int) -> bytes:
    """What that flag changes in a checksum over so many bytes; the flags are the second of them.

    A CRC is linear: that of two texts which differ in some bits differs by the CRC, begun at 0, of
    those bits alone. So the checksum is corrected without the seed of its message (CRC_EXTRA),
    which differs by dialect; a frame that was damaged on the way stays one.
    """
    return _checksum(bytes((0, SIGNED)) + bytes(length - 2), 0)


def _checksum(data: bytes, start: int) -> bytes:
    """As on the wire: the CRC-16 that `binascii` has, with every bit the other way round."""
    crc = binascii.crc_hqx(data.translate(_MIRRORED), start)
    return bytes((crc >> 8, crc & 0xFF)).translate(_MIRRORED)
