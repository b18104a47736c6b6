"""The messages that a peer offers and we lack: announced, or left to another peer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet

_MAX_ANNOUNCED = 1_024
_MAX_LEFT = 1_024


class Offers:
    """The ids of messages that one peer has and that we still lack.

    Attributes:
        announced: ids that the peer has announced since our last OPEN to it.
        left: ids that another peer is to send instead, until they are received.
    """

    def __init__(self) -> None:
        self.announced: set[int] = set()
        self.left: set[int] = set()

    def announce(self, message_ids: Sequence[int]) -> None:
        """Note that the peer announced messages that we lack."""
        self.announced.update(message_ids[: _MAX_ANNOUNCED - len(self.announced)])

    def requested(self) -> None:
        """Clear the announced ids: an OPEN to the peer covers them."""
        self.announced.clear()

    @property
    def left_full(self) -> bool:
        """Whether no more messages can be left to another peer."""
        return len(self.left) >= _MAX_LEFT

    def leave(self, message_ids: Iterable[int]) -> None:
        """Leave messages to another peer."""
        self.left.update(message_ids)

    def still_left(self, message_ids: AbstractSet[int]) -> None:
        """Replace the ids left to another peer after a pull by those not received yet."""
        self.left = set(message_ids)
