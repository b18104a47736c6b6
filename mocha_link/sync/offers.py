"""What a peer offers and we have not taken from it: announced, or left to another peer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet

_MAX_ANNOUNCED = 1_024
_MAX_LEFT = 1_024


class Offers:
    """The ids of messages that one peer has and that we still lack.

    Attributes:
        announced: that the peer announced since our last OPEN to it.
        left: that another peer is to send instead, until they arrive.
    """

    def __init__(self) -> None:
        self.announced: set[int] = set()
        self.left: set[int] = set()

    def announce(self, message_ids: Sequence[int]) -> None:
        """The peer announced messages that we lack."""
        self.announced.update(message_ids[: _MAX_ANNOUNCED - len(self.announced)])

    def requested(self) -> None:
        """An OPEN to the peer covers what it announced."""
        self.announced.clear()

    @property
    def left_full(self) -> bool:
        """Whether no more can be left to another peer."""
        return len(self.left) >= _MAX_LEFT

    def leave(self, message_ids: Iterable[int]) -> None:
        """Messages are left to another peer."""
        self.left.update(message_ids)

    def still_left(self, message_ids: AbstractSet[int]) -> None:
        """A pull has ended: of what was left to another peer these have not arrived."""
        self.left = set(message_ids)
