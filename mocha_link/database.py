"""The newest message of every robot and topic, in memory."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from mocha_link.header import AHEAD_MS, Header


@dataclass(frozen=True, slots=True)
class Record:
    """A message as it is stored and passed on: `body` is what the wire carries, untouched.

    `stamp_s` is the header's time as Unix seconds; `received_s` is when we got or made it.
    """

    header: Header
    priority: int
    body: bytes
    stamp_s: float
    received_s: float


class Database:
    """Records by (robot, topic). Any thread may use it."""

    def __init__(self) -> None:
        self._records: dict[tuple[int, int], Record] = {}
        self._lock = threading.Lock()

    def newest(self, robot_id: int, topic_id: int) -> Record | None:
        """The newest message of a topic of a robot, if there is any."""
        with self._lock:
            return self._records.get((robot_id, topic_id))

    def records(self) -> tuple[Record, ...]:
        """All messages in the order of the wire: most urgent first, then newest first."""
        with self._lock:
            records = list(self._records.values())
        records.sort(key=lambda r: (r.priority, r.stamp_s, r.header.pack()), reverse=True)
        return tuple(records)

    def wants(self, header: Header, now_s: float) -> bool:
        """Whether a message is newer than the stored one of its topic, seen at Unix `now_s`."""
        stored = self.newest(header.robot_id, header.topic_id)
        return stored is None or _newer(header, stored, now_s)

    def insert(self, record: Record, now_s: float) -> bool:
        """Store a message if it is newer than the stored one; says whether it was."""
        key = (record.header.robot_id, record.header.topic_id)
        with self._lock:
            stored = self._records.get(key)
            if stored is not None and not _newer(record.header, stored, now_s):
                return False
            self._records[key] = record
            return True


def _newer(header: Header, stored: Record, now_s: float) -> bool:
    if header == stored.header:
        return False
    stored_s = stored.stamp_s
    if stored_s > now_s + AHEAD_MS / 1000:  # our clock was set back since: see it with today's eyes
        stored_s = stored.header.stamp_s(now_s)
    return header.stamp_s(now_s) > stored_s
