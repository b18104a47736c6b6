"""Address tokens: a peer that returns one in an OPEN has received our packets at its address."""

from __future__ import annotations

import secrets
from collections import deque

_VALID = 3  # the newest tokens that we issued are valid


class AddressTokens:
    """The tokens that we issued to one peer, and the one that it issued to us.

    Attributes:
        received: the newest token from the peer, for our next OPEN; 0: none received yet.
    """

    def __init__(self) -> None:
        self.received = 0
        self._issued: deque[int] = deque(maxlen=_VALID)  # to the peer, the newest last

    def receive(self, address_token: int) -> None:
        """Note the token that the peer has issued to us; 0: keep the previous one."""
        self.received = address_token or self.received

    @property
    def next(self) -> int:
        """The token for the next HELLO to the peer."""
        if not self._issued:
            self.renew()
        return self._issued[-1]

    def renew(self) -> None:
        """Issue a new token next time, so that replayed openings become invalid."""
        self._issued.append(secrets.randbits(64) or 1)

    def verify(self, address_token: int) -> bool:
        """Whether we issued this token to the peer recently."""
        return address_token in self._issued
