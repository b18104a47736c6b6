"""Packets of the datagram path, and what the receiving end knows of them. Bytes only, no sockets.

docs/datagrams.md shows the layout byte by byte.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

TOKEN_BYTES = 6
VERSION = 0x50  # upper half of the first byte; the lower half are the flags below
DATA, AGAIN, ACK = 1, 2, 4  # it has a number and frames; sent once more; it acknowledges
FLAGS = DATA | AGAIN | ACK
WINDOW = 8192  # numbers between the oldest unsettled packet and the next one
MAX_MASK = 128  # bytes of bits in an acknowledgement: what the last 1,024 packets became
MAX_NUMBER = 0xFFFFFFFE  # of a packet: the number behind it is one that can be acknowledged
ACK_DELAY_S = 0.025
LATE_PACKETS = 2  # acknowledge at once when so many wait

_PREFIX = struct.Struct(">B6s")
_ACK = struct.Struct(">IHHB")
_DATA = struct.Struct(">IH")
_SHORT = struct.Struct(">H")
_TICK_S = 0.0001
ACK_BYTES = _ACK.size
DATA_BYTES = _PREFIX.size + _DATA.size + _SHORT.size  # before the frames, at most
LENGTH_BYTES = _SHORT.size


class Ack(NamedTuple):
    """What arrived: everything below `below`, and where bit n of `bits` is set, `start` + n."""

    below: int
    start: int
    bits: int
    delay_s: float  # between the newest packet's arrival and this acknowledgement

    @property
    def end(self) -> int:
        """It covers no number from here on."""
        return max(self.below, self.start + self.bits.bit_length())

    def covers(self, number: int) -> bool:
        """Whether that packet has arrived."""
        return number < self.below or (
            number >= self.start and bool(self.bits >> (number - self.start) & 1)
        )


class Packet(NamedTuple):
    """One packet, taken apart. Without a number it only acknowledges."""

    ack: Ack | None
    number: int | None  # None: it only acknowledges
    floor: int  # the sender needs no acknowledgement below it
    content: int  # the number under which these frames were sent first
    frames: list[bytes]  # what it carries


def parse(packet: bytes) -> Packet | None:
    """Take a packet apart; None if anything in it is not as it has to be."""
    try:
        return _parsed(packet)
    except struct.error:  # it ends too early
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
    """The frames that stand in a packet from a place on; None if they do not end where it ends."""
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
    """Frames as they stand in a packet."""
    return b"".join(part for frame in frames for part in (_SHORT.pack(len(frame)), frame))


def data(  # noqa: PLR0913 - a packet has so many parts
    token: bytes, number: int, *, floor: int, content: int, body: bytes, ack: bytes
) -> bytes:
    """A numbered packet; `body` as `join` makes it, `ack` as `Arrivals.acknowledge` does."""
    flags = VERSION | DATA | (ACK if ack else 0)
    head = _DATA.pack(number, number - floor)
    if content == number:
        return _PREFIX.pack(flags, token) + ack + head + body
    return _PREFIX.pack(flags | AGAIN, token) + ack + head + _SHORT.pack(number - content) + body


def only_ack(token: bytes, ack: bytes) -> bytes:
    """A packet that acknowledges and needs no acknowledgement itself."""
    return _PREFIX.pack(VERSION | ACK, token) + ack


class Arrivals:
    """Which numbers have arrived: whatever comes twice is known, and what came is acknowledged.

    One bit for every number of the window, so a peer cannot make it grow.
    """

    def __init__(self) -> None:
        self.due_s: float | None = None  # when an acknowledgement has to leave
        self.waiting = 0  # packets that are not acknowledged yet
        self.count = 0  # different packets that arrived
        self._floor = 0  # the sender needs no acknowledgement below it
        self._seen = 0  # bit n: floor + n has arrived
        self._next = 0  # after the highest that arrived
        self._newest_s = 0.0  # when that arrived

    def take(self, packet: Packet, now_s: float) -> bool:
        """Note a packet; True if it has frames, and they are new."""
        number = packet.number
        if number is None:
            return False
        if packet.floor > self._floor:
            self._seen >>= packet.floor - self._floor
            self._floor = packet.floor
        if not self._note(number):
            self.due_s = now_s  # the acknowledgement was lost
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
        """Whether a number is in the window, and has not arrived before."""
        place = number - self._floor
        if not 0 <= place < WINDOW or self._seen >> place & 1:
            return False
        self._seen |= 1 << place
        return True

    def acknowledge(self, now_s: float, room: int = MAX_MASK) -> bytes:
        """All that a peer has to know, for a packet that leaves now; empty if it does not fit.

        `room` is for the bits, in bytes.
        """
        whole = (self._seen + 1 & ~self._seen).bit_length() - 1  # the run of ones at the bottom
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
