"""The bytes of frames that may be sent for one pull."""

from __future__ import annotations

from mocha_link.sync.frames import GROUPS, MESSAGE_HEADER_BYTES, TOPICS
from mocha_link.sync.sync_messages import DONE_BYTES

_DONE_BYTES = MESSAGE_HEADER_BYTES + DONE_BYTES
_FREE = (GROUPS, TOPICS)  # not counted, so that they leave room for messages


class SendBudget:
    """The peer's limit on the frames of one pull, and the bytes sent so far.

    Attributes:
        sent_bytes: bytes of all frames.
    """

    def __init__(self) -> None:
        self.sent_bytes = 0
        self._limit_bytes = 0  # from the peer's last OPEN; 0: no limit
        self._free_bytes = 0  # sent bytes that are not counted

    def renew(self, limit_bytes: int) -> None:
        """Set the limit from an OPEN of the peer."""
        self._limit_bytes = limit_bytes

    def spend(self, size: int, kind: int | None = None) -> None:
        """Count a sent frame; `kind`: of its sync message; None: it is a frame of chunks."""
        self.sent_bytes += size
        if kind in _FREE:
            self._free_bytes += size

    def room(self, room: int) -> int:
        """The size that a frame of chunks may have within `room` bytes; DONE must fit after it."""
        if not self._limit_bytes:
            return room
        return min(room, self._limit_bytes + self._free_bytes - self.sent_bytes - _DONE_BYTES)
