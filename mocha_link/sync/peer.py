"""One peer of a node: what its syncs share and remember, and how much it may send ahead.

A connection buffers megabytes on a slow link, and urgent messages cannot overtake that buffer.
So the pulling node grants credit: enough to keep the link busy, no more.
"""

from __future__ import annotations

import secrets
import struct
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from collections.abc import Set as AbstractSet
from typing import NamedTuple

from mocha_link.clock import Instant
from mocha_link.links import (
    Direction,
    LinkEvent,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.store import WRAP_MS, Header, PayloadError, Record, Trailer, is_void, wire
from mocha_link.sync.protocol import (
    DIALLED,
    NEAR_S,
    TRIAL_BOOT_ID,
    Frame,
    NodeContext,
    Reply,
    Route,
    Send,
)
from mocha_link.team import Robot, Topic

Verify = Callable[[Header, Frame, Trailer | None], None]
"""Raises PayloadError for a message that a peer may not hand us."""

MAX_MISSES = 2  # pulls on which datagrams carried nothing although the peer took them
RETRY_EVERY = 8  # then they are tried again only so often
_TOKENS = 3  # address tokens that are good at the same time
_BOOT_IDS = 8  # that are remembered: a process that was replaced does not come back
_ALONE = 16  # openings of one process in a row: no second one runs any more
_BEGUN_BYTES = 64 * 1024 * 1024

GRANT = struct.Struct(">QI")  # bytes since the beginning, largest frame

MIN_WINDOW = 32 * 1024
FIRST_WINDOW = 64 * 1024
KNOWN_WINDOW = 512 * 1024  # the most at first: the link may be a worse one than last time
MAX_WINDOW = 32 * 1024 * 1024
MIN_CHUNK, MAX_CHUNK = 2816, 1024 * 1024  # at least: two segments of TCP
SHARED_CHUNK = 60 * 1024  # at most over a connection of the peer, which takes requests
_QUEUE_S = 0.15  # what may lie in buffers on top of a round trip
_GROWTH = 1.5  # so much more than the rate so far, as it may rise
_CHUNKS = 32  # in a window: what a cut leaves of one is lost
_GRANTS = 4  # per window
_MEMORY_S = 0.5  # a rate counts over the last one to two of these: bytes come in bursts


class Peer:
    """The state of a peer while both nodes run, and the events of its syncs.

    Of what the peer holds and has begun nothing is needed for messages to arrive: it spares sending
    what the peer has, and lets a message that was begun be finished though a newer one has
    replaced it.

    Args:
        verify: refuses messages that the peer may not hand us; None: it may hand us any.
        original: it is known to run the original node: nothing newer is tried.
        datagrams: there is a socket for them.
        budget_bytes: that may come in during a contact; 0: no limit.
        pushed: ids of the robots whose new messages reach the peer no other way than by us.

    Attributes:
        events: for listeners; the node that drives the syncs takes them out.
        refusals: reasons of refused input, for the operator; taken out as well.
        bytes_in: received since the last count; reset by the node.
        address_token: what the peer has given us to show that it has reached us; 0: nothing yet.
        config_mismatch: the peer assigns ids differently, by its latest configuration hash.
        definitions: what ids mean to the peer, as it has said of `known_hash`.
        known_hash: the configuration hash of those; 0: it has not said.
        duplicate: two processes run as this robot: a boot id has come back.
        duplicated: the peer has met two processes that run as our robot.
        restarted: its process is a new one; the node resets it.
        rtt_s: the lowest round trip of the last pull; None: not known.
        rate_bytes_s: of the last pull that moved enough; None: not known.
        udp_misses: pulls in a row on which datagrams brought nothing.
        cut: by topic key, how often a message of the topic was cut, one time after the other.
        announced: ids of messages that the peer announced and that we lack.
        left: ids of messages that another peer is to send instead, until they arrive.
        route: the connection of the peer over which we pull; `DIALLED`: the one that we opened.
        shared: the peer pulls over the connection that we opened.
    """

    def __init__(  # noqa: PLR0913 - all that makes peers differ, once
        self,
        name: str,
        node: NodeContext,
        *,
        verify: Verify | None = None,
        original: bool = False,
        datagrams: bool = True,
        budget_bytes: int = 0,
        pushed: AbstractSet[int] = frozenset(),
    ) -> None:
        self.name = name
        self.node = node
        self.original = original
        self.datagrams = datagrams
        self.budget_bytes = budget_bytes
        self.pushed = pushed
        self.events: list[LinkEvent] = []
        self.refusals: list[str] = []
        self.bytes_in = 0
        self.address_token = 0
        self.config_mismatch = False
        self.definitions: Mapping[int, int] = {}
        self.known_hash = 0
        self.duplicate = False
        self.duplicated = False
        self.restarted = False
        self.rtt_s: float | None = None
        self.rate_bytes_s: float | None = None
        self.udp_misses = 0
        self.cut: dict[int, int] = {}
        self.announced: set[int] = set()
        self.left: set[int] = set()
        self.route: Route = DIALLED
        self.shared = False
        self._verify = verify
        self._histories = node.team.histories  # versions that are kept, by topic key
        self._address_tokens: deque[int] = deque(maxlen=_TOKENS)  # given to it, the newest last
        self._boot_id: int | None = None  # of its process; another one: it has forgotten
        self._past_boot_ids: deque[int] = deque(maxlen=_BOOT_IDS)
        self._in_a_row = 0  # openings of its present process
        self._agreed: frozenset[int] | None = None  # topic keys that are exchanged; None: all
        self._held: dict[int, tuple[int, ...]] = {}  # by topic key: stamps, newest first
        self._begun: dict[int, Record] = {}  # given in part, by message id
        self._begun_bytes = 0  # of their bodies

    # --- what goes out

    def send(self, frame: bytes) -> None:
        """Have a request sent on the connection over which we pull."""
        if self.route == DIALLED:
            self.node.actions.append(Send(self.name, frame))
        else:
            self.node.actions.append(Reply(self.name, self.route, frame))

    def take_in(self, known: tuple[Robot, Topic], record: Record, trailer: Trailer | None) -> bool:
        """Store an intact message that the peer handed us; whether it was new.

        Raises:
            PayloadError: it is of another type than ours, or the peer may not hand it on.
        """
        robot, topic = known
        body, header, now_s = record.body, record.header, record.received_s
        check_type(body, topic)
        if self._verify:
            self._verify(header, body, trailer)
        if not self.node.database.insert(record, now_s):
            return False
        self.events.append(
            MessageStored(self.name, now_s, robot.name, topic.name, header, len(body))
        )
        return True

    # --- events of its syncs

    def report_start(self, direction: Direction, now: Instant) -> None:
        """A sync begins."""
        self.events.append(SyncStarted(self.name, now.unix_s, direction))

    def report_end(  # noqa: PLR0913 - the fields of the event
        self,
        direction: Direction,
        now: Instant,
        *,
        began_s: float,
        messages: int,
        size: int,
        complete: bool = True,
    ) -> None:
        """A sync that began at that steady time has come to its end with so many bytes."""
        taken_s = now.steady_s - began_s
        self.events.append(
            SyncEnded(self.name, now.unix_s, direction, messages, size, taken_s, complete)
        )

    def report_timeout(self, direction: Direction, reason: str, now: Instant) -> None:
        """A sync has broken off, or was turned away."""
        self.events.append(SyncTimedOut(self.name, now.unix_s, direction, reason))

    # --- the way to it

    @property
    def is_near(self) -> bool:
        """Whether round trips are so short that connections serve best."""
        return self.rtt_s is not None and self.rtt_s < NEAR_S

    def may_use_datagrams(self) -> bool:
        """Whether to try datagrams; call it once per pull."""
        if self.udp_misses < MAX_MISSES:
            return True
        self.udp_misses += 1
        return self.udp_misses % RETRY_EVERY == 0

    @property
    def next_token(self) -> int:
        """For the peer, which shows it when it begins by datagrams: those get back to it."""
        if not self._address_tokens:
            self.renew_token()
        return self._address_tokens[-1]

    def renew_token(self) -> None:
        """Issue a new token next time, so that a replayed opening is valid for a while only."""
        self._address_tokens.append(secrets.randbits(64) or 1)

    def verify_token(self, address_token: int) -> bool:
        """Whether we issued this token to the peer recently."""
        return address_token in self._address_tokens

    def agrees(self, config_hash: int) -> bool:
        """Compare the peer's configuration hash with ours; whether it is clear what to exchange."""
        self.config_mismatch = config_hash != self.node.config_hash
        if not self.config_mismatch:
            self._agreed = None
        elif config_hash == self.known_hash:
            ours = self.node.definitions.items()
            self._agreed = frozenset(k for k, each in ours if self.definitions.get(k) == each)
        else:
            self._agreed = frozenset()
            return False
        return True

    def exchanges(self, topic_key: int) -> bool:
        """Whether the messages of a topic are exchanged: it is the same to both nodes."""
        return self._agreed is None or topic_key in self._agreed

    # --- what it holds

    def met(self, boot_id: int) -> None:
        """The peer reported its boot id; a new one clears what it held."""
        if boot_id == self._boot_id:
            self._in_a_row += 1
            self.duplicate = self.duplicate and self._in_a_row < _ALONE
            return
        self._in_a_row = 1
        self._held.clear()
        self.restarted = self._boot_id is not None
        if boot_id != TRIAL_BOOT_ID:
            self.duplicate = self.duplicate or boot_id in self._past_boot_ids
            if self._boot_id not in (None, TRIAL_BOOT_ID):
                self._past_boot_ids.append(self._boot_id)
        self._boot_id = boot_id

    def forget(self) -> None:
        """Clear the holdings of the peer before it reports all of them."""
        self._held.clear()

    def holds(self, *message_ids: int) -> None:
        """The peer holds these messages."""
        listed: dict[int, set[int]] = {}
        for message_id in message_ids:
            listed.setdefault(message_id >> 48, set()).add(message_id & wire.STAMP_MASK)
        for key, stamps in listed.items():
            stamps.update(self._held.get(key, ()))
            newest = sorted(stamps, reverse=True)[: self._histories.get(key, 1)]
            self._held[key] = tuple(newest)

    @property
    def newest(self) -> dict[int, int]:
        """What it is known to hold: by topic key, the newest stamp in milliseconds."""
        return {key: stamps[0] for key, stamps in self._held.items()}

    def lacks(self, record: Record, message_id: int) -> bool:
        """Whether the peer may want a message, as far as is known."""
        key, stamp_ms = message_id >> 48, record.stamp_ms
        if not self.exchanges(key):
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
        while self._begun_bytes > _BEGUN_BYTES and len(self._begun) > 1:
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


def check_type(body: Frame, topic: Topic) -> None:
    """Raise PayloadError unless a sound body is of the type of the topic in our team file."""
    if body[0] != topic.dtype:
        raise PayloadError(
            f"type id {body[0]}, but {topic.name} is {topic.type} ({topic.dtype}) here; "
            "use the same team file everywhere"
        )


class _Mark(NamedTuple):
    """How much had been received at a time."""

    at_s: float
    received: int


class Credit:
    """The pulling node's account of one connection.

    Args:
        rate_bytes_s, rtt_s: what the last contact showed, if there was one.
        max_chunk: the largest frame that the connection takes.
    """

    def __init__(
        self, rate_bytes_s: float | None, rtt_s: float | None, max_chunk: int = MAX_CHUNK
    ) -> None:
        self.received = 0  # bytes so far
        self._max_chunk = max_chunk
        self._rtt_s = rtt_s
        self._window = FIRST_WINDOW  # bytes that may be under way
        self._allowed = FIRST_WINDOW  # of all bytes ever, as granted last
        if rate_bytes_s and rtt_s:
            self._adapt(rate_bytes_s)
            self._window = min(self._window, KNOWN_WINDOW)
            self._allowed = self._window
        self._marks: tuple[_Mark, _Mark] | None = None  # the rate counts from the first one
        self._granted_at = 0  # `received` at the last grant

    @property
    def grant(self) -> bytes:
        """What the peer may send, as it stands on the wire."""
        chunk = min(max(self._window // _CHUNKS, MIN_CHUNK), self._max_chunk)
        return GRANT.pack(self._allowed, chunk)

    def take(self, size: int, now_s: float, rtt_s: float | None) -> bool:
        """Account for received bytes; whether to send the new grant."""
        self.received += size
        if rtt_s:  # the least one: what queues add to it must not lengthen them
            self._rtt_s = min(rtt_s, self._rtt_s or rtt_s)
        here = _Mark(now_s, self.received)
        earlier, later = self._marks = self._marks or (here, here)
        if self.received - self._granted_at < self._window // _GRANTS:
            return False
        self._granted_at = self.received
        passed_s = now_s - earlier.at_s
        if passed_s > 0 and self._rtt_s:
            self._adapt((self.received - earlier.received) / passed_s)
            if now_s - later.at_s > max(_MEMORY_S, 4 * self._rtt_s):
                self._marks = later, here
        self._allowed = max(self._allowed, self.received + self._window)
        return True

    def _adapt(self, rate_bytes_s: float) -> None:
        window = rate_bytes_s * ((self._rtt_s or 0) + _QUEUE_S) * _GROWTH
        self._window = int(min(max(window, MIN_WINDOW), MAX_WINDOW))
