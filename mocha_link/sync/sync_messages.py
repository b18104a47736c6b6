"""The messages of the sync between two new nodes (docs/sync-protocol.md).

In the order of a pull: OPEN, HELLO, GROUPS and ANSWER if digests are compared, DONE, then END or
FOLLOW. SKIP may be sent at any time.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from mocha_link.store import GROUPS, MAX_RANGES, STAMP_MASK, STAMPS_MS, Range
from mocha_link.sync.frames import MAX_SYNC_MESSAGE_BYTES, SyncFrameError, is_body, message_id_of

VERSION = 4
MAX_ANNOUNCED = 32  # message ids in an ANNOUNCE, which is one small frame
MAX_FRAGMENTS = 64
MAX_LISTED = 65_535  # messages of a robot in an ANSWER
MAX_OPENED = 4_096  # in an OPEN: more than any node lists there
MAX_ROBOTS = 256

# Version, sort of knowledge, boot id, budget, configuration hash, configuration hash of the peer's
# last TOPICS, address token.
_OPEN = struct.Struct(">BBQQQQQ")
_SINCE = struct.Struct(">QQ")
_COUNT = struct.Struct(">H")
_DIGEST = struct.Struct(">BQ")
_PARTIAL = struct.Struct(">QIB")
_RANGE = struct.Struct(">II")
# Reception, version, configuration hash, address token, boot id, 1 if the peer's robot runs twice.
_HELLO = struct.Struct(">BBQQQB")
_TOPICS = struct.Struct(">Q")
_DEFINITION = struct.Struct(">HI")
_SKIP = struct.Struct(">Q")
_DONE = struct.Struct(">QQIB")
_GROUPS = struct.Struct(f">B{GROUPS}Q")
_ANSWER = struct.Struct(">BHH")
_TOPIC_STAMP = struct.Struct(">BHI")
_KNOWS_SINCE, _KNOWS_HAVE, _KNOWS_DIGEST = 1, 2, 3


class VersionError(SyncFrameError):
    """An OPEN of another version of the sync."""


@dataclass(frozen=True, slots=True)
class Since:
    """We hold all that database `epoch` of the peer had at `sequence`, and these `message_ids`."""

    epoch: int
    sequence: int
    message_ids: Sequence[int]


@dataclass(frozen=True, slots=True)
class Have:
    """The ids of all messages that we hold."""

    message_ids: Sequence[int]


@dataclass(frozen=True, slots=True)
class Digest:
    """By robot, the digest of all its messages that we hold."""

    digests: dict[int, int]


class FragmentRequest(NamedTuple):
    """A partly received message, and its missing ranges."""

    message_id: int
    total: int
    missing: list[Range]


@dataclass(frozen=True, slots=True)
class Open:
    """The opening of the pulling node: its messages, its incomplete messages, its budget.

    `boot_id` identifies its process. `budget` is in bytes of frames; 0: no limit. `config_hash` is
    the hash of its definitions of all ids (`config_hash_of`), `known_hash` that of the serving
    side's last TOPICS; 0: none received. `address_token` is the last one that the serving side has
    issued to it; 0: none.
    """

    boot_id: int
    budget: int
    knowledge: Since | Have | Digest
    requests: Sequence[FragmentRequest] = ()
    config_hash: int = 0
    address_token: int = 0
    known_hash: int = 0

    def encode(self) -> bytes:
        """Encode the content of the message."""
        match self.knowledge:
            case Since(epoch, sequence, message_ids):
                sort = _KNOWS_SINCE
                parts = [_SINCE.pack(epoch, sequence), _counted(message_ids)]
            case Have(message_ids):
                sort = _KNOWS_HAVE
                parts = [_counted(message_ids)]
            case Digest(digests):
                sort = _KNOWS_DIGEST
                parts = [_COUNT.pack(len(digests))]
                parts += [_DIGEST.pack(*item) for item in digests.items()]
        parts.append(bytes((len(self.requests),)))
        for request in self.requests:
            parts.append(_PARTIAL.pack(request.message_id, request.total, len(request.missing)))
            parts += [_RANGE.pack(*each) for each in request.missing]
        hashes = self.config_hash, self.known_hash
        head = _OPEN.pack(VERSION, sort, self.boot_id, self.budget, *hashes, self.address_token)
        return head + b"".join(parts)

    @classmethod
    def decode(cls, content: bytes) -> Open:
        """Decode the content of the message. Raises SyncFrameError, or VersionError."""
        if content[:1] != bytes((VERSION,)):
            raise VersionError(f"version {content[:1].hex()} of the sync; ours is {VERSION}")
        reader = _Reader(content)
        _, sort, boot_id, budget, config_hash, known_hash, address_token = reader.read(_OPEN)
        knowledge: Since | Have | Digest
        if sort == _KNOWS_SINCE:
            epoch, sequence = reader.read(_SINCE)
            knowledge = Since(epoch, sequence, reader.message_ids())
        elif sort == _KNOWS_HAVE:
            knowledge = Have(reader.message_ids())
        elif sort == _KNOWS_DIGEST:
            knowledge = Digest(dict(reader.table(_DIGEST, reader.read(_COUNT)[0])))
        else:
            raise SyncFrameError(f"knowledge of sort {sort}")
        requests = [_request(reader) for _ in range(reader.byte())]
        if len(requests) > MAX_FRAGMENTS:
            raise SyncFrameError(f"{len(requests)} partial messages")
        reader.end()
        return cls(boot_id, budget, knowledge, requests, config_hash, address_token, known_hash)


def _request(reader: _Reader) -> FragmentRequest:
    message_id, total, count = reader.read(_PARTIAL)
    missing: list[Range] = reader.table(_RANGE, count)
    bounds = [bound for each in missing for bound in each]
    if (
        not 0 < count <= MAX_RANGES
        or not is_body(message_id, total)
        or bounds != sorted(set(bounds))
        or bounds[-1] > total
    ):
        raise SyncFrameError("a partial message with impossible ranges")
    return FragmentRequest(message_id, total, missing)


class Reception(enum.IntEnum):
    """The serving side's answer to an OPEN."""

    WELCOME = 0
    UNKNOWN = 1  # the serving side does not know the sequence of the Since
    TOPICS_WANTED = 2  # its definitions of ids differ: only TOPICS follows
    UNREADABLE = 3  # damaged, or of another version: nothing follows


