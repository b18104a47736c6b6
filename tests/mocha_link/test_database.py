"""The database keeps the newest message of every topic, across the wrap of the wire's time."""

from __future__ import annotations

import pytest

from mocha_link.database import Database, Record
from mocha_link.header import WRAP_S, Header, as_ms

WRAP = 27392 * WRAP_S  # a wrap in the year 2026
HOUR = 3600


def record(stamp_s: float, *, robot_id: int = 0, topic_id: int = 0, priority: int = 0) -> Record:
    header = Header.at(robot_id, topic_id, as_ms(stamp_s))
    return Record(header, priority, b"\0\0x", as_ms(stamp_s), stamp_s)


def test_newest_wins():
    database = Database()
    assert database.wants(record(100).header, 100)
    assert database.insert(record(100), 100)
    assert not database.insert(record(99.999), 101)
    assert not database.wants(record(100).header, 101)
    assert database.insert(record(100.001), 101)
    assert database.newest(0, 0) == record(100.001)
    assert database.newest(0, 1) is None


@pytest.mark.parametrize("later", [1, 10 * HOUR, 15 * HOUR, 18 * HOUR, 40 * HOUR])
def test_messages_after_the_wrap_are_taken_at_once(later):
    database = Database()
    database.insert(record(WRAP - 5), WRAP - 4)
    now = WRAP + later
    assert database.wants(record(now).header, now)
    assert database.insert(record(now), now)
    # and the old one, which other robots still carry, does not come back
    assert not database.wants(record(WRAP - 5).header, now) or later > 15 * HOUR


def test_a_clock_that_was_set_back_does_not_block_new_messages():
    database = Database()
    database.insert(record(WRAP), WRAP)
    now = WRAP - 365 * 24 * HOUR
    old = record(WRAP).header.stamp_s(now)
    assert database.wants(Header.at(0, 0, as_ms(old + 1)), now)
    assert not database.wants(Header.at(0, 0, as_ms(old - 1)), now)


def test_records_are_in_priority_order_then_newest():
    database = Database()
    stored = [
        record(10, topic_id=0, priority=1),
        record(11, topic_id=1, priority=1),
        record(5, topic_id=2, priority=3),
        record(11, robot_id=1, topic_id=1, priority=1),
        record(99, topic_id=3, priority=0),
    ]
    for each in stored:
        database.insert(each, 100)
    assert database.records() == tuple(stored[i] for i in (2, 3, 1, 0, 4))
