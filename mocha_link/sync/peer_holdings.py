"""The messages that a peer is known to hold, whole or in part."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mocha_link.store import WRAP_MS, Record, is_void, wire
from mocha_link.sync.agreement import TopicAgreement

BEGUN_BYTES = 64 * 1024 * 1024  # of messages that are kept though newer ones have replaced them


class PeerHoldings:
    """What one peer holds, and what it was given a part of.

    Nothing of it is needed for messages to arrive: it spares sending what the peer has, and lets a
    message that was begun be finished though a newer one has replaced it.

    Args:
        histories: versions that are kept, by topic key.
        agreement: the topics that are exchanged.
        begun_bytes: of messages that are kept to be finished.
    """

    def __init__(
        self,
        histories: Mapping[int, int],
        agreement: TopicAgreement,
        *,
        begun_bytes: int = BEGUN_BYTES,
    ) -> None:
        self._histories = histories
        self._agreement = agreement
        self._most_begun_bytes = begun_bytes
        self._held: dict[int, tuple[int, ...]] = {}  # by topic key: stamps, newest first
        self._begun: dict[int, Record] = {}  # given in part, by message id
        self._begun_bytes = 0  # of their bodies

    # --- what it holds

    def forget(self) -> None:
        """Clear what the peer holds: it reports all of it next, or its process is a new one."""
        self._held.clear()

    def add(self, *message_ids: int) -> None:
        """The peer holds these messages."""
        listed: dict[int, set[int]] = {}
        for message_id in message_ids:
            listed.setdefault(message_id >> 48, set()).add(message_id & wire.STAMP_MASK)
        for key, stamps in listed.items():
            stamps.update(self._held.get(key, ()))
            newest = sorted(stamps, reverse=True)[: self._histories.get(key, 1)]
            self._held[key] = tuple(newest)

    def stamps_ms(self, topic_key: int) -> tuple[int, ...]:
        """The stamps of the messages of a topic that the peer is known to hold, newest first."""
        return self._held.get(topic_key, ())

    @property
    def newest(self) -> dict[int, int]:
        """What it is known to hold: by topic key, the newest stamp in milliseconds."""
        return {key: stamps[0] for key, stamps in self._held.items()}

    def lacks(self, record: Record, message_id: int) -> bool:
        """Whether the peer may want a message, as far as is known."""
        key, stamp_ms = message_id >> 48, record.stamp_ms
        if not self._agreement.exchanges(key):
            return False
        held = self._held.get(key)
        if held is None:
            return True
        if stamp_ms in held:
            return False
        if is_void(held[0], wire.latest_ms(record.received_s)):  # both clocks were wrong then
            return True
        if record.extrapolated:  # others may have extrapolated another one
            return all((other - stamp_ms) % WRAP_MS for other in held)
        return held[-1] < stamp_ms or len(held) < self._histories.get(key, 1)

    # --- what it was given a part of

    def begin(self, message_id: int, record: Record) -> None:
        """A part of a message has been given out."""
        if message_id in self._begun:
            return
        self._begun[message_id] = record
        self._begun_bytes += len(record.body)
        while self._begun_bytes > self._most_begun_bytes and len(self._begun) > 1:
            self._end(next(iter(self._begun)))

    def begun(self, message_id: int) -> Record | None:
        """A message of which a part was given out earlier."""
        return self._begun.get(message_id)

    def end_begun(self, kept: Iterable[int] = ()) -> None:
        """Let go what was begun, but for those."""
        for message_id in set(self._begun).difference(kept):
            self._end(message_id)

    def _end(self, message_id: int) -> None:
        self._begun_bytes -= len(self._begun.pop(message_id).body)
