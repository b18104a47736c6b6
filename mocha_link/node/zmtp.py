"""Either end of a ZeroMQ connection (ZMTP 3.1, NULL mechanism), without sockets.

libzmq waits for the other side before it sends each part of its handshake: the first answer costs
four round trips, which eat a short contact. The protocol does not ask for that. Our ends send their
whole handshake at once; so the first answer costs three, or two when requests follow without
waiting for the other side's READY. A libzmq that reads them together with the handshake closes
the connection; so they have to come a moment later (see `connection`).

https://rfc.zeromq.org/spec/37/ describes the protocol.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator, Sequence

from mocha_link.errors import MochaLinkError

_SIGNATURE = b"\xff" + bytes(8) + b"\x7f"
_GREETING = _SIGNATURE + b"\x03\x01" + b"NULL".ljust(20, b"\0") + bytes(32)
_MORE, _LONG, _COMMAND = 1, 2, 4
_READY = b"\x05READY"
_SHORT = 256
_MAX_PARTS = 128
OWN_BYTES = 16_384  # bodies from this size on get a buffer of their own
_SHARE = 16  # when this part of them has arrived: memory follows that, not what is announced
_MAX_WAITING = 16_384  # replies that no caller has fetched: far more than are ever under way


def _property(name: bytes, value: bytes) -> bytes:
    return bytes((len(name),)) + name + struct.pack(">I", len(value)) + value


def _frame(flags: int, body: bytes) -> bytes:
    if len(body) < _SHORT:
        return bytes((flags, len(body))) + body
    return struct.pack(">BQ", flags | _LONG, len(body)) + body


def _hello(kind: bytes) -> bytes:
    properties = _property(b"Socket-Type", kind) + _property(b"Identity", b"")
    return _GREETING + _frame(_COMMAND, _READY + properties)


_DELIMITER = b"\x01\x00"  # the empty frame that REP expects before a request


class ZmtpError(MochaLinkError):
    """What came is not the other end of a ZeroMQ connection that we can use."""


Part = bytes | memoryview


def encoded(parts: Sequence[Part]) -> list[Part]:
    """The bytes of a message, in pieces; large parts are not copied."""
    pieces: list[Part] = []
    head = b""
    for number, part in enumerate(parts, 1):
        flags = _MORE if number < len(parts) else 0
        if len(part) < OWN_BYTES:
            head += _frame(flags, bytes(part))
        else:
            pieces += [head + struct.pack(">BQ", flags | _LONG, len(part)), part]
            head = b""
    return [*pieces, head] if head else pieces


class _Large:
    """A body under way, in a buffer of its own."""

    def __init__(self, flags: int, length: int, begin: memoryview) -> None:
        self.flags = flags
        self._view = memoryview(bytearray(length))
        self._have = len(begin)  # bytes so far
        self._view[: self._have] = begin

    def room(self) -> memoryview:
        """What is free of the buffer."""
        return self._view[self._have :]

    def add(self, count: int) -> bool:
        """So many bytes are in `room`; whether that is all."""
        self._have += count
        return self._have == len(self._view)

    @property
    def body(self) -> memoryview:
        """All of it."""
        return self._view.toreadonly()


class ZmtpSession:
    """Turns requests into bytes and bytes into messages; one per TCP connection.

    `hello` (of the end that answers: `hello_of_router`) is to be sent first, without waiting for
    anything. Requests may follow when the other side is `ready`. Parts of messages are bytes; large
    ones are read-only views of all of a buffer that no other session has.

    Args:
        max_bytes: of a message.
        max_waiting: messages at once; beyond that the other side is not what it should be.
    """

    hello = _hello(b"DEALER")
    hello_of_router = _hello(b"ROUTER")

    def __init__(self, max_bytes: int, max_waiting: int = _MAX_WAITING) -> None:
        self.ready = False
        self._max_bytes = max_bytes
        self._max_waiting = max_waiting
        self._buffer = bytearray()  # bytes not parsed yet
        self._greeted = False  # the peer's greeting came
        self._parts: list[Part] = []  # of the message under way
        self._messages: deque[list[Part]] = deque()  # complete, not taken yet
        self._large: _Large | None = None  # a part too large to copy

    @staticmethod
    def request(body: bytes) -> bytes:
        """The bytes of a request with one body part."""
        return _DELIMITER + _frame(0, body)

    def receive(self, data: bytes) -> bytes:
        """Take in bytes; returns what is to be sent back (answers to heartbeats).

        Raises ZmtpError; the connection is of no use then.
        """
        answer = bytearray()
        view = memoryview(data)
        while self._large and view:
            room = self._large.room()
            count = min(len(room), len(view))
            room[:count] = view[:count]
            view = view[count:]
            self._filled(count, answer)
        if not view:
            return bytes(answer)
        self._buffer += view
        position = 0 if self._greeted else self._greet()
        while self._greeted:
            start = position
            size = len(self._buffer)
            if size - position < 2:
                break
            flags = self._buffer[position]
            if flags & _LONG:
                if size - position < 9:
                    break
                length = int.from_bytes(self._buffer[position + 1 : position + 9], "big")
                position += 9
            else:
                length = self._buffer[position + 1]
                position += 2
            if flags > _MORE | _LONG | _COMMAND or length > self._max_bytes:
                raise ZmtpError(f"a frame with flags {flags:#x} and {length} bytes")
            if size - position < length:
                if length < OWN_BYTES or (size - position) * _SHARE < length:
                    position = start
                    break
                self._large = _Large(flags, length, memoryview(self._buffer)[position:])
                position = size
                break
            self._take(flags, bytes(self._buffer[position : position + length]), answer)
            position += length
        del self._buffer[:position]
        return bytes(answer)

    def room(self) -> memoryview | None:
        """Where the next bytes of a large body belong; None if none is under way.

        Who receives them there says how many with `filled`, which spares a copy.
        """
        return self._large.room() if self._large else None

    def filled(self, count: int) -> bytes:
        """Take in what was received in `room`; as `receive`."""
        answer = bytearray()
        self._filled(count, answer)
        return bytes(answer)

    def replies(self) -> Iterator[list[Part]]:
        """The replies since the last call: the body parts of each (a good one has one)."""
        for parts in self.messages():
            yield parts[1:] if parts[0] == b"" else parts

    def messages(self) -> deque[list[Part]]:
        """The messages since the last call: all parts of each."""
        messages, self._messages = self._messages, deque()
        return messages

    def _greet(self) -> int:
        """Check as much of the other side's greeting as is there; its length when it is whole."""
        head = bytes(self._buffer[:10])
        if head[:1] != b"\xff"[: len(head)] or (len(head) == 10 and not head[9] & 1):
            raise ZmtpError("what answers there does not speak ZeroMQ")
        if len(self._buffer) > 10 and self._buffer[10] < 3:
            raise ZmtpError(f"the peer speaks ZMTP {self._buffer[10]}, too old for us")
        if len(self._buffer) < len(_GREETING):
            return 0
        mechanism = bytes(self._buffer[12:32]).rstrip(b"\0")
        if mechanism != b"NULL":
            raise ZmtpError(
                f"the peer wants {mechanism.decode('ascii', 'replace')}: it has a key for us, we "
                "have none for it; give both the same team file"
            )
        self._greeted = True
        return len(_GREETING)

    def _filled(self, count: int, answer: bytearray) -> None:
        large = self._large
        if large and large.add(count):
            self._large = None
            self._take(large.flags, large.body, answer)

    def _take(self, flags: int, body: Part, answer: bytearray) -> None:
        if flags & _COMMAND:
            body = bytes(body)
            if body.startswith(_READY):
                self.ready = True
            elif body.startswith(b"\x05ERROR"):
                raise ZmtpError("the peer refused us")
            elif body.startswith(b"\x04PING"):
                answer += _frame(_COMMAND, b"\x04PONG" + body[7:23])
            return
        self._parts.append(body)
        if not flags & _MORE:
            parts, self._parts = self._parts, []
            if len(self._messages) == self._max_waiting:
                raise ZmtpError("more messages at once than can be meant")
            self._messages.append(parts)
        elif len(self._parts) > _MAX_PARTS or sum(map(len, self._parts)) > self._max_bytes:
            raise ZmtpError("a message of too many parts")
