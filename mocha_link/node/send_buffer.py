"""The bytes that are queued for one connection."""

from __future__ import annotations

import itertools
import socket
from collections import deque
from collections.abc import Iterable

from mocha_link.node.zmtp import Part

_MAX_PIECES = 64  # in a system call


class SendBuffer:
    """Queued bytes in order, sent in as few system calls as possible.

    Attributes:
        size: queued bytes.
        reply_bytes: bytes of replies that were queued since the buffer was last empty. They grow if
            a peer sends requests and does not read the replies.
    """

    def __init__(self, pieces: Iterable[Part] = ()) -> None:
        self.size = 0
        self.reply_bytes = 0
        self._pieces: deque[memoryview] = deque()  # not empty
        self.extend(pieces)

    def __len__(self) -> int:
        return self.size

    def extend(self, pieces: Iterable[Part]) -> None:
        """Queue bytes."""
        for piece in pieces:
            if piece:
                self._pieces.append(memoryview(piece))
                self.size += len(piece)

    def reply(self, piece: Part) -> None:
        """Queue the bytes of a reply."""
        self.count_reply(len(piece))
        self.extend([piece])

    def count_reply(self, size: int) -> None:
        """Count `size` of the queued bytes as a reply."""
        self.reply_bytes += size

    def clear(self) -> None:
        """Drop all queued bytes."""
        self._pieces.clear()
        self.size = self.reply_bytes = 0

    def flush(self, connection: socket.socket) -> None:
        """Send as much as the kernel accepts. Raises OSError."""
        while self._pieces:
            try:
                sent = connection.sendmsg(itertools.islice(self._pieces, _MAX_PIECES))
            except BlockingIOError:
                return
            self.size -= sent
            while sent:
                piece = self._pieces.popleft()
                if len(piece) > sent:
                    self._pieces.appendleft(piece[sent:])
                sent -= min(len(piece), sent)
        self.reply_bytes = 0
