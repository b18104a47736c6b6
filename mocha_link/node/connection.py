"""One outgoing connection to a peer, made fresh for a pull and closed after it.

Requests go out on it and replies come in. Without encryption it is of our own ZMTP, with keys it
is libzmq's; both are driven in the same way: `watch` after every turn, `turn` when `is_ready`.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Container, Iterable, Iterator, Sequence

import zmq
from zmq.utils.monitor import parse_monitor_message

from mocha_link.node import kernel, zmtp
from mocha_link.node.curve import protect_contact
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.zmtp import Part
from mocha_link.store import wire
from mocha_link.team.keys import PublicKey, SecretKey

# A reply: id, prefix, an LZ4 frame of incompressible data, something behind it.
MAX_REPLY_BYTES = wire.MAX_BYTES + 1024 * 1024
EAGER_S = 0.015  # after our handshake, requests leave though the peer's has not come: see `zmtp`

_READ_BYTES = 64 * 1024
_TURN_BYTES = 4 * 1024 * 1024  # in a row, so that no peer starves the others
_MAX_ANSWERS = 1024 * 1024  # to heartbeats
_QUEUE_REPLIES = 16
_LINGER_MS = 300

_FAILURES: dict[int, str] = {
    zmq.Event.DISCONNECTED: "the peer closed the connection",
    zmq.Event.HANDSHAKE_FAILED_NO_DETAIL: "the connection broke in the ZeroMQ handshake, "
    "or the keys do not fit",
    zmq.Event.HANDSHAKE_FAILED_PROTOCOL: "what answers there has no key, or does not speak ZeroMQ",
    zmq.Event.HANDSHAKE_FAILED_AUTH: "the peer refused our key",
    zmq.Event.CLOSED: "cannot connect",
}


class TcpConnection:
    """A connection without encryption, of our own ZMTP: it is set up in half the time.

    Attributes:
        failure: what it suffered, in words; it is of no use then. None: it stands.
        eager: requests do not wait for the peer's handshake; False when that did not do.
    """

    def __init__(self, address: str, port: int, *, eager: bool = True) -> None:
        self.failure: str | None = None
        self.eager = eager
        self._address = (address, port)  # to dial again
        self._unconfirmed: list[bytes] = []  # requests that were sent before the peer was ready
        self._waiting: list[bytes] = []  # requests until it stands
        self._watched: socket.socket | None = None  # in the poller
        self._connect()

    def _connect(self) -> None:
        self._protocol = zmtp.ZmtpSession(MAX_REPLY_BYTES)
        self._out = bytearray(self._protocol.hello)
        self._answers = 0  # bytes of them that may not be out yet
        self._connected_s: float | None = None
        self._opened = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            self._socket.connect(self._address)
        except BlockingIOError:
            pass
        except OSError as error:
            host, port = self._address
            self.failure = f"cannot connect to {host}:{port}: {error.strerror}"

    def watch(self, poller: Poller, owner: str = "") -> None:
        """Have the poller wait for what this waits for, and say whose it is."""
        if self._watched is not self._socket:
            self.forget(poller)  # the first connection
            self._watched = self._socket
        writing = self._connected_s is None or self._out
        flags = zmq.POLLIN | (zmq.POLLOUT if writing else 0)
        poller.register(self._socket.fileno(), flags, owner)

    def forget(self, poller: Poller) -> None:
        """Take it out of the poller."""
        watched, self._watched = self._watched, None
        if watched is not None:
            with contextlib.suppress(KeyError):
                poller.unregister(watched.fileno())
            if watched is not self._socket:
                watched.close()

    def is_ready(self, ready: Container[Polled], now_s: float) -> bool:
        """Whether there is something to do."""
        late = bool(self._waiting) and self._may_ask(now_s)
        return late or self.failure is not None or self._socket.fileno() in ready

    @property
    def is_restless(self) -> bool:
        """Whether something may be to be done of which the poller does not tell."""
        return bool(self._waiting) or self.failure is not None

    @property
    def wake_s(self) -> float | None:
        """When requests leave though the peer's handshake has not come: not together with ours."""
        hurries = self.eager and not self._opened and not self._protocol.ready
        if self._connected_s is None or not hurries or not self._waiting or self._out:
            return None
        return self._connected_s + EAGER_S

    def turn(self, now_s: float) -> bool:
        """Move what can be moved; says whether anything arrived."""
        arrived = False
        try:
            if self._connected_s is None:
                if not self._is_connected():
                    return False
                self._connected_s = now_s
                arrived = True
            arrived = self._read() or arrived
            self._ask(now_s)
            self._flush()
        except (OSError, zmtp.ZmtpError) as error:
            self._fail(error)
        return arrived

    def send(self, frame: bytes) -> None:
        """Send a request."""
        self._waiting.append(self._protocol.request(frame))
        if self._protocol.ready:
            self._ask(0.0)
            with contextlib.suppress(OSError):
                self._flush()

    def replies(self) -> Iterable[Sequence[Part]]:
        """The body parts of the replies since the last call."""
        return self._protocol.replies()

    def rtt_s(self) -> float | None:
        """The round-trip time as the kernel has seen it."""
        return kernel.rtt_s(self._socket)

    def close(self) -> None:
        """Close when what was sent is out."""
        self._socket.close()

    def abort(self) -> None:
        """Close at once: what was sent and is not out yet shall not come late."""
        kernel.reset(self._socket)
        self.close()

    def _is_connected(self) -> bool:
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if error:
            raise OSError(error, os.strerror(error))
        try:
            self._socket.getpeername()
        except OSError:
            return False  # it is under way
        return True

    def _may_ask(self, now_s: float) -> bool:
        wake_s = self.wake_s
        return self._protocol.ready or (wake_s is not None and now_s >= wake_s)

    def _ask(self, now_s: float) -> None:
        if not self._waiting or not self._may_ask(now_s):
            return
        if not self._protocol.ready:
            self._unconfirmed = list(self._waiting)
            self._opened = True
        self._out += b"".join(self._waiting)
        self._waiting.clear()

    def _flush(self) -> None:
        while self._out:
            try:
                sent = self._socket.send(self._out)
            except BlockingIOError:
                return
            del self._out[:sent]
        self._answers = 0

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
            answers = self._protocol.receive(data) if room is None else self._protocol.filled(count)
            self._answers += len(answers)
            if self._answers > _MAX_ANSWERS:
                raise zmtp.ZmtpError("the peer does not read the answers that it asks for")
            self._out += answers
        return taken > 0

    def _fail(self, error: Exception) -> None:
        handshaking = self._connected_s is not None and not self._protocol.ready
        if handshaking and self._opened and isinstance(error, OSError):
            # Our requests got there together with the handshake: this time wait for the peer.
            self.eager = False
            if self._watched is None:  # in the poller its number must not become another one's
                self._socket.close()
            self._waiting = self._unconfirmed + self._waiting
            self._connect()
        elif isinstance(error, zmtp.ZmtpError):
            self.failure = str(error)
        elif handshaking:
            self.failure = "the connection broke in the ZeroMQ handshake, or the peer wants a key"
        elif self._connected_s is None:
            host, port = self._address
            self.failure = f"cannot connect to {host}:{port}: {error.args[-1]}"
        else:
            self.failure = "the peer closed the connection"


