"""The answering end of one connection: bounded, whatever the other end does."""

from __future__ import annotations

import itertools
import socket
from collections import deque
from collections.abc import Sequence

from mocha_link.node.port import MAX_REQUEST_BYTES
from mocha_link.node.zmtp import Part, ZmtpSession, encoded

OWED_BYTES = 256 * 1024  # replies that wait before requests do

_READ_BYTES = 16 * 1024
_MAX_REQUESTS = 1024  # in what is read at once; our pulls have up to 256 under way
_MAX_PIECES = 64  # in a system call


class Caller:
    """A connection to the port: what it asks, and what it has not taken yet."""

    def __init__(self, connection: socket.socket, name: bytes, now_s: float) -> None:
        self.name = name  # begins its routes
        self.connection = connection
        self.number = connection.fileno()
        self.requests: deque[list[Part]] = deque()  # not answered yet
        self.waiting_bytes = 0  # for the kernel to take them
        self.began_s = now_s
        self.ended = False  # nothing more comes
        self.moved = 0  # when it last took or brought something, by the count of the node
        self.watched = 0  # for what the poller waits
        self._session = ZmtpSession(MAX_REQUEST_BYTES, _MAX_REQUESTS)
        self._owed = 0  # bytes of replies since it took all
        self._out: deque[memoryview] = deque()
        self._put(ZmtpSession.hello_of_router)

    @property
    def ready(self) -> bool:
        """Whether its handshake came."""
        return self._session.ready

    @property
    def is_late(self) -> bool:
        """Whether its requests wait because it does not take its replies."""
        return self._owed > OWED_BYTES

    def read(self) -> bool:
        """Take in what has come; whether anything has. Raises ZmtpError."""
        try:
            data = self.connection.recv(_READ_BYTES)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        self.ended = not data
        answer = self._session.receive(data)
        if answer:
            self._put(answer)
            self._owed += len(answer)
        self.requests.extend(self._session.messages())
        return bool(data)

    def reply(self, envelope: Sequence[bytes], frame: bytes) -> None:
        """Have a reply sent with the next `flush`."""
        self._owed += len(frame)
        self.push([*envelope, frame])

    def push(self, parts: Sequence[Part]) -> None:
        """Likewise a frame of a sync, which the replies to its requests do not wait for."""
        for piece in encoded(parts):
            self._put(piece)

    def _put(self, piece: Part) -> None:
        self._out.append(memoryview(piece))
        self.waiting_bytes += len(piece)

    def flush(self) -> bool:
        """Send what the kernel takes; whether it has taken anything."""
        before = self.waiting_bytes
        while self._out:
            try:
                sent = self.connection.sendmsg(itertools.islice(self._out, _MAX_PIECES))
            except BlockingIOError:
                break
            except OSError:  # it is gone
                self.ended = True
                self._out.clear()
                self.waiting_bytes = 0
                break
            self.waiting_bytes -= sent
            while sent:
                piece = self._out.popleft()
                if len(piece) > sent:
                    self._out.appendleft(piece[sent:])
                sent -= min(len(piece), sent)
        if not self._out:
            self._owed = 0
        return self.waiting_bytes < before
