"""The changes that are not on disk yet, between the threads that make them and the one that writes.

No file here.
"""

from __future__ import annotations

import threading

from mocha_link.store.changes import Changes
from mocha_link.store.record import Knowledge, Record


class Backlog:
    """Collects changes for the next transaction; for any thread."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards all below
        self._pending = Changes()  # for the next transaction
        self._given = 0  # changes so far
        self._saved = 0  # changes on disk
        self._suspended = False  # after a fault: written when it is time to try again
        self._hurried = False  # after a fault: it is time
        self._closing = False  # write the rest, and end
        self._ended = False  # nothing is written any more

    @property
    def left(self) -> int:
        """How many changes are not on disk."""
        with self._changed:
            return self._given - self._saved

    # --- for those who make changes

    def put(self, number: int, record: Record) -> None:
        """A message to write."""
        with self._changed:
            self._pending.puts[number] = record
            self._count()

    def drop(self, number: int, key: int) -> None:
        """A message that is not kept any longer, of the topic of that key."""
        with self._changed:
            if self._pending.puts.pop(number, None) is None:
                self._pending.drops[number] = key
            self._count()

    def learn(self, peer: str, knowledge: Knowledge) -> None:
        """What is known of a peer, with all that was put before."""
        with self._changed:
            self._pending.knowledge[peer] = knowledge
            self._count()

    def _count(self) -> None:
        self._given += 1
        self._changed.notify_all()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until what was given before this call is on disk; False: it cannot be now."""
        with self._changed:
            target = self._given
            self._changed.wait_for(
                lambda: (
                    self._saved >= target or self._ended or (self._suspended and not self._hurried)
                ),
                timeout_s,
            )
            return self._saved >= target

    def hurry(self) -> None:
        """After a fault: have the writer try again now."""
        with self._changed:
            self._hurried = self._suspended
            self._changed.notify_all()

    def close(self) -> None:
        """Have the writer write the rest, and end."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()

    # --- for the one who writes

    def wait_for_work(self, retry_s: float) -> bool:
        """Wait for a change, after a fault for the next try; False at the end."""
        with self._changed:
            if self._suspended:
                self._changed.wait_for(lambda: self._closing or self._hurried, retry_s)
            else:
                self._changed.wait_for(lambda: self._closing or self._given > self._saved)
            return not self._closing

    def take(self) -> tuple[Changes, int]:
        """All that is pending, and how many changes are on disk once it is."""
        with self._changed:
            changes, self._pending = self._pending, Changes()
            return changes, self._given

    def put_back(self, changes: Changes) -> None:
        """They were not written."""
        with self._changed:
            self._pending.put_back(changes)

    def saved(self, given: int) -> None:
        """So many changes are on disk."""
        with self._changed:
            self._saved = given
            self._suspended = self._hurried = False
            self._changed.notify_all()

    def suspend(self, *, retry_now: bool) -> None:
        """Writing has failed."""
        with self._changed:
            self._suspended, self._hurried = True, retry_now
            self._changed.notify_all()

    def end(self) -> None:
        """Nothing is written any more: release the callers that wait for the disk."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
