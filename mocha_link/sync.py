"""The frames of the sync between two new nodes (docs/sync-protocol.md), byte by byte.

There are two sorts. A *letter* (OPEN, HELLO, GROUPS, ANSWER, SKIP, DONE, END) may take several
frames, which may arrive in any order. A *chunks* frame carries whole messages and pieces. A
checksum covers everything but the data in chunks, which bring their own.

A message is known by its long id: robot u8, topic u8, stamp u48 (Unix ms), as one number.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from mocha_link.errors import MochaLinkError
from mocha_link.payload import MAX_BYTES, STAMPS_MS
from mocha_link.shelf import MAX_RANGES, Partial, Range

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

VERSION = 1
OPEN, HELLO, GROUPS, ANSWER, SKIP, DONE, END, CHUNKS = range(1, 9)
ROUNDS = 8  # OPENs of one pull
MAX_LETTER_BYTES = 1024 * 1024
MIN_PART_BYTES = 200  # of a letter, but for the last part
MAX_BODY_BYTES = MAX_BYTES + 1024 * 1024  # incompressible data, and what may stand behind it
MAX_CHUNKS = 65_535  # of each sort in one frame
MAX_LISTED = 65_535  # messages of a robot in an ANSWER
MAX_PARTIALS = 64
STAMP_MASK = (1 << 48) - 1
GROUP_COUNT = 16

_LETTER = struct.Struct(">BIBII")  # kind, checksum, round, offset, total
_CHUNKS = struct.Struct(">BIIHH")  # kind, checksum, number, whole messages, pieces
_COVERED = 5  # the checksum is over what follows it
WHOLE = struct.Struct(">QI")  # long id, size
PIECE = struct.Struct(">QIII")  # long id, size of the whole, offset, size of the piece
LETTER_BYTES, CHUNKS_BYTES = _LETTER.size, _CHUNKS.size

_OPEN = struct.Struct(">BBQQ")  # version, sort of knowledge, run, budget
_SINCE = struct.Struct(">QQ")
_COUNT = struct.Struct(">H")
_DIGEST = struct.Struct(">BQ")
_PARTIAL = struct.Struct(">QIB")
_RANGE = struct.Struct(">II")
_HELLO = struct.Struct(">B")
_SKIP = struct.Struct(">Q")
_DONE = struct.Struct(">QQIB")
_GROUPS = struct.Struct(f">B{GROUP_COUNT}Q")
_ANSWER = struct.Struct(">BHH")
_TOPIC_STAMP = struct.Struct(">BHI")
_KNOWS_SINCE, _KNOWS_HAVE, _KNOWS_DIGEST = 1, 2, 3

Frame = bytes | memoryview


class FrameError(MochaLinkError):
    """Bytes that are no frame of the sync."""


def long_id(robot_id: int, topic_id: int, stamp_ms: int) -> int:
    """The long id of a message."""
    return robot_id << 56 | topic_id << 48 | stamp_ms


class Letter(NamedTuple):
    """A complete letter. A pull may have several rounds; what is of an earlier one is void."""

    kind: int
    round: int
    content: bytes


def letter_frame(kind: int, round_: int, content: bytes, offset: int, room: int) -> bytes:
    """The part of a letter from an offset on that fits in `room` bytes."""
    part = content[offset : offset + room - LETTER_BYTES]
    covered = struct.pack(">BII", round_, offset, len(content)) + part
    return struct.pack(">BI", kind, zlib.crc32(covered, kind)) + covered


def letter_frames(kind: int, round_: int, content: bytes, room: int) -> list[bytes]:
    """A letter in frames of at most `room` bytes."""
    step = room - LETTER_BYTES
    offsets = range(0, max(len(content), 1), step)
    return [letter_frame(kind, round_, content, offset, room) for offset in offsets]


class Letters:
    """Puts letters together from their frames. Each comes out once; a SKIP is a frame by itself.

    Args:
        kinds: the kinds of letters that this side receives.
    """

    def __init__(self, *kinds: int) -> None:
        self._kinds = kinds
        self._open: dict[int, tuple[int, Partial | None]] = {}  # by kind: round, what is there

    def take(self, frame: Frame) -> Letter | None:
        """Take in a frame; the letter if this completes it. Raises FrameError."""
        if len(frame) < LETTER_BYTES:
            raise FrameError(f"a frame of {len(frame)} bytes")
        kind, checksum, round_, offset, total = _LETTER.unpack_from(frame)
        if kind not in self._kinds:
            raise FrameError(f"a frame of kind {kind}")
        view = memoryview(frame)
        if zlib.crc32(view[_COVERED:], kind) != checksum:
            raise FrameError("a damaged frame")
        part = view[LETTER_BYTES:]
        end = offset + len(part)
        if round_ >= ROUNDS or total > MAX_LETTER_BYTES or end > total:
            raise FrameError(f"a letter of {total} bytes in round {round_}")
        if len(part) < MIN_PART_BYTES and end < total:
            raise FrameError(f"a letter of {total} bytes in parts of {len(part)}")
        if kind == SKIP and len(part) == total:
            return Letter(kind, round_, bytes(part))
        known, partial = self._open.get(kind, (-1, None))
        if round_ < known or (round_ == known and partial is None):
            return None
        if round_ > known or partial is None or partial.total != total:
            partial = Partial(total)
        partial.add(offset, part)
        content = partial.whole()
        self._open[kind] = (round_, partial if content is None else None)
        return None if content is None else Letter(kind, round_, content)


@dataclass(frozen=True, slots=True)
class Since:
    """We know what your database `epoch` held at `sequence`; since then we got `longs`."""

    epoch: int
    sequence: int
    longs: Sequence[int]


@dataclass(frozen=True, slots=True)
class Have:
    """All that we hold."""

    longs: Sequence[int]


@dataclass(frozen=True, slots=True)
class Digest:
    """The digest of all that we hold of each robot."""

    digests: dict[int, int]


class Wish(NamedTuple):
    """A message of which a part is there, and what is missing of it."""

    long: int
    total: int
    missing: list[Range]


@dataclass(frozen=True, slots=True)
class Open:
    """What the asking side says first: what it has, what it has in part, what it may take.

    `run` is a number of its process. `budget` is in bytes of frames; 0: no limit.
    """

    run: int
    budget: int
    knowledge: Since | Have | Digest
    wishes: Sequence[Wish] = ()

    def encode(self) -> bytes:
        """The content of the letter."""
        match self.knowledge:
            case Since(epoch, sequence, longs):
                sort = _KNOWS_SINCE
                parts = [_SINCE.pack(epoch, sequence), _counted(longs)]
            case Have(longs):
                sort = _KNOWS_HAVE
                parts = [_counted(longs)]
            case Digest(digests):
                sort = _KNOWS_DIGEST
                parts = [_COUNT.pack(len(digests))]
                parts += [_DIGEST.pack(*item) for item in digests.items()]
        parts.append(bytes((len(self.wishes),)))
        for wish in self.wishes:
            parts.append(_PARTIAL.pack(wish.long, wish.total, len(wish.missing)))
            parts += [_RANGE.pack(*each) for each in wish.missing]
        return _OPEN.pack(VERSION, sort, self.run, self.budget) + b"".join(parts)

    @classmethod
    def decode(cls, content: bytes) -> Open:
        """Read the content of the letter. Raises FrameError."""
        reader = _Reader(content)
        version, sort, run, budget = reader.read(_OPEN)
        if version != VERSION:
            raise FrameError(f"version {version} of the sync; ours is {VERSION}")
        knowledge: Since | Have | Digest
        if sort == _KNOWS_SINCE:
            epoch, sequence = reader.read(_SINCE)
            knowledge = Since(epoch, sequence, reader.longs())
        elif sort == _KNOWS_HAVE:
            knowledge = Have(reader.longs())
        elif sort == _KNOWS_DIGEST:
            knowledge = Digest(dict(reader.table(_DIGEST, reader.read(_COUNT)[0])))
        else:
            raise FrameError(f"knowledge of sort {sort}")
        wishes = [_wish(reader) for _ in range(reader.byte())]
        if len(wishes) > MAX_PARTIALS:
            raise FrameError(f"{len(wishes)} partial messages")
        reader.end()
        return cls(run, budget, knowledge, wishes)


def _wish(reader: _Reader) -> Wish:
    long, total, count = reader.read(_PARTIAL)
    missing: list[Range] = reader.table(_RANGE, count)
    bounds = [bound for each in missing for bound in each]
    if (
        not 0 < count <= MAX_RANGES
        or not _is_body(long, total)
        or bounds != sorted(set(bounds))
        or bounds[-1] > total
    ):
        raise FrameError("a partial message with impossible ranges")
    return Wish(long, total, missing)


class Hello(NamedTuple):
    """The serving side's first word. `unknown`: it cannot tell what is new since the Since."""

    unknown: bool

    def encode(self) -> bytes:
        """The content of the letter."""
        return _HELLO.pack(*self)

    @classmethod
    def decode(cls, content: bytes) -> Hello:
        """Read the content of the letter. Raises FrameError."""
        return cls(bool(_only(_HELLO, content)[0]))


