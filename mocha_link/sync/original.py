"""Either side of a sync with an original node. No sockets here.

A pull is GHEAD (the list of headers), one GDATA per wanted message, DENDT.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mocha_link.clock import Instant
from mocha_link.links import Direction
from mocha_link.store import (
    WRAP_MS,
    Header,
    HeaderError,
    Kept,
    PayloadError,
    Record,
    impossibility,
    wire,
)
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import (
    ACK,
    CODE_BYTES,
    DENDT,
    GDATA,
    GHEAD,
    ID_BYTES,
    REQUEST_PATIENCE_S,
    SERRM,
    Frame,
)

MAX_HEADERS = 65_536
FORGET_S = 60.0  # after this silence of a client none of its requests can be in flight
# An original client abandons a reply that takes more than 6 s, and all replies queued after it.
# Smaller replies take that long on no usable link.
LATE_BYTES = 32 * 1024
# An original server replies in order. The window keeps the link busy, by the sizes received so far.
MIN_WINDOW, MAX_WINDOW = 16, 256
_GUESS_BYTES = 512  # assumed size of a message until one is received
_LARGE_BYTES = 8192  # the same if a budget must not be exceeded
_AHEAD_BYTES = 64 * 1024
_AHEAD_S = 0.25
_WEIGHT = 0.125  # of a new size in the moving average


class RequestWindow:
    """Measures the replies of one pull, and limits the requests in flight.

    Attributes:
        size: the limit.
        fetched_s: when the list or the last message was received, steady seconds.
    """

    def __init__(self) -> None:
        self.size = MIN_WINDOW
        self.fetched_s = 0.0
        self._listed_s = 0.0  # when the list was received
        self._fetched_bytes = 0  # of all replies with messages
        self._reply_bytes = float(_GUESS_BYTES)  # size of a reply, moving average

    def listed(self, now: Instant) -> None:
        """Note that the list of headers was received."""
        self._listed_s = self.fetched_s = now.steady_s

    def fetched(self, size: int, now: Instant) -> None:
        """Note that a reply with a message was received."""
        self.fetched_s = now.steady_s
        self._fetched_bytes += size
        self._reply_bytes += _WEIGHT * (size - self._reply_bytes)

    @property
    def bandwidth_bytes_s(self) -> float | None:
        """Bytes per second from the list to the last message; None without any message."""
        taken_s = self.fetched_s - self._listed_s
        return self._fetched_bytes / taken_s if self._fetched_bytes and taken_s > 0 else None

    def adapt(self, rate_bytes_s: float | None, rtt_s: float | None) -> None:
        """Adapt the limit to the rate and round trip of the link, if they are known."""
        ahead = float(_AHEAD_BYTES)
        if rate_bytes_s:
            ahead = max(ahead, rate_bytes_s * ((rtt_s or 0.0) + _AHEAD_S))
        self.size = int(min(max(ahead / self._reply_bytes, MIN_WINDOW), MAX_WINDOW))

    def limit(self, left_bytes: int, messages: int) -> None:
        """Keep the replies within `left_bytes`, by the sizes of the messages received so far."""
        seen = self._fetched_bytes / max(messages, 1) or _LARGE_BYTES
        self.size = min(self.size, max(int(left_bytes / max(self._reply_bytes, seen)), 1))


class ClientSession:
    """Pulls from one peer, once: GHEAD, a window of GDATA, DENDT.

    Every message is stored when it is received, so an aborted session leaves whole messages.

    Args:
        budget: bytes of replies after which the client requests no more; 0: no limit.

    Attributes:
        over: the pull is complete or has failed.
        failure: why the pull failed, for the operator; None: it did not.
        messages: the number of stored messages.
        bytes_in: bytes of all replies.
        cut_short: some messages were not requested, as the budget was used up.
        rtt_s: round trip of DENDT; None until its reply.
        reached: the connection was established, or a reply was received.
        alive_s: when the last bytes were received, steady seconds.
    """

    def __init__(self, peer: Peer, budget: int = 0) -> None:
        self.over = False
        self.failure: str | None = None
        self.messages = 0
        self.bytes_in = 0
        self.cut_short = False
        self.rtt_s: float | None = None
        self.reached = False
        self.alive_s = 0.0
        self._peer = peer
        self._database = peer.node.database
        self._budget = budget
        self._pending: dict[bytes, tuple[bytes, Header | None, float]] = {}  # code, header, when
        self._wanted: deque[Header] = deque()  # messages still to request
        self._window = RequestWindow()  # limits the requests in flight

    def start(self, now: Instant) -> bytes:
        """The first request: for the list of headers."""
        self.alive_s = now.steady_s
        return self._request(now, GHEAD)

    def reply(self, parts: Sequence[Frame], now: Instant) -> list[bytes]:
        """Process the body parts of a reply (a valid one has one part).

        Returns the next requests.
        """
        frame: Frame = parts[0] if len(parts) == 1 else b""
        self.bytes_in += sum(map(len, parts))
        pending = self._pending.pop(bytes(frame[:ID_BYTES]), None)
        if pending is None or self.over:
            self._peer.log.refuse("a reply without a request")
            if not self.over:  # only we use the connection, so the peer is no node
                self.break_off("the peer answered without a request")
            return []
        code, header, sent_s = pending
        self.progress(now)
        body = frame[ID_BYTES:]
        if code == GHEAD:
            self._window.listed(now)
            self._list(bytes(body), now)
        elif header is not None:
            self._window.fetched(len(frame), now)
            self._peer.path.message_arrived(header.key)
            self._store(header, body, now)
        else:
            self.rtt_s = now.steady_s - sent_s
            if body != ACK:
                self._peer.log.refuse("a reply to DENDT that is no acknowledgement")
            self.over = True
            self._learn_rate()
        return [] if self.over else self._next_requests(now)

    def progress(self, now: Instant) -> None:
        """Note that the connection was established, or part of a reply was received."""
        self.reached = True
        self.alive_s = now.steady_s

    def why_silent(self) -> str:
        """The reason for a time-out without a byte."""
        timeout_s = self._peer.node.timeout_s
        if not self.reached:
            return f"no connection within {timeout_s:g} s"
        codes = ", ".join(sorted({code.decode() for code, _, _ in self._pending.values()}))
        return f"no byte for {timeout_s:g} s, waiting for the reply to {codes}"

    def break_off(self, failure: str | None = None) -> None:
        """Abort for the given reason, and note a message that was cut, for the next pull."""
        self.over = True
        self.failure = failure
        self._wanted.clear()
        self._learn_rate()
        cut = next((header for _, header, _ in self._pending.values() if header), None)
        if (
            cut and self.alive_s > self._window.fetched_s
        ):  # a part of it had been received when the link broke
            self._peer.path.message_cut(cut.key)

    @property
    def bandwidth_bytes_s(self) -> float | None:
        """Bytes per second from the list to the last message; None without any message."""
        return self._window.bandwidth_bytes_s

    def _learn_rate(self) -> None:
        self._peer.path.moved(self.bandwidth_bytes_s)

    def _request(self, now: Instant, code: bytes, header: Header | None = None) -> bytes:
        node = self._peer.node
        request_id = node.new_id()
        while request_id in self._pending:
            request_id = node.new_id()
        argument = header.pack() if header else node.name.encode() if code == DENDT else b""
        self._pending[request_id] = (code, header, now.steady_s)
        return request_id + code + argument

    def _list(self, body: bytes, now: Instant) -> None:
        log, path = self._peer.log, self._peer.path
        if len(body) % Header.SIZE or len(body) > MAX_HEADERS * Header.SIZE:
            log.refuse(f"a header list of {len(body)} bytes")
            self.break_off("the peer answered GHEAD with something else than headers")
            return
        found: list[tuple[int, Header]] = []
        for raw in self._database.wanted(body, now.unix_s):
            try:
                header = Header.parse(raw)
            except HeaderError as error:
                log.refuse(str(error))
                continue
            team, stamp_ms = self._peer.node.team, header.stamp_ms(now.unix_s)
            why = impossibility(team, header.robot_id, header.topic_id, stamp_ms, now.unix_s)
            if why:
                log.refuse(f"header {header}: {why}")
            else:
                found.append((path.cuts(header.key), header))
        # Messages that a contact was too short for are requested last, to not starve the others.
        found.sort(key=lambda each: each[0])
        self._wanted.extend(header for _, header in found)

    def _store(self, header: Header, body: Frame, now: Instant) -> None:
        known = self._peer.node.team.topics_by_key.get(header.key)
        if body == SERRM or known is None:
            return  # the peer has replaced it; its next list has the newer one
        robot, topic = known
        try:
            trailer = wire.check(body, (header.robot_id, header.topic_id))
            if trailer:
                _check_time(header, trailer.stamp_ms, now.unix_s)
            stamp_ms = trailer.stamp_ms if trailer else header.stamp_ms(now.unix_s)
            record = Record(header, topic.priority, body, stamp_ms, now.unix_s, trailer is None)
            self.messages += self._peer.store(known, record, trailer)
        except PayloadError as error:
            self._peer.log.refuse(f"message {header} of {robot.name}: {error}")

    def _widen(self) -> None:
        """Adapt the window to the rate of the link and to the size of the messages."""
        path = self._peer.path
        self._window.adapt(self.bandwidth_bytes_s or path.rate_bytes_s, path.rtt_s)
        if self._budget:
            self._window.limit(self._budget - self.bytes_in, self.messages)

    def _next_requests(self, now: Instant) -> list[bytes]:
        self._widen()
        if self._budget and self.bytes_in >= self._budget:
            self._wanted.clear()
            self.cut_short = True
        requests = []
        while self._wanted and len(self._pending) < self._window.size:
            header = self._wanted.popleft()
            if self._database.wants(header, now.unix_s):  # another peer may have sent it meanwhile
                requests.append(self._request(now, GDATA, header))
        return requests if self._pending else [self._request(now, DENDT)]


def _check_time(header: Header, stamp_ms: int, now_s: float) -> None:
    if stamp_ms % WRAP_MS != header.wrapped_ms:
        raise PayloadError("it carries the time of another message")
    if not wire.is_taken(stamp_ms, now_s):
        raise PayloadError("its time is more than 139 years ahead of this clock")


@dataclass(slots=True)
class _Served:
    """A pull of the peer since its GHEAD."""

    since_s: float  # the time of its GHEAD, steady seconds
    messages: int = 0  # sent
    bytes: int = 0  # of all replies
    given_up: bool = False  # it was reported as timed out


class ServerSession:
    """Serves one peer that pulls like original nodes, and reports the start and end of its pulls.

    Topics whose large messages the peer has abandoned are listed last, so that they starve nothing.
    """

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._database = peer.node.database
        self._pull: _Served | None = None  # None: none since the last DENDT
        self._received_s = 0.0  # when the last request was received, steady seconds
        # Offered messages stay available although newer ones replace them, until some time after
        # the peer has requested another list.
        self._offered: Mapping[bytes, Kept] = {}
        self._offered_before: Mapping[bytes, Kept] = {}  # in the previous list
        self._listed_s = 0.0  # when the last list was sent, steady seconds
        self._late: set[bytes] = set()  # topics to list last: first bytes of their headers
        self._under_way = b""  # topic of a large reply that may not have been received

    def handle(self, parts: Sequence[bytes], now: Instant) -> bytes:
        """The reply to the body parts of a request (a valid request has one part)."""
        self._received_s = now.steady_s
        frame = parts[0] if parts else b""
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        argument = frame[ID_BYTES + CODE_BYTES :]
        body: Frame = SERRM
        self._note_arrival(code)
        if len(parts) != 1:
            pass
        elif code == GHEAD:
            self._give_up(now, "the peer began anew")
            self._pull = _Served(now.steady_s)
            self._peer.log.started(Direction.OUT, now)
            body = self._list(now)
        elif code == GDATA:
            body = self._data(argument, now)
        elif code == DENDT:
            body = ACK
            self._end(now)
        if self._pull:
            self._pull.bytes += ID_BYTES + len(body)
        return b"".join((request_id, body))

    def tick(self, now: Instant) -> None:
        """Run the timers: time out a silent peer."""
        silence_s = now.steady_s - self._received_s
        if silence_s <= REQUEST_PATIENCE_S:
            return
        if silence_s > FORGET_S and self._offered:  # free the memory for an absent peer
            self._offered = self._offered_before = {}
        self._give_up(now, f"the peer requested nothing for {REQUEST_PATIENCE_S:g} s")

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` at the latest, in steady seconds; None: no timer runs."""
        if self._pull and not self._pull.given_up:
            return self._received_s + REQUEST_PATIENCE_S
        return self._received_s + FORGET_S if self._offered else None

    def _note_arrival(self, code: bytes) -> None:
        """Note from the next request whether the last large reply was received or abandoned."""
        topic, self._under_way = self._under_way, b""
        if topic and code == GHEAD:
            self._late.add(topic)
        else:
            self._late.discard(topic)

    def _end(self, now: Instant) -> None:
        pull, self._pull = self._pull, None
        if pull:
            self._peer.log.ended(
                Direction.OUT,
                now,
                began_s=pull.since_s,
                messages=pull.messages,
                size=pull.bytes + ID_BYTES + len(ACK),
            )

    def _give_up(self, now: Instant, reason: str) -> None:
        """Report the pull as timed out; on a slow link its DENDT may still be received."""
        if self._pull and not self._pull.given_up:
            self._pull.given_up = True
            self._peer.log.timed_out(Direction.OUT, reason, now)

    def _list(self, now: Instant) -> bytes:
        self._offered_before, self._offered = self._offered, self._database.snapshot()
        self._listed_s = now.steady_s
        headers = self._database.header_list()
        if not self._late:
            return headers
        starts = range(0, len(headers), Header.SIZE)
        each = [headers[start : start + Header.SIZE] for start in starts]
        each.sort(key=lambda header: header[:2] in self._late)
        return b"".join(each)

    def _data(self, argument: bytes, now: Instant) -> Frame:
        if now.steady_s - self._listed_s > REQUEST_PATIENCE_S:
            self._offered_before = {}
        try:
            record = self._database.get(Header.parse(argument))
        except HeaderError:
            return SERRM
        if record is None:
            kept = self._offered.get(argument) or self._offered_before.get(argument)
            if kept is None:
                return SERRM
            record = kept.record
        if self._pull:
            self._pull.messages += 1
        if len(record.body) >= LATE_BYTES:
            self._under_way = argument[:2]
        return record.body