class Hello(NamedTuple):
    """The first message of the serving node: its configuration hash and version, an address token.

    A peer that returns the token in a later OPEN has proven its address. `duplicate`: the serving
    node has detected two processes of the pulling robot.
    """

    reception: Reception = Reception.WELCOME
    config_hash: int = 0
    version: int = VERSION
    address_token: int = 0
    boot_id: int = 0
    duplicate: bool = False

    def encode(self) -> bytes:
        """The content of the message."""
        return _HELLO.pack(
            self.reception,
            self.version,
            self.config_hash,
            self.address_token,
            self.boot_id,
            self.duplicate,
        )

    @classmethod
    def decode(cls, content: bytes) -> Hello:
        """Decode the content of the message. Raises SyncFrameError.

        Of another version only the version number is decoded: the rest may differ.
        """
        if len(content) > 1 and content[1] != VERSION:
            return cls(Reception.UNREADABLE, 0, content[1])
        reception, _, config_hash, address_token, boot_id, duplicate = _only(_HELLO, content)
        if reception > max(Reception):
            raise SyncFrameError(f"a reception of sort {reception}")
        return cls(
            Reception(reception),
            config_hash,
            address_token=address_token,
            boot_id=boot_id,
            duplicate=bool(duplicate),
        )


class Done(NamedTuple):
    """The last message of the serving node: it sent all up to `sequence`, in `frames` frames.

    `cut_short`: the budget was used up before that.
    """

    epoch: int
    sequence: int
    frames: int
    cut_short: bool

    def encode(self) -> bytes:
        """The content of the message."""
        return _DONE.pack(*self)

    @classmethod
    def decode(cls, content: bytes) -> Done:
        """Decode the content of the message. Raises SyncFrameError."""
        epoch, sequence, frames, cut_short = _only(_DONE, content)
        return cls(epoch, sequence, frames, bool(cut_short))


DONE_BYTES = _DONE.size


def encode_topics(config_hash: int, definitions: Mapping[int, int]) -> bytes:
    """The content of a TOPICS: a node's definitions of ids, by topic key."""
    entries = [_DEFINITION.pack(*each) for each in sorted(definitions.items())]
    return _TOPICS.pack(config_hash) + b"".join(entries)


def decode_topics(content: bytes) -> tuple[int, dict[int, int]]:
    """The reverse of `encode_topics`. Raises SyncFrameError."""
    head, entries = content[: _TOPICS.size], content[_TOPICS.size :]
    if len(head) < _TOPICS.size or len(entries) % _DEFINITION.size:
        raise SyncFrameError(f"a TOPICS of {len(content)} bytes")
    return _TOPICS.unpack(head)[0], dict(_DEFINITION.iter_unpack(entries))


def encode_groups(groups: Iterable[tuple[int, Sequence[int]]]) -> bytes:
    """The content of a GROUPS: robot ids, and the digests of the groups of their topics."""
    return b"".join(_GROUPS.pack(robot_id, *digests) for robot_id, digests in groups)


