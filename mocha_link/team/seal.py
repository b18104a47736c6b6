"""Sealed UDP packets between two robots: encrypted, authentic, and of that direction only.

XSalsa20-Poly1305 (NaCl's secretbox) with a random nonce in front of each packet. The key of a
direction is derived from the Curve25519 secret that both robots share, so a packet that is sent
back to its sender does not open there.
"""

from __future__ import annotations

import hashlib
import os

try:
    import nacl.bindings
    import nacl.exceptions
except ImportError:  # pragma: no cover - keys.SecretKey says so before a Seal can be made
    pass

from mocha_link.errors import MochaLinkError
from mocha_link.team.keys import PublicKey, SecretKey

NONCE_BYTES = 24
OVERHEAD_BYTES = NONCE_BYTES + 16
_PURPOSE = b"mocha-link udp 1"


class SealError(MochaLinkError):
    """A packet that cannot be sealed for a peer."""


class Seal:
    """Seals packets for one peer and opens those that it sealed for us.

    Raises:
        SealError: the peer's key makes no shared secret.
    """

    def __init__(self, own: SecretKey, peer: PublicKey) -> None:
        mine, its = own.public.curve, peer.curve
        try:
            shared = nacl.bindings.crypto_box_beforenm(its, own.curve)
        except nacl.exceptions.CryptoError:
            raise SealError(f"'{peer.text}' is not a key to share a secret with") from None
        self._out = _key(shared, mine + its)
        self._in = _key(shared, its + mine)

    def seal(self, packet: bytes) -> bytes:
        """The packet as it goes out: OVERHEAD_BYTES longer."""
        nonce = os.urandom(NONCE_BYTES)
        sealed: bytes = nacl.bindings.crypto_secretbox(packet, nonce, self._out)
        return nonce + sealed

    def open(self, sealed: bytes) -> bytes | None:
        """The packet that the peer sealed for us; None for anything else."""
        if len(sealed) < OVERHEAD_BYTES:
            return None
        try:
            packet: bytes = nacl.bindings.crypto_secretbox_open(
                sealed[NONCE_BYTES:], sealed[:NONCE_BYTES], self._in
            )
        except nacl.exceptions.CryptoError:
            return None
        return packet


def _key(shared: bytes, direction: bytes) -> bytes:
    return hashlib.blake2b(direction, key=shared, person=_PURPOSE, digest_size=32).digest()
