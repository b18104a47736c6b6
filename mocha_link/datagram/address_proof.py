"""Whether what is sent gets to the peer itself, not to a victim in whose name it came."""

from __future__ import annotations

RETURN = 3  # times the bytes received: more does not leave before the peer has proven its address
UNLIMITED = 1 << 30


class AddressProof:
    """Limits what is sent to an address that the peer has not proven to be its own.

    Attributes:
        proven: the limit is off.
        bytes_in: that were received from there.
        bytes_out: that were sent there.
    """

    def __init__(self, *, proven: bool) -> None:
        self.proven = proven
        self.bytes_in = 0
        self.bytes_out = 0

    @property
    def quota(self) -> int:
        """How many bytes may leave."""
        return UNLIMITED if self.proven else RETURN * self.bytes_in - self.bytes_out
