"""Own messages: throttled by topic, never twice the same header."""

from __future__ import annotations

import pytest

from mocha_link.database import Database, Record
from mocha_link.header import Header
from mocha_link.publisher import Publisher

T = 1_795_175_900.0


@pytest.fixture
def database() -> Database:
    return Database()


@pytest.fixture
def publisher(team, database) -> Publisher:
    return Publisher(team.robot("titan"), team.topics_of("titan"), database)


@pytest.fixture
def slow(team):
    return team.topic("titan", "/slow")  # at most every 5 s


@pytest.fixture
def often(team):
    return team.topic("titan", "/map")


def stored(database, topic) -> bytes | None:
    record = database.newest(2, topic.topic_id)
    return record.body if record else None


def test_an_early_message_waits_and_the_newest_one_is_stored(publisher, database, slow):
    record, now = publisher.publish(slow, b"1", T, at_once=False)
    assert now
    assert record.header == Header.at(2, 1, int(T * 1000))
    assert publisher.publish(slow, b"2", T + 1, at_once=False)[1] is False
    third, _ = publisher.publish(slow, b"3", T + 2, at_once=False)
    assert stored(database, slow) == b"1"
    assert publisher.due(T + 4.9) == []
    assert publisher.due(T + 5) == [third]
    assert third.stamp_s == T + 2  # stamped when it was said, not when it left
    assert stored(database, slow) == b"3"
    assert publisher.due(T + 20) == []
    assert publisher.publish(slow, b"4", T + 10, at_once=False)[1]


def test_at_once_and_flush_do_not_wait(publisher, database, slow):
    publisher.publish(slow, b"1", T, at_once=False)
    publisher.publish(slow, b"2", T + 1, at_once=False)
    assert publisher.publish(slow, b"3", T + 2, at_once=True)[1]
    assert stored(database, slow) == b"3"
    assert publisher.flush(slow, T + 2) is None
    publisher.publish(slow, b"4", T + 3, at_once=False)
    assert publisher.flush(slow, T + 3).body == b"4"
    assert stored(database, slow) == b"4"


def test_a_clock_set_back_holds_nothing_for_ever(publisher, database, slow):
    publisher.publish(slow, b"1", T, at_once=False)
    assert publisher.publish(slow, b"2", T - 1000, at_once=False)[1]
    assert stored(database, slow) == b"2"


def test_two_messages_of_a_topic_never_share_a_header(publisher, often):
    times = (T, T, T, T - 3600, T + 0.001, T)
    headers = [publisher.publish(often, b"x", t, at_once=False)[0].header for t in times]
    assert len(set(headers)) == len(times)
    assert [h.milliseconds for h in headers] == [0, 1, 2, 3, 4, 5]


def test_new_messages_follow_those_from_before_a_restart(publisher, database, often):
    before = Header.at(2, 0, int(T * 1000) + 500)
    database.insert(Record(before, 3, b"old", int(T * 1000) + 500, T), T)
    record, now = publisher.publish(often, b"new", T, at_once=False)
    assert now
    assert record.header == Header.at(2, 0, int(T * 1000) + 501)
    assert stored(database, often) == b"new"


def test_a_message_held_over_a_recovery_still_leaves(publisher, database, slow):
    publisher.publish(slow, b"1", T, at_once=False)
    publisher.publish(slow, b"2", T + 1, at_once=False)
    before = Header.at(2, 1, int(T * 1000) + 90_000)
    database.insert(Record(before, 0, b"old", int(T * 1000) + 90_000, T), T + 2)
    (record,) = publisher.due(T + 5)
    assert record.header == Header.at(2, 1, int(T * 1000) + 90_001)
    assert stored(database, slow) == b"2"


def test_a_recovered_message_does_not_replace_what_was_said_since(publisher, database, often):
    assert publisher.recovered(often, T) is None
    publisher.publish(often, b"new", T, at_once=False)
    assert publisher.recovered(often, T) is None
    before = Header.at(2, 0, int(T * 1000) + 90_000)
    database.insert(Record(before, 3, b"old", int(T * 1000) + 90_000, T), T)
    record = publisher.recovered(often, T + 1)
    assert (record.header, record.body) == (Header.at(2, 0, int(T * 1000) + 90_001), b"new")
    assert stored(database, often) == b"new"
    assert publisher.recovered(often, T + 1) is None
    assert publisher.publish(often, b"3", T + 2, at_once=False)[0].stamp_s == T + 90.002
