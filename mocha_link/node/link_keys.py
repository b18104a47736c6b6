"""The keys that protect the links of a node."""

from __future__ import annotations

from collections.abc import Mapping

from mocha_link.team import PublicKey, Seal, SecretKey


class LinkKeys:
    """The secret key of a node, and the public keys of its peers; links to others are unprotected.

    Args:
        secret: of the node; None: no link is protected.
        peers: keys of protected peers.

    Raises:
        SealError: a peer's key is invalid.

    Attributes:
        peers: keys of protected peers.
    """

    def __init__(
        self, secret: SecretKey | None = None, peers: Mapping[str, PublicKey] | None = None
    ) -> None:
        self.peers = peers or {}
        self._secret = secret
        self._seals = (
            {peer: Seal(secret, key) for peer, key in self.peers.items()} if secret else {}
        )

    def pair(self, peer: str) -> tuple[SecretKey, PublicKey] | None:
        """Our secret key and the peer's public key; None: the link is not protected."""
        key = self.peers.get(peer)
        return (self._secret, key) if self._secret and key else None

    def protects(self, peer: str) -> bool:
        """Whether everything received on the link is proven to be the peer's."""
        return peer in self._seals

    def seal(self, peer: str, packet: bytes) -> bytes:
        """Seal a datagram to the peer, if the link is protected."""
        seal = self._seals.get(peer)
        return seal.seal(packet) if seal else packet

    def open(self, peer: str, packet: bytes) -> bytes | None:
        """Open a received datagram, if the link is protected; None: the peer did not send it."""
        seal = self._seals.get(peer)
        return seal.open(packet) if seal else packet
