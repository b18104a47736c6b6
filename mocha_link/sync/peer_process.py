"""The process that runs as a peer's robot, by its boot id: restarted, or running twice."""

from __future__ import annotations

from collections import deque

from mocha_link.sync.protocol import TRIAL_BOOT_ID

_BOOT_IDS = 8  # that are remembered: a process that was replaced does not come back
_ALONE = 16  # openings of one process in a row: no second one runs any more


class PeerProcess:
    """What the boot ids of a peer's syncs show of its process.

    Attributes:
        duplicate: two processes run as the peer's robot: a boot id has come back.
        duplicated: the peer has met two processes that run as our robot.
    """

    def __init__(self) -> None:
        self.duplicate = False
        self.duplicated = False
        self._restarted = False  # since the node asked last
        self._boot_id: int | None = None  # of the present process; None: it has not opened yet
        self._past_boot_ids: deque[int] = deque(maxlen=_BOOT_IDS)
        self._in_a_row = 0  # openings of the present process

    def opened(self, boot_id: int) -> bool:
        """The peer has opened a sync; whether its process is another one than before."""
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
        """The peer reports in a HELLO whether it has met two processes of our robot."""
        self.duplicated = duplicated

    def take_restarted(self) -> bool:
        """Whether the peer's process is a new one since the last call."""
        restarted, self._restarted = self._restarted, False
        return restarted
