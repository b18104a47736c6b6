"""Packets of the datagram path, and the receiver's record of their numbers. No sockets.

docs/datagrams.md shows the layout byte by byte.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

TOKEN_BYTES = 6
VERSION = 0x50  # the upper half of the first byte; the lower half has the flags below
DATA, AGAIN, ACK = 1, 2, 4  # number and frames; a retransmission; an acknowledgement
FLAGS = DATA | AGAIN | ACK
WINDOW = 8192  # numbers between the oldest unsettled packet and the next one
MAX_MASK = 128  # bytes of bits in an acknowledgement: the last 1,024 packets
MAX_NUMBER = 0xFFFFFFFE  # of a packet: an acknowledgement can still name the next number
ACK_DELAY_S = 0.025
LATE_PACKETS = 2  # acknowledge at once when this many packets are unacknowledged

_PREFIX = struct.Struct(">B6s")
_ACK = struct.Struct(">IHHB")
_DATA = struct.Struct(">IH")
_SHORT = struct.Struct(">H")
_TICK_S = 0.0001
ACK_BYTES = _ACK.size
ALONE_BYTES = _PREFIX.size + ACK_BYTES  # of an acknowledgement alone, before its bits
DATA_BYTES = _PREFIX.size + _DATA.size + _SHORT.size  # before the frames, at most
LENGTH_BYTES = _SHORT.size


class Ack(NamedTuple):
    """The received numbers: all below `below`, and `start` + n for each set bit n of `bits`."""

    below: int
    start: int
    bits: int
    delay_s: float  # between the newest packet's arrival and this acknowledgement

    @property
    def end(self) -> int:
        """The number after the highest one that it covers."""
        return max(self.below, self.start + self.bits.bit_length())

    def covers(self, number: int) -> bool:
        """Whether it acknowledges that packet."""
        return number < self.below or (
            number >= self.start and bool(self.bits >> (number - self.start) & 1)
        )


class Packet(NamedTuple):
    """One parsed packet."""

    ack: Ack | None
    number: int | None  # None: it only acknowledges
    floor: int  # the sender needs no acknowledgement below this number
    content: int  # the number of the packet that first carried these frames
    frames: list[bytes]


def parse(packet: bytes) -> Packet | None:
    """Parse a packet; None if it is invalid."""
    try:
        return _parsed(packet)
    except struct.error:  # truncated
        return None


def _parsed(packet: bytes) -> Packet | None:
    flags, _ = _PREFIX.unpack_from(packet)
    if flags & ~FLAGS != VERSION:
        return None
    at = _PREFIX.size
    ack = None
    if flags & ACK:
        below, skip, delay, length = _ACK.unpack_from(packet, at)
        bits = packet[at + ACK_BYTES : at + ACK_BYTES + length]
        at += ACK_BYTES + length
        if length > MAX_MASK or skip > WINDOW or at > len(packet):
            return None
        ack = Ack(below, below + skip, int.from_bytes(bits, "little"), delay * _TICK_S)
    if not flags & DATA:
        alone = ack and at == len(packet) and not flags & AGAIN
        return Packet(ack, None, 0, 0, []) if alone else None
    number, behind = _DATA.unpack_from(packet, at)
    at += _DATA.size
    back = 0
    if flags & AGAIN:
        (back,) = _SHORT.unpack_from(packet, at)
        at += _SHORT.size
    if number > MAX_NUMBER or behind >= WINDOW or behind > number:
        return None
    if back > behind or (back == 0) != (not flags & AGAIN):
        return None
    frames = split(packet, at)
    return None if frames is None else Packet(ack, number, number - behind, number - back, frames)


def split(packet: bytes, at: int) -> list[bytes] | None:
    """The frames in a packet from an offset on; None if the last one does not end with it."""
    frames = []
    size = len(packet)
    while at < size:
        begin = at + LENGTH_BYTES
        if begin > size:
            return None
        at = begin + (packet[at] << 8 | packet[at + 1])
        if at > size:
            return None
        frames.append(packet[begin:at])
    return frames


def join(frames: Iterable[bytes]) -> bytes:
    """Encode frames for a packet."""
    return b"".join(part for frame in frames for part in (_SHORT.pack(len(frame)), frame))


def data(  # noqa: PLR0913 - the fields of the packet
    token: bytes, number: int, *, floor: int, content: int, body: bytes, ack: bytes
) -> bytes:
    """A numbered packet; `body` from `join`, `ack` from `Arrivals.acknowledge`."""
    flags = VERSION | DATA | (ACK if ack else 0)
    head = _DATA.pack(number, number - floor)
    if content == number:
        return _PREFIX.pack(flags, token) + ack + head + body
    return _PREFIX.pack(flags | AGAIN, token) + ack + head + _SHORT.pack(number - content) + body


def only_ack(token: bytes, ack: bytes) -> bytes:
    """A packet with an acknowledgement only, which is not acknowledged itself."""
    return _PREFIX.pack(VERSION | ACK, token) + ack


class Arrivals:
    """The received numbers, to detect duplicates and to acknowledge packets.

    It keeps one bit for every number of the window, so a peer cannot make it grow.
    """

    def __init__(self) -> None:
        self.due_s: float | None = None  # when an acknowledgement must be sent
        self.waiting = 0  # received packets that are not acknowledged yet
        self.count = 0  # distinct packets received
        self._floor = 0  # the sender needs no acknowledgement below this number
        self._seen = 0  # bit n: floor + n was received
        self._next = 0  # the number after the highest one received
        self._newest_s = 0.0  # when the highest one was received

    def take(self, packet: Packet, now_s: float) -> bool:
        """Note a packet; returns whether it has frames, and they are new."""
        number = packet.number
        if number is None:
            return False
        if packet.floor > self._floor:
            self._seen >>= packet.floor - self._floor
            self._floor = packet.floor
        if not self._note(number):
            self.due_s = now_s  # a copy: our acknowledgement was lost
            return False
        self.count += 1
        self.waiting += 1
        if number != self._next or not packet.frames or self.waiting >= LATE_PACKETS:
            self.due_s = now_s
        elif self.due_s is None:
            self.due_s = now_s + ACK_DELAY_S
        if number >= self._next:
            self._next = number + 1
            self._newest_s = now_s
        new = packet.content == number or self._note(packet.content)
        return new and bool(packet.frames)

    def _note(self, number: int) -> bool:
        """Note a number; returns whether it is in the window, and was not received before."""
        place = number - self._floor
        if not 0 <= place < WINDOW or self._seen >> place & 1:
            return False
        self._seen |= 1 << place
        return True

    def defer(self) -> None:
        """Let no acknowledgement be due before the next packet is received."""
        self.due_s = None

    def acknowledge(self, now_s: float, room: int = MAX_MASK) -> bytes:
        """An acknowledgement for a packet that is sent now; empty if it does not fit.

        `room`: the bytes available for the bits.
        """
        whole = (self._seen + 1 & ~self._seen).bit_length() - 1  # the number of trailing ones
        rest = self._seen >> whole
        length = (rest.bit_length() + 7) // 8
        skip = 0
        if length > MAX_MASK:
            skip = (length - MAX_MASK) * 8
            rest >>= skip
            length = MAX_MASK
        if length > room:
            return b""
        delay = min(int((now_s - self._newest_s) / _TICK_S), 0xFFFF) if self.count else 0
        self.due_s = None
        self.waiting = 0
        below = self._floor + whole
        return _ACK.pack(below, skip, max(delay, 0), length) + rest.to_bytes(length, "little")
