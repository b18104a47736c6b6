"""The asking side of a sync with an original node. No sockets here.

A pull is GHEAD (the list of headers), one GDATA per wanted message, DENDT.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from mocha_link.clock import Instant
from mocha_link.store import wire
from mocha_link.store.record import Record
from mocha_link.store.wire import WRAP_MS, Header, HeaderError, PayloadError
from mocha_link.sync.peer import Peer, check_type
from mocha_link.sync.protocol import (
    ACK,
    DENDT,
    GDATA,
    GHEAD,
    ID_BYTES,
    SERRM,
    Frame,
    request,
)

MAX_HEADERS = 65_536
# Requests under way at once; an original server answers them in order. As many as keep the link
# busy, by the sizes seen so far.
MIN_WINDOW, MAX_WINDOW = 16, 256
_GUESS_BYTES = 512  # of a message, while none has come
_LARGE_BYTES = 8192  # the same where more must not come than was meant to
_AHEAD_BYTES = 64 * 1024
FIRST_WINDOW = _AHEAD_BYTES // _GUESS_BYTES
_AHEAD_S = 0.25
_WEIGHT = 0.125  # of a new size in the average


class ClientSession:
    """Pulls from one peer, once: GHEAD, a window of GDATA, DENDT.

    Every message is stored as it arrives, so a session that breaks off leaves whole messages.

    Args:
        budget: bytes of replies after which nothing more is asked for; 0: no limit.

    Attributes:
        over: all was said, or it is of no use to go on.
        failure: why it is of no use to go on, in words; None if all was said.
        messages: that were stored.
        bytes_in: of replies.
        cut_short: not all came, as the budget was used up.
        rtt_s: round trip of DENDT; None until it is answered.
        reached: the connection stands, or something was answered.
        alive_s: steady seconds when the peer was heard last.
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
        self._asked: dict[bytes, tuple[bytes, Header | None, float]] = {}  # code, header, when
        self._wanted: deque[Header] = deque()  # headers to ask for yet
        self._window = MIN_WINDOW  # most requests under way
        self._size = float(_GUESS_BYTES)  # of a reply, smoothed, in bytes
        self._listed_s = self._fetched_s = 0.0  # when the list came, and the last message
        self._fetched_bytes = 0  # of GDATA replies

    def start(self, now: Instant) -> bytes:
        """The first request: for the list of headers."""
        self.alive_s = now.steady_s
        return self._request(now, GHEAD)

    def reply(self, parts: Sequence[Frame], now: Instant) -> list[bytes]:
        """Take in the body parts of a reply (a good one has one part); what to ask next."""
        frame: Frame = parts[0] if len(parts) == 1 else b""
        self.bytes_in += sum(map(len, parts))
        asked = self._asked.pop(bytes(frame[:ID_BYTES]), None)
        if asked is None or self.over:
            self._peer.refusals.append("a reply to nothing that was asked")
            if not self.over:  # the connection is ours alone, so the peer is no node
                self.break_off("the peer answered what was not asked")
            return []
        code, header, asked_s = asked
        self.progress(now)
        body = frame[ID_BYTES:]
        if code == GHEAD:
            self._listed_s = self._fetched_s = now.steady_s
            self._list(bytes(body), now)
        elif header is not None:
            self._fetched_s = now.steady_s
            self._fetched_bytes += len(frame)
            self._size += _WEIGHT * (len(frame) - self._size)
            self._peer.cut.pop(_topic_of(header), None)
            self._store(header, body, now)
        else:
            self.rtt_s = now.steady_s - asked_s
            if body != ACK:
                self._peer.refusals.append("a reply to DENDT that is no acknowledgement")
            self.over = True
            self._learn_rate()
        return [] if self.over else self._next_requests(now)

    def progress(self, now: Instant) -> None:
        """The connection stands, or bytes have arrived, though no whole reply yet."""
        self.reached = True
        self.alive_s = now.steady_s

    def why_silent(self) -> str:
        """What to say when nothing has come for the time-out."""
        timeout_s = self._peer.node.timeout_s
        if not self.reached:
            return f"no connection within {timeout_s:g} s"
        codes = ", ".join(sorted({code.decode() for code, _, _ in self._asked.values()}))
        return f"no byte for {timeout_s:g} s, waiting for the reply to {codes}"

    def break_off(self, failure: str | None = None) -> None:
        """The connection is gone, or of no use for the reason given: learn from it."""
        self.over = True
        self.failure = failure
        self._wanted.clear()
        self._learn_rate()
        cut = next((header for _, header, _ in self._asked.values() if header), None)
        if cut and self.alive_s > self._fetched_s:  # a part of it was here when the link broke
            topic = _topic_of(cut)
            self._peer.cut[topic] = self._peer.cut.get(topic, 0) + 1

    @property
    def bandwidth_bytes_s(self) -> float | None:
        """Bytes per second from the list to the last message; None without any message."""
        taken_s = self._fetched_s - self._listed_s
        return self._fetched_bytes / taken_s if self._fetched_bytes and taken_s > 0 else None

    def _learn_rate(self) -> None:
        self._peer.rate_bytes_s = self.bandwidth_bytes_s or self._peer.rate_bytes_s

    def _request(self, now: Instant, code: bytes, header: Header | None = None) -> bytes:
        new_id, own = self._peer.node.new_id, self._peer.node.name
        request_id = new_id()
        while request_id in self._asked:
            request_id = new_id()
        argument = header.pack() if header else own.encode() if code == DENDT else b""
        self._asked[request_id] = (code, header, now.steady_s)
        return request(request_id, code, argument)

    def _list(self, body: bytes, now: Instant) -> None:
        refusals, cut = self._peer.refusals, self._peer.cut
        if len(body) % Header.SIZE or len(body) > MAX_HEADERS * Header.SIZE:
            refusals.append(f"a header list of {len(body)} bytes")
            self.break_off("the peer answered GHEAD with something else than headers")
            return
        found: list[tuple[int, Header]] = []
        for raw in self._database.wanted(body, now.unix_s):
            try:
                header = Header.parse(raw)
            except HeaderError as error:
                refusals.append(str(error))
                continue
            if _topic_of(header) not in self._peer.node.team.topics_by_key:
                refusals.append(f"header {header}: no such robot or topic in the team")
            elif header.hangs_old_nodes:
                refusals.append(f"header {header}: original nodes would stop over its time")
            else:
                found.append((cut.get(_topic_of(header), 0), header))
        # What a contact was too short for comes last: it must not starve the others again.
        found.sort(key=lambda each: each[0])
        self._wanted.extend(header for _, header in found)

    def _store(self, header: Header, body: Frame, now: Instant) -> None:
        known = self._peer.node.team.topics_by_key.get(_topic_of(header))
        if body == SERRM or known is None:
            return  # replaced at the peer meanwhile; the next list has the newer one
        robot, topic = known
        try:
            check_type(body, topic)
            trailer = wire.check(body, (header.robot_id, header.topic_id))
            if trailer:
                _check_time(header, trailer.stamp_ms)
            stamp_ms = trailer.stamp_ms if trailer else header.stamp_ms(now.unix_s)
            record = Record(header, topic.priority, body, stamp_ms, now.unix_s, trailer is None)
            self.messages += self._peer.take_in(known, record, trailer)
        except PayloadError as error:
            self._peer.refusals.append(f"message {header} of {robot.name}: {error}")

    def _widen(self) -> None:
        """Adapt the window to what the link carries and to how large the messages are."""
        ahead = float(_AHEAD_BYTES)
        rate = self.bandwidth_bytes_s or self._peer.rate_bytes_s
        if rate:
            ahead = max(ahead, rate * ((self._peer.rtt_s or 0.0) + _AHEAD_S))
        self._window = int(min(max(ahead / self._size, MIN_WINDOW), MAX_WINDOW))
        if self._budget:
            left = self._budget - self.bytes_in
            seen = self._fetched_bytes / max(self.messages, 1) or _LARGE_BYTES
            self._window = min(self._window, max(int(left / max(self._size, seen)), 1))

    def _next_requests(self, now: Instant) -> list[bytes]:
        self._widen()
        if self._budget and self.bytes_in >= self._budget:
            self._wanted.clear()
            self.cut_short = True
        requests = []
        while self._wanted and len(self._asked) < self._window:
            header = self._wanted.popleft()
            if self._database.wants(header, now.unix_s):  # another peer may have brought it
                requests.append(self._request(now, GDATA, header))
        return requests if self._asked else [self._request(now, DENDT)]


def _check_time(header: Header, stamp_ms: int) -> None:
    if stamp_ms % WRAP_MS != header.wrapped_ms:
        raise PayloadError("it carries the time of another message")
    if stamp_ms >= wire.TAKEN_MS:
        raise PayloadError("of an impossible time")


def _topic_of(header: Header) -> int:
    return header.robot_id << 8 | header.topic_id
