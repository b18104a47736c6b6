"""Either end of a ZeroMQ connection (ZMTP 3.1), without sockets.

libzmq waits for the peer before it sends each part of its handshake. The first reply then takes
four round trips, a large share of a short contact. The protocol does not require that. Our ends
send their whole handshake at once: the first reply takes three round trips, or two if the requests
do not wait for the peer's READY. A libzmq that reads requests together with the handshake closes
the connection, so requests are sent a moment after the handshake (see `connection`).

libzmq limits the size of each part, not the number of parts that it buffers. A session here limits
the size of a message, all its parts together.

The mechanism is `Null`, or one of `curve`, which encrypts.

https://rfc.zeromq.org/spec/37/ describes the protocol.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator, Sequence
from typing import ClassVar, Protocol

from mocha_link.errors import MochaLinkError

_SIGNATURE = b"\xff" + bytes(8) + b"\x7f"
GREETING_BYTES = 64
MORE, _LONG, COMMAND = 1, 2, 4
READY, ERROR = b"\x05READY", b"\x05ERROR"
_PING, _SUBSCRIBE, _CANCEL = b"\x04PING", b"\x09SUBSCRIBE", b"\x06CANCEL"
MAX_HANDSHAKE_BYTES = 8192  # of each command
_SHORT = 256
MAX_PARTS = 128
OWN_BYTES = 16_384  # larger bodies get a buffer of their own
_SHARE = 16  # after 1/16 of them is received: a peer cannot reserve memory by announcing a size
_MAX_WAITING = 16_384  # replies that were not fetched: far more than are ever in flight


def _property(name: bytes, value: bytes) -> bytes:
    return bytes((len(name),)) + name + struct.pack(">I", len(value)) + value


def _frame(flags: int, body: bytes) -> bytes:
    if len(body) < _SHORT:
        return bytes((flags, len(body))) + body
    return struct.pack(">BQ", flags | _LONG, len(body)) + body


def metadata(kind: bytes) -> bytes:
    """The metadata of a handshake: the socket type."""
    return _property(b"Socket-Type", kind) + _property(b"Identity", b"")


def _greeting(mechanism: bytes, *, as_server: bool) -> bytes:
    about = mechanism.ljust(20, b"\0") + bytes((as_server,)) + bytes(31)
    return _SIGNATURE + b"\x03\x01" + about


class ZmtpError(MochaLinkError):
    """The peer violated the ZeroMQ protocol, or uses an incompatible version of it.

    Attributes:
        reply: The ERROR to send to the peer before the connection is closed; empty: none.
    """

    def __init__(self, message: str, *, reply: bytes = b"") -> None:
        super().__init__(message)
        self.reply = reply and _frame(COMMAND, reply)


class NoEncryptionError(ZmtpError):
    """The peer does not encrypt, but must."""


class WrongKeyError(ZmtpError):
    """The peer's key is not the accepted one."""


Part = bytes | memoryview


class Mechanism(Protocol):
    """A ZMTP security mechanism: the handshake of a connection, and the encoding of its parts.

    Attributes:
        name: The name in the greeting.
        as_server: The flag in the greeting: this end's key is known to the other end.
        overhead: The bytes that it adds to a part on the wire.
        known: The peer has proven an accepted key.
    """

    name: ClassVar[bytes]
    as_server: ClassVar[bool]
    overhead: ClassVar[int]
    known: bool

    def opening(self) -> bytes | None:
        """The command to send right after the greeting; None: the other end begins."""

    def handshake(self, command: bytes) -> tuple[bytes | None, bool]:
        """Process a command of the handshake; returns the reply, and whether it is complete.

        Raises ZmtpError.
        """

    def seal(self, flags: int, body: Part) -> Part | None:
        """A part in its wire form; None: unchanged."""

    def open(self, body: Part) -> tuple[int, Part] | None:
        """Flags and content of a received part; None: unchanged. Raises ZmtpError."""


class Null:
    """The mechanism without keys and encryption.

    Args:
        kind: The socket type.
    """

    name: ClassVar[bytes] = b"NULL"
    as_server: ClassVar[bool] = False
    overhead: ClassVar[int] = 0

    def __init__(self, kind: bytes) -> None:
        self.known = False
        self._kind = kind

    def opening(self) -> bytes:
        """The READY, which does not depend on the peer."""
        return READY + metadata(self._kind)

    def handshake(self, command: bytes) -> tuple[bytes | None, bool]:
        """No reply, and whether the command is the peer's READY. Raises ZmtpError."""
        if command.startswith(ERROR):
            raise ZmtpError("the peer refused us")
        return None, command.startswith(READY)

    def seal(self, flags: int, body: Part) -> None:
        """None: parts are sent unchanged."""

    def open(self, body: Part) -> None:
        """None: parts are received unchanged."""


