"""What a database holds: messages with their headers, and what is known of a peer's database.

A header is the 6-byte name of a message on the wire: who, what, and when modulo 65536 seconds.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, Self

from mocha_link.errors import MochaLinkError

WRAP_S = 65536
WRAP_MS = WRAP_S * 1000
# A stamp is taken for the one between 15.2 h ago and 3 h ahead: old messages are common, messages
# from the future only come from badly set clocks.
AHEAD_MS = 3 * 3600 * 1000
# Original nodes stop for good over a message in the first second of the 65536.
UNSAFE_MS = 1000

_LAYOUT = struct.Struct(">BBHH")


class HeaderError(MochaLinkError):
    """Bytes or numbers that are not a message header."""


@dataclass(frozen=True, slots=True)
class Header:
    """`seconds` is Unix time modulo 65536; `milliseconds` 0 to 999. Raises HeaderError."""

    SIZE: ClassVar[int] = _LAYOUT.size

    robot_id: int  # see `Team`
    topic_id: int  # see `Team`
    seconds: int
    milliseconds: int

    def __post_init__(self) -> None:
        limits = (256, 256, WRAP_S, 1000)
        values = (self.robot_id, self.topic_id, self.seconds, self.milliseconds)
        for value, limit in zip(values, limits, strict=True):
            if not 0 <= value < limit:
                raise HeaderError(f"{value} in header {values} is not within 0 to {limit - 1}")

    @classmethod
    def at(cls, robot_id: int, topic_id: int, stamp_ms: int) -> Self:
        """The header of a message of that time, in whole milliseconds of Unix time."""
        seconds, milliseconds = divmod(stamp_ms % WRAP_MS, 1000)
        return cls(robot_id, topic_id, seconds, milliseconds)

    @classmethod
    def parse(cls, raw: bytes) -> Self:
        """Read the 6 bytes of the wire. Raises HeaderError."""
        if len(raw) != cls.SIZE:
            raise HeaderError(f"a header has {cls.SIZE} bytes, not {len(raw)}")
        return cls(*_LAYOUT.unpack(raw))

    def pack(self) -> bytes:
        """The 6 bytes of the wire, big endian."""
        return _LAYOUT.pack(self.robot_id, self.topic_id, self.seconds, self.milliseconds)

    @property
    def hangs_old_nodes(self) -> bool:
        """Whether its time is in the first second after a wrap (see UNSAFE_MS)."""
        return self.wrapped_ms <= UNSAFE_MS

    def stamp_s(self, near_s: float) -> float:
        """Unix seconds of the message, as it is seen at Unix time `near_s`."""
        return self.stamp_ms(near_s) / 1000

    def stamp_ms(self, near_s: float) -> int:
        """The same in milliseconds."""
        latest = latest_ms(near_s)
        return latest - (latest - self.wrapped_ms) % WRAP_MS

    @property
    def wrapped_ms(self) -> int:
        """Its time in milliseconds, modulo 65536 s."""
        return self.seconds * 1000 + self.milliseconds

    def __str__(self) -> str:
        return self.pack().hex()


def as_ms(unix_s: float) -> int:
    """Whole milliseconds, without losing one to binary fractions."""
    return round(unix_s * 1_000_000) // 1000


def latest_ms(now_s: float) -> int:
    """The latest stamp that a header may stand for at Unix `now_s`; no stamp is before 1970."""
    return max(as_ms(now_s) + AHEAD_MS, WRAP_MS - 1)


def next_stamp_ms(now_s: float, last_ms: int | None) -> int:
    """The time that a new message gets: now, but later than the last one and safe for old nodes."""
    stamp = as_ms(now_s)
    if last_ms is not None:
        stamp = max(stamp, last_ms + 1)
    early = UNSAFE_MS - stamp % WRAP_MS
    return stamp + early + 1 if early >= 0 else stamp


@dataclass(frozen=True, slots=True)
class Record:
    """A message as it is stored and passed on: `body` is what the wire carries, untouched.

    `stamp_ms` is when the robot published it, Unix milliseconds below 2**47 that agree with the
    header modulo 65536 s; `received_s` is when we got or made it. `extrapolated`: the stamp
    was guessed from the header by our clock, as that of an original node has to be: if the clock
    was wrong, it is wrong by a multiple of 65536 s, and comparisons bear with that. `body` is a
    read-only view if it came in a buffer of its own.
    """

    header: Header
    priority: int  # of the topic; greater is more urgent
    body: bytes | memoryview
    stamp_ms: int
    received_s: float
    extrapolated: bool = False

    @property
    def stamp_s(self) -> float:
        """Unix seconds of publication."""
        return self.stamp_ms / 1000


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What we know of a peer's database.

    Everything that it held up to its number `sequence` of its `epoch` has been offered to us. Our
    own last number was `own_sequence` then. Each is a u64; ValueError otherwise.
    """

    epoch: int
    sequence: int
    own_sequence: int

    def __post_init__(self) -> None:
        for value in (self.epoch, self.sequence, self.own_sequence):
            if not 0 <= value < 1 << 64:
                raise ValueError(f"{value} is not within 0 to 2**64 - 1")
