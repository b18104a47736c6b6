"""One outgoing connection to a peer, made fresh for a pull and closed after it."""

from __future__ import annotations

import os
import socket
import struct

import zmq
from zmq.utils.monitor import parse_monitor_message

from mocha_link import payload

# A reply: id, prefix, an LZ4 frame of incompressible data, something behind it.
MAX_REPLY_BYTES = payload.MAX_BYTES + 1024 * 1024
QUEUE_REPLIES = 16

_BYTES_RECEIVED_AT = 128  # of struct tcp_info, linux/tcp.h (since 4.1)

_FAILURES: dict[int, str] = {
    zmq.Event.DISCONNECTED: "the peer closed the connection",
    zmq.Event.HANDSHAKE_FAILED_NO_DETAIL: "the connection broke in the ZeroMQ handshake",
    zmq.Event.HANDSHAKE_FAILED_PROTOCOL: "what answers there does not speak ZeroMQ",
    zmq.Event.HANDSHAKE_FAILED_AUTH: "the peer refused us",
}


class Contact:
    """A DEALER to one peer, which a REP or ROUTER there takes for a REQ.

    `failure` says what the connection suffered, if anything; `listen` keeps it up to date.

    Raises:
        zmq.ZMQError: the address is none, or the process has no socket left.
    """

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], host: str, port: int) -> None:
        self.failure: str | None = None
        self.socket = context.socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.RCVHWM, QUEUE_REPLIES)
        self.socket.setsockopt(zmq.MAXMSGSIZE, MAX_REPLY_BYTES)
        events = int(zmq.Event.CONNECTED)
        for failure in _FAILURES:
            events |= failure
        self.monitor = self.socket.get_monitor_socket(events)
        self._port = port
        self._fd: int | None = None
        self._received = 0
        try:
            self.socket.connect(f"tcp://{host}:{port}")
        except zmq.ZMQError:
            self.close()
            raise

    def send(self, frame: bytes) -> None:
        """Send a request; the empty delimiter makes it one for REP sockets."""
        self.socket.send_multipart([b"", frame], flags=zmq.NOBLOCK)

    def receive(self) -> list[bytes] | None:
        """The body parts of the next reply; None if none is there."""
        try:
            parts = self.socket.recv_multipart(zmq.NOBLOCK)
        except zmq.Again:
            return None
        return parts[1:] if parts[0] == b"" else parts

    def listen(self) -> None:
        """Take in what ZeroMQ tells about the connection."""
        while self.monitor.poll(0):
            event = parse_monitor_message(self.monitor.recv_multipart(zmq.NOBLOCK))
            if event["event"] == zmq.Event.CONNECTED:
                self._fd, self._received = int(event["value"]), -1
            else:
                self._fd = None
                self.failure = _FAILURES.get(event["event"], self.failure)

    def has_progressed(self) -> bool:
        """Whether it connected or bytes arrived since the last call, also of part of a reply.

        ZeroMQ only shows whole messages, and a large one may take long on a slow link; so this
        asks the kernel.
        """
        if self._fd is None:
            return False
        before, self._received = self._received, _bytes_received(self._fd, self._port)
        return self._received > before

    def close(self) -> None:
        """Close at once; nothing that is queued is sent any more."""
        self.socket.disable_monitor()
        self.monitor.close(0)
        self.socket.close(0)


def _bytes_received(fd: int, port: int) -> int:
    """The bytes that a TCP connection to a port has received; 0 if it cannot be known."""
    try:
        copy = os.dup(fd)  # it is libzmq's and may be closed at any time
    except OSError:
        return 0
    try:
        with socket.socket(fileno=copy) as connection:
            copy = -1
            if connection.getpeername()[1] != port:
                return 0
            info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
            received: int = struct.unpack_from("=Q", info, _BYTES_RECEIVED_AT)[0]
            return received
    except (OSError, AttributeError, IndexError, TypeError, struct.error):
        return 0
    finally:
        if copy >= 0:
            os.close(copy)
