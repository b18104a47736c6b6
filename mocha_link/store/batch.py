"""Several small messages in one: what topics with `aggregate` put on the wire.

Every message is its length (u32, big endian) and its bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

from mocha_link.errors import MochaLinkError

FULL_BYTES = 64 * 1024  # a batch of so much goes at once

_LENGTH = struct.Struct(">I")


class BatchError(MochaLinkError):
    """Bytes that are no batch of messages."""


def pack(parts: Iterable[bytes]) -> bytes:
    """The batch of some messages, in their order."""
    return b"".join(piece for part in parts for piece in (_LENGTH.pack(len(part)), part))


def unpack(data: bytes) -> tuple[bytes, ...]:
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
