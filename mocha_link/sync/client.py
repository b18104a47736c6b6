"""The asking side of a sync with an original node: GHEAD, GDATA, DENDT. No sockets here."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from mocha_link.clock import Instant
from mocha_link.links.link_events import (
    Direction,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.store import payload
from mocha_link.store.database import Database
from mocha_link.store.payload import PayloadError, Trailer
from mocha_link.store.record import WRAP_MS, Header, HeaderError, Record
from mocha_link.sync.frames import Frame, Step
from mocha_link.sync.protocol import ACK, DENDT, GDATA, GHEAD, ID_BYTES, SERRM, request
from mocha_link.sync.sync_receiver import Verify
from mocha_link.team.team import Team, Topic

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


class PathHistory(Protocol):
    """What earlier pulls have shown of the way to a peer."""

    rtt_s: float | None
    rate_bytes_s: float | None
    cut: dict[int, int]  # by robot and topic: how often its message was cut, one after the other


class ClientSession:
    """Pulls from one peer, once: GHEAD, a window of GDATA, DENDT.

    Every message is stored as it arrives, so a session that breaks off leaves whole messages.
    Make one per pull; it is `over` when it has ended or broken off, `broken` in the latter case.

    Args:
        path_stats: what is known of the way; it learns which message was cut.
        verify: raises PayloadError for a message that this peer may not hand us.
        budget: bytes of replies after which nothing more is asked for; 0: no limit.
    """

    def __init__(  # noqa: PLR0913 - all it needs to know, once
        self,
        peer: str,
        own: str,
        *,
        team: Team,
        database: Database,
        new_id: Callable[[], bytes],
        timeout_s: float,
        path_stats: PathHistory,
        verify: Verify | None = None,
        budget: int = 0,
    ) -> None:
        self.peer = peer
        self.over = self.broken = False
        self.bytes_in = 0  # of replies
        self.rtt_s: float | None = None  # of DENDT; None until it is answered
        self._own = own
        self._team = team
        self._database = database
        self._new_id = new_id
        self._timeout_s = timeout_s
        self._path_stats = path_stats
        self._verify = verify
        self._budget = budget
        # code, header, when asked
        self._asked: dict[bytes, tuple[bytes, Header | None, float]] = {}
        self._wanted: deque[Header] = deque()  # headers to ask for yet
        self._window = MIN_WINDOW  # most requests under way
        self._size = float(_GUESS_BYTES)  # of a reply, smoothed, in bytes
        self._messages = 0  # that were stored
        self.reached = self._cut_short = False  # something was answered; not all came
        # steady clock, as the next
        self._began_s = self._listed_s = self._fetched_s = self.alive_s = 0.0
        self._fetched_bytes = 0  # of GDATA replies

    def start(self, now: Instant) -> Step:
        """Begin: ask for the list of headers."""
        self._began_s = self.alive_s = now.steady_s
        step = Step(events=[SyncStarted(self.peer, now.unix_s, Direction.IN)])
        self._ask(step, now, GHEAD)
        return step

    def reply(self, parts: Sequence[Frame], now: Instant) -> Step:
        """Take in the body parts of a reply (a good one has one part)."""
        step = Step()
        frame: Frame = parts[0] if len(parts) == 1 else b""
        self.bytes_in += sum(map(len, parts))
        asked = self._asked.pop(bytes(frame[:ID_BYTES]), None)
        if asked is None or self.over:
            step.refusals.append("a reply to nothing that was asked")
            if not self.over:  # the connection is ours alone, so the peer is no node
                self._fail(step, "the peer answered what was not asked", now)
            return step
        code, header, asked_s = asked
        self.progress(now)
        body = frame[ID_BYTES:]
        if code == GHEAD:
            self._listed_s = self._fetched_s = now.steady_s
            self._list(step, bytes(body), now)
        elif header is not None:
            self._fetched_s = now.steady_s
            self._fetched_bytes += len(frame)
            self._size += _WEIGHT * (len(frame) - self._size)
            self._path_stats.cut.pop(_topic_of(header), None)
            self._store(step, header, body, now)
        else:
            self.rtt_s = now.steady_s - asked_s
            if body != ACK:
                step.refusals.append("a reply to DENDT that is no acknowledgement")
            self._end(step, now)
        if not self.over:
            self._go_on(step, now)
        return step

    def progress(self, now: Instant) -> None:
        """The connection stands, or bytes have arrived, though no whole reply yet."""
        self.reached = True
        self.alive_s = now.steady_s

    def why_silent(self) -> str:
        """What to say when nothing has come for the time-out."""
        if not self.reached:
            return f"no connection within {self._timeout_s:g} s"
        codes = ", ".join(sorted({code.decode() for code, _, _ in self._asked.values()}))
        return f"no byte for {self._timeout_s:g} s, waiting for the reply to {codes}"

    def fail(self, reason: str, now: Instant) -> Step:
        """Break off for a reason that is known outside, e.g. a closed connection."""
        step = Step()
        self._fail(step, reason, now)
        return step

    @property
    def bandwidth_bytes_s(self) -> float | None:
        """Bytes per second from the list to the last message; None without any message."""
        taken_s = self._fetched_s - self._listed_s
        return self._fetched_bytes / taken_s if self._fetched_bytes and taken_s > 0 else None

    def _ask(self, step: Step, now: Instant, code: bytes, header: Header | None = None) -> None:
        request_id = self._new_id()
        while request_id in self._asked:
            request_id = self._new_id()
        argument = header.pack() if header else self._own.encode() if code == DENDT else b""
        self._asked[request_id] = (code, header, now.steady_s)
        step.frames.append(request(request_id, code, argument))

    def _list(self, step: Step, body: bytes, now: Instant) -> None:
        if len(body) % Header.SIZE or len(body) > MAX_HEADERS * Header.SIZE:
            step.refusals.append(f"a header list of {len(body)} bytes")
            self._fail(step, "the peer answered GHEAD with something else than headers", now)
            return
        found: list[tuple[int, Header]] = []
        for raw in self._database.wanted(body, now.unix_s):
            try:
                header = Header.parse(raw)
            except HeaderError as error:
                step.refusals.append(str(error))
                continue
            if self._team.by_ids(header.robot_id, header.topic_id) is None:
                step.refusals.append(f"header {header}: no such robot or topic in the team")
            elif header.hangs_old_nodes:
                step.refusals.append(f"header {header}: original nodes would stop over its time")
            else:
                found.append((self._path_stats.cut.get(_topic_of(header), 0), header))
        # What a contact was too short for comes last: it must not starve the others again.
        found.sort(key=lambda each: each[0])
        self._wanted.extend(header for _, header in found)

    def _store(self, step: Step, header: Header, body: Frame, now: Instant) -> None:
        known = self._team.by_ids(header.robot_id, header.topic_id)
        if body == SERRM or known is None:
            return  # replaced at the peer meanwhile; the next list has the newer one
        robot, topic = known
        try:
            trailer = self._check(header, body, topic)
        except PayloadError as error:
            step.refusals.append(f"message {header} of {robot.name}: {error}")
            return
        stamp_ms = trailer.stamp_ms if trailer else header.stamp_ms(now.unix_s)
        record = Record(header, topic.priority, body, stamp_ms, now.unix_s, trailer is None)
        if self._database.insert(record, now.unix_s):
            self._messages += 1
            step.events.append(
                MessageStored(self.peer, now.unix_s, robot.name, topic.name, header, len(body))
            )

    def _check(self, header: Header, body: Frame, topic: Topic) -> Trailer | None:
        payload.check_type(body, topic)
        trailer = payload.check(body, payload.Ids(header.robot_id, header.topic_id))
        if trailer and trailer.stamp_ms % WRAP_MS != header.wrapped_ms:
            raise PayloadError("it carries the time of another message")
        if trailer and trailer.stamp_ms >= payload.TAKEN_MS:
            raise PayloadError("of an impossible time")
        if self._verify:
            self._verify(header, body, trailer)
        return trailer

    def _widen(self) -> None:
        """Adapt the window to what the link carries and to how large the messages are."""
        ahead = float(_AHEAD_BYTES)
        rate = self.bandwidth_bytes_s or self._path_stats.rate_bytes_s
        if rate:
            ahead = max(ahead, rate * ((self._path_stats.rtt_s or 0.0) + _AHEAD_S))
        self._window = int(min(max(ahead / self._size, MIN_WINDOW), MAX_WINDOW))
        if self._budget:
            left = self._budget - self.bytes_in
            seen = self._fetched_bytes / max(self._messages, 1) or _LARGE_BYTES
            self._window = min(self._window, max(int(left / max(self._size, seen)), 1))

    def _go_on(self, step: Step, now: Instant) -> None:
        self._widen()
        if self._budget and self.bytes_in >= self._budget:
            self._wanted.clear()
            self._cut_short = True
        while self._wanted and len(self._asked) < self._window:
            header = self._wanted.popleft()
            if self._database.wants(header, now.unix_s):  # another peer may have brought it
                self._ask(step, now, GDATA, header)
        if not self._asked:
            self._ask(step, now, DENDT)

    def _end(self, step: Step, now: Instant) -> None:
        self.over = True
        self._path_stats.rate_bytes_s = self.bandwidth_bytes_s or self._path_stats.rate_bytes_s
        step.events.append(
            SyncEnded(
                self.peer,
                now.unix_s,
                Direction.IN,
                messages=self._messages,
                bytes=self.bytes_in,
                duration_s=now.steady_s - self._began_s,
                complete=not self._cut_short,
            )
        )

    def _fail(self, step: Step, reason: str, now: Instant) -> None:
        self.over = self.broken = True
        self._wanted.clear()
        self._path_stats.rate_bytes_s = self.bandwidth_bytes_s or self._path_stats.rate_bytes_s
        cut = next((header for _, header, _ in self._asked.values() if header), None)
        if cut and self.alive_s > self._fetched_s:  # a part of it was here when the link broke
            topic = _topic_of(cut)
            self._path_stats.cut[topic] = self._path_stats.cut.get(topic, 0) + 1
        step.events.append(SyncTimedOut(self.peer, now.unix_s, Direction.IN, reason))


def _topic_of(header: Header) -> int:
    return header.robot_id << 8 | header.topic_id
