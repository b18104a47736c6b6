"""One TCP connection passed through a relay, and the radio link that carries it.

Nothing here waits: sockets are non-blocking, `wanted` says what to wait for, and the relay's
thread calls back when it happened.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
from dataclasses import dataclass, field

CHUNK_BYTES = 64 * 1024

_RATE_BURST_S = 0.05  # a limited link may send this much of its rate at once
_RESET = struct.pack("ii", 1, 0)  # SO_LINGER that closes with a reset: the peer learns of it


@dataclass(slots=True, eq=False)
class RadioLink:
    """The radio between two robots: both directions, all their connections.

    Attributes:
        rate_bytes_s: What it carries in both directions together; None: no limit.
        up: Whether it carries anything now.
        down_since_s: When it was cut, on the relay's wall clock.
        credit_bytes: What a limited link may carry before it earns more.
        flows: The connections over it.
    """

    rate_bytes_s: float | None = None
    up: bool = False
    down_since_s: float = 0.0
    credit_bytes: float = 0.0
    flows: set[Flow] = field(default_factory=set)
    _earned_until_s: float = 0.0

    def restart_credit(self, now_s: float) -> None:
        """Earn from now on only."""
        self._earned_until_s = now_s

    def earn_credit(self, now_s: float) -> None:
        """Credit for the time that has passed; a little may be saved up."""
        if self.rate_bytes_s is None:
            return
        earned = max(0.0, now_s - self._earned_until_s) * self.rate_bytes_s
        self._earned_until_s = now_s
        most = max(1.0, self.rate_bytes_s * _RATE_BURST_S)
        self.credit_bytes = min(self.credit_bytes + earned, most)

    def allowance(self) -> int:
        """How many bytes may be read now."""
        if not self.up:
            return 0
        return (
            CHUNK_BYTES if self.rate_bytes_s is None else min(CHUNK_BYTES, int(self.credit_bytes))
        )


@dataclass(slots=True, eq=False)
class RelayedSocket:
    """One end of a connection: its socket, and bytes that it has yet to take."""

    socket: socket.socket
    flow: Flow
    pending: bytes = b""
    at_end: bool = False  # it will send nothing more
    told_end: bool = False  # it was told that nothing more will come
    watched: int = 0  # what the selector waits for


class Flow:
    """A relayed connection: the accepted end, and the end that is being dialled.

    Bytes are read from one side only when the other has taken all before, so no more than a chunk
    per direction is ever held.
    """

    def __init__(self, accepted: socket.socket, dialling: socket.socket, link: RadioLink) -> None:
        self.link = link
        self.near = RelayedSocket(accepted, self)
        self.far = RelayedSocket(dialling, self)
        self._connected = False  # the far end answers; until then it is dialled

    @property
    def sides(self) -> tuple[RelayedSocket, RelayedSocket]:
        """Both ends."""
        return self.near, self.far

    @property
    def ended(self) -> bool:
        """Both ends have said all, and were told so."""
        return all(side.at_end and side.told_end for side in self.sides)

    def serve(self, side: RelayedSocket, mask: int) -> bool:
        """Do what the selector found possible; False if the connection is broken."""
        try:
            if side is self.far and not self._connected:
                if side.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                    return False
                self._connected = True
            if mask & selectors.EVENT_WRITE:
                self._flush(side)
            if mask & selectors.EVENT_READ:
                self._read(side)
        except BlockingIOError:
            return True  # the readiness was an old one
        except OSError:
            return False
        return True

    def wanted(self, side: RelayedSocket) -> int:
        """What the selector should wait for at a side; nothing while the link is cut."""
        if not self.link.up:
            return 0
        dialling = side is self.far and not self._connected
        wanted = selectors.EVENT_WRITE if dialling or side.pending else 0
        if not (dialling or side.at_end or self._other(side).pending) and self.link.allowance():
            wanted |= selectors.EVENT_READ
        return wanted

    def close(self, *, reset: bool) -> None:
        """Close both sockets; with a reset, so that both ends learn of it at once."""
        for side in self.sides:
            close_socket(side.socket, reset=reset)

    def _other(self, side: RelayedSocket) -> RelayedSocket:
        return self.far if side is self.near else self.near

    def _read(self, side: RelayedSocket) -> None:
        other = self._other(side)
        size = self.link.allowance()
        if side.at_end or other.pending or not size:
            return
        other.pending = side.socket.recv(size)
        self.link.credit_bytes -= len(other.pending)
        side.at_end = not other.pending
        self._flush(other)

    def _flush(self, side: RelayedSocket) -> None:
        if side is self.far and not self._connected:
            return
        if side.pending:
            with contextlib.suppress(BlockingIOError):
                side.pending = side.pending[side.socket.send(side.pending) :]
        if not side.pending and self._other(side).at_end and not side.told_end:
            side.told_end = True
            side.socket.shutdown(socket.SHUT_WR)


def close_socket(connection: socket.socket, *, reset: bool) -> None:
    """Close a TCP socket, quietly or with a reset."""
    if reset:
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
    connection.close()
