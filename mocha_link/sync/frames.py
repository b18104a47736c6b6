"""The frames of the sync between two new nodes (docs/sync-protocol.md).

There are two sorts. A *sync message* (OPEN, HELLO, GROUPS, ANSWER, SKIP, DONE, END, FOLLOW,
ANNOUNCE, TOPICS) may take several frames, in any order. A *chunks* frame carries whole messages
of robots, and pieces of them. A checksum covers everything but the data in chunks, which have their
own.

The id of a robot's message is robot u8, topic u8, stamp u48 (Unix ms), as one number.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from itertools import chain
from operator import itemgetter
from typing import NamedTuple

from mocha_link.errors import MochaLinkError
from mocha_link.store import MAX_BODY_BYTES, STAMP_MASK, STAMPS_MS, Fragment, Header, Record
from mocha_link.sync.credit import MAX_CHUNK
from mocha_link.sync.protocol import ID_BYTES, Frame

# Kinds of frames.
OPEN, HELLO, GROUPS, ANSWER, SKIP, DONE, END, CHUNKS, FOLLOW, ANNOUNCE, TOPICS = range(1, 12)
ROUNDS = 8  # OPENs of one pull
MAX_SYNC_MESSAGE_BYTES = 1024 * 1024
MIN_PART_BYTES = 200  # of a sync message, except the last part
MAX_CHUNKS = 1_024  # of each sort in one frame, whose processing blocks the node
LARGE_BYTES = 32_768  # larger data are parts of their own, where frames have parts
MAX_LARGE = 48  # such parts in one frame

_MESSAGE = struct.Struct(">BIBII")  # kind, checksum, round, offset, total
CHUNKS_HEAD = struct.Struct(">BIBIHH")  # kind, checksum, round, number, whole messages, pieces
COVERED = 5  # offset of the bytes that the checksum covers
WHOLE = struct.Struct(">QI")  # message id, size
PIECE = struct.Struct(">QIII")  # message id, size of the whole, offset, size of the piece
MESSAGE_HEADER_BYTES, CHUNKS_BYTES = _MESSAGE.size, CHUNKS_HEAD.size


def is_reply(parts: Sequence[Frame]) -> bool:
    """Whether a frame on a connection replies to a pull: no request code follows its id."""
    return bool(parts) and len(parts[0]) > ID_BYTES and 0 < parts[0][ID_BYTES] <= TOPICS


class SyncFrameError(MochaLinkError):
    """Received bytes are not a valid frame of the sync."""


def message_id_of(robot_id: int, topic_id: int, stamp_ms: int) -> int:
    """The id of a message of a robot."""
    return robot_id << 56 | topic_id << 48 | stamp_ms


def header_of(message_id: int) -> Header:
    """The header of a message."""
    return Header.at(message_id >> 56, message_id >> 48 & 0xFF, message_id & STAMP_MASK)


def record_id(record: Record) -> int:
    """The message id of a record."""
    return message_id_of(record.header.robot_id, record.header.topic_id, record.stamp_ms)


def is_body(message_id: int, total: int) -> bool:
    """Whether a message with that id and size is possible."""
    return 0 < total <= MAX_BODY_BYTES and message_id & STAMP_MASK < STAMPS_MS


class SyncMessage(NamedTuple):
    """A complete message of the sync; mocha_link/sync/sync_messages.py reads its content.

    A pull may have several rounds; a message of an earlier round is ignored.
    """

    kind: int
    round: int
    content: bytes


def message_frame(kind: int, round_: int, content: bytes, offset: int, room: int) -> bytes:
    """The part of a message from an offset on that fits in `room` bytes."""
    part = content[offset : offset + room - MESSAGE_HEADER_BYTES]
    covered = struct.pack(">BII", round_, offset, len(content)) + part
    return struct.pack(">BI", kind, zlib.crc32(covered, kind)) + covered


def message_frames(kind: int, round_: int, content: bytes, room: int) -> list[bytes]:
    """A message in frames of at most `room` bytes."""
    step = room - MESSAGE_HEADER_BYTES
    offsets = range(0, max(len(content), 1), step)
    return [message_frame(kind, round_, content, offset, room) for offset in offsets]


class MessageAssembler:
    """Reassembles sync messages from their frames.

    Each message is returned once. SKIP and ANNOUNCE fit in one frame and may be repeated.

    Args:
        kinds: the kinds of messages that this side receives.
    """

    def __init__(self, *kinds: int) -> None:
        self._kinds = kinds
        self._open: dict[int, tuple[int, Fragment | None]] = {}  # by kind: round, parts; None: done

    def receives(self, frame: Frame) -> bool:
        """Whether a frame is of a kind that this side receives."""
        return bool(len(frame)) and frame[0] in self._kinds

    def take(self, frame: Frame) -> SyncMessage | None:
        """Process a frame; returns the message if this completes it. Raises SyncFrameError."""
        if len(frame) < MESSAGE_HEADER_BYTES:
            raise SyncFrameError(f"a frame of {len(frame)} bytes")
        kind, checksum, round_, offset, total = _MESSAGE.unpack_from(frame)
        if kind not in self._kinds:
            raise SyncFrameError(f"a frame of kind {kind}")
        view = memoryview(frame)
        if zlib.crc32(view[COVERED:], kind) != checksum:
            raise SyncFrameError("a damaged frame")
        part = view[MESSAGE_HEADER_BYTES:]
        end = offset + len(part)
        if round_ >= ROUNDS or total > MAX_SYNC_MESSAGE_BYTES or end > total:
            raise SyncFrameError(f"a message of {total} bytes in round {round_}")
        if len(part) < MIN_PART_BYTES and end < total:
            raise SyncFrameError(f"a message of {total} bytes in parts of {len(part)}")
        if kind in (SKIP, ANNOUNCE) and len(part) == total:
            return SyncMessage(kind, round_, bytes(part))
        known, fragment = self._open.get(kind, (-1, None))
        if round_ < known or (round_ == known and fragment is None):
            return None
        if round_ > known or fragment is None or fragment.total != total:
            fragment = Fragment(total)
        fragment.add(offset, part)
        content = fragment.whole()
        self._open[kind] = (round_, fragment if content is None else None)
        return None if content is None else SyncMessage(kind, round_, content)


def chunks_parts(
    place: tuple[int, int],
    wholes: list[bytes],
    pieces: list[bytes],
    data: list[Frame],
    prefix: bytes = b"",
) -> list[Frame]:
    """A frame of chunks: its round and number, packed WHOLEs and PIECEs, and their data.

    `prefix` precedes it. Large data are parts of their own, so that they are not copied.
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


