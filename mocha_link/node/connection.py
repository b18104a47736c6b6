"""One outgoing connection to a peer, which carries our requests and the peer's replies.

The caller drives it: `watch` after every turn, `turn` when `is_ready`.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Container, Iterable, Sequence

import zmq

from mocha_link.forks import closed_in_children
from mocha_link.hosts import family_of, host_of, joined, socket_address
from mocha_link.node import kernel, zmtp
from mocha_link.node.curve import CurveClient
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.send_buffer import SendBuffer
from mocha_link.node.zmtp import Part
from mocha_link.store import wire
from mocha_link.sync import Standing
from mocha_link.team import PublicKey, SecretKey

# A reply: id, prefix, an LZ4 frame of incompressible data, and a trailer.
MAX_REPLY_BYTES = wire.MAX_BYTES + 1024 * 1024
SEND_BEFORE_READY_S = (
    0.015  # from connecting until requests are sent without the peer's handshake: see `zmtp`
)

_READ_BYTES = 64 * 1024
_TURN_BYTES = 4 * 1024 * 1024  # read in a row, so that no peer starves the others
_MAX_PONG_BYTES = 1024 * 1024  # queued replies to the peer's heartbeats


class Connection:
    """A ZMTP connection that is set up in half the time that libzmq needs.

    Args:
        host: An address, IPv4 or IPv6.
        port: The peer's port for us.
        send_before_ready: Requests do not wait for the peer's handshake; with keys they must.
        keys: Our secret key and the peer's public key; None: the connection is not encrypted.

    Attributes:
        host: the peer's address, for which it was opened.
        failure: the text of the error that ended the connection; None: it is usable.
        send_before_ready: requests do not wait for the peer's handshake; becomes False when the
            peer closes the connection because of that.
        left: it was abandoned in favour of another address.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        send_before_ready: bool = True,
        keys: tuple[SecretKey, PublicKey] | None = None,
    ) -> None:
        self.host = host
        self.failure: str | None = None
        self.left = False
        self.send_before_ready = send_before_ready
        self._keys = keys
        self._port = port
        self._unreported = False  # `advance` has received bytes that the next `turn` reports
        self._unconfirmed: list[bytes] = []  # requests that were sent before the peer was ready
        self._waiting: list[bytes] = []  # requests that were not sent yet
        self._watched: socket.socket | None = None  # registered with the poller
        self._connect()

    def _connect(self) -> None:
        self._protocol = zmtp.ZmtpSession(MAX_REPLY_BYTES, mechanism=self._mechanism())
        self._out = SendBuffer([self._protocol.hello])
        self._connected_s: float | None = None  # when TCP was established, steady seconds
        self._opened = False  # requests were sent before the peer was ready
        self._socket = closed_in_children(socket.socket(family_of(self.host), socket.SOCK_STREAM))
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        kernel.bear_losses(self._socket)
        try:
            self._socket.connect(socket_address(self.host, self._port))
        except BlockingIOError:
            pass
        except OSError as error:
            self._fail_to_connect(error.strerror or str(error))

    def _fail_to_connect(self, why: str) -> None:
        self.failure = f"cannot connect to {joined(self.host, self._port)}: {why}"

    def _mechanism(self) -> zmtp.Mechanism:
        if self._keys is None:
            return zmtp.Null(b"DEALER")
        own, peer = self._keys
        return CurveClient(own.curve, own.public.curve, peer.curve)

    def watch(self, poller: Poller, owner: str = "") -> None:
        """Register the events that the connection waits for, with their owner."""
        if self._watched is not self._socket:
            self.forget(poller)  # the first connection
            self._watched = self._socket
        writing = self._connected_s is None or self._out
        flags = zmq.POLLIN | (zmq.POLLOUT if writing else 0)
        poller.register(self._socket.fileno(), flags, owner)

    def forget(self, poller: Poller) -> None:
        """Unregister it from the poller."""
        watched, self._watched = self._watched, None
        if watched is not None:
            with contextlib.suppress(KeyError):
                poller.unregister(watched.fileno())
            if watched is not self._socket:
                watched.close()

    def is_ready(self, ready: Container[Polled], now_s: float) -> bool:
        """Whether a turn is due."""
        late = bool(self._waiting) and self._may_request(now_s)
        return late or self.failure is not None or self._socket.fileno() in ready

    @property
    def needs_polling(self) -> bool:
        """Whether the connection needs turns without a poller event."""
        return bool(self._waiting) or self.failure is not None

    @property
    def wake_s(self) -> float | None:
        """When requests are sent although the peer's handshake is missing; None: they are not."""
        sends_early = (
            self.send_before_ready
            and not self._opened
            and not self._protocol.ready
            and not self._keys
        )
        if self._connected_s is None or not sends_early or not self._waiting or self._out:
            return None
        return self._connected_s + SEND_BEFORE_READY_S

    @property
    def stands(self) -> bool:
        """Whether it is established; with keys, whether the peer has proven its key."""
        return self._protocol.ready if self._keys else self._connected_s is not None

    def advance(self, now_s: float) -> None:
        """Continue its set-up; the next `turn` reports the bytes that were received."""
        self._unreported |= self.turn(now_s)

    def leave(self, why: str) -> None:
        """Abandon it: its addresses are out of date, and a new connection may succeed."""
        self.failure = self.failure or why
        self.left = True

    def is_from_here(self) -> bool:
        """Whether this machine still has the local address of the connection."""
        try:
            return kernel.is_ours(host_of(self._socket.getsockname()))
        except OSError:
            return False

    def turn(self, now_s: float) -> bool:
        """Send and receive as much as possible; returns whether anything was received."""
        arrived, self._unreported = self._unreported, False
        try:
            if self._connected_s is None:
                if not self._is_connected():
                    return arrived
                self._connected_s = now_s
                arrived = True
            arrived = self._read() or arrived
            self._send_requests(now_s)
            self._out.flush(self._socket)
        except (OSError, zmtp.ZmtpError) as error:
            self._fail(error)
        return arrived

    def send(self, frame: bytes) -> None:
        """Send a request."""
        self._waiting.append(frame)
        if self._protocol.ready:
            self._send_requests(0.0)
            with contextlib.suppress(OSError):
                self._out.flush(self._socket)

    def take_waiting(self) -> list[bytes]:
        """Remove and return the requests that were not sent yet."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def replies(self) -> Iterable[Sequence[Part]]:
        """The body parts of the replies since the last call."""
        return self._protocol.replies()

    def rtt_s(self) -> float | None:
        """The round-trip time that the kernel has measured."""
        return kernel.rtt_s(self._socket)

    def unanswered(self) -> int:
        """The kernel's count of consecutive retransmissions."""
        return kernel.unanswered(self._socket)

    def close(self) -> None:
        """Close; the kernel sends what it has taken, bytes that are queued here are dropped."""
        self._socket.close()

    def abort(self) -> None:
        """Close at once and discard unsent bytes, which would reach the peer too late."""
        kernel.reset(self._socket)
        self.close()

    def _is_connected(self) -> bool:
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if error:
            raise OSError(error, os.strerror(error))
        try:
            self._socket.getpeername()
        except OSError:
            return False  # still connecting
        return True

    def _may_request(self, now_s: float) -> bool:
        wake_s = self.wake_s
        return self._protocol.ready or (wake_s is not None and now_s >= wake_s)

    def _send_requests(self, now_s: float) -> None:
        if not self._waiting or not self._may_request(now_s):
            return
        if not self._protocol.ready:
            self._unconfirmed = list(self._waiting)
            self._opened = True
        for frame in self._waiting:
            self.push([frame])
        self._waiting.clear()

    def push(self, parts: Sequence[Part]) -> None:
        """Queue a frame of a sync for the next `flush`; the connection must be established."""
        self._out.extend(self._protocol.encoded([b"", *parts]))

    def flush(self) -> bool:
        """Send as much as the kernel accepts; returns whether nothing is left."""
        with contextlib.suppress(OSError):  # the next turn reports the error
            self._out.flush(self._socket)
        return not self._out

    @property
    def takes_frames(self) -> bool:
        """Whether frames may be pushed."""
        return self.failure is None and self._protocol.ready

    def standing(self) -> Standing:
        """The kernel's measurements."""
        return kernel.standing(self._socket)

    def _read(self) -> bool:
        taken = 0
        while taken < _TURN_BYTES:
            room = self._protocol.room()
            try:
                if room is None:
                    data = self._socket.recv(_READ_BYTES)
                    count = len(data)
                else:
                    count = self._socket.recv_into(room)
            except BlockingIOError:
                break
            if not count:
                raise ConnectionResetError(0, "the peer closed the connection")
            taken += count
            replies = self._protocol.receive(data) if room is None else self._protocol.filled(count)
            self._out.reply(replies)
            if self._out.reply_bytes > _MAX_PONG_BYTES:
                raise zmtp.ZmtpError("the peer does not read the replies that it requests")
        return taken > 0

    def _fail(self, error: Exception) -> None:
        handshaking = self._connected_s is not None and not self._protocol.ready
        if handshaking and self._opened and isinstance(error, OSError):
            # The peer closed because it read our requests with the handshake: wait for it now.
            self.send_before_ready = False
            if self._watched is None:  # while registered its descriptor must not be reused
                self._socket.close()
            self._waiting = self._unconfirmed + self._waiting
            self._connect()
        elif isinstance(error, zmtp.ZmtpError):
            self.failure = str(error)
        elif handshaking:
            why = "the keys do not fit, or it has none" if self._keys else "the peer wants a key"
            self.failure = f"the connection broke in the ZeroMQ handshake, or {why}"
        elif self._connected_s is None:
            self._fail_to_connect(str(error.args[-1]))
        else:
            self.failure = "the peer closed the connection"