class Done(NamedTuple):
    """The serving side's last word: all up to its `sequence` has been said, in `frames` frames.

    `cut_short`: the budget ended before that.
    """

    epoch: int
    sequence: int
    frames: int
    cut_short: bool

    def encode(self) -> bytes:
        """The content of the letter."""
        return _DONE.pack(*self)

    @classmethod
    def decode(cls, content: bytes) -> Done:
        """Read the content of the letter. Raises FrameError."""
        epoch, sequence, frames, cut_short = _only(_DONE, content)
        return cls(epoch, sequence, frames, bool(cut_short))


DONE_BYTES = LETTER_BYTES + _DONE.size


def encode_groups(groups: Iterable[tuple[int, Sequence[int]]]) -> bytes:
    """Robot ids and the digests of the groups of their topics."""
    return b"".join(_GROUPS.pack(robot_id, *digests) for robot_id, digests in groups)


def decode_groups(content: bytes) -> dict[int, tuple[int, ...]]:
    """The reverse of `encode_groups`. Raises FrameError."""
    if len(content) % _GROUPS.size:
        raise FrameError(f"group digests in {len(content)} bytes")
    return {each[0]: each[1:] for each in _GROUPS.iter_unpack(content)}


class Answer(NamedTuple):
    """All that the asking side holds in some groups (a bit each) of a robot's topics."""

    robot_id: int
    groups: int
    longs: Sequence[int]


