"""The body of a message on the wire: DTYPE u8, PRIORITY u8, then one LZ4 frame.

What stands behind the end of the LZ4 frame is carried on but not read (old nodes do the same).
"""

from __future__ import annotations

import lz4.frame

from mocha_link.errors import MochaLinkError

MAX_BYTES = 64 * 1024 * 1024
PREFIX = 2
_STEP_BYTES = 1024 * 1024


class PayloadError(MochaLinkError):
    """A message that cannot be sent, or a received body that is not one."""


def pack(dtype: int, priority: int, data: bytes) -> bytes:
    """The body for data. Raises PayloadError if it is larger than any node would accept."""
    size = memoryview(data).nbytes  # TypeError for what is not bytes
    if size > MAX_BYTES:
        raise PayloadError(f"{size} bytes; at most {MAX_BYTES} can be sent: split the message")
    body: bytes = bytes((dtype, priority)) + lz4.frame.compress(data)
    return body


def dtype_of(body: bytes) -> int:
    """The type id in a body. Raises PayloadError."""
    if len(body) <= PREFIX:
        raise PayloadError(f"a body of {len(body)} bytes holds no message")
    return body[0]


def unpack(body: bytes, limit: int = MAX_BYTES) -> bytes:
    """The data in a body, decompressed to at most `limit` bytes. Raises PayloadError."""
    dtype_of(body)
    decompressor = lz4.frame.LZ4FrameDecompressor()
    data, pending = bytearray(), body[PREFIX:]
    try:
        while not decompressor.eof:
            # Doubling keeps the copies few; the room for a bomb is never asked for at once.
            room = min(max(len(data), _STEP_BYTES), limit + 1 - len(data))
            piece = decompressor.decompress(pending, max_length=room)
            pending = b""
            data += piece
            if len(data) > limit:
                raise PayloadError(f"unpacks to more than {limit} bytes")
            if not piece and decompressor.needs_input and not decompressor.eof:
                raise PayloadError("ends within its LZ4 frame")
    except (RuntimeError, EOFError, ValueError, MemoryError) as error:
        raise PayloadError(f"not an LZ4 frame: {error}") from None
    return bytes(data)
