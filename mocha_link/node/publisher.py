"""The robot's own messages: their stamps, and the minimum interval between them."""

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
MOST_RECOVERED = 16  # own messages of a topic from before a restart; more are another node's
FULL_BYTES = 64 * 1024  # a batch of this size is stored at once


@dataclass(slots=True)
class _Draft:
    """Messages that are not packed yet, and the stamp that was returned for them."""

    stamp_ms: int  # as returned to the program
    made_s: float  # Unix time
    parts: list[bytes] = field(default_factory=list)  # data, in order
    size: int = 0  # bytes of all parts
    frame: bytes | None = None  # the compressed form of a single part

    def add(self, data: bytes) -> None:
        self.parts.append(data)
        self.size += len(data)


class Publisher:
    """Makes records of the robot's own messages and holds those published too early.

    Args:
        sign: makes the signature of a message of a topic; None: messages are not signed.
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
        self._last_ms: dict[str, int] = {}  # by topic: the last stamp that was returned
        self._stored_s: dict[str, float] = {}  # by topic: Unix time of the last stored message
        self._held: dict[str, _Draft] = {}  # by topic, until its interval has passed
        self._latest: dict[str, tuple[_Draft, Header]] = {}  # by topic: our newest message
        self._overtaken: Counter[str] = Counter()  # by topic: replacements by unknown own messages

    def publish(
        self,
        topic: Topic,
        data: bytes,
        now_s: float,
        *,
        at_once: bool,
        frame: bytes | None = None,
    ) -> tuple[Header, list[Record]]:
        """Publish a message; returns its header, and the records that were stored.

        A message that is published before the topic's interval has passed is held until then. The
        next message replaces it, or joins it if the topic has `aggregate`. `frame` is the result of
        `wire.compress` for the data, if the caller has called it.

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
        # A stamp of a clock that was wrong by more than a century does not count: nodes refuse
        # that message, and every one with a later stamp.
        if newest is not None and is_void(newest.stamp_ms, latest_ms):
            newest = None
        if last_ms is not None and is_void(last_ms, latest_ms):
            last_ms = None
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
        """Store our latest message again if one from before a restart has replaced it.

        A peer may return such a message to us; its stamp is later if our clock was set back. If
        this happens too often, another node publishes under our name. Then ours is not stored
        again, as the other node would do the same.
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
        """Store the held messages whose interval has passed, and return them."""
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
            # One from before a restart has a later stamp. Peers accept ours only if it is newer.
            newest = self._database.newest(self._robot.robot_id, topic.topic_id) or record
            draft.stamp_ms = self._stamp_after(topic, newest, now_s, record.body)
            self._last_ms[topic.name] = draft.stamp_ms
            record = self._record(topic, draft)
            self._database.insert(record, now_s)
        draft.frame = None  # the record has it
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
        # A clock that was set back must not hold a message for longer than the interval.
        return last is None or not 0 <= now_s - last < interval_s

    def _is_shared(self, topic: Topic) -> bool:
        """Whether another node also publishes this robot's topic."""
        return self._overtaken[topic.name] > MOST_RECOVERED

    def _stamp_after(
        self, topic: Topic, earlier: Record, now_s: float, data: bytes | memoryview
    ) -> int:
        """The stamp after a message from before a restart.

        If the clock is behind that message, peers may hold unknown later ones, a millisecond apart,
        and two messages must not have the same header. The stamp is therefore some minutes later,
        by an offset derived from the data.
        """
        if as_ms(now_s) > earlier.stamp_ms or self._is_shared(topic):
            return next_stamp_ms(now_s, earlier.stamp_ms)
        leap_ms = int.from_bytes(blake2b(data, digest_size=8).digest(), "big") % LEAP_MS
        return next_stamp_ms(now_s, earlier.stamp_ms + leap_ms)


def next_stamp_ms(now_s: float, last_ms: int | None) -> int:
    """The stamp of a new message: now, but later than the last one and safe for old nodes."""
    stamp = as_ms(now_s)
    if last_ms is not None:
        stamp = max(stamp, last_ms + 1)
    early = UNSAFE_MS - stamp % WRAP_MS
    return stamp + early + 1 if early >= 0 else stamp