def encode_answers(answers: Iterable[Answer]) -> bytes:
    """The content of an ANSWER. What does not fit in a letter is left out, and may come twice."""
    parts = []
    room = MAX_LETTER_BYTES - (1 << 8) * _ANSWER.size
    for robot_id, groups, longs in answers:
        listed = longs[: min(room // _TOPIC_STAMP.size, MAX_LISTED)]
        room -= len(listed) * _TOPIC_STAMP.size
        parts.append(_ANSWER.pack(robot_id, groups, len(listed)))
        parts += [long.to_bytes(8, "big")[1:] for long in listed]
    return b"".join(parts)


def decode_answers(content: bytes) -> list[Answer]:
    """The reverse of `encode_answers`. Raises FrameError."""
    reader = _Reader(content)
    answers = []
    while not reader.at_end:
        robot_id, groups, count = reader.read(_ANSWER)
        table = reader.table(_TOPIC_STAMP, count)
        longs = [long_id(robot_id, topic, upper << 32 | lower) for topic, upper, lower in table]
        answers.append(Answer(robot_id, groups, longs))
    return answers


def encode_skip(long: int) -> bytes:
    """The content of a SKIP: a message whose rest need not be sent."""
    return _SKIP.pack(long)


def decode_skip(content: bytes) -> int:
    """The reverse of `encode_skip`. Raises FrameError."""
    long: int = _only(_SKIP, content)[0]
    return long


class Chunks(NamedTuple):
    """A frame of chunks: `data` has the whole messages one after another, then the pieces."""

    number: int
    wholes: list[tuple[int, int]]  # long id, size
    pieces: list[tuple[int, int, int, int]]  # long id, size of the whole, offset, size
    data: memoryview


def chunks_frame(
    number: int, wholes: list[bytes], pieces: list[bytes], data: list[Frame], prefix: bytes = b""
) -> bytes:
    """A frame of chunks from packed WHOLEs and PIECEs and their data, with a prefix before it."""
    covered = b"".join((struct.pack(">IHH", number, len(wholes), len(pieces)), *wholes, *pieces))
    head = struct.pack(">BI", CHUNKS, zlib.crc32(covered, CHUNKS))
    return b"".join((prefix, head, covered, *data))


def read_chunks(frame: Frame) -> Chunks:
    """Read a frame of chunks. Raises FrameError."""
    if len(frame) < CHUNKS_BYTES:
        raise FrameError(f"a frame of {len(frame)} bytes")
    kind, checksum, number, whole_count, piece_count = _CHUNKS.unpack_from(frame)
    middle = CHUNKS_BYTES + whole_count * WHOLE.size
    end = middle + piece_count * PIECE.size
    view = memoryview(frame)
    if end > len(frame) or kind != CHUNKS or zlib.crc32(view[_COVERED:end], kind) != checksum:
        raise FrameError("a damaged frame")
    wholes = list(WHOLE.iter_unpack(view[CHUNKS_BYTES:middle]))
    pieces = list(PIECE.iter_unpack(view[middle:end]))
    sizes = [size for _, size in wholes]
    if 0 in sizes:
        raise FrameError("a message of 0 bytes")
    size = sum(sizes)
    for long, total, offset, length in pieces:
        if offset + length > total or not length or not _is_body(long, total):
            raise FrameError(f"a piece of {length} bytes at {offset} of {total}")
        size += length
    if size != len(frame) - end:
        raise FrameError(f"chunks of {size} bytes in a frame with {len(frame) - end}")
    return Chunks(number, wholes, pieces, view[end:])


def _is_body(long: int, total: int) -> bool:
    return 0 < total <= MAX_BODY_BYTES and long & STAMP_MASK < STAMPS_MS


def _counted(longs: Sequence[int]) -> bytes:
    return struct.pack(f">H{len(longs)}Q", len(longs), *longs)


def _only(layout: struct.Struct, content: bytes) -> tuple[Any, ...]:
    if len(content) != layout.size:
        raise FrameError(f"a letter of {len(content)} bytes, not {layout.size}")
    return layout.unpack(content)


class _Reader:
    """Reads what stands one after another."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._at = 0

    @property
    def at_end(self) -> bool:
        return self._at == len(self._content)

    def read(self, layout: struct.Struct) -> tuple[Any, ...]:
        return layout.unpack(self._take(layout.size))

    def byte(self) -> int:
        return self._take(1)[0]

    def table(self, layout: struct.Struct, count: int) -> list[tuple[Any, ...]]:
        return list(layout.iter_unpack(self._take(layout.size * count)))

    def longs(self) -> tuple[int, ...]:
        (count,) = self.read(_COUNT)
        longs = struct.unpack(f">{count}Q", self._take(8 * count))
        if any(long & STAMP_MASK >= STAMPS_MS for long in longs):
            raise FrameError("a stamp that is no time")
        return longs

    def end(self) -> None:
        if not self.at_end:
            raise FrameError(f"{len(self._content) - self._at} bytes too many")

    def _take(self, size: int) -> bytes:
        part = self._content[self._at : self._at + size]
        if len(part) != size:
            raise FrameError(f"ends {size - len(part)} bytes too early")
        self._at += size
        return part
