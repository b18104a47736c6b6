"""The answering side of one peer: its pulls, whatever node it runs and whatever path they take.

Nothing here touches sockets: requests and datagrams in, replies and frames out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet

from mocha_link.clock import Instant
from mocha_link.links import Direction
from mocha_link.sync.credit import GRANT
from mocha_link.sync.flows import Flows
from mocha_link.sync.frames import HELLO, message_frame
from mocha_link.sync.original import ServerSession
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import (
    CODE_BYTES,
    FOLLOW_S,
    GHEAD,
    ID_BYTES,
    LINGER_S,
    PATIENCE_S,
    SERRM,
    SYNC1,
    SYNCC,
    SYNCF,
    Frame,
    Route,
    Standing,
)
from mocha_link.sync.sync_messages import Hello, Reception
from mocha_link.sync.sync_sender import SyncSender

REMEMBERED = 16  # pulls that are over; what comes late of them begins no new one
REPLACED_S = 0.5  # a datagram does not replace a sync that received a frame within this time
LATE_ACK_S = 0.1  # so long an acknowledgement may be late
PADDING = b"\0"  # what a frame without meaning begins with

_HELLO_ROOM = 64


def _patience_s(sync: SyncSender) -> float:
    """How long the peer may send nothing."""
    return FOLLOW_S if sync.ended else PATIENCE_S


class Server:
    """Serves one peer, and reports the start and end of its pulls."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self._session = ServerSession(peer)
        self._sync: SyncSender | None = None  # under way, or followed
        self._flows = Flows(peer)  # of datagrams; the current one is of the newest sync
        self._past: deque[bytes] = deque(maxlen=REMEMBERED)  # ids of syncs that are over
        self._ended_s = 0.0  # of the last sync
        self._rejected: tuple[bytes, Reception] | None = None  # the last one that was turned away
        self._opened: deque[tuple[bytes, Route]] = deque(maxlen=REMEMBERED)  # ids and connections
        self._loses_much = False  # its connection does, by the kernel
        self._contact_s = 0.0  # when a radio last saw a contact begin, steady clock

    def handle(self, route: Route, parts: Sequence[bytes], now: Instant) -> bytes | None:
        """The reply to the body parts of a request; None: none, or not yet (see `supply`)."""
        frame = parts[0] if len(parts) == 1 else b""
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        if code in (SYNC1, SYNCF, SYNCC):
            return self._handle_sync(route, frame, now)
        if code == GHEAD and (request_id, route) in self._opened:
            return None  # the fallback for original nodes
        return self._session.handle(parts, now)

    def packet(self, packet: bytes, now: Instant) -> bool:
        """Process a datagram; whether its source is the peer's address, so it is no replay."""
        flow = self._flows.current
        token = packet[1 : 1 + ID_BYTES]
        if len(token) != ID_BYTES:
            return False
        if flow is None or flow.token != token:
            return self._packet_of_new(token, packet, now)
        refused, arrived = flow.refused, flow.arrived
        for frame in flow.receive(packet, now.steady_s):
            if self._sync and self._sync.id == flow.token:
                self._sync.take(frame)
                self._check_sync(now)
        if self._sync and flow.refused == refused:
            self._sync.received_s = now.steady_s
            self._use_datagrams(self._sync)
        return flow.arrived > arrived

    def transmit(self, now: Instant) -> list[bytes]:
        """The datagrams to send now."""
        flow = self._flows.current
        if flow is None:
            return []
        packets = flow.transmit(now.steady_s)
        if self._sync is None and flow.settled:
            self._flows.close()
        return packets

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` and `transmit` at the latest; None: the time brings nothing."""
        sync, flow = self._sync, self._flows.current
        times = [self._session.wake_s, flow.wake_s if flow else None]
        if sync:
            times += [sync.received_s + _patience_s(sync), self._unreachable_s(sync)]
        elif flow:
            times.append(self._ended_s + LINGER_S)
        return min((each for each in times if each is not None), default=None)

    def request_pull(self) -> None:
        """Have a peer that follows pull again."""
        if self._sync and self._sync.ended:
            self._sync.request_pull()

    @property
    def received_s(self) -> float:
        """When something of the peer's sync came last, steady seconds."""
        return self._sync.received_s if self._sync else 0.0

    @property
    def over(self) -> Route | None:
        """A connection of the peer over which it pulls, and we may pull as well."""
        sync = self._sync
        if sync is None or sync.received_s < self._contact_s:
            return None  # it may have gone with the contact before
        return sync.route or None  # not the one that we opened

    def wants_push(self, robot_ids: AbstractSet[int]) -> bool:
        """Whether new messages of these robots concern the peer."""
        return self._sync is not None and self._sync.wants_push(robot_ids)

    def route(self, standing: Callable[[Route], Standing | None]) -> Route | None:
        """The connection of the sync, if it has one that is `standing`.

        A closed connection does not reach the peer. One that followed there does not any more; one
        in the middle of a pull may go on by datagrams, or over another connection.
        """
        sync = self._sync
        if sync is None or sync.route is None:
            return None
        found = standing(sync.route)
        self._loses_much = found is not None and found.loses_much
        if found is None:
            sync.route = None
            if sync.follows and not sync.by_datagram:
                self._release(sync)
        elif self._loses_much:
            self._use_datagrams(sync)
        return sync.route

    def lost(self, route: Route) -> None:
        """A connection was lost, and the peer does not get there what it follows."""
        self.route(lambda each: None if each == route else Standing(loses_much=self._loses_much))

    def supply(self) -> tuple[Route, list[Frame]] | None:
        """The next frame for a connection, in parts, if the peer has credit left for one."""
        sync = self._sync
        if sync is None or sync.route is None or self._datagrams_carry(sync):
            return None
        parts = sync.supply()
        return (sync.route, parts) if parts else None

    def _datagrams_carry(self, sync: SyncSender) -> bool:
        """Whether they carry what there is: a first window, and more where TCP loses much.

        A peer that follows gets what is new over its connection, if that stands.
        """
        if not sync.by_datagram or self._flows.current is None:
            return False
        if (
            (sync.done and not (sync.ended and sync.route))
            or self._loses_much
            or not self._flows.window_used(admitted=sync.admitted, sent=sync.sent)
        ):
            return True
        sync.all_cast = False
        flow = self._flows.current
        sync.by_datagram = not (sync.admitted or flow.judged) and flow.rtt_s is not None
        return False

    def _use_datagrams(self, sync: SyncSender) -> None:
        """Have them carry what the connection began, where TCP loses much and they get there."""
        flow = self._flows.current
        if flow is None or flow.token != sync.id or sync.done:
            return
        if flow.rtt_s is not None and self._loses_much:
            sync.by_datagram = True

    def on_contact(self, now: Instant) -> None:
        """A new contact begins."""
        self._contact_s = now.steady_s
        if self._flows.current:
            self._flows.current.on_contact(now.steady_s)

    def tick(self, now: Instant) -> None:
        """Run the timers: the silence of a peer ends its pull."""
        self._session.tick(now)
        sync = self._sync
        if sync is None and self._flows.current and now.steady_s - self._ended_s > LINGER_S:
            self._flows.close()
        if sync is None:
            return
        unreachable_s = self._unreachable_s(sync)
        if self._flows.current and unreachable_s is not None and now.steady_s > unreachable_s:
            sync.leave_datagrams(self._flows.current.reclaim())
        if now.steady_s - sync.received_s > _patience_s(sync):
            self._break_off(sync, f"the peer said nothing for {PATIENCE_S:g} s", now)

    def _unreachable_s(self, sync: SyncSender) -> float | None:
        """When it is clear that our datagrams do not get back to the peer: the connection serves.

        Its request was more than a round trip behind the peer's datagrams, and an acknowledgement
        takes no longer.
        """
        flow = self._flows.current
        if sync.reclaimed or sync.route is None or flow is None or flow.rtt_s is not None:
            return None
        if not sync.by_datagram and flow.settled:
            return None
        return sync.routed_s + 2 * (sync.routed_s - sync.began_s) + LATE_ACK_S

    def _handle_sync(self, route: Route, frame: bytes, now: Instant) -> bytes | None:
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        argument = frame[ID_BYTES + CODE_BYTES :]
        sync = self._sync
        if sync is None or sync.id != request_id:
            if code != SYNC1:
                return request_id + SERRM
            self._opened.append((request_id, route))
            if request_id in self._past:
                return self._rejection(request_id)  # a connection that came too late
            sync = SyncSender(self.peer, request_id, now.steady_s)
            grant, argument = argument[: GRANT.size], argument[GRANT.size :]
            if not sync.open(argument):
                # An error reply would make us an original node to the peer, who reads by ids.
                self._rejected = (request_id, Reception.UNREADABLE)
                return self._rejection(request_id)
            sync.route = route
            sync.grant(grant)
            self._begin(sync, now)
            return self._rejection(request_id)
        if code == SYNC1 and sync.sent and sync.route != route and self._flows.current is None:
            # Its first connection broke, with all that was sent and granted on it.
            sync = self._sync = SyncSender(self.peer, request_id, sync.began_s)
        sync.received_s = now.steady_s
        if sync.route is None or code == SYNC1:
            sync.carry_on(route, now)
            self._opened.append((request_id, route))
        if code == SYNC1:
            sync.grant(argument[: GRANT.size])
            argument = argument[GRANT.size :]
        if code == SYNCC:
            sync.grant(argument)
        elif not sync.take(argument):
            return request_id + SERRM
        self._check_sync(now)
        return self._rejection(request_id)

    def _rejection(self, request_id: bytes) -> bytes | None:
        """The reply on the connection of a rejected sync."""
        if self._rejected is None or self._rejected[0] != request_id:
            return None
        hello = Hello(self._rejected[1], self.peer.node.config_hash)
        return request_id + message_frame(HELLO, 0, hello.encode(), 0, _HELLO_ROOM)

    def _packet_of_new(self, token: bytes, packet: bytes, now: Instant) -> bool:
        if token in self._past or self._flows.is_deaf(now):
            return False
        before = self._sync
        if before and before.id == token:
            return self._packet_for_connection(before, packet, now)
        if before and not before.ended and now.steady_s - before.received_s < REPLACED_S:
            return False  # a copy of an old opening must not end what goes well
        sync = SyncSender(self.peer, token, now.steady_s)
        flow = self._flows.make(sync)
        frames = [frame for frame in flow.receive(packet, now.steady_s) if frame[:1] != PADDING]
        if not frames or not all(sync.open(frame) for frame in frames):
            return False
        flow.proven = sync.admitted
        reached = before and (before.route or (self._flows.current and self._flows.current.proven))
        if reached and not flow.proven:
            return False  # nor ever what the peer gets; it may always begin anew by a connection
        sync.by_datagram = sync.all_cast = True
        self._begin(sync, now)
        self._flows.begin(flow, now)
        return True

    def _packet_for_connection(self, sync: SyncSender, packet: bytes, now: Instant) -> bool:
        """The connection was first, so it serves until a probe has come back as a datagram."""
        flow = self._flows.make(sync)
        flow.receive(packet, now.steady_s)
        if sync.done or flow.refused:
            return False
        flow.proven = sync.admitted
        flow.on_contact(now.steady_s)
        self._flows.begin(flow, now)
        return True

    def _begin(self, sync: SyncSender, now: Instant) -> None:
        if self._sync:
            self._break_off(self._sync, "the peer began anew", now)
        self._sync = sync
        self.peer.connection.share(sync.route)
        self.peer.log.started(Direction.OUT, now)
        self._check_sync(now)

    def _check_sync(self, now: Instant) -> None:
        """End the pull when the peer has ended it, or is rejected."""
        sync = self._sync
        if sync and (sync.over or sync.follows) and not sync.ended:
            self._end(sync, now)
        elif sync and sync.rejection is not None:
            self._reject(sync, sync.rejection, now)

    def _reject(self, sync: SyncSender, why: Reception, now: Instant) -> None:
        """Reject a sync; its flow stays until the rejection is sent."""
        self._sync = None
        self._past.append(sync.id)
        self._ended_s = now.steady_s
        self._rejected = (sync.id, why)
        reason = f"{self.peer.name} speaks another version of the sync; install the same release"
        self.peer.log.timed_out(Direction.OUT, reason, now)

    def _end(self, sync: SyncSender, now: Instant) -> None:
        sync.ended = True
        if self._flows.current is None:
            self.peer.tokens.renew()  # it has got one; a copy of what it began with is of no use
        if not sync.follows:
            self._sync = None
            self.peer.connection.unshare()
            self._past.append(sync.id)
            self._ended_s = now.steady_s
        self.peer.log.ended(
            Direction.OUT,
            now,
            began_s=sync.began_s,
            messages=sync.messages,
            size=sync.bytes,
            complete=not sync.cut_short,
        )

    def _break_off(self, sync: SyncSender, reason: str, now: Instant) -> None:
        settled = (
            sync.done and sync.all_cast and self._flows.current and self._flows.current.settled
        )
        if settled and not sync.ended:
            self._end(sync, now)  # all has arrived, only the peer's END has not
            return
        self._release(sync)
        if not sync.ended:  # otherwise its end was reported already
            self.peer.log.timed_out(Direction.OUT, reason, now)

    def _release(self, sync: SyncSender) -> None:
        self._sync = None
        self.peer.connection.unshare()
        self._past.append(sync.id)
        self._flows.close()
