"""One pull from one peer, whatever node it runs and whatever path is open. No sockets here.

On a fresh connection it says three things at once: SYNC1 (a new node goes on from there), GHEAD
with the same id right behind it (an original node, which refuses SYNC1, goes on from there), and
the same opening in a datagram, which arrives before any connection stands. On a connection that the
pull before has left standing it says SYNC1 alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from mocha_link.clock import Instant
from mocha_link.datagram.datagram import Flow
from mocha_link.links.link_events import Direction, SyncEnded, SyncTimedOut
from mocha_link.links.metrics import throughput_bytes_s
from mocha_link.store.database import Database
from mocha_link.store.reassembly_buffer import ReassemblyBuffer
from mocha_link.sync.client import ClientSession
from mocha_link.sync.credit import Credit
from mocha_link.sync.frames import Frame, Step
from mocha_link.sync.peer_state import PeerState
from mocha_link.sync.protocol import ID_BYTES, SERRM, SYNC1, SYNCC, SYNCF, request
from mocha_link.sync.sync_receiver import SyncReceiver, Verify
from mocha_link.team.team import Team

Path = Literal["original", "zmq", "udp"]

NEAR_S = 0.02  # round trips below this: a connection is set up in no time and carries more
LOOK_S = 0.025  # a connection that stands within this time tells that an unknown peer is near
PATIENCE_S = 0.1  # without an answer on the connection to a near peer, datagrams may get through
MESSAGE_ROOM = 1100  # our frames fit in a datagram, whichever path they take
MAX_MISSES = 2  # pulls on which datagrams carried nothing although the peer took them
IDLE = 2  # times the time-out: so long datagrams may come that carry nothing
RETRY_EVERY = 8  # then they are tried again only so often
STANDS_S = 3.0  # without a byte for longer, a connection that stood is taken for gone


@dataclass(slots=True)
class PathStats:
    """What earlier pulls have shown of the way to a peer."""

    rtt_s: float | None = None  # the lowest of the last pull
    rate_bytes_s: float | None = None  # of the last pull that moved enough
    udp_misses: int = 0  # pulls in a row without a datagram
    cut: dict[int, int] = field(default_factory=dict)  # see `client.PathHistory`

    @property
    def is_near(self) -> bool:
        """Whether round trips are so short that connections serve best."""
        return self.rtt_s is not None and self.rtt_s < NEAR_S

    def may_use_datagrams(self) -> bool:
        """Whether to try datagrams; asked once per pull."""
        if self.udp_misses < MAX_MISSES:
            return True
        self.udp_misses += 1
        return self.udp_misses % RETRY_EVERY == 0


@dataclass(frozen=True, slots=True, kw_only=True)
class PullContext:
    """What the pulls of a node share."""

    own: str
    team: Team
    database: Database
    reassembly: ReassemblyBuffer
    new_id: Callable[[], bytes]
    timeout_s: float
    follow: bool = True


class Pull:
    """Brings over everything that is new at a peer; make one per pull, it is `over` at its end.

    It is `broken` as well if it broke off. One that `follows` goes on taking in what the peer
    stores after its end.

    Args:
        original: the peer is known to run the original node: do not try anything newer.
        datagrams: there is a socket for them.
        standing: the connection of the pull before stands, and the peer is a new node.
        budget: bytes that may come in; 0: no limit.
    """

    def __init__(  # noqa: PLR0913 - all it needs to know, once
        self,
        peer: str,
        pull_context: PullContext,
        path_stats: PathStats,
        peer_state: PeerState,
        *,
        verify: Verify | None,
        original: bool,
        datagrams: bool,
        standing: bool = False,
        budget: int,
    ) -> None:
        self.peer = peer
        self.id = b""  # names it in every frame
        self.over = False
        self.broken = False
        self.standing = standing  # on a connection of which is not known yet whether it still does
        # None until it is known
        self.path: Path | None = "original" if original else "zmq" if standing else None
        self.alive_s = 0.0  # when the peer was heard, steady clock
        self.flow: Flow | None = None  # of datagrams, once one leaves
        self._path_stats = path_stats
        self._peer_state = peer_state
        self._timeout_s = pull_context.timeout_s  # without a byte
        self._session = ClientSession(
            peer,
            pull_context.own,
            team=pull_context.team,
            database=pull_context.database,
            new_id=pull_context.new_id,
            timeout_s=pull_context.timeout_s,
            path_stats=path_stats,
            verify=verify,
            budget=budget,
        )
        self._receiver = SyncReceiver(
            peer,
            team=pull_context.team,
            database=pull_context.database,
            reassembly=pull_context.reassembly,
            peer_state=peer_state,
            verify=verify,
            budget=budget,
            room=MESSAGE_ROOM,
            follow=pull_context.follow,
        )
        may = datagrams and not original and not standing
        self._datagrams = may and path_stats.may_use_datagrams()
        self._credit = Credit(path_stats.rate_bytes_s, path_stats.rtt_s)
        self._outbox: deque[bytes] = deque()  # frames for datagrams
        self._datagrams_at_s: float | None = None  # when the first leaves
        self._refused = False  # by SERRM: an original node
        self._began_s = self._first_s = self._last_s = 0.0  # first and last data, steady clock

    def start(self, now: Instant) -> Step:
        """Begin; the frames are for a fresh connection, or for the one that stands."""
        self._began_s = self.alive_s = now.steady_s
        step = self._session.start(now)
        if self.path == "original":
            return step
        self.id = step.frames[0][:ID_BYTES]
        if self.standing:
            step.frames.clear()
        acquainted = self._peer_state.address_token != 0
        opening = self._receiver.open(now).frames
        first = request(self.id, SYNC1, self._credit.grant + opening[0])
        rest = [request(self.id, SYNCF, frame) for frame in opening[1:]]
        step.frames[:0] = [first, *rest]
        if self._datagrams:
            self._outbox.extend(opening)
            size = sum(map(len, opening))
            if not acquainted and size < MESSAGE_ROOM:
                # The peer sends little more than it got before it knows that it is us.
                self._outbox.append(bytes(MESSAGE_ROOM - size))
            known = self._path_stats.rtt_s is not None
            wait_s = PATIENCE_S if self._path_stats.is_near else 0.0 if known else LOOK_S
            self._datagrams_at_s = now.steady_s + wait_s
            step.packets += self._due_datagrams(now)
        return step

    def reply(self, parts: Sequence[Frame], now: Instant) -> Step:
        """Take in the body parts of a reply on the connection.

        A good one has one part; only frames of a sync may have more.
        """
        frame: Frame = parts[0] if parts else b""
        if self.path == "original":
            return self._reply_of_original(parts, now)
        if frame[:ID_BYTES] != self.id:
            return self._refuse("a reply to nothing that was asked", now)
        if frame[ID_BYTES:] == SERRM and len(parts) == 1:
            return self._reply_of_refusal(now)
        if self._refused:
            self.path = "original"
            return self._reply_of_original(parts, now)
        first, self.path = self.path is None, "zmq"
        step = self._take(memoryview(frame)[ID_BYTES:], now, parts[1:])
        if first and step.refusals:
            broken = self.fail("what answers there is not a node", now)
            return Step(events=broken.events, refusals=step.refusals)
        step.frames = [request(self.id, SYNCF, each) for each in step.frames]
        size = sum(map(len, parts))
        if self._credit.take(size, now.steady_s, self._path_stats.rtt_s) and self.goes_on:
            step.frames.append(request(self.id, SYNCC, self._credit.grant))
        return step

    def packet(self, packet: bytes, now: Instant) -> Step:
        """Take in a datagram of the peer."""
        step = Step()
        if self.flow is None:
            return step
        for frame in self.flow.receive(packet, now.steady_s):
            self.path = self.path or "udp"  # moved to the connection it stays there
            taken = self._take(frame, now)
            self._outbox.extend(taken.frames)
            step.events += taken.events
            step.refusals += taken.refusals
        if self.flow.alive_s == now.steady_s:
            self.progress(now, self.flow.rtt_s)
        step.packets += self._due_datagrams(now)
        return step

    def progress(self, now: Instant, rtt_s: float | None = None) -> None:
        """The connection stands, or bytes have arrived, though no whole reply yet."""
        self.alive_s = now.steady_s
        self.standing = False
        if rtt_s is not None:
            self._path_stats.rtt_s = rtt_s
        if self.path in ("original", None):
            self._session.progress(now)

    def measured(self, rtt_s: float) -> None:
        """The round trip of the connection, as far as it is known by now."""
        if self.path == "udp":
            return
        self._path_stats.rtt_s = rtt_s
        if self._path_stats.is_near and self._datagrams_at_s is not None:
            self._datagrams_at_s = max(self._datagrams_at_s, self._began_s + PATIENCE_S)

    def on_contact(self, now: Instant) -> Step:
        """A new contact begins while the pull is under way."""
        if self.flow:
            self.flow.on_contact(now.steady_s)
        return Step(packets=self._due_datagrams(now))

    def tick(self, now: Instant) -> Step:
        """What the time alone brings: datagrams that are due, and the end of patience."""
        if self.over:
            return Step(packets=self._due_datagrams(now))
        if now.steady_s - self.alive_s > self._timeout_s:
            midway = self.path not in ("original", None)
            silent = f"no byte for {self._timeout_s:g} s in the middle of a sync"
            return self.fail(silent if midway else self._session.why_silent(), now)
        since_s = max(self._last_s, self._began_s)
        if self._relies_on_datagrams and now.steady_s - since_s > IDLE * self._timeout_s:
            self._path_stats.udp_misses += 1
            return self.fail("only small datagrams of the peer get here", now)
        return Step(packets=self._due_datagrams(now))

    def fail(self, reason: str, now: Instant) -> Step:
        """Break off for a reason that is known outside, e.g. a closed connection."""
        if self.over:
            return Step()
        self.over = self.broken = True
        self._learn()
        if self.path in ("original", None):
            return self._session.fail(reason, now)
        return Step(events=[SyncTimedOut(self.peer, now.unix_s, Direction.IN, reason)])

    def disconnected(self, reason: str, now: Instant) -> Step:
        """The connection broke; that does not matter while datagrams get through."""
        if self.path == "udp":
            return Step()
        if self.path is None and self.flow is not None and self.flow.alive_s is not None:
            return Step()
        return self.fail(reason, now)

    @property
    def follows(self) -> bool:
        """Whether it is over, and what the peer stores later comes in all the same."""
        return self._receiver.follows and not self.broken

    @property
    def goes_on(self) -> bool:
        """Whether frames of the peer are expected."""
        return not self.over or self.follows

    def is_in_vain(self, now: Instant) -> bool:
        """Whether the connection that stood has brought nothing for too long: try a fresh one."""
        patience_s = STANDS_S + 2 * (self._path_stats.rtt_s or 0.0)
        return self.standing and now.steady_s - self._began_s > patience_s

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` at the latest."""
        if self._datagrams_at_s is not None:
            return self._datagrams_at_s
        return self.flow.wake_s if self.flow else None

    @property
    def bytes_in(self) -> int:
        """Bytes that came in so far."""
        return self._session.bytes_in + self._receiver.bytes

    @property
    def rtt_s(self) -> float | None:
        """The round trip on the way to the peer."""
        return self._session.rtt_s or self._path_stats.rtt_s

    @property
    def bandwidth_bytes_s(self) -> float | None:
        """Bytes per second while messages came in; None without any message."""
        if self.path in ("original", None):
            return self._session.bandwidth_bytes_s
        taken_s = self._last_s - self._first_s
        return self._receiver.bytes / taken_s if self._receiver.messages and taken_s > 0 else None

    @property
    def throughput_bytes_s(self) -> float | None:
        """What it moved per second, if it was enough to say something of the link."""
        rate = self.bandwidth_bytes_s
        return throughput_bytes_s(self.bytes_in, self.bytes_in / rate, self.rtt_s) if rate else None

    @property
    def _relies_on_datagrams(self) -> bool:
        """Whether nothing has come on the connection that says what the peer is."""
        return self.flow is not None and self.path in (None, "udp") and not self._refused

    def _reply_of_refusal(self, now: Instant) -> Step:
        if self.path is not None:
            return self.fail("the peer does not know of the sync any more", now)
        if self._peer_state.config_mismatch:  # a node of ours, last time: no other one now
            self._peer_state.config_mismatch = False
            return self.fail(f"{self.peer} had another team file; asking once more", now)
        self._refused = True  # an original node; its reply to GHEAD comes next
        self.flow = self._datagrams_at_s = None
        self.progress(now)
        return Step()

    def _reply_of_original(self, parts: Sequence[Frame], now: Instant) -> Step:
        step = self._session.reply(parts, now)
        self.alive_s = self._session.alive_s
        self.over, self.broken = self._session.over, self._session.broken
        return step

    def _refuse(self, why: str, now: Instant) -> Step:
        """The connection is ours alone: what says such things is no node."""
        broken = self.fail("the peer answered what was not asked", now)
        return Step(events=broken.events, refusals=[why])

    def _due_datagrams(self, now: Instant) -> list[bytes]:
        """The datagrams to send now."""
        if self._datagrams_at_s is not None and self._datagrams_at_s <= now.steady_s:
            self._datagrams_at_s = None
            if self.path is None and not self._refused:
                self.flow = Flow(self.id, self._next_frame, rtt_s=self._path_stats.rtt_s)
        return self.flow.transmit(now.steady_s) if self.flow else []

    def _next_frame(self, _room: int) -> bytes | None:
        return self._outbox.popleft() if self._outbox else None

    def _take(self, frame: Frame, now: Instant, more: Sequence[Frame] = ()) -> Step:
        self.progress(now)
        self._first_s = self._first_s or now.steady_s
        self._last_s = now.steady_s
        step = self._receiver.receive(frame, now, more)
        if self._receiver.rejection:
            step.events += self.fail(self._receiver.rejection, now).events
        elif self._receiver.over and not self.over:
            self.over = True
            self._learn()
            step.events.append(
                SyncEnded(
                    self.peer,
                    now.unix_s,
                    Direction.IN,
                    messages=self._receiver.messages,
                    bytes=self._receiver.bytes,
                    duration_s=now.steady_s - self._began_s,
                    complete=self._receiver.complete,
                )
            )
        return step

    def _learn(self) -> None:
        """What nothing came of says nothing of datagrams: the contact may have been too short."""
        if self.path == "zmq":
            self._path_stats.rate_bytes_s = self.bandwidth_bytes_s or self._path_stats.rate_bytes_s
        elif self.path == "udp" and (self._receiver.messages or self._receiver.complete):
            self._path_stats.udp_misses = 0
