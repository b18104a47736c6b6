"""What the robot itself has to say: stamps, and how often a topic may enter the database."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from mocha_link.database import Database, Record
from mocha_link.header import Header, next_stamp_ms

if TYPE_CHECKING:
    from mocha_link.team import Robot, Topic


class Publisher:
    """Makes records of the robot's own messages and holds those that come too early."""

    def __init__(self, robot: Robot, topics: tuple[Topic, ...], database: Database) -> None:
        self._robot = robot
        self._topics = {topic.name: topic for topic in topics}
        self._database = database
        self._last_ms: dict[str, int] = {}
        self._stored_s: dict[str, float] = {}
        self._held: dict[str, Record] = {}
        self._latest: dict[str, Record] = {}

    def publish(
        self, topic: Topic, body: bytes, now_s: float, *, at_once: bool
    ) -> tuple[Record, bool]:
        """The record of a new message, and whether it was stored now or is held.

        A message that is held is replaced by the next one, and stored when the topic's interval
        since the last stored one is over. `body` is made by `payload.pack`.
        """
        last_ms = self._last_ms.get(topic.name)
        recovered = self._database.newest(self._robot.robot_id, topic.topic_id)
        if recovered is not None:  # it may come from a peer, from before a restart
            last_ms = max(last_ms or 0, recovered.stamp_ms)
        stamp_ms = self._last_ms[topic.name] = next_stamp_ms(now_s, last_ms)
        header = Header.at(self._robot.robot_id, topic.topic_id, stamp_ms)
        record = Record(header, topic.priority, body, stamp_ms, received_s=now_s)
        self._held[topic.name] = record
        due = at_once or self._is_due(topic.name, now_s)
        return record, due and self.flush(topic, now_s) is not None

    def flush(self, topic: Topic, now_s: float) -> Record | None:
        """Store the held message of a topic, if there is one, and return it."""
        record = self._held.pop(topic.name, None)
        if record is None:
            return None
        self._stored_s[topic.name] = now_s
        return self._store(topic, record, now_s)

    def recovered(self, topic: Topic, now_s: float) -> Record | None:
        """Store our latest message anew if one from before a restart has replaced it.

        A peer hands that back to us; it has the later stamp if our clock is behind what it was.
        """
        latest = self._latest.get(topic.name)
        newest = self._database.newest(self._robot.robot_id, topic.topic_id)
        if latest is None or newest is None or newest.header == latest.header:
            return None
        return self._store(topic, latest, now_s)

    def _store(self, topic: Topic, record: Record, now_s: float) -> Record:
        newest = self._database.newest(self._robot.robot_id, topic.topic_id)
        if not self._database.insert(record, now_s) and newest:
            # From before a restart, with a later stamp. Ours must follow it to be taken by anyone.
            stamp_ms = self._last_ms[topic.name] = next_stamp_ms(now_s, newest.stamp_ms)
            header = Header.at(self._robot.robot_id, topic.topic_id, stamp_ms)
            record = replace(record, header=header, stamp_ms=stamp_ms)
            self._database.insert(record, now_s)
        self._latest[topic.name] = record
        return record

    def due(self, now_s: float) -> list[Record]:
        """Store the held messages whose interval is over, and return them."""
        names = [name for name in self._held if self._is_due(name, now_s)]
        records = (self.flush(self._topics[name], now_s) for name in names)
        return [record for record in records if record is not None]

    def _is_due(self, name: str, now_s: float) -> bool:
        last = self._stored_s.get(name)
        interval_s = self._topics[name].min_interval_s
        # A clock that was set back must not hold a message until it comes round again.
        return last is None or not 0 <= now_s - last < interval_s