def encoded(parts: Sequence[Part], mechanism: Mechanism | None = None) -> list[Part]:
    """The bytes of a message, in pieces; large parts are not copied."""
    pieces: list[Part] = []
    head = b""
    for number, part in enumerate(parts, 1):
        flags, body = MORE if number < len(parts) else 0, part
        if mechanism and (sealed := mechanism.seal(flags, part)) is not None:
            flags, body = 0, sealed
        if len(body) < OWN_BYTES:
            head += _frame(flags, bytes(body))
        else:
            pieces += [head + struct.pack(">BQ", flags | _LONG, len(body)), body]
            head = b""
    return [*pieces, head] if head else pieces


class _Large:
    """A partly received body in a buffer of its own."""

    def __init__(self, flags: int, length: int, begin: memoryview) -> None:
        self.flags = flags
        self._view = memoryview(bytearray(length))
        self._have = len(begin)  # bytes so far
        self._view[: self._have] = begin

    def room(self) -> memoryview:
        """The rest of the buffer."""
        return self._view[self._have :]

    def add(self, count: int) -> bool:
        """Note that `count` bytes were received into `room`; returns whether it is complete."""
        self._have += count
        return self._have == len(self._view)

    @property
    def size(self) -> int:
        """The size of the whole body in bytes."""
        return len(self._view)

    @property
    def body(self) -> memoryview:
        """The whole body."""
        return self._view.toreadonly()


