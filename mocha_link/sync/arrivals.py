"""The pulling side's record of the received frames of a round."""

from __future__ import annotations

from mocha_link.sync.frames import SyncFrameError
from mocha_link.sync.sync_messages import Done

_MAX_AHEAD = 65_536


class Arrivals:
    """The received frames of one round, in any order, and the DONE with their number.

    Attributes:
        round: the number of the round.
    """

    def __init__(self, round_: int) -> None:
        self.round = round_
        self._next = 0  # all frames below this number were received, and those in `_ahead`
        self._ahead: set[int] = set()  # received numbers above `_next`
        self._damaged = 0  # frames received damaged
        self._done: Done | None = None

    def count(self, number: int) -> bool:
        """Note a received frame; returns whether it is no duplicate. Raises SyncFrameError."""
        if number < self._next or number in self._ahead:
            return False
        if number == self._next:
            self._next += 1
            while self._next in self._ahead:
                self._ahead.remove(self._next)
                self._next += 1
        elif len(self._ahead) < _MAX_AHEAD:
            self._ahead.add(number)
        else:
            raise SyncFrameError("a frame far ahead of the others")
        return True

    def count_damaged(self) -> None:
        """Count a damaged frame."""
        self._damaged += 1

    def end(self, done: Done) -> None:
        """Note the peer's DONE."""
        self._done = done

    @property
    def done(self) -> Done | None:
        """The peer's DONE, once all frames of the round were received."""
        done = self._done
        arrived = self._next + len(self._ahead) + self._damaged
        return done if done and arrived >= done.frames else None
