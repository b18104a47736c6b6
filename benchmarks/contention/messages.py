"""Messages of a ZeroMQ connection, without taking part in it."""

from __future__ import annotations

from typing import Final, NamedTuple

GREETING_BYTES: Final = 64  # these as in ZMTP 3.1, https://rfc.zeromq.org/spec/37/
_MORE, _LONG, _COMMAND = 1, 2, 4
_SHORT_HEAD: Final = 2
_LONG_HEAD: Final = 9


class Piece(NamedTuple):
    """What crosses as a whole: the greeting, a command, or a message.

    Attributes:
        raw: Its bytes.
        body: The last part of a message; None: it is no message.
    """

    raw: bytes
    body: bytes | None


class Cutter:
    """Cuts the bytes of one direction into pieces."""

    def __init__(self) -> None:
        self._buffer = bytearray()  # not cut yet
        self._greeted = False  # the greeting is through
        self._parts = bytearray()  # of a message whose last part is not here yet

    def feed(self, data: bytes) -> list[Piece]:
        """Take bytes as they come; the pieces that are whole now."""
        self._buffer += data
        pieces = []
        if not self._greeted and len(self._buffer) >= GREETING_BYTES:
            self._greeted = True
            pieces.append(Piece(self._take(GREETING_BYTES), None))
        while self._greeted and (found := self._frame()):
            flags, raw, body = found
            if flags & _COMMAND:
                pieces.append(Piece(raw, None))
                continue
            self._parts += raw
            if not flags & _MORE:
                pieces.append(Piece(bytes(self._parts), body))
                self._parts.clear()
        return pieces

    def _frame(self) -> tuple[int, bytes, bytes] | None:
        """The next frame: its flags, its bytes, its body; None: not all of it is here."""
        if len(self._buffer) < _SHORT_HEAD:
            return None
        flags = self._buffer[0]
        head = _LONG_HEAD if flags & _LONG else _SHORT_HEAD
        size = head + int.from_bytes(self._buffer[1:head], "big")
        if len(self._buffer) < max(head, size):
            return None
        raw = self._take(size)
        return flags, raw, raw[head:]

    def _take(self, size: int) -> bytes:
        raw = bytes(self._buffer[:size])
        del self._buffer[:size]
        return raw
