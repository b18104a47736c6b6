"""Text as ROS 2 serializes it; what both ways to ROS 2 share."""

from __future__ import annotations

import struct
from collections.abc import Callable

_LITTLE_ENDIAN = b"\x00\x01"


class Cdr:
    """A middleware whose messages are CDR."""

    ros = 2

    def text(self, data: bytes) -> bytes:
        """See `bridge.Middleware`."""
        return _LITTLE_ENDIAN + b"\0\0" + struct.pack("<I", len(data) + 1) + data + b"\0"

    def from_text(self, data: bytes) -> bytes:
        """See `bridge.Middleware`."""
        order = "<" if data[:2] == _LITTLE_ENDIAN else ">"
        if len(data) < 9 or data[0] or data[1] > 1:
            raise ValueError("not a std_msgs/String")
        end = 8 + struct.unpack_from(f"{order}I", data, 4)[0]
        if not 9 <= end <= len(data) <= end + 3 or data[end - 1]:
            raise ValueError("not a std_msgs/String")
        return data[8 : end - 1]

    def watch(self, wait: Callable[[float], bool]) -> str | None:
        """See `bridge.Middleware`: DDS needs no server that could be another one later."""
        del wait
        return None
