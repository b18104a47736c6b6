"""Either end of a ZeroMQ connection (ZMTP 3.1), without sockets.

libzmq waits for the peer before it sends each part of its handshake: the first reply costs
four round trips, which eat a short contact. The protocol does not require that. Our ends send their
whole handshake at once; so the first reply costs three, or two when requests follow without
waiting for the other side's READY. A libzmq that reads them together with the handshake closes
the connection; so they have to come a moment later (see `connection`).

libzmq also keeps the parts of a message until the last one has come, however many there are: its
limit is one of parts. A session of ours takes messages up to a size, all parts together.

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
MAX_HANDSHAKE_BYTES = 8192  # of a command in it
_SHORT = 256
MAX_PARTS = 128
OWN_BYTES = 16_384  # bodies from this size on get a buffer of their own
_SHARE = 16  # when this part of them has arrived: memory follows that, not what is announced
_MAX_WAITING = 16_384  # replies that the program has not fetched: far more than are ever under way


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
    """What came is not the other end of a ZeroMQ connection that we can use.

    Attributes:
        reply: What the other end is to get before it is closed.
    """

    def __init__(self, message: str, *, reply: bytes = b"") -> None:
        super().__init__(message)
        self.reply = reply and _frame(COMMAND, reply)


class NoEncryptionError(ZmtpError):
    """The other end does not encrypt, and has to."""


class WrongKeyError(ZmtpError):
    """The other end has another key than the one that is let in here."""


Part = bytes | memoryview


class Mechanism(Protocol):
    """How the two ends of a connection begin, and what they do to the parts of messages.

    Attributes:
        name: In the greeting.
        as_server: Likewise: the end whose key the other one knows.
        overhead: So many bytes longer is a part on the wire.
        known: The other end has shown a key that is let in here.
    """

    name: ClassVar[bytes]
    as_server: ClassVar[bool]
    overhead: ClassVar[int]
    known: bool

    def opening(self) -> bytes | None:
        """The command that follows the greeting unasked, if there is one."""

    def handshake(self, command: bytes) -> tuple[bytes | None, bool]:
        """Process a command of the handshake; returns the reply, and whether it was the last.

        Raises ZmtpError.
        """

    def seal(self, flags: int, body: Part) -> Part | None:
        """A part in its wire form; None: unchanged."""

    def open(self, body: Part) -> tuple[int, Part] | None:
        """Flags and content of a received part; None: unchanged. Raises ZmtpError."""


class Null:
    """No key, no encryption.

    Args:
        kind: Of the socket.
    """

    name: ClassVar[bytes] = b"NULL"
    as_server: ClassVar[bool] = False
    overhead: ClassVar[int] = 0

    def __init__(self, kind: bytes) -> None:
        self.known = False
        self._kind = kind

    def opening(self) -> bytes:
        """Nothing of the other end is needed for it."""
        return READY + metadata(self._kind)

    def handshake(self, command: bytes) -> tuple[bytes | None, bool]:
        """Whether the other end is ready, too. Raises ZmtpError."""
        if command.startswith(ERROR):
            raise ZmtpError("the peer refused us")
        return None, command.startswith(READY)

    def seal(self, flags: int, body: Part) -> None:
        """As it is."""

    def open(self, body: Part) -> None:
        """As it came."""


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
    def size(self) -> int:
        """Of all of it, in bytes."""
        return len(self._view)

    @property
    def body(self) -> memoryview:
        """All of it."""
        return self._view.toreadonly()


class ZmtpSession:
    """Turns requests into bytes and bytes into messages; one per connection.

    `hello` is to be sent first, without waiting for anything. Requests may follow when the other
    side is `ready`. Parts of messages are bytes; large ones are read-only views of all of a buffer
    that no other session has.

    Args:
        max_bytes: of a message, all its parts together; its last part may exceed it by as much.
        max_waiting: messages at once; beyond that the other side is not what it should be.
        mechanism: of the connection; as it is used up with it, no other one may have it.

    Attributes:
        ready: Whether the handshake is through.
        hello: What is to be sent first.
        received: Bytes that have come.
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
        self._greeted = False  # the peer's greeting came
        self._parts: list[Part] = []  # of the message under way
        self._parts_bytes = 0  # of all of them
        self._messages: deque[list[Part]] = deque()  # complete, not taken yet
        self._large: _Large | None = None  # a part too large to copy
        command = self._mechanism.opening()
        self.hello = _greeting(self._mechanism.name, as_server=self._mechanism.as_server)
        self.hello += b"" if command is None else _frame(COMMAND, command)

    @property
    def held_bytes(self) -> int:
        """What of a message has come, and the room for the rest of a large part of it."""
        large = self._large.size if self._large else 0
        return len(self._buffer) + self._parts_bytes + large

    @property
    def known(self) -> bool:
        """Whether the other end has shown a key that is let in here."""
        return self._mechanism.known

    @property
    def greeted(self) -> bool:
        """Whether the peer's greeting is complete."""
        return self._greeted

    def encoded(self, parts: Sequence[Part]) -> list[Part]:
        """The bytes of a message, to be sent in this order; see `encoded`."""
        return encoded(parts, self._mechanism)

    def request(self, body: bytes) -> bytes:
        """The bytes of a request with one body part, behind the empty one that REP expects."""
        return b"".join(self.encoded([b"", body]))

    def receive(self, data: bytes) -> bytes:
        """Take in bytes; returns the bytes to send back (replies to heartbeats).

        Raises ZmtpError; the connection is of no use then.
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
            return MAX_HANDSHAKE_BYTES  # no key was shown for more
        return self._max_bytes + self._mechanism.overhead

    def room(self) -> memoryview | None:
        """Where the next bytes of a large body belong; None if none is under way.

        The caller receives into it and reports the number with `filled`, which saves a copy.
        """
        return self._large.room() if self._large else None

    def filled(self, count: int) -> bytes:
        """Take in what was received in `room`; as `receive`."""
        reply = bytearray()
        self.received += count
        self._filled(count, reply)
        return bytes(reply)

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
                else "what answers there has no key, or does not speak ZeroMQ"
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
                raise ZmtpError("a message before the handshake is through")
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
        if command.startswith(_SUBSCRIBE):  # as a message, which it is before ZMTP 3.1
            self._deliver([b"\1" + command[len(_SUBSCRIBE) :]])
        elif command.startswith(_CANCEL):
            self._deliver([b"\0" + command[len(_CANCEL) :]])
        return b""

    def _deliver(self, message: list[Part]) -> None:
        if len(self._messages) == self._max_waiting:
            raise ZmtpError("more messages at once than can be meant")
        self._messages.append(message)
