"""A second implementation of the pulling side of the sync, from the pages alone.

Written from docs/sync-protocol.md, docs/protocol.md, and what they link to of the team file and of
a message's trailer: ZeroMQ, struct and LZ4, and nothing of ours, so that what it understands of a
node is what the pages have.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import lz4.frame
import zmq

OPEN, HELLO, GROUPS, ANSWER, SKIP, DONE, END, CHUNKS, FOLLOW, ANNOUNCE, TOPICS = range(1, 12)
SINCE, HAVE, DIGEST = 1, 2, 3  # forms of the list in OPEN
VERSION = 4
MAX_PARTIALS, MAX_RANGES = 64, 16
WAIT_MS = 60_000  # a limit against hangs

_MESSAGE = struct.Struct(">BIBII")  # kind, CRC, round, offset, size
_CHUNKS = struct.Struct(">BIBIHH")  # kind, CRC, round, number, whole messages, pieces
_WHOLE = struct.Struct(">8sI")
_PIECE = struct.Struct(">8sIII")
_COVERED = 5  # the CRC covers what follows it
_TRAILER = bytes.fromhex("d66d636c")


@dataclass(frozen=True, order=True)
class MessageId:
    """The name of a message of a robot."""

    robot: int
    topic: int
    stamp_ms: int

    @classmethod
    def of(cls, data: bytes) -> MessageId:
        return cls(data[0], data[1], int.from_bytes(data[2:8], "big"))

    def __bytes__(self) -> bytes:
        return bytes((self.robot, self.topic)) + self.stamp_ms.to_bytes(6, "big")

    @property
    def header(self) -> bytes:
        seconds, ms = divmod(self.stamp_ms, 1000)
        return struct.pack(">BBHH", self.robot, self.topic, seconds % 65536, ms)


class Configuration:
    """The ids of a team file, as a document, and what of them is on the wire."""

    def __init__(self, team: dict[str, Any]) -> None:
        topics = {name: kind["topics"] for name, kind in team["kinds"].items()}
        types = sorted(topic["type"] for each in topics.values() for topic in each)
        table = []
        self.definitions: dict[tuple[int, int], bytes] = {}
        for robot_id, name in enumerate(sorted(team["robots"])):
            robot = team["robots"][name]
            ros = robot.get("ros", 1)
            rows = [
                [
                    number,
                    each["name"],
                    each["type"],
                    types.index(each["type"]),
                    bool(each.get("aggregate")),
                ]
                for number, each in enumerate(topics[robot["kind"]])
            ]
            table.append([robot_id, name, ros, rows])
            for row in rows:
                about = [[robot_id, name, ros], row]
                self.definitions[robot_id, row[0]] = _blake2b(json.dumps(about).encode(), 4)
        self.hash = _blake2b(json.dumps(table).encode(), 8)

    @property
    def topics(self) -> bytes:
        """The content of a TOPICS."""
        return self.hash + b"".join(bytes(key) + of for key, of in self.definitions.items())


@dataclass
class Partial:
    """A message that has arrived in part."""

    data: bytearray
    missing: list[tuple[int, int]]

    def add(self, offset: int, piece: bytes) -> None:
        end = offset + len(piece)
        self.data[offset:end] = piece
        before = [(first, min(last, offset)) for first, last in self.missing if first < offset]
        after = [(max(first, end), last) for first, last in self.missing if last > end]
        self.missing = before + after


@dataclass
class Store:
    """What is kept from pull to pull."""

    bodies: dict[MessageId, bytes] = field(default_factory=dict)
    partials: dict[MessageId, Partial] = field(default_factory=dict)
    place: bytes = b""  # epoch and number of the last DONE
    token: bytes = bytes(8)
    boot_id: bytes = field(default_factory=lambda: os.urandom(8))
    their_hash: bytes = bytes(8)  # of the last TOPICS
    shared: set[tuple[int, int]] | None = None  # topics that both define alike; None: all

    def data(self, robot: int, topic: int) -> list[bytes]:
        """The data of a topic, oldest first."""
        mine = sorted(each for each in self.bodies if (each.robot, each.topic) == (robot, topic))
        return [_unpacked(self.bodies[each])[0] for each in mine]

    def digest(self, robot: int, group: int | None = None) -> bytes:
        total = 0
        for each in self.bodies:
            if each.robot == robot and group in (None, each.topic % 16):
                total ^= int.from_bytes(_blake2b(each.header, 8), "big")
        return total.to_bytes(8, "big")


class Puller:
    """Pulls over one connection.

    Args:
        configuration: of its team file.
        store: what it has, and where messages go.
        endpoint: the port that the serving robot has for it.
        window_bytes: how far the peer may send ahead.
        frame_bytes: the largest frame of the peer.
    """

    def __init__(
        self,
        configuration: Configuration,
        store: Store,
        endpoint: str,
        *,
        window_bytes: int = 256 * 1024,
        frame_bytes: int = 60_000,
    ) -> None:
        self.store = store
        self.receptions: list[int] = []  # of the last pull
        self.received = 0  # bytes of the last pull, and of what is pushed after it
        self.compared = 0  # robots in GROUPS
        self.announced: list[MessageId] = []
        self._configuration = configuration
        self._window_bytes, self._frame_bytes = window_bytes, frame_bytes
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self._socket.linger = 0
        self._socket.connect(endpoint)

    def close(self) -> None:
        self._socket.close()

    def pull(self, form: int, *, budget: int = 0, cut_bytes: int = 0, follow: bool = False) -> bool:
        """Pull once; whether it was complete. `cut_bytes`: stop in the middle, without END."""
        self._id = os.urandom(6)
        self._budget = budget
        self.received, self._allowed = 0, self._window_bytes
        self.receptions = []
        self._begin_round(0)
        self._send(OPEN, self._opening(form), b"SYNC1" + self._credit())
        while not self._done or len(self._numbers) < self._done[2]:
            self._receive()
            if cut_bytes and self.received >= cut_bytes:
                return False
            if self._failed and self._done and len(self._numbers) == self._done[2]:
                self._next_round()
        epoch, number, _, cut_short = self._done
        if cut_short:
            self._send(END, b"")
            return False
        if self.store.shared is None:
            self.store.place = struct.pack(">QQ", epoch, number)
        self._send(FOLLOW if follow else END, b"")
        return True

    def follow(self, until: Callable[[], bool]) -> None:
        """Take in what is pushed after a pull that follows."""
        while not until():
            self._receive()

    def _credit(self) -> bytes:
        return struct.pack(">QI", self._allowed, self._frame_bytes)

    def _next_round(self) -> None:
        self._begin_round(self._round + 1)
        self._send(OPEN, self._opening(HAVE))

    def _begin_round(self, number: int) -> None:
        self._round = number
        self._parts: dict[int, Partial] = {}  # of sync messages, by kind
        self._numbers: set[int] = set()  # of CHUNKS
        self._done: tuple[int, ...] = ()
        self._failed = False

    def _send(self, kind: int, content: bytes, code: bytes = b"SYNCF") -> None:
        step = self._frame_bytes - _MESSAGE.size
        for offset in range(0, len(content) or 1, step):
            part = content[offset : offset + step]
            covered = struct.pack(">BII", self._round, offset, len(content)) + part
            frame = struct.pack(">BI", kind, zlib.crc32(covered, kind)) + covered
            self._socket.send_multipart([b"", self._id + code + frame])
            code = b"SYNCF"

    def _receive(self) -> None:
        if not self._socket.poll(WAIT_MS):
            raise TimeoutError
        delimiter, first, *more = self._socket.recv_multipart()
        assert not delimiter
        if first[:6] != self._id or first[6] > TOPICS:
            return  # of the pull before, or a request: the node pulls back, and we do not serve
        self.received += len(first) + sum(map(len, more))
        self.take(first[6:] + b"".join(more))
        if self.received > self._allowed - self._window_bytes // 2:
            self._allowed = self.received + self._window_bytes
            self._socket.send_multipart([b"", self._id + b"SYNCC" + self._credit()])

    def _opening(self, form: int) -> bytes:
        store = self.store
        parts = [bytes((VERSION, form)), store.boot_id, struct.pack(">Q", self._budget)]
        parts += [self._configuration.hash, store.their_hash, store.token]
        if form == DIGEST:
            robots = sorted({each.robot for each in store.bodies})
            parts.append(struct.pack(">H", len(robots)))
            parts += [bytes((robot,)) + store.digest(robot) for robot in robots]
        else:
            parts.append(store.place if form == SINCE else b"")
            parts.append(struct.pack(">H", len(store.bodies)))
            parts += map(bytes, store.bodies)
        partials = list(store.partials.items())[:MAX_PARTIALS]
        parts.append(bytes((len(partials),)))
        for message, partial in partials:
            ranges = partial.missing[:MAX_RANGES]
            parts.append(bytes(message) + struct.pack(">IB", len(partial.data), len(ranges)))
            parts += [struct.pack(">II", *each) for each in ranges]
        return b"".join(parts)

    def take(self, frame: bytes) -> None:
        """Take in a frame."""
        if frame[0] == CHUNKS:
            self._take_chunks(frame)
            return
        kind, checksum, round_, offset, size = _MESSAGE.unpack_from(frame)
        assert zlib.crc32(frame[_COVERED:], kind) == checksum
        if round_ != self._round:
            return
        message = self._parts.setdefault(kind, Partial(bytearray(size), [(0, size)]))
        message.add(offset, frame[_MESSAGE.size :])
        if not message.missing or not size:
            del self._parts[kind]
            self._take_message(kind, bytes(message.data))

    def _take_message(self, kind: int, content: bytes) -> None:
        if kind == HELLO:
            reception, version, _, self.store.token, _, _ = struct.unpack(">BB8s8s8sB", content)
            self.receptions.append(reception)
            assert (version, reception != 3) == (VERSION, True)
            if reception == 1:
                self._next_round()
        elif kind == TOPICS:
            theirs = {(each[0], each[1]): each[2:] for each in _cut(content[8:], 6)}
            ours = self._configuration.definitions
            self.store.their_hash = content[:8]
            self.store.shared = {key for key, of in theirs.items() if ours.get(key) == of}
            self._send(TOPICS, self._configuration.topics)
            self._next_round()
        elif kind == GROUPS:
            self._answer(content)
        elif kind == ANNOUNCE:
            self.announced += map(MessageId.of, _cut(content, 8))
        elif kind == DONE:
            self._done = struct.unpack(">QQIB", content)

    def _answer(self, groups: bytes) -> None:
        answer = b""
        for each in _cut(groups, 1 + 16 * 8):
            robot, theirs = each[0], _cut(each[1:], 8)
            self.compared += 1
            differ = {g for g in range(16) if theirs[g] != self.store.digest(robot, g)}
            have = [m for m in self.store.bodies if m.robot == robot and m.topic % 16 in differ]
            answer += struct.pack(">BHH", robot, sum(1 << group for group in differ), len(have))
            answer += b"".join(bytes(message)[1:] for message in have)
        self._send(ANSWER, answer)

    def _take_chunks(self, frame: bytes) -> None:
        _, checksum, round_, number, wholes, pieces = _CHUNKS.unpack_from(frame)
        middle = _CHUNKS.size + wholes * _WHOLE.size
        at = end = middle + pieces * _PIECE.size
        assert zlib.crc32(frame[_COVERED:at], CHUNKS) == checksum
        if round_ != self._round:
            return
        self._numbers.add(number)
        for name, size in _WHOLE.iter_unpack(frame[_CHUNKS.size : middle]):
            self._store(MessageId.of(name), frame[at : at + size])
            at += size
        for name, total, offset, size in _PIECE.iter_unpack(frame[middle:end]):
            message = MessageId.of(name)
            new = Partial(bytearray(total), [(0, total)])
            partial = self.store.partials.setdefault(message, new)
            partial.add(offset, frame[at : at + size])
            at += size
            if not partial.missing:
                del self.store.partials[message]
                self._store(message, bytes(partial.data))
        assert at == len(frame)

    def _store(self, message: MessageId, body: bytes) -> None:
        assert (message.robot, message.topic) in self._configuration.definitions
        if _is_intact(message, body):
            self.store.bodies[message] = body
        else:
            self._failed = True


def _blake2b(data: bytes, size: int) -> bytes:
    return hashlib.blake2b(data, digest_size=size).digest()


def _cut(data: bytes, size: int) -> list[bytes]:
    assert len(data) % size == 0
    return [data[at : at + size] for at in range(0, len(data), size)]


def _unpacked(body: bytes) -> tuple[bytes, bytes]:
    """The data of a message, and its trailer."""
    frame = lz4.frame.LZ4FrameDecompressor()
    return frame.decompress(body[2:]), frame.unused_data or b""


def _is_intact(message: MessageId, body: bytes) -> bool:
    try:
        _, trailer = _unpacked(body)
    except RuntimeError:
        return False
    of_ids = zlib.crc32(bytes((message.robot, message.topic)))
    return (
        trailer.startswith(_TRAILER)
        and body[-4:] == struct.pack(">I", zlib.crc32(body[:-4], of_ids))
        and int.from_bytes(trailer[8:14], "big") == message.stamp_ms
    )
