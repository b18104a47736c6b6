"""A limit on what is sent to an address that may have been spoofed (amplification attacks)."""

from __future__ import annotations

RETURN = 3  # times the bytes received may be sent before the peer has proven its address
UNLIMITED = 1 << 30


class AddressProof:
    """Limits the bytes that are sent to an address until the peer has proven that it is its own.

    Attributes:
        proven: the address is proven: no limit applies.
        bytes_in: bytes received from the address.
        bytes_out: bytes sent to the address.
    """

    def __init__(self, *, proven: bool) -> None:
        self.proven = proven
        self.bytes_in = 0
        self.bytes_out = 0

    @property
    def quota(self) -> int:
        """How many more bytes may be sent."""
        return UNLIMITED if self.proven else RETURN * self.bytes_in - self.bytes_out
