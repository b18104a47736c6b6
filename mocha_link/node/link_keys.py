"""What protects the links of a node."""

from __future__ import annotations

from collections.abc import Mapping

from mocha_link.team import PublicKey, Seal, SecretKey


class LinkKeys:
    """The secret key of a node, and the public keys of its peers; links to other peers are open.

    Args:
        secret: of the node; None: no link is protected.
        peers: keys of protected peers.

    Raises:
        SealError: a peer's key makes no shared secret.

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
        """Ours and the peer's; None: the link is open."""
        key = self.peers.get(peer)
        return (self._secret, key) if self._secret and key else None

    def protects(self, peer: str) -> bool:
        """Whether only the peer itself can send what is received from it."""
        return peer in self._seals

    def seal(self, peer: str, packet: bytes) -> bytes:
        """A datagram as it is sent to the peer."""
        seal = self._seals.get(peer)
        return seal.seal(packet) if seal else packet

    def open(self, peer: str, packet: bytes) -> bytes | None:
        """A datagram that the peer sent; None: somebody else did."""
        seal = self._seals.get(peer)
        return seal.open(packet) if seal else packet
