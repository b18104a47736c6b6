"""The robot's own messages: their stamps, and how often a topic may enter the database."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from hashlib import blake2b
from math import inf

from mocha_link.logs import NodeLog
from mocha_link.store import (
    LENGTH_BYTES,
    UNSAFE_MS,
    WRAP_MS,
    Database,
    Header,
    Record,
    as_ms,
    is_void,
    pack_batch,
    wire,
)
from mocha_link.team import Robot, Topic

Sign = Callable[[Topic, bytes], bytes]

LEAP_MS = 600_000
MOST_RECOVERED = 16  # messages of a topic that we did not make; more are not from before a restart
FULL_BYTES = 64 * 1024  # a batch of so much goes at once


@dataclass(slots=True)
class _Draft:
    """Messages that are not packed yet, and the stamp that they have been promised."""

    stamp_ms: int  # as promised
    made_s: float  # Unix time
    parts: list[bytes] = field(default_factory=list)  # data, in order
    size: int = 0  # bytes of all
    frame: bytes | None = None  # of the only part

    def add(self, data: bytes) -> None:
        self.parts.append(data)
        self.size += len(data)


class Publisher:
    """Makes records of the robot's own messages and holds those that come too early.

    Args:
        sign: makes the signature of a message of a topic; None: they are not signed.
    """

    def __init__(
        self,
        robot: Robot,
        topics: tuple[Topic, ...],
        database: Database,
        sign: Sign | None = None,
    ) -> None:
        self._robot = robot
        self._topics = {topic.name: topic for topic in topics}  # by name
        self._database = database
        self._sign = sign
        self._last_ms: dict[str, int] = {}  # stamp promised last
        self._stored_s: dict[str, float] = {}  # Unix time of the last one
        self._held: dict[str, _Draft] = {}  # by topic, for its interval
        self._latest: dict[str, tuple[_Draft, Header]] = {}  # the newest made of each topic
        self._overtaken: Counter[str] = Counter()  # by messages of ours that we did not make

    def publish(
        self,
        topic: Topic,
        data: bytes,
        now_s: float,
        *,
        at_once: bool,
        frame: bytes | None = None,
    ) -> tuple[Header, list[Record]]:
        """The header of a new message, and what was stored now because of it.

        A message that comes before the topic's interval since the last stored one is over is held
        until then; the next one replaces it, or joins it if the topic has `aggregate`. `frame` is
        what `wire.compress` made of the data, if the caller has called it.

        Raises:
            PayloadError: larger than any node would accept.
        """
        wire.check_size(data, LENGTH_BYTES if topic.aggregate else 0)
        stored = []
        draft = self._held.get(topic.name)
        if draft and topic.aggregate and draft.size + len(data) > FULL_BYTES:
            stored.append(self._flush(topic, now_s))
            draft = None
        last_ms = self._last_ms.get(topic.name)
        newest = self._database.newest(self._robot.robot_id, topic.topic_id)
        latest_ms = wire.latest_ms(now_s)
        if newest is not None and is_void(newest.stamp_ms, latest_ms):
            newest = None  # our clock was wrong by more than a century: no node takes that message,
        if last_ms is not None and is_void(last_ms, latest_ms):
            last_ms = None  # nor any later one
        if newest is not None and (last_ms is None or newest.stamp_ms > last_ms):
            stamp_ms = self._stamp_after(topic, newest, now_s, data)
        else:
            stamp_ms = next_stamp_ms(now_s, last_ms)
        self._last_ms[topic.name] = stamp_ms
        if draft is None or not topic.aggregate:
            draft = self._held[topic.name] = _Draft(stamp_ms, now_s)
        draft.stamp_ms, draft.made_s = stamp_ms, now_s
        draft.add(data)
        draft.frame = None if topic.aggregate else frame
        header = Header.at(self._robot.robot_id, topic.topic_id, stamp_ms)
        if at_once or self._is_due(topic.name, now_s):
            record = self._flush(topic, now_s)
            stored.append(record)
            header = record.header
        return header, stored

    def flush(self, topic: Topic, now_s: float) -> Record | None:
        """Store the held message of a topic, if there is one, and return it."""
        return self._flush(topic, now_s) if topic.name in self._held else None

    def recovered(self, topic: Topic, now_s: float) -> Record | None:
        """Store our latest message anew if one from before a restart has replaced it.

        A peer hands that back to us; it has the later stamp if our clock is behind what it was. If
        there is no end of them another node speaks in our name, and ours are not stored anew: that
        one would do the same.
        """
        newest = self._database.newest(self._robot.robot_id, topic.topic_id)
        draft, header = self._latest.get(topic.name, (None, None))
        if draft is None or newest is None or newest.header == header:
            return None
        self._overtaken[topic.name] += 1
        if self._overtaken[topic.name] == MOST_RECOVERED + 1:
            NodeLog(self._robot.name).warning(
                "another node publishes %s's topic %s: give each robot a name of its own",
                self._robot.name,
                topic.name,
            )
        return None if self._is_shared(topic) else self._store(topic, draft, now_s)

    def due(self, now_s: float) -> list[Record]:
        """Store the held messages whose interval is over, and return them."""
        names = [name for name in self._held if self._is_due(name, now_s)]
        return [self._flush(self._topics[name], now_s) for name in names]

    @property
    def due_s(self) -> float:
        """When, in Unix seconds, `due` has something to store; inf: nothing is held."""
        return min((self._due_s(name) for name in self._held), default=inf)

    def _due_s(self, name: str) -> float:
        return self._stored_s.get(name, -inf) + self._topics[name].min_interval_s

    def _flush(self, topic: Topic, now_s: float) -> Record:
        self._stored_s[topic.name] = now_s
        return self._store(topic, self._held.pop(topic.name), now_s)

    def _store(self, topic: Topic, draft: _Draft, now_s: float) -> Record:
        record = self._record(topic, draft)
        if not self._database.insert(record, now_s):
            # From before a restart, with a later stamp. Ours must follow it to be taken by anyone.
            newest = self._database.newest(self._robot.robot_id, topic.topic_id) or record
            draft.stamp_ms = self._stamp_after(topic, newest, now_s, record.body)
            self._last_ms[topic.name] = draft.stamp_ms
            record = self._record(topic, draft)
            self._database.insert(record, now_s)
        draft.frame = None  # it is in the record
        self._latest[topic.name] = (draft, record.header)
        return record

    def _record(self, topic: Topic, draft: _Draft) -> Record:
        body = wire.pack(
            topic.dtype,
            topic.priority,
            pack_batch(draft.parts) if topic.aggregate else draft.parts[0],
            stamp_ms=draft.stamp_ms,
            ids=(self._robot.robot_id, topic.topic_id),
            sign=partial(self._sign, topic) if self._sign else None,
            frame=draft.frame,
        )
        header = Header.at(self._robot.robot_id, topic.topic_id, draft.stamp_ms)
        return Record(header, topic.priority, body, draft.stamp_ms, received_s=draft.made_s)

    def _is_due(self, name: str, now_s: float) -> bool:
        last = self._stored_s.get(name)
        interval_s = self._topics[name].min_interval_s
        # A clock that was set back must not hold a message until it comes round again.
        return last is None or not 0 <= now_s - last < interval_s

    def _is_shared(self, topic: Topic) -> bool:
        """Whether another node, too, sends messages of ours on a topic."""
        return self._overtaken[topic.name] > MOST_RECOVERED

    def _stamp_after(
        self, topic: Topic, earlier: Record, now_s: float, data: bytes | memoryview
    ) -> int:
        """The stamp that follows a message from before a restart.

        If the clock is behind it, others may hold still later ones of which we know nothing, each a
        millisecond after the other, and two messages must not get the same header. So it is some
        minutes later; how much follows from the data.
        """
        if as_ms(now_s) > earlier.stamp_ms or self._is_shared(topic):
            return next_stamp_ms(now_s, earlier.stamp_ms)
        leap_ms = int.from_bytes(blake2b(data, digest_size=8).digest(), "big") % LEAP_MS
        return next_stamp_ms(now_s, earlier.stamp_ms + leap_ms)


def next_stamp_ms(now_s: float, last_ms: int | None) -> int:
    """The time that a new message gets: now, but later than the last one and safe for old nodes."""
    stamp = as_ms(now_s)
    if last_ms is not None:
        stamp = max(stamp, last_ms + 1)
    early = UNSAFE_MS - stamp % WRAP_MS
    return stamp + early + 1 if early >= 0 else stamp
