"""Detects by boot ids that a peer's process was restarted, or runs twice."""

from __future__ import annotations

from collections import deque

from mocha_link.sync.protocol import TRIAL_BOOT_ID

_BOOT_IDS = 8  # remembered: a boot id that appears again belongs to a second process
_ALONE = 16  # after this many consecutive openings of one process no second one runs


class PeerProcess:
    """The process of a peer, by the boot ids in its syncs.

    Attributes:
        duplicate: two processes run as the peer's robot: an earlier boot id has appeared again.
        duplicated: the peer has detected two processes that run as our robot.
    """

    def __init__(self) -> None:
        self.duplicate = False
        self.duplicated = False
        self._restarted = False  # since the last `take_restarted`
        self._boot_id: int | None = None  # of the current process; None: it has not opened yet
        self._past_boot_ids: deque[int] = deque(maxlen=_BOOT_IDS)
        self._in_a_row = 0  # consecutive openings of the current process

    def opened(self, boot_id: int) -> bool:
        """Note the boot id of an opening; returns whether the process differs from the last one."""
        if boot_id == self._boot_id:
            self._in_a_row += 1
            self.duplicate = self.duplicate and self._in_a_row < _ALONE
            return False
        self._in_a_row = 1
        self._restarted = self._boot_id is not None
        if boot_id != TRIAL_BOOT_ID:
            self.duplicate = self.duplicate or boot_id in self._past_boot_ids
            if self._boot_id not in (None, TRIAL_BOOT_ID):
                self._past_boot_ids.append(self._boot_id)
        self._boot_id = boot_id
        return True

    def report_duplicated(self, *, duplicated: bool) -> None:
        """Note from a HELLO whether the peer has detected two processes of our robot."""
        self.duplicated = duplicated

    def take_restarted(self) -> bool:
        """Whether the peer's process was replaced since the last call."""
        restarted, self._restarted = self._restarted, False
        return restarted
