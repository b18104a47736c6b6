"""Encrypted connections: both ends of CurveZMQ, as mechanisms of a `ZmtpSession`.

A port of a node serves one peer and accepts only that peer's key. Links where one side has no key
use NULL, as original nodes do.

Before a client has proven its key it can cost the server one frame of a few kilobytes and two curve
operations. https://rfc.zeromq.org/spec/26/ describes the protocol; both ends interoperate with
libzmq. The mechanisms need the extra ``keys`` (PyNaCl); importing this module does not.
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
"""The bytes that encryption adds to a part: a name, a counter, a tag, flags."""

_KEY_BYTES, _COOKIE_BYTES, _TAG_BYTES = 32, 96, 16
_HELLO, _WELCOME, _INITIATE, _MESSAGE = (
    b"\x05HELLO",
    b"\x07WELCOME",
    b"\x08INITIATE",
    b"\x07MESSAGE",
)
_VERSION = b"\1\0"
_HELLO_BYTES, _WELCOME_BYTES = 200, 168
_HELLO_BOX, _HELLO_KEY = 120, 80  # their offsets
_VOUCH_BYTES = 80
_REFUSED = ERROR + b"\x03400"
_AT_CLIENT, _AT_SERVER = b"CurveZMQMESSAGES", b"CurveZMQMESSAGEC"  # nonces of received messages


class _Curve:
    """The common part of both ends: the keys of a connection, and its counters.

    Args:
        kind: The socket type.
    """

    name: ClassVar[bytes] = b"CURVE"
    overhead: ClassVar[int] = OVERHEAD_BYTES
    _incoming: ClassVar[bytes]
    _outgoing: ClassVar[bytes]

    def __init__(self, kind: bytes) -> None:
        require()
        self.known = False
        self._metadata = metadata(kind)
        self._sent = 0  # the counter of the last sent box
        self._came = 0  # the counter of the last received box, which must increase
        self._public, self._own = nacl.crypto_box_keypair()  # short-term, for this connection
        self._shared = b""  # the key that both short-term key pairs share

    def seal(self, flags: int, body: Part) -> bytes:
        """Encrypt a part as a MESSAGE."""
        counter = self._counted()
        box = nacl.crypto_box_afternm(
            bytes((flags & 1 | flags >> 1 & 2,)) + body, self._outgoing + counter, self._shared
        )
        return _MESSAGE + counter + bytes(box)

    def open(self, body: Part) -> tuple[int, Part]:
        """Decrypt a MESSAGE; returns its flags and content. Raises ZmtpError."""
        counter = bytes(body[8:16])
        if bytes(body[:8]) != _MESSAGE or len(body) < OVERHEAD_BYTES:
            raise ZmtpError("the peer sent a message that is not encrypted")
        plain = self._opened(bytes(body[16:]), self._incoming, counter, self._shared)
        flags = plain[0] & 1 | (plain[0] & 2) << 1
        return flags, plain[1:] if len(plain) <= OWN_BYTES else memoryview(plain)[1:]

    def _counted(self) -> bytes:
        self._sent += 1
        return self._sent.to_bytes(8, "big")

    def _opened(self, box: bytes, nonce: bytes, counter: bytes, key: bytes) -> bytes:
        number = int.from_bytes(counter, "big")
        if number <= self._came:
            raise ZmtpError("the peer repeated an encrypted message")
        plain = _unboxed(box, nonce + counter, key)
        self._came = number
        return plain


class CurveServer(_Curve):
    """The end whose public key the client knows.

    Args:
        secret: The secret key (X25519) of this end.
        allowed: The accepted public key; None: every client that knows ours is accepted.
        kind: The socket type.
    """

    as_server: ClassVar[bool] = True
    _incoming, _outgoing = _AT_SERVER, _AT_CLIENT

    def __init__(self, secret: bytes, allowed: bytes | None, kind: bytes = b"ROUTER") -> None:
        super().__init__(kind)
        self._secret = secret
        self._allowed = allowed
        self._cookie = b""  # the client must return it
        self._client = b""  # the client's short-term key

    def opening(self) -> None:
        """None: the client begins."""

    def handshake(self, command: bytes) -> tuple[bytes, bool]:
        """Process the client's HELLO, then its INITIATE. Raises ZmtpError."""
        if not self._cookie:
            return self._welcome(command), False
        return self._let_in(command), True

    def _welcome(self, hello: bytes) -> bytes:
        if len(hello) != _HELLO_BYTES or not hello.startswith(_HELLO + _VERSION):
            raise ZmtpError("the client did not begin with HELLO")
        self._client = hello[_HELLO_KEY : _HELLO_KEY + _KEY_BYTES]
        counter = hello[_HELLO_KEY + _KEY_BYTES : _HELLO_BOX]
        key = _agreed(self._client, self._secret)
        self._opened(hello[_HELLO_BOX:], b"CurveZMQHELLO---", counter, key)
        # The connection keeps the state that a cookie would carry, so a random cookie suffices.
        self._cookie = os.urandom(_COOKIE_BYTES)
        self._shared = _agreed(self._client, self._own)
        nonce = os.urandom(_TAG_BYTES)
        box = nacl.crypto_box_afternm(self._public + self._cookie, b"WELCOME-" + nonce, key)
        return _WELCOME + nonce + bytes(box)

    def _let_in(self, initiate: bytes) -> bytes:
        start = len(_INITIATE) + _COOKIE_BYTES
        cookie, counter = initiate[len(_INITIATE) : start], initiate[start : start + 8]
        if not initiate.startswith(_INITIATE) or not hmac.compare_digest(cookie, self._cookie):
            raise ZmtpError("the client sent no valid INITIATE")
        plain = self._opened(initiate[start + 8 :], b"CurveZMQINITIATE", counter, self._shared)
        client, plain = plain[:_KEY_BYTES], plain[_KEY_BYTES:]
        nonce, vouch = plain[:_TAG_BYTES], plain[_TAG_BYTES : _TAG_BYTES + _VOUCH_BYTES]
        vouched = _unboxed(vouch, b"VOUCH---" + nonce, _agreed(client, self._own))
        if vouched != self._client + nacl.crypto_scalarmult_base(self._secret):
            raise ZmtpError("a vouch for another connection", reply=_REFUSED)
        if self._allowed is not None and not hmac.compare_digest(client, self._allowed):
            raise WrongKeyError("the key is not that of this port's peer", reply=_REFUSED)
        self.known = True
        counter = self._counted()
        box = nacl.crypto_box_afternm(self._metadata, b"CurveZMQREADY---" + counter, self._shared)
        return READY + counter + bytes(box)


