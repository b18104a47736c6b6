"""The bytes that pulls may bring in during one contact with a peer."""

from __future__ import annotations

LEAST_BUDGET = 1024  # with less left no pull begins


class ContactBudget:
    """The budget of the contact with one peer.

    Args:
        limit_bytes: that may come in during a contact; 0: no limit.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._spent_bytes = 0  # of this contact

    @property
    def left_bytes(self) -> int | None:
        """Bytes that a pull may take; 0: too few for one; None: no limit."""
        left = self._limit_bytes - self._spent_bytes
        return None if not self._limit_bytes else left if left >= LEAST_BUDGET else 0

    @property
    def is_spent(self) -> bool:
        """Whether no pull begins any more in this contact."""
        return self.left_bytes == 0

    def spend(self, size: int) -> None:
        """So many bytes came in."""
        self._spent_bytes += size

    def renew(self) -> None:
        """A contact begins, or what counts as one."""
        self._spent_bytes = 0

    def extend(self) -> None:
        """A pull that has begun goes on over another connection: allow it a little more."""
        if self.is_spent:
            self._spent_bytes -= LEAST_BUDGET
