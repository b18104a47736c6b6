"""MAVLink frames as bytes: splitting datagrams, headers, signatures.

Payloads are not parsed: MAVSDK does that.
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
    """Sender and message id of a frame."""

    system_id: int
    component_id: int
    message_id: int


def header_of(frame: bytes) -> Header:
    """The header of a whole frame."""
    if frame[0] == MAVLINK_1:
        return Header(*frame[3:6])
    return Header(frame[5], frame[6], int.from_bytes(frame[7:10], "little"))


def is_signed(frame: bytes) -> bool:
    """Whether a whole frame has a signature, valid or not."""
    return frame[0] == MAVLINK_2 and bool(frame[2] & SIGNED)


def length_at(data: bytes | bytearray, at: int) -> int | None:
    """The length of the frame that starts at this position, by its first bytes.

    Returns:
        Bytes; 0 if no frame starts there, None if more bytes are needed.
    """
    if data[at] == MAVLINK_1:
        return None if at + 2 > len(data) else data[at + 1] + SHORTEST_1_BYTES
    if data[at] == MAVLINK_2:
        if at + 3 > len(data):
            return None
        return data[at + 1] + SHORTEST_2_BYTES + SIGNATURE_BYTES * bool(data[at + 2] & SIGNED)
    return 0


def frames_of(datagram: bytes) -> Iterator[bytes]:
    """The whole frames in a datagram, in order, up to the first invalid byte."""
    at = 0
    while at < len(datagram):
        length = length_at(datagram, at)
        if not length or at + length > len(datagram):
            return
        yield datagram[at : at + length]
        at += length


def without_signature(frame: bytes) -> bytes:
    """Remove the signature of a frame."""
    return _flipped(frame[:-SIGNATURE_BYTES])


def is_intact(frame: bytes, crc_extra: int) -> bool:
    """Whether an unsigned frame's checksum is correct; `crc_extra`: its message's seed."""
    return _checksum(frame[1:-2] + bytes((crc_extra,)), 0xFFFF) == frame[-2:]


def flagged(frame: bytes) -> bytes:
    """An unsigned MAVLink 2 frame with the signature flag set: the input of a signature."""
    return _flipped(frame)


def _flipped(frame: bytes) -> bytes:
    """An unsigned frame with the signature flag flipped and the checksum corrected."""
    body = bytes((frame[1], frame[2] ^ SIGNED)) + frame[3:-2]
    change = _change_of_checksum(len(body) + 1)
    return frame[:1] + body + bytes((frame[-2] ^ change[0], frame[-1] ^ change[1]))


@cache
def _change_of_checksum(length: int) -> bytes:
    """The change of a checksum over this many bytes by that flag, which is in the second byte.

    A CRC is linear: the CRCs of two texts differ by the CRC, started at 0, of the bits that differ.
    So the checksum is corrected without the message's seed (CRC_EXTRA), which depends on the
    dialect. A damaged frame stays invalid.
    """
    return _checksum(bytes((0, SIGNED)) + bytes(length - 2), 0)


def _checksum(data: bytes, start: int) -> bytes:
    """The checksum on the wire: `binascii`'s CRC-16 with reversed bits."""
    crc = binascii.crc_hqx(data.translate(_MIRRORED), start)
    return bytes((crc >> 8, crc & 0xFF)).translate(_MIRRORED)
