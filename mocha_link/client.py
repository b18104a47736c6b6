"""The asking side of a sync: one pull of everything that is new at a peer. No sockets here."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mocha_link import payload
from mocha_link.database import Database, Record
from mocha_link.header import Header, HeaderError
from mocha_link.metrics import (
    Direction,
    LinkEvent,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.payload import PayloadError
from mocha_link.protocol import ACK, DENDT, GDATA, GHEAD, ID_BYTES, SERRM, request

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mocha_link.clock import Instant
    from mocha_link.team import Robot, Team, Topic

WINDOW = 8  # requests under way at once; an original server answers them in order
MAX_HEADERS = 65_536


@dataclass(slots=True)
class Step:
    """What a session wants done: frames to send, events to tell, refusals to count."""

    frames: list[bytes] = field(default_factory=list)
    events: list[LinkEvent] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)


class ClientSession:
    """Pulls from one peer, once: GHEAD, a window of GDATA, DENDT.

    Every message is stored as it arrives, so a session that breaks off leaves whole messages.
    Make one per pull; it is `over` when it has ended or broken off.
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
        window: int = WINDOW,
    ) -> None:
        self.peer = peer
        self.over = False
        self.bytes_in = 0
        self.rtt_s: float | None = None
        self._own = own
        self._team = team
        self._database = database
        self._new_id = new_id
        self._timeout_s = timeout_s
        self._window = window
        self._asked: dict[bytes, tuple[bytes, Header | None, float]] = {}
        self._wanted: deque[Header] = deque()
        self._messages = 0
        self._reached = False
        self._began_s = self._listed_s = self._fetched_s = self.alive_s = 0.0
        self._fetched_bytes = 0

    def start(self, now: Instant) -> Step:
        """Begin: ask for the list of headers."""
        self._began_s = self.alive_s = now.steady_s
        step = Step(events=[SyncStarted(self.peer, now.unix_s, Direction.IN)])
        self._ask(step, now, GHEAD)
        return step

    def reply(self, parts: Sequence[bytes], now: Instant) -> Step:
        """Take in the body parts of a reply (a good one has one part)."""
        step = Step()
        frame = parts[0] if len(parts) == 1 else b""
        self.bytes_in += sum(map(len, parts))
        asked = self._asked.pop(frame[:ID_BYTES], None)
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
            self._list(step, body, now)
        elif header is not None:
            self._fetched_s = now.steady_s
            self._fetched_bytes += len(frame)
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
        self._reached = True
        self.alive_s = now.steady_s

    def tick(self, now: Instant) -> Step:
        """Break off if nothing has arrived for too long."""
        if self.over or now.steady_s - self.alive_s <= self._timeout_s:
            return Step()
        if not self._reached:
            return self.fail(f"no connection within {self._timeout_s:g} s", now)
        codes = ", ".join(sorted({code.decode() for code, _, _ in self._asked.values()}))
        return self.fail(
            f"no byte for {self._timeout_s:g} s, waiting for the reply to {codes}", now
        )

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
        wanted: dict[tuple[int, int], Header] = {}
        for start in range(0, len(body), Header.SIZE):
            raw = body[start : start + Header.SIZE]
            try:
                header = Header.parse(raw)
            except HeaderError as error:
                step.refusals.append(str(error))
                continue
            if self._team.by_ids(header.robot_id, header.topic_id) is None:
                step.refusals.append(f"header {header}: no such robot or topic in the team")
            elif header.hangs_old_nodes:
                step.refusals.append(f"header {header}: original nodes would stop over its time")
            elif self._database.wants(header, now.unix_s):
                key = (header.robot_id, header.topic_id)
                best = wanted.get(key)
                if best is None or header.stamp_s(now.unix_s) > best.stamp_s(now.unix_s):
                    wanted[key] = header
        self._wanted.extend(wanted.values())

    def _store(self, step: Step, header: Header, body: bytes, now: Instant) -> None:
        known = self._team.by_ids(header.robot_id, header.topic_id)
        if body == SERRM or known is None:
            return  # replaced at the peer meanwhile; the next list has the newer one
        try:
            self._check(body, known)
        except PayloadError as error:
            step.refusals.append(f"message {header}: {error}")
            return
        robot, topic = known
        record = Record(
            header,
            topic.priority,
            body,
            stamp_ms=header.stamp_ms(now.unix_s),
            received_s=now.unix_s,
            inferred=True,
        )
        if self._database.insert(record, now.unix_s):
            self._messages += 1
            step.events.append(
                MessageStored(self.peer, now.unix_s, robot.name, topic.name, header, len(body))
            )

    @staticmethod
    def _check(body: bytes, known: tuple[Robot, Topic]) -> None:
        robot, topic = known
        if payload.dtype_of(body) != topic.dtype:
            raise PayloadError(
                f"type id {body[0]}, but {robot.name} {topic.name} is {topic.type} ({topic.dtype}) "
                "here; use the same team file everywhere"
            )
        payload.unpack(body)  # only to know that it can be done

    def _go_on(self, step: Step, now: Instant) -> None:
        while self._wanted and len(self._asked) < self._window:
            header = self._wanted.popleft()
            if self._database.wants(header, now.unix_s):  # another peer may have brought it
                self._ask(step, now, GDATA, header)
        if not self._asked:
            self._ask(step, now, DENDT)

    def _end(self, step: Step, now: Instant) -> None:
        self.over = True
        step.events.append(
            SyncEnded(
                self.peer,
                now.unix_s,
                Direction.IN,
                messages=self._messages,
                bytes=self.bytes_in,
                duration_s=now.steady_s - self._began_s,
            )
        )

    def _fail(self, step: Step, reason: str, now: Instant) -> None:
        self.over = True
        self._wanted.clear()
        step.events.append(SyncTimedOut(self.peer, now.unix_s, Direction.IN, reason))
