"""The bytes of frames that one pull may be sent."""

from __future__ import annotations

from mocha_link.sync.frames import GROUPS, MESSAGE_HEADER_BYTES, TOPICS
from mocha_link.sync.sync_messages import DONE_BYTES

_DONE_BYTES = MESSAGE_HEADER_BYTES + DONE_BYTES
_FREE = (GROUPS, TOPICS)  # kinds that must not leave too little for any message


class SendBudget:
    """What the peer allows one pull to send, and what was sent of it.

    Attributes:
        sent_bytes: of all frames.
    """

    def __init__(self) -> None:
        self.sent_bytes = 0
        self._limit_bytes = 0  # by the peer's last OPEN; 0: no limit
        self._free_bytes = 0  # of what was sent, what does not count

    def renew(self, limit_bytes: int) -> None:
        """The peer has opened with another limit."""
        self._limit_bytes = limit_bytes

    def spend(self, size: int, kind: int | None = None) -> None:
        """A frame was sent, of a sync message of this kind or of chunks."""
        self.sent_bytes += size
        if kind in _FREE:
            self._free_bytes += size

    def room(self, room: int) -> int:
        """What a frame of chunks may take of so many bytes: DONE has to follow."""
        if not self._limit_bytes:
            return room
        return min(room, self._limit_bytes + self._free_bytes - self.sent_bytes - _DONE_BYTES)
