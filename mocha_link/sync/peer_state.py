"""What a node remembers of a peer from contact to contact, as long as both keep running."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable, Iterable

from mocha_link.store.payload import STAMP_MASK
from mocha_link.store.record import WRAP_MS, Record
from mocha_link.sync.frames import message_id_of

TOKENS = 3
BEGUN_BYTES = 64 * 1024 * 1024


class PeerState:
    """What one peer is known to hold, and the messages that it has got a part of.

    Nothing here is needed for messages to arrive: it spares sending what the peer has, and lets a
    message that was begun be finished though a newer one has replaced it.

    Args:
        boot_id: a random u64 of our process. The peer forgets what it knows of us when it changes.
        history: as the database has it: how many versions of a topic are kept.
        config_hash: what ids mean to us, as one number (`config_hash_of`).

    Attributes:
        address_token: what the peer has given us to show that it has reached us; 0: nothing yet.
        config_mismatch: ids mean something else to the peer, as far as its last word on that goes.
    """

    def __init__(
        self, boot_id: int, history: Callable[[int, int], int] | None = None, config_hash: int = 0
    ) -> None:
        self.boot_id = boot_id
        self.config_hash = config_hash
        self.address_token = 0
        self.config_mismatch = False
        # Given to the peer, the newest last.
        self._address_tokens: deque[int] = deque(maxlen=TOKENS)
        self._history = history
        self._peer_boot_id: int | None = None  # another one: it has forgotten
        self._held: dict[int, tuple[int, ...]] = {}  # by topic key: stamps, newest first
        self._begun: dict[int, Record] = {}  # given in part, by message id
        self._begun_bytes = 0  # of their bodies

    @property
    def next_token(self) -> int:
        """For the peer, which shows it when it begins by datagrams: those get back to it."""
        if not self._address_tokens:
            self.renew_token()
        return self._address_tokens[-1]

    def renew_token(self) -> None:
        """Give it another one next time; so a copy of what it said is of use for a while only."""
        self._address_tokens.append(secrets.randbits(64) or 1)

    def admits(self, address_token: int) -> bool:
        """Whether it is one that we have given to the peer of late."""
        return address_token in self._address_tokens

    def agrees(self, config_hash: int) -> bool:
        """The peer says what ids mean to it; whether that is what they mean to us."""
        self.config_mismatch = config_hash != self.config_hash
        return not self.config_mismatch

    def met(self, boot_id: int) -> None:
        """The peer says which boot of it is speaking."""
        if boot_id != self._peer_boot_id:
            self._held.clear()
            self._peer_boot_id = boot_id

    def forget(self) -> None:
        """The peer says all that it holds: what it said before is nothing."""
        self._held.clear()

    def holds(self, message_id: int) -> None:
        """The peer holds a message."""
        key, stamp_ms = message_id >> 48, message_id & STAMP_MASK
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

    def lacks(self, record: Record, message_id: int) -> bool:
        """Whether the peer may want a message, as far as is known."""
        key, stamp_ms = message_id >> 48, record.stamp_ms
        held = self._held.get(key)
        if held is None:
            return True
        if stamp_ms in held:
            return False
        if record.extrapolated:  # others may have extrapolated another one
            return all((other - stamp_ms) % WRAP_MS for other in held)
        return held[-1] < stamp_ms or len(held) < self._depth(key)

    def begin(self, message_id: int, record: Record) -> None:
        """A part of a message has been given out."""
        if message_id in self._begun:
            return
        self._begun[message_id] = record
        self._begun_bytes += len(record.body)
        while self._begun_bytes > BEGUN_BYTES and len(self._begun) > 1:
            self._end(next(iter(self._begun)))

    def begun(self, message_id: int) -> Record | None:
        """A message of which a part was given out earlier."""
        return self._begun.get(message_id)

    def end(self, kept: Iterable[int] = ()) -> None:
        """Let go what was begun, but for those."""
        for message_id in set(self._begun).difference(kept):
            self._end(message_id)

    def _end(self, message_id: int) -> None:
        self._begun_bytes -= len(self._begun.pop(message_id).body)

    def _depth(self, key: int) -> int:
        return self._history(key >> 8, key & 0xFF) if self._history else 1


def record_id(record: Record) -> int:
    """The message id of a record."""
    header = record.header
    return message_id_of(header.robot_id, header.topic_id, record.stamp_ms)