def decode_groups(content: bytes) -> dict[int, tuple[int, ...]]:
    """The reverse of `encode_groups`. Raises SyncFrameError."""
    if len(content) % _GROUPS.size:
        raise SyncFrameError(f"group digests in {len(content)} bytes")
    return {each[0]: each[1:] for each in _GROUPS.iter_unpack(content)}


class HeldGroups(NamedTuple):
    """The messages that the pulling node holds in some groups (a bit each) of a robot's topics."""

    robot_id: int
    groups: int
    message_ids: Sequence[int]


def encode_answers(held_groups: Iterable[HeldGroups]) -> bytes:
    """The content of an ANSWER. Ids that do not fit are omitted; the messages may be sent twice."""
    parts = []
    room = MAX_SYNC_MESSAGE_BYTES - (1 << 8) * _ANSWER.size
    for robot_id, groups, message_ids in held_groups:
        listed = message_ids[: min(room // _TOPIC_STAMP.size, MAX_LISTED)]
        room -= len(listed) * _TOPIC_STAMP.size
        parts.append(_ANSWER.pack(robot_id, groups, len(listed)))
        parts += [message_id.to_bytes(8, "big")[1:] for message_id in listed]
    return b"".join(parts)


def decode_answers(content: bytes) -> list[HeldGroups]:
    """The reverse of `encode_answers`. Raises SyncFrameError."""
    reader = _Reader(content)
    held_groups: list[HeldGroups] = []
    while not reader.at_end:
        if len(held_groups) == MAX_ROBOTS:
            raise SyncFrameError("more robots in an ANSWER than a team can have")
        robot_id, groups, count = reader.read(_ANSWER)
        table = reader.table(_TOPIC_STAMP, count)
        message_ids = [
            message_id_of(robot_id, topic, upper << 32 | lower) for topic, upper, lower in table
        ]
        held_groups.append(HeldGroups(robot_id, groups, message_ids))
    return held_groups


def encode_skip(message_id: int) -> bytes:
    """The content of a SKIP: the rest of this message need not be sent."""
    return _SKIP.pack(message_id)


def decode_skip(content: bytes) -> int:
    """The reverse of `encode_skip`. Raises SyncFrameError."""
    message_id: int = _only(_SKIP, content)[0]
    return message_id


def encode_announce(message_ids: Sequence[int]) -> bytes:
    """The content of an ANNOUNCE: the ids of new messages to pull; empty: pull in any case."""
    if len(message_ids) > MAX_ANNOUNCED:
        return b""
    return struct.pack(f">{len(message_ids)}Q", *message_ids)


def decode_announce(content: bytes) -> tuple[int, ...]:
    """The reverse of `encode_announce`. Raises SyncFrameError."""
    if len(content) % 8 or len(content) > 8 * MAX_ANNOUNCED:
        raise SyncFrameError(f"an ANNOUNCE of {len(content)} bytes")
    return struct.unpack(f">{len(content) // 8}Q", content)


def _counted(message_ids: Sequence[int]) -> bytes:
    return struct.pack(f">H{len(message_ids)}Q", len(message_ids), *message_ids)


def _only(layout: struct.Struct, content: bytes) -> tuple[Any, ...]:
    if len(content) != layout.size:
        raise SyncFrameError(f"a message of {len(content)} bytes, not {layout.size}")
    return layout.unpack(content)


class _Reader:
    """Reads consecutive fields."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._at = 0  # offset of the next field

    @property
    def at_end(self) -> bool:
        return self._at == len(self._content)

    def read(self, layout: struct.Struct) -> tuple[Any, ...]:
        return layout.unpack(self._take(layout.size))

    def byte(self) -> int:
        return self._take(1)[0]

    def table(self, layout: struct.Struct, count: int) -> list[tuple[Any, ...]]:
        return list(layout.iter_unpack(self._take(layout.size * count)))

    def message_ids(self) -> tuple[int, ...]:
        (count,) = self.read(_COUNT)
        if count > MAX_OPENED:
            raise SyncFrameError(f"{count} messages in an OPEN")
        message_ids = struct.unpack(f">{count}Q", self._take(8 * count))
        if any(message_id & STAMP_MASK >= STAMPS_MS for message_id in message_ids):
            raise SyncFrameError("a stamp that is no time")
        return message_ids

    def end(self) -> None:
        if not self.at_end:
            raise SyncFrameError(f"{len(self._content) - self._at} bytes too many")

    def _take(self, size: int) -> bytes:
        part = self._content[self._at : self._at + size]
        if len(part) != size:
            raise SyncFrameError(f"ends {size - len(part)} bytes too early")
        self._at += size
        return part
