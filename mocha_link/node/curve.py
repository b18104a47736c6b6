"""Encrypted connections: CurveZMQ, both ends of it, as mechanisms of a `ZmtpSession`.

A port of a node serves one peer, so the key of that peer is the only one that opens it. Links
where one side has no key stay as they are in the original (NULL).

What an end may cost before it has shown its key: a frame of a few kilobytes, and two operations on
the curve. https://rfc.zeromq.org/spec/26/ describes the protocol; libzmq talks to both ends.
Needs the extra ``keys`` (PyNaCl); importing this module does not.
"""

from __future__ import annotations

import hmac
import os
from typing import ClassVar, Final

from mocha_link.node.zmtp import ERROR, OWN_BYTES, READY, Part, WrongKeyError, ZmtpError, metadata
from mocha_link.team import require

try:
    import nacl.bindings as nacl
    from nacl.exceptions import CryptoError
except ImportError:  # pragma: no cover - the development set-up has it
    pass

OVERHEAD_BYTES: Final = 33
"""That encryption adds to a part: a name, a counter, a tag, flags."""

_KEY_BYTES, _COOKIE_BYTES, _TAG_BYTES = 32, 96, 16
_HELLO, _WELCOME, _INITIATE, _MESSAGE = (
    b"\x05HELLO",
    b"\x07WELCOME",
    b"\x08INITIATE",
    b"\x07MESSAGE",
)
_VERSION = b"\1\0"
_HELLO_BYTES, _WELCOME_BYTES = 200, 168
_HELLO_BOX, _HELLO_KEY = 120, 80  # where they begin
_VOUCH_BYTES = 80
_REFUSED = ERROR + b"\x03400"
_AT_CLIENT, _AT_SERVER = b"CurveZMQMESSAGES", b"CurveZMQMESSAGEC"  # nonces of what comes there


class _Curve:
    """What both ends have in common: the keys of a connection, and its counters.

    Args:
        kind: Of the socket.
    """

    name: ClassVar[bytes] = b"CURVE"
    overhead: ClassVar[int] = OVERHEAD_BYTES
    _incoming: ClassVar[bytes]
    _outgoing: ClassVar[bytes]

    def __init__(self, kind: bytes) -> None:
        require()
        self.known = False
        self._metadata = metadata(kind)
        self._sent = 0  # the counter of what we have sent
        self._came = 0  # of what has come: it only grows
        self._public, self._own = nacl.crypto_box_keypair()  # of this connection only
        self._shared = b""  # with the other end's of this connection

    def seal(self, flags: int, body: Part) -> bytes:
        """A part as it goes over the wire."""
        counter = self._counted()
        box = nacl.crypto_box_afternm(
            bytes((flags & 1 | flags >> 1 & 2,)) + body, self._outgoing + counter, self._shared
        )
        return _MESSAGE + counter + bytes(box)

    def open(self, body: Part) -> tuple[int, Part]:
        """Flags and content of what came. Raises ZmtpError."""
        counter = bytes(body[8:16])
        if bytes(body[:8]) != _MESSAGE or len(body) < OVERHEAD_BYTES:
            raise ZmtpError("what came is no encrypted message")
        plain = self._opened(bytes(body[16:]), self._incoming, counter, self._shared)
        flags = plain[0] & 1 | (plain[0] & 2) << 1
        return flags, plain[1:] if len(plain) <= OWN_BYTES else memoryview(plain)[1:]

    def _counted(self) -> bytes:
        self._sent += 1
        return self._sent.to_bytes(8, "big")

    def _opened(self, box: bytes, nonce: bytes, counter: bytes, key: bytes) -> bytes:
        number = int.from_bytes(counter, "big")
        if number <= self._came:
            raise ZmtpError("what came was there before")
        plain = _unboxed(box, nonce + counter, key)
        self._came = number
        return plain


