"""Which frames of chunks of a round have come to the pulling side, and whether all have."""

from __future__ import annotations

from mocha_link.sync.frames import SyncFrameError
from mocha_link.sync.sync_messages import Done

_MAX_AHEAD = 65_536


class Arrivals:
    """The frames of one round, which come in any order, and the DONE that says how many there are.

    Attributes:
        round: its number.
    """

    def __init__(self, round_: int) -> None:
        self.round = round_
        self._next = 0  # all frames below this number have come, and `_ahead`
        self._ahead: set[int] = set()  # numbers that came ahead of it
        self._damaged = 0  # frames
        self._done: Done | None = None

    def count(self, number: int) -> bool:
        """A frame has come; whether it is the first time. Raises SyncFrameError."""
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
        """A frame has come that cannot be read."""
        self._damaged += 1

    def end(self, done: Done) -> None:
        """The peer has sent all."""
        self._done = done

    @property
    def done(self) -> Done | None:
        """The peer's DONE, once all its frames have come."""
        done = self._done
        arrived = self._next + len(self._ahead) + self._damaged
        return done if done and arrived >= done.frames else None
