"""A message as programs see it, and the batches in which some topics send theirs.

Several small messages go in one where the topic says `aggregate`: each is its length (u32, big
endian) and its bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field

from mocha_link.errors import MochaLinkError
from mocha_link.store import wire
from mocha_link.store.record import Record
from mocha_link.store.wire import Header
from mocha_link.team import Priority, Team

_LENGTH = struct.Struct(">I")
LENGTH_BYTES = _LENGTH.size  # before each message of a batch


class BatchError(MochaLinkError):
    """Bytes that are no batch of messages."""


def pack_batch(parts: Iterable[bytes]) -> bytes:
    """The batch of some messages, in their order."""
    return b"".join(piece for part in parts for piece in (_LENGTH.pack(len(part)), part))


def unpack_batch(data: bytes) -> tuple[bytes, ...]:
    """The messages of a batch. Raises BatchError."""
    parts = []
    position = 0
    while position < len(data):
        start = position + _LENGTH.size
        if start > len(data):
            raise BatchError("ends within a length")
        position = start + _LENGTH.unpack_from(data, start - _LENGTH.size)[0]
        if position > len(data):
            raise BatchError("ends within a message")
        parts.append(data[start:position])
    return tuple(parts)


@dataclass(frozen=True, slots=True)
class Message:
    """The newest message of a topic of a robot.

    `stamp_s` is when the robot published it, `received_s` when it got here: Unix seconds. `parts`
    are the messages in it, more than one if the topic says `aggregate`, none if it is damaged.
    """

    robot: str
    topic: str
    header: Header
    priority: Priority
    data: bytes = field(repr=False)
    stamp_s: float
    received_s: float
    parts: tuple[bytes, ...] = field(default=(), repr=False)


def as_bytes(data: bytes, topic: str) -> bytes:
    """The data of a message of a topic that is to be published. Raises TypeError."""
    try:
        return bytes(memoryview(data))
    except TypeError:
        raise TypeError(
            f"the data of {topic} must be bytes, not {type(data).__name__}; e.g. "
            "json.dumps(value).encode(), or what mocha_link.ros.typed.Typed(team).encode makes"
        ) from None


def message_of(record: Record, team: Team) -> Message | None:
    """A stored message, unpacked; None if the team has no such topic.

    A storage may hold those, of another team file.
    """
    known = team.by_ids(record.header.robot_id, record.header.topic_id)
    if known is None:
        return None
    robot, topic = known
    data = wire.unpack(record.body)
    return Message(
        robot=robot.name,
        topic=topic.name,
        header=record.header,
        priority=topic.priority,
        data=data,
        stamp_s=record.stamp_s,
        received_s=record.received_s,
        parts=_parts(data) if topic.aggregate else (data,),
    )


def _parts(data: bytes) -> tuple[bytes, ...]:
    try:
        return unpack_batch(data)
    except BatchError:  # of a peer whose team file says something else
        return ()
