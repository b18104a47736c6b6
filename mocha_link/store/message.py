"""A message as programs see it, and the batches of topics with `aggregate`.

A batch joins several small messages: each is its length (u32, big endian) and its bytes.
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
    """Bytes that are not a batch of messages."""


def pack_batch(parts: Iterable[bytes]) -> bytes:
    """Join messages into a batch, in their order.

    Args:
        parts: the payloads.

    Returns:
        The bytes of the batch.
    """
    return b"".join(piece for part in parts for piece in (_LENGTH.pack(len(part)), part))


def unpack_batch(data: bytes) -> tuple[bytes, ...]:
    """Split a batch into its messages.

    Args:
        data: the bytes of the batch.

    Returns:
        The payloads, in their order.

    Raises:
        BatchError: the bytes end within a length or a message.
    """
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

    Attributes:
        robot: the name of the robot that published it.
        topic: the name of the topic.
        header: the header on the wire.
        priority: the priority of the topic.
        data: the payload; with `aggregate` a batch.
        stamp_s: when the robot published it, Unix seconds.
        received_s: when this node received it, Unix seconds.
        parts: the messages in the batch if the topic has `aggregate`, else the payload alone; empty
            if the batch is damaged.
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
    """The payload of a message as bytes, which the caller cannot change any more.

    Args:
        data: bytes, a bytearray or a memoryview; other objects with a buffer, e.g. numpy arrays,
            are refused, as a receiver would not know what its bytes mean.
        topic: the name of the topic, for the error.

    Raises:
        TypeError: it is another object.
        PayloadError: larger than any node would accept; it is not copied then.
    """
    given: object = data  # the annotation is not enforced
    if not isinstance(given, bytes | bytearray | memoryview):
        raise TypeError(
            f"the data of {topic} must be bytes, not {type(data).__name__}; e.g. "
            "json.dumps(value).encode(), array.tobytes(), or what "
            "mocha_link.ros.typed.Typed(team).encode makes"
        )
    wire.check_size(data)
    return data if isinstance(given, bytes) else bytes(data)


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
    except BatchError:  # of a peer with another team file
        return ()
