"""The bytes that pulls may receive during one contact with a peer."""

from __future__ import annotations

LEAST_BUDGET = 1024  # no pull begins with less left


class ContactBudget:
    """The budget of the contact with one peer.

    Args:
        limit_bytes: may be received during a contact; 0: no limit.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._spent_bytes = 0  # of this contact

    @property
    def left_bytes(self) -> int | None:
        """Bytes that a pull may receive; 0: too few for a pull; None: no limit."""
        left = self._limit_bytes - self._spent_bytes
        return None if not self._limit_bytes else left if left >= LEAST_BUDGET else 0

    @property
    def is_spent(self) -> bool:
        """Whether no further pull may begin in this contact."""
        return self.left_bytes == 0

    def spend(self, size: int) -> None:
        """Count received bytes."""
        self._spent_bytes += size

    def renew(self) -> None:
        """Reset the budget: a contact begins."""
        self._spent_bytes = 0

    def extend(self) -> None:
        """Allow a running pull that continues over another connection a little more."""
        if self.is_spent:
            self._spent_bytes -= LEAST_BUDGET
