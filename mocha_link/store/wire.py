"""A message on the wire: a header of 6 bytes, and a body.

The header has robot, topic, and time modulo 65536 seconds. The body is DTYPE u8, PRIORITY u8, one
LZ4 frame, and a trailer. Old nodes carry on what stands behind the frame without reading it, so
that is where the trailer of ours is: magic (4 bytes), version (u8 and its complement), its own
length u16, stamp u48 (Unix ms), then perhaps a signature (64 bytes), then a CRC-32. Of version 2
that is of robot id, topic id and the whole body up to there, so a message cannot be taken for one
of another topic of the same time; of version 1, which storages may still hold, of the body only.
Anything else behind the frame is carried on and not read.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple, Self

import lz4.frame

from mocha_link.errors import MochaLinkError

Body = bytes | memoryview
Ids = tuple[int, int]
"""Robot id and topic id: whose message it is, and of which of its topics."""

WRAP_S = 65536
WRAP_MS = WRAP_S * 1000
# A stamp is taken for the one between 15.2 h ago and 3 h ahead: old messages are common, messages
# from the future only come from badly set clocks.
AHEAD_MS = 3 * 3600 * 1000
# Original nodes stop for good over a message in the first second of the 65536.
UNSAFE_MS = 1000

MAX_BYTES = 64 * 1024 * 1024
MAX_BODY_BYTES = MAX_BYTES + 1024 * 1024  # incompressible data, and what may stand behind it
PREFIX = 2
STAMPS_MS = 2**47
STAMP_MASK = (1 << 48) - 1  # of a message id
# 139 years from now: our clock may not be set, and what was forged for then has a later time soon.
FUTURE_MS = 2**42
MAGIC = b"\xd6mcl"
VERSION = 2  # version 1: the checksum does not cover the ids
SIGNATURE_BYTES = 64
MAX_BLOCKS = 65_536  # no encoder needs more; each costs us time before anything is known of it

_HEADER = struct.Struct(">BBHH")
_STEP_BYTES = 1024 * 1024
_CHECK_BYTES = 120 * 1024  # from the allocator's warm memory; more would be new memory every time
_FRAME_MAGIC = b"\x04\x22\x4d\x18"
_BLOCK_BYTES = {4: 1 << 16, 5: 1 << 18, 6: 1 << 20, 7: 1 << 22}
_MOST_PER_BYTE = 255  # an LZ4 block cannot unpack to more than this per byte
_STORED = 1 << 31
_U32 = struct.Struct("<I")
_U64 = struct.Struct("<Q")
_CRC = struct.Struct(">I")
# Magic, version, its complement, length, stamp: the upper 16 and the lower 32 bits.
_TRAILER = struct.Struct(f">{len(MAGIC)}sBBHHI")
_BARE, _SIGNED = _TRAILER.size + _CRC.size, _TRAILER.size + SIGNATURE_BYTES + _CRC.size


class HeaderError(MochaLinkError):
    """Bytes or numbers that are not a message header."""


@dataclass(frozen=True, slots=True)
class Header:
    """`seconds` is Unix time modulo 65536; `milliseconds` 0 to 999. Raises HeaderError."""

    SIZE: ClassVar[int] = _HEADER.size

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
        return cls(*_HEADER.unpack(raw))

    def pack(self) -> bytes:
        """The 6 bytes of the wire, big endian."""
        return _HEADER.pack(self.robot_id, self.topic_id, self.seconds, self.milliseconds)

    @property
    def key(self) -> int:
        """Its topic as one number, robot id * 256 + topic id: as its first two bytes read."""
        return self.robot_id << 8 | self.topic_id

    def stamp_s(self, near_s: float) -> float:
        """Unix seconds of the message, nearest to Unix time `near_s`."""
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


def is_taken(stamp_ms: int, now_s: float) -> bool:
    """Whether a message of that time may come from others at Unix `now_s`."""
    return stamp_ms < as_ms(now_s) + FUTURE_MS


class PayloadError(MochaLinkError):
    """A message that cannot be sent, or a received body that is not one."""


@dataclass(frozen=True, slots=True)
class Trailer:
    """The trailer of a new node behind the LZ4 frame: the stamp, and perhaps a signature."""

    stamp_ms: int  # Unix milliseconds
    signature: bytes | None = None  # Ed25519; None: unsigned
    version: int = VERSION  # of the trailer
    at: int = field(default=0, compare=False)  # where in the body the LZ4 frame ends


class _Frame(NamedTuple):
    """An LZ4 frame in a body: where it ends, the stated size of its data, the most it may hold."""

    end: int  # offset behind it
    size: int | None  # None: it is not stated
    most: int  # bytes of data, by its blocks


def pack(  # noqa: PLR0913 - what a message is made from
    dtype: int,
    priority: int,
    data: bytes,
    *,
    stamp_ms: int,
    ids: Ids | None = None,
    sign: Callable[[bytes], bytes] | None = None,
    frame: bytes | None = None,
) -> bytes:
    """The body for data, signed if `sign` is given: what original nodes make, and our trailer.

    Without `ids` the trailer is of version 1. `frame` is what `compress` made of the data, if
    the caller has called it already.

    Raises:
        PayloadError: larger than any node would accept.
    """
    check_size(data)
    if frame is None:
        frame = compress(data)
    prefix = bytes((dtype, priority))
    if not 0 <= stamp_ms < STAMPS_MS:
        raise PayloadError(f"stamp {stamp_ms} ms is no time; set the clock")
    signature = sign(statement(prefix, stamp_ms, frame)) if sign else b""
    length = _SIGNED if signature else _BARE
    upper, lower = stamp_ms >> 32, stamp_ms & 0xFFFFFFFF
    version = VERSION if ids else 1
    head = _TRAILER.pack(MAGIC, version, version ^ 255, length, upper, lower)
    crc = zlib.crc32(bytes(ids or ()))
    for part in (prefix, frame, head, signature):
        crc = zlib.crc32(part, crc)
    return b"".join((prefix, frame, head, signature, _CRC.pack(crc)))


def compress(data: bytes) -> bytes:
    """The LZ4 frame of data: the longest part of `pack`."""
    frame: bytes = lz4.frame.compress(data)
    return frame


def check_size(data: bytes, more: int = 0) -> None:
    """Raise PayloadError if data, and `more` bytes, are larger than any node would accept."""
    size = memoryview(data).nbytes + more  # TypeError without a buffer of bytes
    if size > MAX_BYTES:
        raise PayloadError(f"{size} bytes; at most {MAX_BYTES} can be sent: split the message")


def unpack(body: Body, limit: int = MAX_BYTES) -> bytes:
    """The data in a body, decompressed to at most `limit` bytes. Raises PayloadError.

    Only reads: what came from outside goes through `check` once, before it is kept.
    """
    return b"".join(_decompressed(body, _frame(body), limit))


def check(
    body: Body, ids: Ids | None = None, stamp_ms: int | None = None, limit: int = MAX_BYTES
) -> Trailer | None:
    """Verify everything in a body but the signature; its trailer, if it has one.

    `ids` are the ids of the header; only a message without a trailer of version 2 passes without.
    `stamp_ms` is the announced time of publication, where it is known in full.

    It takes next to no memory, whatever the body states.

    Raises:
        PayloadError: not an LZ4 frame, larger than `limit`, damaged on its way, or the message
            of another robot, topic or time.
    """
    frame = _frame(body)
    found = _trailer(body, frame.end)
    if found:
        length = _SIGNED if found.signature else _BARE
        crc_at = frame.end + length - _CRC.size
        seed = zlib.crc32(bytes(ids or ())) if found.version > 1 else 0
        if zlib.crc32(memoryview(body)[:crc_at], seed) != _CRC.unpack_from(body, crc_at)[0]:
            raise PayloadError("damaged on its way: its checksum is another one")
    if found and stamp_ms is not None and found.stamp_ms != stamp_ms:
        raise PayloadError(f"of time {found.stamp_ms} ms, but its id has {stamp_ms} ms")
    _decompressed(body, frame, limit, _CHECK_BYTES)
    return found


def statement(prefix: Body, stamp_ms: int, frame: Body) -> bytes:
    """What a signature covers of a body: all but what stands behind the LZ4 frame, and the time."""
    return bytes(prefix) + stamp_ms.to_bytes(6, "big") + hashlib.sha256(frame).digest()


def _trailer(body: Body, at: int) -> Trailer | None:
    start = body[at : at + len(MAGIC)]
    if start != MAGIC:
        # What is nearly the magic was it before a fault. What is not is not for us to read.
        if sum(a == b for a, b in zip(start, MAGIC, strict=False)) >= len(MAGIC) // 2:
            raise PayloadError("damaged on its way: its trailer is not readable")
        return None
    if len(body) - at < _BARE:
        raise PayloadError("ends within its trailer")
    _, version, complement, length, upper, lower = _TRAILER.unpack_from(body, at)
    if version > VERSION and version ^ complement == 255:
        return None  # a later format
    stamp_ms = upper << 32 | lower
    known = version ^ complement == 255 and version and length in (_BARE, _SIGNED)
    if not known or stamp_ms >= STAMPS_MS:
        raise PayloadError("damaged on its way: its trailer is not readable")
    if len(body) - at < length:
        raise PayloadError("ends within its trailer")
    signature_at = at + _TRAILER.size
    signature = bytes(body[signature_at : at + length - _CRC.size])
    return Trailer(stamp_ms, signature or None, version, at)


def _frame(body: Body) -> _Frame:
    """Walk over the blocks of the LZ4 frame in a body without unpacking them."""
    if len(body) <= PREFIX:
        raise PayloadError(f"a body of {len(body)} bytes holds no message")
    if body[PREFIX : PREFIX + 4] != _FRAME_MAGIC:
        raise PayloadError("not an LZ4 frame: it does not begin like one")
    try:
        flags, kind = body[PREFIX + 4], body[PREFIX + 5] >> 4 & 7
        if flags >> 6 != 1 or kind not in _BLOCK_BYTES:
            raise PayloadError("not an LZ4 frame: its header is of another version")
        at = PREFIX + 6
        size = _U64.unpack_from(body, at)[0] if flags & 0x08 else None
        at += 0 if size is None else 8
        at += 5 if flags & 0x01 else 1  # a dictionary's id, the header's checksum
        behind = 4 if flags & 0x10 else 0  # each block's checksum
        most = 0
        for _ in range(MAX_BLOCKS):
            length: int = _U32.unpack_from(body, at)[0]
            at += 4
            if length == 0:
                break
            stored, length = length & _STORED, length & ~_STORED
            most += length if stored else min(_BLOCK_BYTES[kind], length * _MOST_PER_BYTE)
            at += length + behind
        else:
            raise PayloadError(f"cut into more than {MAX_BLOCKS} blocks")
    except (struct.error, IndexError):
        raise PayloadError("ends within its LZ4 frame") from None
    at += 4 if flags & 0x04 else 0  # the checksum of all
    if at > len(body):
        raise PayloadError("ends within its LZ4 frame")
    return _Frame(at, size, most)


def _decompressed(
    body: Body, frame: _Frame, limit: int, check_only_bytes: int | None = None
) -> list[bytes]:
    """The data in as few pieces as possible; none if it is only checked, so much at a time.

    Raises PayloadError.
    """
    size = frame.size
    if size is not None and size > limit:
        raise PayloadError(f"unpacks to more than {limit} bytes")
    if size is not None and size > frame.most:
        raise PayloadError(f"not an LZ4 frame: {size} bytes do not fit in its blocks")
    pieces: list[bytes] = []
    done, at, over = 0, PREFIX, False
    view = memoryview(body)
    context = lz4.frame.create_decompression_context()
    try:
        while not over:
            # One call if the size is stated; otherwise doubling keeps the copies few, and the room
            # for a bomb is never allocated at once.
            room = size if size and not done else min(max(done, _STEP_BYTES), limit - done) + 1
            piece, read, over = lz4.frame.decompress_chunk(
                context, view[at : frame.end], max_length=check_only_bytes or room
            )
            at += read
            done += len(piece)
            if done > (limit if size is None else size):
                raise PayloadError(f"unpacks to more than {limit if size is None else size} bytes")
            if not over and not piece and not read:
                raise PayloadError("ends within its LZ4 frame")
            if check_only_bytes is None:
                pieces.append(piece)
    except (RuntimeError, EOFError, ValueError, MemoryError) as error:
        raise PayloadError(f"not an LZ4 frame: {error}") from None
    if at != frame.end or (size is not None and done != size):
        raise PayloadError("not an LZ4 frame: its size is another one than it states")
    return pieces