class ZmtpSession:
    """Turns requests into bytes and bytes into messages; one per connection.

    The caller sends `hello` first, without waiting. Requests may follow when the peer is `ready`.
    Parts of messages are bytes; a large part is a read-only view of its own buffer.

    Args:
        max_bytes: the limit for a message, all its parts together; the last part may exceed it by
            the same amount.
        max_waiting: the limit for messages that were not fetched.
        mechanism: of this connection only, as it holds its keys and counters.

    Attributes:
        ready: The handshake is complete.
        hello: The greeting, with the first command if the mechanism has one.
        received: Bytes received so far.
    """

    def __init__(
        self,
        max_bytes: int,
        max_waiting: int = _MAX_WAITING,
        mechanism: Mechanism | None = None,
    ) -> None:
        self.ready = False
        self.received = 0
        self._mechanism = mechanism or Null(b"DEALER")
        self._max_bytes = max_bytes
        self._max_waiting = max_waiting
        self._buffer = bytearray()  # bytes not parsed yet
        self._greeted = False  # the peer's greeting is complete
        self._parts: list[Part] = []  # of the incomplete message
        self._parts_bytes = 0  # their total size
        self._messages: deque[list[Part]] = deque()  # complete, not fetched yet
        self._large: _Large | None = None  # an incomplete part that is too large to copy
        command = self._mechanism.opening()
        self.hello = _greeting(self._mechanism.name, as_server=self._mechanism.as_server)
        self.hello += b"" if command is None else _frame(COMMAND, command)

    @property
    def held_bytes(self) -> int:
        """The memory of the incomplete message, with the whole buffer of a large part."""
        large = self._large.size if self._large else 0
        return len(self._buffer) + self._parts_bytes + large

    @property
    def known(self) -> bool:
        """Whether the peer has proven an accepted key."""
        return self._mechanism.known

    def encoded(self, parts: Sequence[Part]) -> list[Part]:
        """The bytes of a message, in the order to send; see the function `encoded`."""
        return encoded(parts, self._mechanism)

    def request(self, body: bytes) -> bytes:
        """The bytes of a request with one body part, after the empty part that REP expects."""
        return b"".join(self.encoded([b"", body]))

    def receive(self, data: bytes) -> bytes:
        """Process received bytes; returns the bytes to send back (replies to heartbeats).

        Raises ZmtpError, after which the connection is unusable.
        """
        reply = bytearray()
        view = memoryview(data)
        self.received += len(data)
        while self._large and view:
            room = self._large.room()
            count = min(len(room), len(view))
            room[:count] = view[:count]
            view = view[count:]
            self._filled(count, reply)
        if not view:
            return bytes(reply)
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
            if flags > MORE | _LONG | COMMAND or length > self._most():
                raise ZmtpError(f"a frame with flags {flags:#x} and {length} bytes")
            if size - position < length:
                if length < OWN_BYTES or (size - position) * _SHARE < length:
                    position = start
                    break
                self._large = _Large(flags, length, memoryview(self._buffer)[position:])
                position = size
                break
            self._take(flags, bytes(self._buffer[position : position + length]), reply)
            position += length
        del self._buffer[:position]
        return bytes(reply)

    def _most(self) -> int:
        if not self.ready and self._mechanism.overhead:
            return MAX_HANDSHAKE_BYTES  # more only after the peer has proven its key
        return self._max_bytes + self._mechanism.overhead

    def room(self) -> memoryview | None:
        """The buffer for the next bytes of a large body; None: no large body is incomplete.

        The caller receives into it and reports the number of bytes with `filled`: one copy less.
        """
        return self._large.room() if self._large else None

    def filled(self, count: int) -> bytes:
        """Process `count` bytes that were received into `room`; otherwise like `receive`."""
        reply = bytearray()
        self.received += count
        self._filled(count, reply)
        return bytes(reply)

    def replies(self) -> Iterator[list[Part]]:
        """The replies since the last call: the body parts of each (a valid reply has one)."""
        for parts in self.messages():
            yield parts[1:] if parts[0] == b"" else parts

    def messages(self) -> deque[list[Part]]:
        """The messages since the last call: all parts of each."""
        messages, self._messages = self._messages, deque()
        return messages

    def _greet(self) -> int:
        """Check the received part of the peer's greeting; returns its length once complete."""
        head = bytes(self._buffer[:10])
        if head[:1] != b"\xff"[: len(head)] or (len(head) == 10 and not head[9] & 1):
            raise ZmtpError("what answers there is not a ZeroMQ socket")
        if len(self._buffer) > 10 and self._buffer[10] < 3:
            raise ZmtpError(f"the peer uses ZMTP {self._buffer[10]}, too old for us")
        if len(self._buffer) < GREETING_BYTES:
            return 0
        wanted, ours = bytes(self._buffer[12:32]).rstrip(b"\0"), self._mechanism.name
        if wanted != ours:
            if self._mechanism.as_server:
                raise NoEncryptionError("the peer does not encrypt, and has to")
            shown = wanted.decode("ascii", "replace")
            raise ZmtpError(
                f"the peer wants {shown}: it has a key for us, we have none for it; give both the "
                "same team file"
                if ours == Null.name
                else "what answers there has no key, or is not a ZeroMQ socket"
            )
        self._greeted = True
        return GREETING_BYTES

    def _filled(self, count: int, reply: bytearray) -> None:
        large = self._large
        if large and large.add(count):
            self._large = None
            self._take(large.flags, large.body, reply)

    def _take(self, flags: int, body: Part, reply: bytearray) -> None:
        if not self.ready:
            if not flags & COMMAND:
                raise ZmtpError("a message before the end of the handshake")
            command, self.ready = self._mechanism.handshake(bytes(body))
            reply += b"" if command is None else _frame(COMMAND, command)
            return
        opened = self._mechanism.open(body)
        if opened is not None:
            flags, body = opened
        if flags & COMMAND:
            reply += self._obey(bytes(body))
            return
        self._parts.append(body)
        self._parts_bytes += len(body)
        if not flags & MORE:
            parts, self._parts, self._parts_bytes = self._parts, [], 0
            self._deliver(parts)
        elif len(self._parts) > MAX_PARTS or self._parts_bytes > self._max_bytes:
            raise ZmtpError("a message of too many parts")

    def _obey(self, command: bytes) -> bytes:
        """Process a command after the handshake; returns the bytes to send back."""
        if command.startswith(_PING):
            pong = b"\x04PONG" + command[7:23]
            sealed = self._mechanism.seal(COMMAND, pong)
            return _frame(COMMAND, pong) if sealed is None else _frame(0, bytes(sealed))
        if command.startswith(_SUBSCRIBE):  # handed out as a message, its form before ZMTP 3.1
            self._deliver([b"\1" + command[len(_SUBSCRIBE) :]])
        elif command.startswith(_CANCEL):
            self._deliver([b"\0" + command[len(_CANCEL) :]])
        return b""

    def _deliver(self, message: list[Part]) -> None:
        if len(self._messages) == self._max_waiting:
            raise ZmtpError("more messages at once than can be meant")
        self._messages.append(message)
