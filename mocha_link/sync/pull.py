"""One pull from one peer, by either protocol and over either path. No sockets here.

On a new connection it sends three requests at once: SYNC1 for a new node, GHEAD with the same id
for an original node, which refuses SYNC1, and the opening of SYNC1 in a datagram, which arrives
before a connection is established. On the previous pull's connection it sends SYNC1 alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Literal

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.links import Direction, throughput_bytes_s
from mocha_link.sync.credit import MAX_CHUNK, SHARED_CHUNK, Credit
from mocha_link.sync.original import ClientSession
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import (
    ID_BYTES,
    SERRM,
    SYNC1,
    SYNCC,
    SYNCF,
    Frame,
    SendDatagram,
)
from mocha_link.sync.pull_states import OVER, PullEvent, PullState, next_state
from mocha_link.sync.sync_receiver import SyncReceiver

NEAR_CONNECT_S = 0.025  # a new peer whose connection is established within this time is near
NEAR_REPLY_S = 0.1  # for a near peer's reply on the connection, before datagrams are tried
MESSAGE_ROOM = 1100  # every frame of ours fits in a datagram, on either path
Path = Literal["original", "zmq", "udp"]
IDLE = 2  # times the time-out: how long datagrams without content keep a pull alive
UNANSWERED_S = 1.0  # after this time without an answer a connection of the peer is tried
STANDS_S = 3.0  # a reused connection without a byte for longer counts as lost


class PullDatagrams:
    """Opens a flow for a pull after a delay, unless the connection has replied by then.

    Attributes:
        flow: the flow, once a datagram is sent.
        due_s: when to send the first datagram, steady seconds; None: none is scheduled.
        bytes_in: bytes of the frames received by datagrams.
    """

    def __init__(self, peer: Peer) -> None:
        self.flow: Flow | None = None
        self.due_s: float | None = None
        self.bytes_in = 0
        self._peer = peer
        self._outbox: deque[bytes] = deque()  # frames to send

    def begin(self, opening: list[bytes], now: Instant, *, acquainted: bool) -> None:
        """Schedule the frames of the opening.

        `acquainted`: the opening proves our address to the peer.
        """
        path = self._peer.path
        self._outbox.extend(opening)
        size = sum(map(len, opening))
        if not acquainted and size < MESSAGE_ROOM:
            # Before our address is proven the peer may send only a multiple of what it received.
            self._outbox.append(bytes(MESSAGE_ROOM - size))
        known = path.rtt_s is not None
        wait_s = NEAR_REPLY_S if path.is_near else 0.0 if known else NEAR_CONNECT_S
        self.due_s = now.steady_s + wait_s

    def put_off(self, until_s: float) -> None:
        """Send the first datagram no earlier than `until_s`, if it is not sent yet."""
        if self.due_s is not None:
            self.due_s = max(self.due_s, until_s)

    def drop(self) -> None:
        """Send no more datagrams: the peer does not support them."""
        self.flow = self.due_s = None

    def is_due(self, now: Instant) -> bool:
        """Whether to send the first datagram now; True only once."""
        due = self.due_s is not None and self.due_s <= now.steady_s
        if due:
            self.due_s = None
        return due

    def open(self, token: bytes) -> None:
        """Open the flow; the next `transmit` sends its first datagram."""
        self.flow = Flow(token, self._next_frame, rtt_s=self._peer.path.rtt_s)

    def reply(self, size: int, frames: Iterable[bytes]) -> None:
        """Count a frame that was received by a datagram, and queue the replies."""
        self.bytes_in += size
        self._outbox.extend(frames)

    def transmit(self, now: Instant) -> None:
        """Send the datagrams that are due."""
        if self.flow:
            for packet in self.flow.transmit(now.steady_s):
                self._peer.node.actions.append(SendDatagram(self._peer.name, packet))

    @property
    def answered(self) -> bool:
        """Whether the peer has sent a datagram."""
        return self.flow is not None and self.flow.alive_s is not None

    @property
    def wake_s(self) -> float | None:
        """When the next datagram is due, in steady seconds; None: none is."""
        flow_s = self.flow.wake_s if self.flow else None
        return min((each for each in (self.due_s, flow_s) if each is not None), default=None)

    def _next_frame(self, _room: int) -> bytes | None:
        return self._outbox.popleft() if self._outbox else None


class Pull:
    """Receives the new messages of a peer; make one per pull.

    Args:
        standing: it reuses the connection of the previous pull, and the peer is a new node.
        budget: bytes that may be received; 0: no limit.

    Attributes:
        id: identifies it in every frame of a sync; empty if only the original protocol is tried.
        state: its state; see `STATES`.
        path: the path of the messages; None until it is known.
        began_s: when it began, steady seconds.
        alive_s: when the last bytes were received, steady seconds.
        datagrams: the datagrams of the pull.
    """

    def __init__(self, peer: Peer, *, standing: bool = False, budget: int = 0) -> None:
        self.id = b""
        self.state = PullState.STANDING if standing else PullState.OPENING
        if peer.original:
            self.state = PullState.ORIGINAL
        self.path: Path | None = "original" if peer.original else "zmq" if standing else None
        self.alive_s = 0.0
        self.datagrams = PullDatagrams(peer)
        self._peer = peer
        self._session = ClientSession(peer, budget)
        self._receiver = SyncReceiver(peer, room=MESSAGE_ROOM, budget=budget)
        may = peer.datagrams and not peer.original and not standing
        self._casts = may and peer.path.may_use_datagrams()  # also begins by datagrams
        chunk = MAX_CHUNK if peer.connection.is_ours else SHARED_CHUNK
        self._credit = Credit(peer.path.rate_bytes_s, peer.path.rtt_s, chunk)
        self._hushed = False  # a later pull has begun on the same connection
        self.began_s = self._first_s = self._last_s = 0.0  # first and last data, steady clock

    def start(self, now: Instant, *, again: bool = False) -> None:
        """Begin on a new or reused connection; `again`: without a start event."""
        self.began_s = self.alive_s = now.steady_s
        if not again:
            self._peer.log.started(Direction.IN, now)
        headers_request = self._session.start(now)
        if self.path == "original":
            self._peer.connection.send(headers_request)
            return
        self.id = headers_request[:ID_BYTES]
        acquainted = self._peer.tokens.received != 0
        opening = self._receiver.open(now)
        self._peer.connection.send(self.id + SYNC1 + self._credit.grant + opening[0])
        self._send_frames(opening[1:])
        if self.state is PullState.OPENING:
            self._peer.connection.send(headers_request)
        if self._casts:
            self.datagrams.begin(opening, now, acquainted=acquainted)
            self.transmit(now)

    def reply(self, parts: Sequence[Frame], now: Instant) -> None:
        """Process the body parts of a reply on the connection.

        A valid reply has one part; only frames of a sync may have more.
        """
        frame: Frame = parts[0] if parts else b""
        if self.path == "original":
            self._reply_of_original(parts, now)
        elif frame[:ID_BYTES] != self.id:
            self._peer.log.refuse("a reply without a request")
            self.fail("the peer answered without a request", now)  # only we use the connection
        elif frame[ID_BYTES:] == SERRM and len(parts) == 1:
            self._reply_of_refusal(now)
        elif self.state is PullState.REFUSED:
            self.path = "original"
            self._happens(PullEvent.LIST)
            self._reply_of_original(parts, now)
        else:
            first, self.path = self.path is None, "zmq"
            refusals = len(self._peer.log.refusals)
            frames = self._take(memoryview(frame)[ID_BYTES:], now, parts[1:])
            if first and len(self._peer.log.refusals) > refusals:
                self.fail("what answers there is not a node", now)
                return
            if self._hushed:
                return
            if frames:
                self._send_frames(frames)
            size = sum(map(len, parts))
            if self._credit.take(size, now.steady_s, self._peer.path.rtt_s) and self.goes_on:
                self._peer.connection.send(self.id + SYNCC + self._credit.grant)

    def hush(self) -> None:
        """Send nothing more on the connection: the next pull has begun on it."""
        self._hushed = True

    def packet(self, packet: bytes, now: Instant) -> None:
        """Process a datagram of the peer."""
        flow = self.flow
        if flow is None:
            return
        for frame in flow.receive(packet, now.steady_s):
            self.path = self.path or "udp"  # once on the connection, it stays there
            self.datagrams.reply(len(frame), self._take(frame, now))
        if flow.alive_s == now.steady_s:
            self.progress(now)
            if flow.rtt_s:
                self._peer.path.measured(flow.rtt_s)
        self.transmit(now)

    def progress(self, now: Instant) -> None:
        """Note that the connection was established, or part of a reply was received."""
        self.alive_s = now.steady_s
        self._happens(PullEvent.BYTES)
        if self.path in ("original", None):
            self._session.progress(now)

    def measured(self, rtt_s: float) -> None:
        """Note the round trip of the connection."""
        if self.path == "udp":
            return
        self._peer.path.measured(rtt_s)
        if self._peer.path.is_near:
            self.datagrams.put_off(self.began_s + NEAR_REPLY_S)

    def tick(self, now: Instant) -> None:
        """Run the timers: datagrams that are due, and time-outs."""
        timeout_s = self._peer.node.timeout_s
        received_s = max(self._last_s, self.began_s)
        if self.over:
            self.transmit(now)
        elif now.steady_s - self.alive_s > timeout_s:
            midway = self.path not in ("original", None)
            silent = f"no byte for {timeout_s:g} s in the middle of a sync"
            self.fail(silent if midway else self._session.why_silent(), now)
        elif self._relies_on_datagrams and now.steady_s - received_s > IDLE * timeout_s:
            self._peer.path.datagrams_missed()
            self.fail("only small datagrams of the peer get here", now)
        else:
            self.transmit(now)

    def transmit(self, now: Instant) -> None:
        """Send the datagrams that are due."""
        if self.datagrams.is_due(now) and self.state is PullState.OPENING:
            self.datagrams.open(self.id)
        self.datagrams.transmit(now)

    def fail(self, reason: str, now: Instant) -> None:
        """Abort for a given reason, e.g. a closed connection."""
        if not self.over:
            self.abandon()
            self._peer.log.timed_out(Direction.IN, reason, now)

    def abandon(self) -> None:
        """Abort without an event."""
        self._happens(PullEvent.FAILURE)
        self._learn()
        if self.path in ("original", None):
            self._session.break_off()

    def disconnected(self, reason: str, now: Instant) -> None:
        """Note that the connection was lost; the pull continues while datagrams are received."""
        if self.path != "udp" and not (self.path is None and self.datagrams.answered):
            self.fail(reason, now)

    @property
    def flow(self) -> Flow | None:
        """The flow of its datagrams, once one is sent."""
        return self.datagrams.flow

    def _happens(self, event: PullEvent) -> None:
        self.state = next_state(self.state, event)

    @property
    def over(self) -> bool:
        """Whether it has ended or was aborted; if it `follows`, pushed messages are received."""
        return self.state in OVER

    @property
    def broken(self) -> bool:
        """Whether it was aborted."""
        return self.state is PullState.BROKEN

    @property
    def standing(self) -> bool:
        """Whether it waits for the first byte on a reused connection, which may be lost."""
        return self.state is PullState.STANDING

    @property
    def follows(self) -> bool:
        """Whether it has ended, and messages that the peer pushes are received."""
        return self.state is PullState.FOLLOWING

    @property
    def pull_needed(self) -> bool:
        """Whether the peer has stored messages since that it does not push."""
        return self._receiver.pull_needed

    @property
    def goes_on(self) -> bool:
        """Whether frames of the peer are expected."""
        return not self.over or self.follows

    def is_in_vain(self, now: Instant) -> bool:
        """Whether a reused connection has received nothing for too long: try a new one."""
        return self.standing and now.steady_s > self._vain_s

    def is_unanswered(self, now: Instant) -> bool:
        """Whether nothing was received from the peer in the time for an answer."""
        silent = self.path is None and not self.datagrams.answered
        return silent and now.steady_s - self.began_s > UNANSWERED_S + 2 * (self.rtt_s or 0.0)

    @property
    def _vain_s(self) -> float:
        """When `is_in_vain` becomes true."""
        return self.began_s + STANDS_S + 2 * (self._peer.path.rtt_s or 0.0)

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` at the latest; None: no timer runs."""
        datagrams_s = self.datagrams.wake_s
        times = [] if datagrams_s is None else [datagrams_s]
        if not self.over:
            timeout_s = self._peer.node.timeout_s
            times.append(self.alive_s + timeout_s)
            if self._relies_on_datagrams:
                times.append(max(self._last_s, self.began_s) + IDLE * timeout_s)
            if self.standing:
                times.append(self._vain_s)
        return min(times, default=None)

    @property
    def carrier(self) -> Path | None:
        """The path of most of the bytes."""
        if self.path in ("original", None):
            return self.path
        return "udp" if 2 * self.datagrams.bytes_in > self._receiver.bytes else "zmq"

    @property
    def rtt_s(self) -> float | None:
        """The round trip to the peer."""
        return self._session.rtt_s or self._peer.path.rtt_s

    @property
    def throughput_bytes_s(self) -> float | None:
        """Bytes per second, if the pull was large enough to measure the link."""
        rate, size = self._bandwidth_bytes_s, self._session.bytes_in + self._receiver.bytes
        return throughput_bytes_s(size, size / rate, self.rtt_s) if rate else None

    @property
    def _bandwidth_bytes_s(self) -> float | None:
        """Bytes per second while messages were received; None without any message."""
        if self.path in ("original", None):
            return self._session.bandwidth_bytes_s
        taken_s = self._last_s - self._first_s
        return self._receiver.bytes / taken_s if self._receiver.messages and taken_s > 0 else None

    @property
    def _relies_on_datagrams(self) -> bool:
        """Whether nothing but datagrams was received so far."""
        waits = self.state in (PullState.OPENING, PullState.SYNCING)
        return self.flow is not None and self.path in (None, "udp") and waits

    def _reply_of_refusal(self, now: Instant) -> None:
        if self.path is not None:
            self.fail("the peer does not know of the sync any more", now)
        elif self._peer.agreement.config_mismatch:  # it ran a new node last time: try once more
            self._peer.agreement.expect_match()
            self.fail(f"{self._peer.name} had another team file; requesting once more", now)
        else:
            self._happens(PullEvent.REFUSAL)  # an original node; its reply to GHEAD follows
            self.datagrams.drop()
            self.progress(now)

    def _reply_of_original(self, parts: Sequence[Frame], now: Instant) -> None:
        session = self._session
        for frame in session.reply(parts, now):
            self._peer.connection.send(frame)
        self.alive_s = session.alive_s
        if session.over and not self.over:
            failed = session.failure is not None
            self._happens(PullEvent.FAILURE if failed else PullEvent.END)
            if session.failure is not None:
                self._peer.log.timed_out(Direction.IN, session.failure, now)
                return
            self._peer.log.ended(
                Direction.IN,
                now,
                began_s=self.began_s,
                messages=session.messages,
                size=session.bytes_in,
                complete=not session.cut_short,
            )

    def _take(self, frame: Frame, now: Instant, more: Sequence[Frame] = ()) -> list[bytes]:
        """Process a frame of a sync; returns the replies."""
        self.alive_s = self._last_s = now.steady_s
        self._first_s = self._first_s or now.steady_s
        self._happens(PullEvent.FRAME)
        receiver = self._receiver
        frames = receiver.receive(frame, now, more)
        if receiver.rejection:
            self.fail(receiver.rejection, now)
        elif receiver.over and not self.over:
            self._happens(PullEvent.FOLLOW if receiver.follows else PullEvent.END)
            self._learn()
            self._peer.log.ended(
                Direction.IN,
                now,
                began_s=self.began_s,
                messages=receiver.messages,
                size=receiver.bytes,
                complete=receiver.complete,
            )
        return frames

    def _send_frames(self, frames: Sequence[bytes]) -> None:
        for frame in frames:
            self._peer.connection.send(self.id + SYNCF + frame)

    def _learn(self) -> None:
        """Note the rate, and whether datagrams delivered messages.

        A pull without a byte does not count against datagrams: the contact may have been too short.
        """
        if self.path == "zmq":
            self._peer.path.moved(self._bandwidth_bytes_s)
        elif self.path == "udp" and (self._receiver.messages or self._receiver.complete):
            self._peer.path.datagrams_carried()