class Chunks(NamedTuple):
    """A frame of chunks, `number` of its round."""

    round: int
    number: int
    wholes: list[tuple[int, memoryview]]  # message id, body
    pieces: list[tuple[int, int, int, memoryview]]  # message id, size of the whole, offset, data


def read_chunks(frame: Frame, more: Sequence[Frame] = ()) -> Chunks:
    """Parse a frame of chunks, which may have several parts. Raises SyncFrameError.

    Data are copied only if they span two parts.
    """
    if len(frame) < CHUNKS_BYTES:
        raise SyncFrameError(f"a frame of {len(frame)} bytes")
    kind, checksum, round_, number, whole_count, piece_count = CHUNKS_HEAD.unpack_from(frame)
    middle = CHUNKS_BYTES + whole_count * WHOLE.size
    end = middle + piece_count * PIECE.size
    view = memoryview(frame)
    covered = view[COVERED:end]
    many = max(whole_count, piece_count) > MAX_CHUNKS
    if many or end > len(frame) or kind != CHUNKS or zlib.crc32(covered, kind) != checksum:
        raise SyncFrameError(f"a frame with {whole_count} messages" if many else "a damaged frame")
    wholes = list(WHOLE.iter_unpack(view[CHUNKS_BYTES:middle]))
    pieces = list(PIECE.iter_unpack(view[middle:end]))
    for message_id, total, offset, length in pieces:
        if offset + length > total or not length or not is_body(message_id, total):
            raise SyncFrameError(f"a piece of {length} bytes at {offset} of {total}")
    sizes = list(map(itemgetter(-1), chain(wholes, pieces)))
    if 0 in sizes:
        raise SyncFrameError("a message of 0 bytes")
    parts: list[memoryview] = [view[end:]]
    parts.extend(map(memoryview, more))
    room = sum(map(len, parts))
    if sum(sizes) != room or room > MAX_CHUNK:  # it might unpack to 255 times as much
        raise SyncFrameError(f"chunks of {sum(sizes)} bytes in a frame with {room}")
    contents: list[memoryview] = []
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
        contents.append(found[-1] if len(found[-1]) == size else memoryview(b"".join(found)))
    bodies = list(zip(map(itemgetter(0), wholes), contents, strict=False))
    rest = zip(pieces, contents[whole_count:], strict=True)
    cut = [(*piece[:3], data) for piece, data in rest] if pieces else []
    return Chunks(round_, number, bodies, cut)
