"""The frames of the sync between two new nodes (docs/sync-protocol.md).

There are two sorts. A *letter* (OPEN, HELLO, GROUPS, ANSWER, SKIP, DONE, END) may take several
frames, which may arrive in any order. A *chunks* frame carries whole messages and pieces. A
checksum covers everything but the data in chunks, which bring their own.

A message is known by its long id: robot u8, topic u8, stamp u48 (Unix ms), as one number.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from mocha_link.errors import MochaLinkError
from mocha_link.store.payload import is_body
from mocha_link.store.reassembly_buffer import Partial

OPEN, HELLO, GROUPS, ANSWER, SKIP, DONE, END, CHUNKS = range(1, 9)  # kinds of frames
ROUNDS = 8  # OPENs of one pull
MAX_LETTER_BYTES = 1024 * 1024
MIN_PART_BYTES = 200  # of a letter, but for the last part
MAX_CHUNKS = 65_535  # of each sort in one frame
LARGE_BYTES = 32_768  # data from this size on are parts of their own, where frames have parts
MAX_LARGE = 48  # of them in one frame

_LETTER = struct.Struct(">BIBII")  # kind, checksum, round, offset, total
_CHUNKS = struct.Struct(">BIBIHH")  # kind, checksum, round, number, whole messages, pieces
_COVERED = 5  # the checksum is over what follows it
WHOLE = struct.Struct(">QI")  # long id, size
PIECE = struct.Struct(">QIII")  # long id, size of the whole, offset, size of the piece
LETTER_BYTES, CHUNKS_BYTES = _LETTER.size, _CHUNKS.size

Frame = bytes | memoryview


class FrameError(MochaLinkError):
    """Bytes that are no frame of the sync."""


def long_id(robot_id: int, topic_id: int, stamp_ms: int) -> int:
    """The long id of a message."""
    return robot_id << 56 | topic_id << 48 | stamp_ms


class Letter(NamedTuple):
    """A complete letter; mocha_link/sync/sync_messages.py reads its content.

    A pull may have several rounds; a letter of an earlier one is void.
    """

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


class Chunks(NamedTuple):
    """A frame of chunks, `number` of its round.

    `data` has the whole messages one after another, then the pieces; `more` goes on with them.
    """

    round: int
    number: int
    wholes: list[tuple[int, int]]  # long id, size
    pieces: list[tuple[int, int, int, int]]  # long id, size of the whole, offset, size
    data: memoryview
    more: tuple[memoryview, ...] = ()

    def contents(self) -> Iterator[memoryview]:
        """The data of each whole message, then of each piece; copied only across parts."""
        parts = [self.data, *self.more]
        sizes = [size for _, size in self.wholes] + [piece[-1] for piece in self.pieces]
        index = at = 0
        for size in sizes:
            found: list[memoryview] = []
            missing = size
            while missing:
                piece = parts[index][at : at + missing]
                found.append(piece)
                missing -= len(piece)
                at += len(piece)
                if at == len(parts[index]):
                    index, at = index + 1, 0
            yield found[-1] if len(found[-1]) == size else memoryview(b"".join(found))


def chunks_parts(
    place: tuple[int, int],
    wholes: list[bytes],
    pieces: list[bytes],
    data: list[Frame],
    prefix: bytes = b"",
) -> list[Frame]:
    """A frame of chunks: its round and number, packed WHOLEs and PIECEs, and their data.

    `prefix` goes before it. Large data are parts of their own, so that nobody has to copy them.
    """
    head = struct.pack(">BIHH", *place, len(wholes), len(pieces))
    covered = b"".join((head, *wholes, *pieces))
    checksum = zlib.crc32(covered, CHUNKS)
    parts: list[Frame] = []
    small: list[Frame] = [prefix, struct.pack(">BI", CHUNKS, checksum), covered]
    left = MAX_LARGE
    for each in data:
        if len(each) < LARGE_BYTES or not left:
            small.append(each)
            continue
        left -= 1
        if small:
            parts.append(b"".join(small))
            small = []
        parts.append(each)
    if small:
        parts.append(b"".join(small))
    return parts


def chunks_frame(
    place: tuple[int, int],
    wholes: list[bytes],
    pieces: list[bytes],
    data: list[Frame],
    prefix: bytes = b"",
) -> bytes:
    """The same in one part."""
    parts = chunks_parts(place, wholes, pieces, data, prefix)
    return bytes(parts[0]) if len(parts) == 1 else b"".join(parts)


def own(view: Frame) -> Frame:
    """The same bytes, as something that does not keep much more than them in memory."""
    whole = view.obj if isinstance(view, memoryview) else view
    if len(view) >= LARGE_BYTES and len(view) * 8 >= len(whole) * 7:  # type: ignore[arg-type]
        return view
    return bytes(view)


def read_chunks(frame: Frame, more: Sequence[Frame] = ()) -> Chunks:
    """Read a frame of chunks that may be in several parts. Raises FrameError."""
    if len(frame) < CHUNKS_BYTES:
        raise FrameError(f"a frame of {len(frame)} bytes")
    kind, checksum, round_, number, whole_count, piece_count = _CHUNKS.unpack_from(frame)
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
        if offset + length > total or not length or not is_body(long, total):
            raise FrameError(f"a piece of {length} bytes at {offset} of {total}")
        size += length
    room = len(frame) - end + sum(map(len, more))
    if size != room:
        raise FrameError(f"chunks of {size} bytes in a frame with {room}")
    return Chunks(round_, number, wholes, pieces, view[end:], tuple(map(memoryview, more)))