class CurveServer(_Curve):
    """The end whose key the other one knows.

    Args:
        secret: The secret key (X25519) of this end.
        allowed: The public key of the other end; None: whoever knows ours is let in.
        kind: Of the socket.
    """

    as_server: ClassVar[bool] = True
    _incoming, _outgoing = _AT_SERVER, _AT_CLIENT

    def __init__(self, secret: bytes, allowed: bytes | None, kind: bytes = b"ROUTER") -> None:
        super().__init__(kind)
        self._secret = secret
        self._allowed = allowed
        self._cookie = b""  # what the other end has to show again
        self._client = b""  # its key of this connection

    def opening(self) -> None:
        """The client begins."""

    def handshake(self, command: bytes) -> tuple[bytes, bool]:
        """Take the client's HELLO, then its INITIATE. Raises ZmtpError."""
        if not self._cookie:
            return self._welcome(command), False
        return self._let_in(command), True

    def _welcome(self, hello: bytes) -> bytes:
        if len(hello) != _HELLO_BYTES or not hello.startswith(_HELLO + _VERSION):
            raise ZmtpError("what came is no HELLO")
        self._client = hello[_HELLO_KEY : _HELLO_KEY + _KEY_BYTES]
        counter = hello[_HELLO_KEY + _KEY_BYTES : _HELLO_BOX]
        key = _agreed(self._client, self._secret)
        self._opened(hello[_HELLO_BOX:], b"CurveZMQHELLO---", counter, key)
        # The connection remembers what a cookie would bring back: this one only has to return.
        self._cookie = os.urandom(_COOKIE_BYTES)
        self._shared = _agreed(self._client, self._own)
        nonce = os.urandom(_TAG_BYTES)
        box = nacl.crypto_box_afternm(self._public + self._cookie, b"WELCOME-" + nonce, key)
        return _WELCOME + nonce + bytes(box)

    def _let_in(self, initiate: bytes) -> bytes:
        start = len(_INITIATE) + _COOKIE_BYTES
        cookie, counter = initiate[len(_INITIATE) : start], initiate[start : start + 8]
        if not initiate.startswith(_INITIATE) or not hmac.compare_digest(cookie, self._cookie):
            raise ZmtpError("what came is no INITIATE")
        plain = self._opened(initiate[start + 8 :], b"CurveZMQINITIATE", counter, self._shared)
        client, plain = plain[:_KEY_BYTES], plain[_KEY_BYTES:]
        nonce, vouch = plain[:_TAG_BYTES], plain[_TAG_BYTES : _TAG_BYTES + _VOUCH_BYTES]
        vouched = _unboxed(vouch, b"VOUCH---" + nonce, _agreed(client, self._own))
        if vouched != self._client + nacl.crypto_scalarmult_base(self._secret):
            raise ZmtpError("a vouch for another connection", reply=_REFUSED)
        if self._allowed is not None and not hmac.compare_digest(client, self._allowed):
            raise WrongKeyError("the key is not of this port's peer", reply=_REFUSED)
        self.known = True
        counter = self._counted()
        box = nacl.crypto_box_afternm(self._metadata, b"CurveZMQREADY---" + counter, self._shared)
        return READY + counter + bytes(box)


class CurveClient(_Curve):
    """The end that knows the other one's key.

    Args:
        secret: The secret key (X25519) of this end.
        public: Its public half.
        server: The public key of the other end.
        kind: Of the socket.
    """

    as_server: ClassVar[bool] = False
    _incoming, _outgoing = _AT_CLIENT, _AT_SERVER

    def __init__(
        self, secret: bytes, public: bytes, server: bytes, kind: bytes = b"DEALER"
    ) -> None:
        super().__init__(kind)
        self._long_term = secret, public
        self._server = server
        self._welcomed = False

    def opening(self) -> bytes:
        """The HELLO."""
        counter = self._counted()
        key = _agreed(self._server, self._own)
        box = nacl.crypto_box_afternm(bytes(64), b"CurveZMQHELLO---" + counter, key)
        return _HELLO + _VERSION + bytes(72) + self._public + counter + bytes(box)

    def handshake(self, command: bytes) -> tuple[bytes | None, bool]:
        """Take the server's WELCOME, then its READY. Raises ZmtpError."""
        if command.startswith(ERROR):
            raise WrongKeyError("the peer refused our key")
        if not self._welcomed:
            return self._initiate(command), False
        if not command.startswith(READY):
            raise ZmtpError("what came is no READY")
        start = len(READY) + 8
        counter = command[len(READY) : start]
        self._opened(command[start:], b"CurveZMQREADY---", counter, self._shared)
        self.known = True
        return None, True

    def _initiate(self, welcome: bytes) -> bytes:
        if len(welcome) != _WELCOME_BYTES or not welcome.startswith(_WELCOME):
            raise ZmtpError("what came is no WELCOME")
        start = len(_WELCOME) + _TAG_BYTES
        nonce = b"WELCOME-" + welcome[len(_WELCOME) : start]
        plain = _unboxed(welcome[start:], nonce, _agreed(self._server, self._own))
        server, cookie = plain[:_KEY_BYTES], plain[_KEY_BYTES:]
        self._shared = _agreed(server, self._own)
        secret, public = self._long_term
        tag, counter = os.urandom(_TAG_BYTES), self._counted()
        vouch = nacl.crypto_box_afternm(
            self._public + self._server, b"VOUCH---" + tag, _agreed(server, secret)
        )
        box = nacl.crypto_box_afternm(
            public + tag + bytes(vouch) + self._metadata,
            b"CurveZMQINITIATE" + counter,
            self._shared,
        )
        self._welcomed = True
        return _INITIATE + cookie + counter + bytes(box)


def _agreed(public: bytes, secret: bytes) -> bytes:
    """The secret that two key pairs share. Raises WrongKeyError: the public key is none."""
    try:
        return bytes(nacl.crypto_box_beforenm(public, secret))
    except (CryptoError, ValueError):
        raise WrongKeyError("what came is no key", reply=_REFUSED) from None


def _unboxed(box: bytes, nonce: bytes, key: bytes) -> bytes:
    """Raises WrongKeyError: it is not for us, or was changed on its way."""
    try:
        return bytes(nacl.crypto_box_open_afternm(box, nonce, key))
    except (CryptoError, ValueError):
        raise WrongKeyError("what came cannot be opened with our key") from None
