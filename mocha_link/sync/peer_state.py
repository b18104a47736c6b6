"""What a node remembers of a peer from contact to contact, as long as both keep running."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable, Iterable

from mocha_link.store.header import WRAP_MS
from mocha_link.store.payload import STAMP_MASK
from mocha_link.store.record import Record
from mocha_link.sync.frames import long_id

TICKETS = 3
BEGUN_BYTES = 64 * 1024 * 1024


class Acquaintance:
    """What one peer is known to hold, and the messages that it has got a part of.

    Nothing here is needed for messages to arrive: it spares sending what the peer has, and lets a
    message that was begun be finished though a newer one has replaced it.

    Args:
        run: a random u64 of our process. The peer forgets what it remembers of us when it changes.
        history: as the database has it: how many versions of a topic are kept.
        terms: what ids mean to us, as one number (`terms.shared_mark`).

    Attributes:
        ticket: what the peer has given us to show that it has reached us; 0: nothing yet.
        foreign: ids mean something else to the peer, as far as its last word on that goes.
    """

    def __init__(
        self, run: int, history: Callable[[int, int], int] | None = None, terms: int = 0
    ) -> None:
        self.run = run
        self.terms = terms
        self.ticket = 0
        self.foreign = False
        self._tickets: deque[int] = deque(maxlen=TICKETS)  # given to the peer, the newest last
        self._history = history
        self._peer_run: int | None = None
        self._held: dict[int, tuple[int, ...]] = {}  # by topic key: stamps, newest first
        self._begun: dict[int, Record] = {}
        self._begun_bytes = 0

    @property
    def next_ticket(self) -> int:
        """For the peer, which shows it when it begins by datagrams: those get back to it."""
        if not self._tickets:
            self.renew_ticket()
        return self._tickets[-1]

    def renew_ticket(self) -> None:
        """Give it another one next time; so a copy of what it said is of use for a while only."""
        self._tickets.append(secrets.randbits(64) or 1)

    def admits(self, ticket: int) -> bool:
        """Whether it is one that we have given to the peer of late."""
        return ticket in self._tickets

    def agrees(self, terms: int) -> bool:
        """The peer says what ids mean to it; whether that is what they mean to us."""
        self.foreign = terms != self.terms
        return not self.foreign

    def met(self, run: int) -> None:
        """The peer says which run of it is speaking."""
        if run != self._peer_run:
            self._held.clear()
            self._peer_run = run

    def forget(self) -> None:
        """The peer says all that it holds: what it said before is nothing."""
        self._held.clear()

    def holds(self, long: int) -> None:
        """The peer holds a message."""
        key, stamp_ms = long >> 48, long & STAMP_MASK
        held = self._held.get(key)
        if held is None:
            self._held[key] = (stamp_ms,)
        elif stamp_ms not in held:
            stamps = sorted((*held, stamp_ms), reverse=True)
            self._held[key] = tuple(stamps[: self._depth(key)])

    @property
    def newest(self) -> dict[tuple[int, int], int]:
        """What it is known to hold: by robot id and topic id, the newest stamp in milliseconds."""
        return {(key >> 8, key & 0xFF): stamps[0] for key, stamps in self._held.items()}

    def lacks(self, record: Record, long: int) -> bool:
        """Whether the peer may want a message, as far as is known."""
        key, stamp_ms = long >> 48, record.stamp_ms
        held = self._held.get(key)
        if held is None:
            return True
        if stamp_ms in held:
            return False
        if record.inferred:  # others may have inferred another one
            return all((other - stamp_ms) % WRAP_MS for other in held)
        return held[-1] < stamp_ms or len(held) < self._depth(key)

    def begin(self, long: int, record: Record) -> None:
        """A part of a message has been given out."""
        if long in self._begun:
            return
        self._begun[long] = record
        self._begun_bytes += len(record.body)
        while self._begun_bytes > BEGUN_BYTES and len(self._begun) > 1:
            self._end(next(iter(self._begun)))

    def begun(self, long: int) -> Record | None:
        """A message of which a part was given out earlier."""
        return self._begun.get(long)

    def end(self, kept: Iterable[int] = ()) -> None:
        """Let go what was begun, but for those."""
        for long in set(self._begun).difference(kept):
            self._end(long)

    def _end(self, long: int) -> None:
        self._begun_bytes -= len(self._begun.pop(long).body)

    def _depth(self, key: int) -> int:
        return self._history(key >> 8, key & 0xFF) if self._history else 1


def record_id(record: Record) -> int:
    """The long id of a record."""
    header = record.header
    return long_id(header.robot_id, header.topic_id, record.stamp_ms)