def _content(frame: zmq.Frame) -> Part:
    """What is in a frame of libzmq; copied only if it is small, so that it keeps nothing else."""
    return frame.bytes if len(frame) < zmtp.OWN_BYTES else frame.buffer.toreadonly()


class CurveConnection:
    """An encrypted connection, by libzmq; see `TcpConnection`."""

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        address: str,
        port: int,
        *,
        own: SecretKey,
        peer: PublicKey,
    ) -> None:
        self.failure: str | None = None  # in words; None: it stands
        self.eager = True  # dial again soon
        self._socket = context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVHWM, _QUEUE_REPLIES)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_REPLY_BYTES)
        protect_contact(self._socket, own, peer)
        events = int(zmq.Event.CONNECTED)
        for failure in _FAILURES:
            events |= failure
        self._monitor = self._socket.get_monitor_socket(events)
        self._port = port
        self._fd: int | None = None  # libzmq's descriptor
        self._received = 0  # bytes, by the kernel
        self._full = False  # libzmq takes no more
        self._socket.connect(f"tcp://{address}:{port}")

    def watch(self, poller: Poller, owner: str = "") -> None:
        """Have the poller wait for what this waits for, and say whose it is."""
        poller.register(self._socket, zmq.POLLIN, owner)
        poller.register(self._monitor, zmq.POLLIN, owner)

    def forget(self, poller: Poller) -> None:
        """Take it out of the poller."""
        for each in (self._socket, self._monitor):
            with contextlib.suppress(KeyError):
                poller.unregister(each)

    is_restless = True  # libzmq does not tell of bytes

    @property
    def wake_s(self) -> float | None:
        """Nothing here goes by the clock."""
        return None

    def is_ready(self, ready: Container[Polled], _now_s: float) -> bool:
        """Whether there is something to do."""
        over = self._full or self.failure is not None
        return over or self._socket in ready or self._monitor in ready

    def turn(self, _now_s: float) -> bool:
        """Take in what ZeroMQ tells about the connection; says whether anything arrived."""
        self._take_events()
        if self._full:  # if nothing has told a better reason
            self.failure = self.failure or "the connection takes nothing more"
        before = self._received
        with kernel.borrowed(self._fd, remote=self._port) as connection:
            self._received = kernel.bytes_received(connection) or before
        return self._received > before

    def _take_events(self) -> None:
        while self._monitor.poll(0):
            event = parse_monitor_message(self._monitor.recv_multipart(zmq.NOBLOCK))
            if event["event"] == zmq.Event.CONNECTED:
                self._fd, self._received = int(event["value"]), -1
            else:
                self._fd = None  # the first event says why, those after it only that
                self.failure = self.failure or _FAILURES.get(event["event"])

    def send(self, frame: bytes) -> None:
        """Send a request; the empty delimiter makes it one for REP sockets."""
        try:
            self._socket.send_multipart([b"", frame], flags=zmq.NOBLOCK)
        except zmq.Again:
            self._full = True

    def replies(self) -> Iterator[Sequence[Part]]:
        """The body parts of the replies since the last call."""
        while True:
            try:
                frames = self._socket.recv_multipart(zmq.NOBLOCK, copy=False)
            except zmq.Again:
                return
            parts = [_content(each) for each in frames]
            yield parts[1:] if parts[0] == b"" else parts

    def rtt_s(self) -> float | None:
        """The round-trip time as the kernel has seen it."""
        with kernel.borrowed(self._fd, remote=self._port) as connection:
            return kernel.rtt_s(connection)

    def close(self, linger_ms: int = _LINGER_MS) -> None:
        """Close when what was sent is out, or after 0.3 s."""
        self._socket.disable_monitor()
        self._monitor.close(0)
        self._socket.close(linger_ms)

    def abort(self) -> None:
        """Close at once: what was sent and is not out yet shall not come late."""
        self._take_events()  # its descriptor may not have been told yet
        with kernel.borrowed(self._fd, remote=self._port) as connection:
            kernel.reset(connection)
        self.close(0)


Connection = TcpConnection | CurveConnection
