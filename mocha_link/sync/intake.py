"""Checks, reassembles and stores the messages that one pull receives."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from collections.abc import Set as AbstractSet

from mocha_link.clock import Instant
from mocha_link.store import (
    Header,
    PayloadError,
    Record,
    impossibility,
    is_alone,
    wire,
)
from mocha_link.sync.frames import LARGE_BYTES, Chunks, SyncFrameError
from mocha_link.sync.holdings import Holdings
from mocha_link.sync.peer import Peer, check_type
from mocha_link.sync.protocol import Frame

MAX_RECEIVED_IDS = 65_536
_SKIP_BYTES = 4_096  # a SKIP is sent only if it saves more than this
_MAX_BEGUN = 1_024
_MAX_FAILED = 1_024
_MAX_REFUSALS = 100  # reported per frame


class Intake:
    """Stores the messages of one pull; refuses damaged and impossible ones.

    Args:
        holdings: the messages that we hold.
        remembered: the number of received message ids that are remembered. Later messages are
            reported to the peer in the next pull like our own.

    Attributes:
        messages: the number of stored messages.
        received_ids: ids of messages that the peer sent before the pull ended.
        flawed: the round lacks messages that may be requested again.
        hopeless: some message cannot be received intact in this pull.
    """

    def __init__(
        self, peer: Peer, holdings: Holdings, *, remembered: int = MAX_RECEIVED_IDS
    ) -> None:
        self.messages = 0
        self.received_ids: set[int] = set()
        self.flawed = False
        self.hopeless = False
        self._peer = peer
        self._holdings = holdings
        self._reassembly = peer.node.reassembly
        self._topics = peer.node.team.topics_by_key
        self._remembered = remembered
        self._now = Instant(0.0, 0.0)  # when the current frame was received
        self._refusals_end = 0  # no refusals beyond this number are recorded
        self._begun: set[int] = set()  # partly received in this pull
        self._skipped: set[int] = set()  # skipped in this round
        self._skips: list[int] = []  # skipped, with a SKIP still to send
        self._failed: set[int] = set()  # messages received damaged

    # --- the course of the pull

    def begin_frame(self, now: Instant) -> None:
        """Begin the processing of a frame."""
        self._now = now
        self._refusals_end = len(self._peer.log.refusals) + _MAX_REFUSALS

    def begin_round(self) -> None:
        """Begin a round."""
        self.flawed = False
        self._skipped.clear()

    def end(self) -> None:
        """End the pull: later messages are pushed, and are not added to `received_ids`."""
        self._remembered = 0

    def refuse_frame(self, error: SyncFrameError) -> None:
        """Refuse a damaged frame, whose messages may be requested again."""
        self._refuse(str(error))
        self.flawed = True

    def missing(self, left: AbstractSet[int]) -> list[int]:
        """Partly received messages, and those of `left` that no other peer is sending."""
        elsewhere = self._reassembly.elsewhere(self._peer.name, self._now.steady_s)
        return [*filter(self._is_new, self._begun), *(left - elsewhere)]

    # --- messages

    def take(self, chunks: Chunks) -> None:
        """Process a frame of chunks. Raises SyncFrameError."""
        for message_id, body in chunks.wholes:
            keeps = len(body) >= LARGE_BYTES and is_alone(body)
            self._take_message(message_id, body if keeps else bytes(body))
        for piece in chunks.pieces:
            self._take_piece(*piece)

    def take_skips(self) -> list[int]:
        """The messages to skip since the last call: their rest need not be sent."""
        skips, self._skips = self._skips, []
        return skips

    def wanted(self, message_ids: Collection[int]) -> list[int]:
        """The announced messages that are possible and new."""
        return [
            each for each in message_ids if not self._is_impossible(each) and self._is_new(each)
        ]

    def _take_piece(self, message_id: int, total: int, offset: int, data: memoryview) -> None:
        if self._is_impossible(message_id):
            return
        # Another peer has sent it or a newer one, or is sending it now.
        if not self._is_new(message_id) or self._holdings.leaves(message_id, total, self._now):
            self._begun.discard(message_id)
            more = total - offset - len(data) > _SKIP_BYTES and len(self._skipped) < _MAX_BEGUN
            if more and message_id not in self._skipped:
                self._skipped.add(message_id)
                self._skips.append(message_id)
            return
        if message_id not in self._begun and len(self._begun) >= _MAX_BEGUN:
            raise SyncFrameError("parts of too many messages")
        body = self._reassembly.add(message_id, total, offset, data, self._peer.name)
        if body is None:
            self._begun.add(message_id)
        else:
            self._begun.discard(message_id)
            self._take_message(message_id, body)

    def _take_message(self, message_id: int, body: Frame) -> None:
        if self._is_impossible(message_id):
            return
        peer, stamp_ms = self._peer, message_id & wire.STAMP_MASK
        robot, topic = known = self._topics[message_id >> 48]
        try:
            trailer = wire.check(body, (robot.robot_id, topic.topic_id), stamp_ms)
            if trailer is None:
                check_type(body, topic)
        except PayloadError as error:  # may have been damaged in transit
            self._refuse(f"message {message_id:016x}: {error}")
            if not self._reassembly.fail(message_id):  # all its parts are this peer's
                self.hopeless |= message_id in self._failed or len(self._failed) >= _MAX_FAILED
                self._failed.add(message_id)
            self.flawed = True
        else:
            header = Header.at(robot.robot_id, topic.topic_id, stamp_ms)
            now_s = self._now.unix_s
            record = Record(header, topic.priority, body, stamp_ms, now_s, trailer is None)
            peer.holdings.add(message_id)
            if len(self.received_ids) < self._remembered:
                self.received_ids.add(message_id)
            try:
                self.messages += peer.store(known, record, trailer)
            except PayloadError as error:  # intact: a repetition would be refused as well
                self._refuse(f"message {message_id:016x}: {error}")
                self._reassembly.fail(message_id, but=peer.name)
                return
            if self._reassembly.cost:
                self._reassembly.drop(message_id)

    def _is_impossible(self, message_id: int) -> bool:
        """Whether a message is not the team's, or not exchanged; records the refusal."""
        peer, key, stamp_ms = self._peer, message_id >> 48, message_id & wire.STAMP_MASK
        why = impossibility(peer.node.team, *divmod(key, 256), stamp_ms, self._now.unix_s)
        if why is None:
            if peer.agreement.exchanges(key):
                return False
            robot, topic = self._topics[key]
            why = (
                f"{topic.name} of {robot.name} is not exchanged with {peer.name}; "
                "use the same team file everywhere"
            )
        self._refuse(f"message {message_id:016x}: {why}")
        return True

    def still_new(self, message_ids: Iterable[int]) -> Iterator[int]:
        """Those that were not received, from this peer or another one."""
        return filter(self._is_new, message_ids)

    def _is_new(self, message_id: int) -> bool:
        return self._holdings.wants(message_id, self._now.unix_s)

    def _refuse(self, reason: str) -> None:
        if len(self._peer.log.refusals) < self._refusals_end:
            self._peer.log.refuse(reason)
