"""Serves the pulls of one peer, by either protocol and over either path.

No sockets here: requests and datagrams in, replies and frames out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.links import Direction
from mocha_link.sync.credit import GRANT
from mocha_link.sync.flows import Flows
from mocha_link.sync.frames import HELLO, message_frame
from mocha_link.sync.original import ServerSession
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import (
    CODE_BYTES,
    GHEAD,
    ID_BYTES,
    LINGER_S,
    REQUEST_PATIENCE_S,
    SERRM,
    SYNC1,
    SYNCC,
    SYNCF,
    Frame,
    Route,
    Standing,
)
from mocha_link.sync.send_states import SendState
from mocha_link.sync.served_pull import ServedPull
from mocha_link.sync.sync_messages import Hello, Reception

REMEMBERED = 16  # past pulls, so that their late packets do not begin a new pull
REPLACED_S = 0.5  # a datagram does not replace a sync that received a frame within this time
PADDING = b"\0"  # the first byte of a padding frame

_HELLO_ROOM = 64


class Server:
    """Serves one peer, and reports the start and end of its pulls.

    Attributes:
        peer: the peer.
    """

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self._original = ServerSession(peer)
        self._pull: ServedPull | None = None  # running, or followed by the peer
        self._flows = Flows(peer)  # of datagrams; the current one is of the newest sync
        self._past: deque[bytes] = deque(maxlen=REMEMBERED)  # ids of past syncs
        self._ended_s = 0.0  # when the last sync ended, steady seconds
        self._rejected: bytes | None = None  # id of the last rejected sync
        self._opened: deque[tuple[bytes, Route]] = deque(maxlen=REMEMBERED)  # ids and connections
        self._contact_s = 0.0  # when the radio last reported a new contact, steady seconds

    # --- input

    def handle(self, route: Route, parts: Sequence[bytes], now: Instant) -> bytes | None:
        """The reply to the body parts of a request; None: none, or not yet (see `supply`)."""
        frame = parts[0] if len(parts) == 1 else b""
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        if code in (SYNC1, SYNCF, SYNCC):
            return self._handle_sync(route, frame, now)
        if code == GHEAD and (request_id, route) in self._opened:
            return None  # the fallback for original nodes
        return self._original.handle(parts, now)

    def packet(self, packet: bytes, now: Instant) -> bool:
        """Process a datagram; returns whether it is no replay, so its source is the peer."""
        flow = self._flows.current
        token = packet[1 : 1 + ID_BYTES]
        if len(token) != ID_BYTES:
            return False
        if flow is None or flow.token != token:
            return self._packet_of_new(token, packet, now)
        refused, arrived = flow.refused, flow.arrived
        for frame in _received(flow, packet, now):
            if self._pull and self._pull.id == flow.token:
                self._take(self._pull, frame, now)
        if self._pull and flow.refused == refused:
            self._pull.received(now)
            self._pull.use_datagrams()
        return flow.arrived > arrived

    def route(self, standing: Callable[[Route], Standing | None]) -> Route | None:
        """The connection of the sync, if it has one that is open by `standing`."""
        pull = self._pull
        if pull is None or pull.connection.route is None:
            return None
        found = standing(pull.connection.route)
        self._flows.connection_measured(loses_much=found is not None and found.loses_much)
        if not pull.connection_stands(found):
            self._release(pull)
        return pull.connection.route

    def lost(self, route: Route) -> None:
        """Note that a connection was lost, on which a peer that follows receives no more pushes."""
        unchanged = Standing(loses_much=self._flows.loses_much)
        self.route(lambda each: None if each == route else unchanged)

    def on_contact(self, now: Instant) -> None:
        """Note that a contact begins."""
        self._contact_s = now.steady_s
        if self._flows.current:
            self._flows.current.on_contact(now.steady_s)

    def request_pull(self) -> None:
        """Request that a peer that follows pulls again."""
        if self._pull and self._pull.sender.ended:
            self._pull.sender.request_pull()

    # --- output

    def transmit(self, now: Instant) -> list[bytes]:
        """The datagrams to send now."""
        flow = self._flows.current
        if flow is None:
            return []
        packets = flow.transmit(now.steady_s)
        if self._pull is None and flow.settled:
            self._flows.close()
        return packets

    def supply(self) -> tuple[Route, list[Frame]] | None:
        """The next frame for a connection, in parts, if the peer has credit left for one."""
        return self._pull.supply() if self._pull else None

    def wants_push(self, robot_ids: AbstractSet[int]) -> bool:
        """Whether new messages of these robots concern the peer."""
        return self._pull is not None and self._pull.sender.wants_push(robot_ids)

    # --- for our own pulls

    @property
    def received_s(self) -> float:
        """When the last input for the peer's sync was received, steady seconds."""
        return self._pull.received_s if self._pull else 0.0

    @property
    def over(self) -> Route | None:
        """A connection of the peer over which it pulls, and we may pull as well."""
        pull = self._pull
        if pull is None or pull.received_s < self._contact_s:
            return None  # it may have been lost with the previous contact
        return pull.connection.route or None  # not the one that we opened

    # --- timers

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` and `transmit` at the latest; None: no timer runs."""
        flow = self._flows.current
        times = [self._original.wake_s, flow.wake_s if flow else None]
        if self._pull:
            times.append(self._pull.wake_s)
        elif flow:
            times.append(self._ended_s + LINGER_S)
        return min((each for each in times if each is not None), default=None)

    def tick(self, now: Instant) -> None:
        """Run the timers: time out the pull of a silent peer."""
        self._original.tick(now)
        pull = self._pull
        if pull:
            pull.fall_back_to_tcp(now)
            if pull.is_silent(now):
                self._break_off(pull, f"the peer sent nothing for {REQUEST_PATIENCE_S:g} s", now)
        elif self._flows.current and now.steady_s - self._ended_s > LINGER_S:
            self._flows.close()

    # --- a pull begins

    def _handle_sync(self, route: Route, frame: bytes, now: Instant) -> bytes | None:
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        argument = frame[ID_BYTES + CODE_BYTES :]
        pull = self._pull
        if pull is None or pull.id != request_id:
            if code != SYNC1:
                return request_id + SERRM
            self._open_sync(route, request_id, argument, now)
            return self._rejection(request_id)
        connection = pull.connection
        if (
            code == SYNC1
            and connection.sent
            and connection.route != route
            and self._flows.current is None
        ):
            # Its first connection was lost, with all frames sent and credit granted on it.
            pull = self._pull = ServedPull(self.peer, request_id, pull.began_s, self._flows)
        pull.received(now)
        if pull.connection.route is None or code == SYNC1:
            pull.connection.move(route, now)
            self._opened.append((request_id, route))
        if code == SYNC1:
            pull.connection.grant(argument[: GRANT.size])
            argument = argument[GRANT.size :]
        if code == SYNCC:
            pull.connection.grant(argument)
        else:
            self._take(pull, argument, now)
        return self._rejection(request_id)

    def _open_sync(self, route: Route, request_id: bytes, argument: bytes, now: Instant) -> None:
        """Begin a pull on a connection."""
        self._opened.append((request_id, route))
        if request_id in self._past:
            return  # a late connection of a past pull
        pull = ServedPull(self.peer, request_id, now.steady_s, self._flows)
        if not pull.sender.open(argument[GRANT.size :]):
            # After an error reply the peer would take us for an original node.
            self._rejected = request_id
            return
        pull.connection.begin(route)
        pull.connection.grant(argument[: GRANT.size])
        self._begin(pull, now)

    def _packet_of_new(self, token: bytes, packet: bytes, now: Instant) -> bool:
        if token in self._past or self._flows.is_deaf(now):
            return False
        before = self._pull
        if before and before.id == token:
            return self._packet_for_connection(before, packet, now)
        if before and not before.sender.ended and now.steady_s - before.received_s < REPLACED_S:
            return False  # a replayed opening must not end a running pull
        pull = ServedPull(self.peer, token, now.steady_s, self._flows)
        flow = self._flows.make(token, pull.next_for_datagram)
        frames = _received(flow, packet, now)
        if not frames or not all(pull.sender.open(frame) for frame in frames):
            return False
        flow.proven = pull.sender.admitted
        if before and before.reaches_peer and not flow.proven:
            return False  # nor one that reaches the peer, which can always open by a connection
        pull.begin_by_datagrams()
        self._begin(pull, now)
        self._flows.begin(flow, now)
        return True

    def _packet_for_connection(self, pull: ServedPull, packet: bytes, now: Instant) -> bool:
        """Begin datagrams for a pull that the connection has begun; a probe must return first."""
        flow = self._flows.make(pull.id, pull.next_for_datagram)
        flow.receive(packet, now.steady_s)
        if pull.sender.all_sent or flow.refused:
            return False
        flow.proven = pull.sender.admitted
        flow.on_contact(now.steady_s)
        self._flows.begin(flow, now)
        return True

    def _begin(self, pull: ServedPull, now: Instant) -> None:
        if self._pull:
            self._break_off(self._pull, "the peer began anew", now)
        self._pull = pull
        self.peer.connection.share(pull.connection.route)
        self.peer.log.started(Direction.OUT, now)
        if pull.sender.state is SendState.REJECTED:
            self._reject(pull, now)

    # --- a pull ends

    def _take(self, pull: ServedPull, frame: Frame, now: Instant) -> None:
        """Pass a frame to the pull, and report its end; a damaged frame is ignored."""
        before = pull.sender.state
        if not pull.sender.take(frame):
            self.peer.log.refuse("a damaged frame of a sync")
        match pull.sender.state:
            case state if state is before:
                pass
            case SendState.REJECTED:
                self._reject(pull, now)
            case SendState.FOLLOWED:
                self._report_end(pull, now)
            case SendState.OVER if before is not SendState.FOLLOWED:
                self._end(pull, now, complete=before is not SendState.CUT_SHORT)

    def _rejection(self, request_id: bytes) -> bytes | None:
        """The reply on the connection of a rejected sync."""
        if self._rejected != request_id:
            return None
        node = self.peer.node
        hello = Hello(Reception.UNREADABLE, node.config_hash, boot_id=node.boot_id)
        return request_id + message_frame(HELLO, 0, hello.encode(), 0, _HELLO_ROOM)

    def _reject(self, pull: ServedPull, now: Instant) -> None:
        """Reject a sync; its flow stays open until the rejection is sent."""
        self._pull = None
        self._past.append(pull.id)
        self._ended_s = now.steady_s
        self._rejected = pull.id
        reason = f"{self.peer.name} uses another version of the sync; install the same release"
        self.peer.log.timed_out(Direction.OUT, reason, now)

    def _end(self, pull: ServedPull, now: Instant, *, complete: bool) -> None:
        """Close a pull that has ended, without following."""
        self._pull = None
        self.peer.connection.unshare()
        self._past.append(pull.id)
        self._ended_s = now.steady_s
        self._report_end(pull, now, complete=complete)

    def _report_end(self, pull: ServedPull, now: Instant, *, complete: bool = True) -> None:
        if self._flows.current is None:
            self.peer.tokens.renew()  # makes replays of its opening useless
        self.peer.log.ended(
            Direction.OUT,
            now,
            began_s=pull.began_s,
            messages=pull.sender.messages,
            size=pull.sender.sent_bytes,
            complete=complete,
        )

    def _break_off(self, pull: ServedPull, reason: str, now: Instant) -> None:
        """Close a pull that the peer does not continue."""
        before = pull.sender.state
        ended = pull.sender.ended  # its end was already reported
        if pull.has_arrived and not ended:
            pull.sender.end()  # everything is acknowledged, only the peer's END is missing
            self._end(pull, now, complete=before is SendState.DONE)
            return
        self._release(pull)
        if not ended:
            self.peer.log.timed_out(Direction.OUT, reason, now)

    def _release(self, pull: ServedPull) -> None:
        """Send nothing more for a pull."""
        pull.sender.end()
        self._pull = None
        self.peer.connection.unshare()
        self._past.append(pull.id)
        self._flows.close()


def _received(flow: Flow, packet: bytes, now: Instant) -> list[bytes]:
    """The new frames of a datagram, without padding."""
    return [frame for frame in flow.receive(packet, now.steady_s) if frame[:1] != PADDING]