class CurveClient(_Curve):
    """The end that knows the server's public key.

    Args:
        secret: The secret key (X25519) of this end.
        public: The public key of this end.
        server: The public key of the server.
        kind: The socket type.
    """

    as_server: ClassVar[bool] = False
    _incoming, _outgoing = _AT_CLIENT, _AT_SERVER

    def __init__(
        self, secret: bytes, public: bytes, server: bytes, kind: bytes = b"DEALER"
    ) -> None:
        super().__init__(kind)
        self._long_term = secret, public
        self._server = server
        self._welcomed = False  # the server's WELCOME was received

    def opening(self) -> bytes:
        """The HELLO."""
        counter = self._counted()
        key = _agreed(self._server, self._own)
        box = nacl.crypto_box_afternm(bytes(64), b"CurveZMQHELLO---" + counter, key)
        return _HELLO + _VERSION + bytes(72) + self._public + counter + bytes(box)

    def handshake(self, command: bytes) -> tuple[bytes | None, bool]:
        """Process the server's WELCOME, then its READY. Raises ZmtpError."""
        if command.startswith(ERROR):
            raise WrongKeyError("the peer refused our key")
        if not self._welcomed:
            return self._initiate(command), False
        if not command.startswith(READY):
            raise ZmtpError("the server sent no READY")
        start = len(READY) + 8
        counter = command[len(READY) : start]
        self._opened(command[start:], b"CurveZMQREADY---", counter, self._shared)
        self.known = True
        return None, True

    def _initiate(self, welcome: bytes) -> bytes:
        if len(welcome) != _WELCOME_BYTES or not welcome.startswith(_WELCOME):
            raise ZmtpError("the server sent no valid WELCOME")
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
    """The key that two key pairs share. Raises WrongKeyError if the public key is invalid."""
    try:
        return bytes(nacl.crypto_box_beforenm(public, secret))
    except (CryptoError, ValueError):
        raise WrongKeyError("the peer sent an invalid key", reply=_REFUSED) from None


def _unboxed(box: bytes, nonce: bytes, key: bytes) -> bytes:
    """Open a box. Raises WrongKeyError if it is for another key, or was modified."""
    try:
        return bytes(nacl.crypto_box_open_afternm(box, nonce, key))
    except (CryptoError, ValueError):
        raise WrongKeyError("the peer sent a box that our key does not open") from None
