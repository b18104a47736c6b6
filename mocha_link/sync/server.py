"""The answering side of one peer: its pulls, whatever node it runs and whatever path they take.

Nothing here touches sockets: requests and datagrams in, replies and frames out.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence

from mocha_link.clock import Instant
from mocha_link.datagram.datagram import Flow
from mocha_link.links.link_events import Direction, SyncEnded, SyncStarted, SyncTimedOut
from mocha_link.store.config_hash import difference
from mocha_link.sync.frames import HELLO, OPEN, SyncFrameError, message_frame
from mocha_link.sync.original import ServerSession
from mocha_link.sync.peer import GRANT, MAX_CHUNK, MIN_CHUNK, Peer
from mocha_link.sync.protocol import (
    CODE_BYTES,
    FOLLOW_S,
    GHEAD,
    ID_BYTES,
    LINGER_S,
    NEAR_S,
    PATIENCE_S,
    SERRM,
    SYNC1,
    SYNCC,
    SYNCF,
    Frame,
    Route,
)
from mocha_link.sync.sync_messages import Hello, Reception
from mocha_link.sync.sync_sender import MIN_ROOM, SyncSender

FAST_BYTES_S = 2.5e6  # at this rate a connection carries more than datagrams from Python
REMEMBERED = 16  # pulls that are over; what comes late of them begins no new one
REPLACED_S = 0.5  # a sync that has heard its peer within this time is not replaced by a datagram
MOST_UNHEARD = 3  # after so many flows in a row without an acknowledgement
UNHEARD_S = 0.1  # so long an acknowledgement may be late
PADDING = b"\0"  # what a frame without meaning begins with
DEAF_S = 10.0  # datagrams open nothing for so long; connections do

_HELLO_ROOM = 64


def _random_number() -> int:
    return int.from_bytes(os.urandom(4), "big") >> 2


class _Sync:
    """A pull of a new node."""

    def __init__(self, request_id: bytes, sender: SyncSender, now: Instant) -> None:
        self.id = request_id  # that its frames begin with
        self.sender = sender
        self.began_s = now.steady_s  # steady clock, as the next
        self.heard_s = now.steady_s  # of the newest frame
        self.by_datagram = False  # frames came by datagrams
        self.follows = False  # the pull is over, and what is stored later leaves at once
        self.all_cast = False  # everything that was given out went by datagrams
        self.route: Route | None = None  # the peer's connection
        self.routed_s = 0.0  # when it came to that
        self.again: deque[bytes] = deque()  # frames that datagrams may not have brought
        self.sent = 0  # bytes on that connection
        self.allowed = 0  # bytes granted on it
        self.chunk = MIN_CHUNK  # bytes of a reply

    def grant(self, raw: bytes) -> None:
        """Take in what may be sent on the connection."""
        if len(raw) == GRANT.size:
            allowed, chunk = GRANT.unpack(raw)
            self.allowed = max(self.allowed, allowed)
            self.chunk = min(max(chunk, MIN_CHUNK), MAX_CHUNK)


class Server:
    """Answers one peer, whatever it sends, and tells when its pulls start and end."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._session = ServerSession(peer)
        self._sync: _Sync | None = None  # under way, or followed
        self._flow: Flow | None = None  # of datagrams, of the newest sync
        self._past: deque[bytes] = deque(maxlen=REMEMBERED)  # ids of syncs that are over
        self._ended_s = 0.0  # of the last sync
        self._rejected: tuple[bytes, Reception] | None = None  # the last one that was turned away
        self._opened: deque[tuple[bytes, Route]] = deque(maxlen=REMEMBERED)  # ids and connections
        self._unheard = 0  # flows in a row of which the peer has acknowledged nothing
        self._deaf_until_s = 0.0  # datagrams open nothing
        self._rate_bytes_s: float | None = None  # of the last flow, for the next
        self._rtt_s: float | None = None  # likewise

    def answer(self, route: Route, parts: Sequence[bytes], now: Instant) -> bytes | None:
        """The reply to the body parts of a request; None: none, or not yet (see `supply`)."""
        frame = parts[0] if len(parts) == 1 else b""
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        if code in (SYNC1, SYNCF, SYNCC):
            return self._answer_sync(route, frame, now)
        if code == GHEAD and (request_id, route) in self._opened:
            return None  # the fallback for original nodes
        return self._session.answer(parts, now)

    def packet(self, packet: bytes, now: Instant) -> bool:
        """Take in a datagram; says whether it was one of a sync."""
        flow = self._flow
        token = packet[1 : 1 + ID_BYTES]
        if len(token) != ID_BYTES:
            return False
        if flow is None or flow.token != token:
            return self._packet_of_new(token, packet, now)
        refused = flow.refused
        for frame in flow.receive(packet, now.steady_s):
            self._feed_frame(frame, now)
        if self._sync and flow.refused == refused:
            self._sync.heard_s = now.steady_s
        return flow.refused == refused

    def transmit(self, now: Instant) -> list[bytes]:
        """The datagrams to send now."""
        flow = self._flow
        if flow is None:
            return []
        packets = flow.transmit(now.steady_s)
        if self._sync is None and flow.settled:
            self._close_flow()
        return packets

    @property
    def wake_s(self) -> float | None:
        """When to call `transmit` at the latest."""
        return self._flow.wake_s if self._flow else None

    @property
    def is_busy(self) -> bool:
        """Whether a pull is under way, whose time-outs are to be looked after."""
        return not self._sync.follows if self._sync else self._flow is not None

    def is_due(self, now: Instant) -> bool:
        """Whether `transmit` has something, though nothing was stored meanwhile."""
        if self.is_busy:
            return True
        wake_s = self.wake_s
        return wake_s is not None and wake_s <= now.steady_s

    @property
    def route(self) -> Route | None:
        """The connection of the sync, if it has one."""
        return self._sync.route if self._sync else None

    def supply(self) -> tuple[Route, list[Frame]] | None:
        """The next frame for a connection, in parts, if the peer has credit left for one."""
        sync = self._sync
        if sync is None or sync.route is None or self._datagrams_carry(sync):
            return None
        if sync.again:
            frame = sync.id + sync.again.popleft()
            sync.sent += len(frame)
            return sync.route, [frame]
        room = sync.allowed - sync.sent
        if room <= 0:
            return None
        parts = sync.sender.next_parts(min(sync.chunk, max(room, MIN_ROOM + ID_BYTES)), sync.id)
        if parts is None:
            return None
        sync.sent += sum(map(len, parts))
        return sync.route, parts

    def _datagrams_carry(self, sync: _Sync) -> bool:
        """Whether they carry what there is; to a near or fast peer its connection does from now on.

        One that follows by datagrams has closed its connection.
        """
        flow = self._flow
        if not sync.by_datagram or flow is None:
            return False
        near = flow.rtt_s is not None and flow.rtt_s < NEAR_S
        if sync.follows or not (near or (flow.rate_bytes_s or 0) >= FAST_BYTES_S):
            return True
        sync.by_datagram = sync.all_cast = False
        return False

    def on_contact(self, now: Instant) -> None:
        """A new contact begins."""
        if self._flow:
            self._flow.on_contact(now.steady_s)

    def tick(self, now: Instant) -> None:
        """What the peer's silence ends."""
        self._session.tick(now)
        sync = self._sync
        if sync is None and self._flow and now.steady_s - self._ended_s > LINGER_S:
            self._close_flow()
        if sync:
            self._doubt_datagrams(sync, now)
        if sync and now.steady_s - sync.heard_s > (FOLLOW_S if sync.follows else PATIENCE_S):
            self._break_off(sync, f"the peer said nothing for {PATIENCE_S:g} s", now)

    def _doubt_datagrams(self, sync: _Sync, now: Instant) -> None:
        """Where ours do not get back to the peer, the connection serves.

        Its request was more than a round trip behind the peer's datagrams, and an acknowledgement
        takes no longer.
        """
        flow = self._flow
        if not sync.by_datagram or sync.route is None or flow is None or flow.rtt_s is not None:
            return
        if now.steady_s - sync.routed_s > 2 * (sync.routed_s - sync.began_s) + UNHEARD_S:
            sync.by_datagram = False
            sync.all_cast = sync.sender.done
            sync.again.extend(flow.reclaim())

    def _answer_sync(self, route: Route, frame: bytes, now: Instant) -> bytes | None:
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        argument = frame[ID_BYTES + CODE_BYTES :]
        sync = self._sync
        if sync is None or sync.id != request_id:
            if code != SYNC1:
                return request_id + SERRM
            self._opened.append((request_id, route))
            if request_id in self._past:
                return self._rejection(request_id)  # a connection that came too late
            sync = _Sync(request_id, SyncSender(self._peer), now)
            grant, argument = argument[: GRANT.size], argument[GRANT.size :]
            if not self._opens(sync, argument):
                # An error reply would make us an original node to the peer, who reads by ids.
                self._rejected = (request_id, Reception.UNREADABLE)
                return self._rejection(request_id)
            sync.route = route
            sync.grant(grant)
            self._begin(sync, now)
            return self._rejection(request_id)
        sync.heard_s = now.steady_s
        if code == SYNC1 and sync.sent and sync.route != route and self._flow is None:
            # Its first connection broke, with all that was sent on it.
            sync.sender = SyncSender(self._peer)
            sync.allowed = 0
        if sync.route is None or code == SYNC1:
            sync.route, sync.sent, sync.routed_s = route, 0, now.steady_s
            self._opened.append((request_id, route))
        if code == SYNC1:
            sync.grant(argument[: GRANT.size])
            argument = argument[GRANT.size :]
        if code == SYNCC:
            sync.grant(argument)
        elif not self._takes(sync, argument):
            return request_id + SERRM
        self._look(now)
        return self._rejection(request_id)

    def _rejection(self, request_id: bytes) -> bytes | None:
        """What to say on the connection of a sync that is turned away."""
        if self._rejected is None or self._rejected[0] != request_id:
            return None
        hello = Hello(self._rejected[1], self._peer.node.config_hash)
        return request_id + message_frame(HELLO, 0, hello.encode(), 0, _HELLO_ROOM)

    def _packet_of_new(self, token: bytes, packet: bytes, now: Instant) -> bool:
        sync = self._sync
        if token in self._past or now.steady_s < self._deaf_until_s:
            return False
        if sync and sync.id == token and not sync.by_datagram:
            return True  # the connection was first, so it serves
        heeds = sync and not sync.follows and now.steady_s - sync.heard_s < REPLACED_S
        if sync and sync.id != token and heeds:
            return False  # a copy of an old opening must not end what goes well
        sync = _Sync(token, SyncSender(self._peer), now)
        flow = Flow(
            token,
            lambda room: self._next_for_datagram(sync, room),
            rate_bytes_s=self._rate_bytes_s,
            rtt_s=self._rtt_s,
            first_number=_random_number(),
            proven=False,
        )
        frames = [frame for frame in flow.receive(packet, now.steady_s) if frame[:1] != PADDING]
        if not frames or not all(self._opens(sync, frame) for frame in frames):
            return False
        flow.proven = sync.sender.admitted
        sync.by_datagram = sync.all_cast = True
        self._begin(sync, now)
        self._close_flow()
        self._flow = flow
        if self._unheard >= MOST_UNHEARD:
            # An attacker may be opening in the name of the peer, which drowns in what we send it.
            self._deaf_until_s = now.steady_s + DEAF_S
        return True

    @staticmethod
    def _next_for_datagram(sync: _Sync, room: int) -> bytes | None:
        fits = room >= MIN_ROOM or sync.sender.is_brief(room)
        return sync.sender.next(room) if sync.by_datagram and fits else None

    def _feed_frame(self, frame: bytes, now: Instant) -> None:
        if self._sync and self._flow and self._sync.id == self._flow.token:
            self._takes(self._sync, frame)
            self._look(now)

    def _opens(self, sync: _Sync, frame: bytes) -> bool:
        return frame[:1] == bytes((OPEN,)) and self._takes(sync, frame)

    @staticmethod
    def _takes(sync: _Sync, frame: bytes) -> bool:
        try:
            sync.sender.receive(frame)
        except SyncFrameError:
            return False
        return True

    def _begin(self, sync: _Sync, now: Instant) -> None:
        if self._sync:
            self._break_off(self._sync, "the peer began anew", now)
        self._sync = sync
        self._peer.events.append(SyncStarted(self._peer.name, now.unix_s, Direction.OUT))
        self._look(now)

    def _look(self, now: Instant) -> None:
        """End the pull when the peer says that it is over, or may not have anything."""
        sync = self._sync
        if sync and (sync.sender.over or sync.sender.follows) and not sync.follows:
            self._end(sync, now)
        elif self._sync and self._sync.sender.rejection is not None:
            self._turn_away(self._sync, self._sync.sender.rejection, now)

    def _turn_away(self, sync: _Sync, why: Reception, now: Instant) -> None:
        """A flow stays until it has said so."""
        self._sync = None
        self._past.append(sync.id)
        self._ended_s = now.steady_s
        self._rejected = (sync.id, why)
        reason = difference(self._peer.name)
        if why is Reception.UNREADABLE:
            reason = (
                f"{self._peer.name} speaks another version of the sync; install the same release"
            )
        self._peer.events.append(SyncTimedOut(self._peer.name, now.unix_s, Direction.OUT, reason))

    def _end(self, sync: _Sync, now: Instant) -> None:
        sync.follows = sync.sender.follows
        if not sync.follows:
            self._sync = None
            self._past.append(sync.id)
            self._ended_s = now.steady_s
        self._peer.events.append(
            SyncEnded(
                self._peer.name,
                now.unix_s,
                Direction.OUT,
                messages=sync.sender.messages,
                bytes=sync.sender.bytes,
                duration_s=now.steady_s - sync.began_s,
                complete=not sync.sender.cut_short,
            )
        )

    def _break_off(self, sync: _Sync, reason: str, now: Instant) -> None:
        settled = sync.sender.done and sync.all_cast and self._flow and self._flow.settled
        if settled and not sync.follows:
            self._end(sync, now)  # all has arrived, only the peer's END has not
            return
        self._sync = None
        self._past.append(sync.id)
        self._close_flow()
        if not sync.follows:  # otherwise it has ended well, and was told
            self._tell_timeout(reason, now)

    def _tell_timeout(self, reason: str, now: Instant) -> None:
        timed_out = SyncTimedOut(self._peer.name, now.unix_s, Direction.OUT, reason)
        self._peer.events.append(timed_out)

    def _close_flow(self) -> None:
        flow, self._flow = self._flow, None
        if flow:
            self._unheard = self._unheard + 1 if flow.rtt_s is None else 0
        if flow and flow.rtt_s is not None:
            self._peer.renew_token()
            self._rtt_s = flow.rtt_s
            self._rate_bytes_s = flow.rate_bytes_s or self._rate_bytes_s
