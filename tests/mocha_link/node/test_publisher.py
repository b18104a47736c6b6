"""Own messages: throttled by topic, never twice the same header."""

import pytest

from mocha_link.node import publisher as publishing
from mocha_link.node.publisher import LEAP_MS, MOST_RECOVERED, Publisher
from mocha_link.store import wire
from mocha_link.store.database import Database
from mocha_link.store.message import unpack_batch
from mocha_link.store.record import Record
from mocha_link.store.wire import Header, PayloadError

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


def ids_of(record: Record) -> tuple[int, int]:
    return (record.header.robot_id, record.header.topic_id)


def stored(database, topic) -> bytes | None:
    """The data of the newest message of a topic of titan."""
    record = database.newest(2, topic.topic_id)
    return wire.unpack(record.body) if record else None


def own(topic, stamp_ms: int, data: bytes) -> Record:
    """A message of titan from before a restart."""
    body = wire.pack(topic.dtype, topic.priority, data, stamp_ms=stamp_ms)
    return Record(Header.at(2, topic.topic_id, stamp_ms), topic.priority, body, stamp_ms, T)


def test_an_early_message_waits_and_the_newest_one_is_stored(publisher, database, slow):
    header, (record,) = publisher.publish(slow, b"1", T, at_once=False)
    assert header == record.header == Header.at(2, 1, int(T * 1000))
    assert publisher.publish(slow, b"2", T + 1, at_once=False)[1] == []
    third, nothing = publisher.publish(slow, b"3", T + 2, at_once=False)
    assert nothing == []
    assert stored(database, slow) == b"1"
    assert publisher.due(T + 4.9) == []
    (record,) = publisher.due(T + 5)
    assert record.header == third
    assert record.stamp_s == T + 2  # stamped when it was published, not when it left
    assert stored(database, slow) == b"3"
    assert publisher.due(T + 20) == []
    assert publisher.publish(slow, b"4", T + 10, at_once=False)[1]


def test_a_clock_set_back_holds_nothing_for_ever(publisher, database, slow):
    publisher.publish(slow, b"1", T, at_once=False)
    assert publisher.publish(slow, b"2", T - 1000, at_once=False)[1]
    assert stored(database, slow) == b"2"


def test_new_messages_follow_those_from_before_a_restart(publisher, database, often):
    database.insert(own(often, int(T * 1000) + 500, b"old"), T)
    header, (record,) = publisher.publish(often, b"new", T, at_once=False)
    assert header == record.header == Header.at(2, 0, record.stamp_ms)
    assert 0 < record.stamp_ms - int(T * 1000) - 500 <= LEAP_MS
    assert stored(database, often) == b"new"


def test_a_message_held_over_a_recovery_still_leaves(publisher, database, slow):
    publisher.publish(slow, b"1", T, at_once=False)
    publisher.publish(slow, b"2", T + 1, at_once=False)
    database.insert(own(slow, int(T * 1000) + 90_000, b"old"), T + 2)
    (record,) = publisher.due(T + 5)
    assert record.header == Header.at(2, 1, record.stamp_ms)
    assert 0 < record.stamp_ms - int(T * 1000) - 90_000 <= LEAP_MS
    assert wire.check(record.body, ids_of(record)).stamp_ms == record.stamp_ms
    assert stored(database, slow) == b"2"


def test_a_recovered_message_does_not_replace_what_was_published_since(publisher, database, often):
    assert publisher.recovered(often, T) is None
    publisher.publish(often, b"new", T, at_once=False)
    assert publisher.recovered(often, T) is None
    database.insert(own(often, int(T * 1000) + 90_000, b"old"), T)
    record = publisher.recovered(often, T + 1)
    assert record.header == Header.at(2, 0, record.stamp_ms)
    assert 0 < record.stamp_ms - int(T * 1000) - 90_000 <= LEAP_MS
    assert wire.check(record.body, ids_of(record)).stamp_ms == record.stamp_ms
    assert stored(database, often) == b"new"
    assert publisher.recovered(often, T + 1) is None
    (another,) = publisher.publish(often, b"3", T + 2, at_once=False)[1]
    assert another.stamp_ms == record.stamp_ms + 1


def test_two_robots_of_the_same_name_do_not_drive_their_stamps_ahead(team, often, caplog):
    """Each receives the other's message, which is newer, and has the newest one in turn."""
    ends = []
    for number in range(2):
        database = Database()
        publisher = Publisher(team.robot("titan"), team.topics_of("titan"), database)
        publisher.publish(often, b"of node %d" % number, T + number, at_once=False)
        ends.append((publisher, database))
    for second in range(100):
        for (_, source), (publisher, database) in (ends, ends[::-1]):
            database.insert(source.newest(2, often.topic_id), T + second)
            publisher.recovered(often, T + second)
            if second > 50:  # and now they publish something, too
                header, _ = publisher.publish(often, b"%d" % second, T + second, at_once=False)
                assert header == database.newest(2, often.topic_id).header
    newest_ms = max(database.newest(2, often.topic_id).stamp_ms for _, database in ends)
    assert newest_ms - T * 1000 <= 2 * (MOST_RECOVERED + 1) * LEAP_MS
    assert caplog.text.count("another node publishes titan's topic /map") == 2  # of each one


def test_lives_with_a_wrong_clock_do_not_make_the_same_header(team, often):
    """A peer has the first life's second message, which the second life does not know of."""
    headers = set()
    for _ in range(2):
        database = Database()
        database.insert(own(often, int(T * 1000), b"known to all"), T)
        publisher = Publisher(team.robot("titan"), team.topics_of("titan"), database)
        for number in range(20):
            data = b"%d %d" % (len(headers), number)
            headers.add(publisher.publish(often, data, 100.0, at_once=False)[0])
    assert len(headers) == 40


def test_too_large_a_message_is_refused_before_anything(publisher, database, slow, monkeypatch):
    monkeypatch.setattr(wire, "MAX_BYTES", 100)
    with pytest.raises(PayloadError, match="101 bytes; at most 100"):
        publisher.publish(slow, bytes(101), T, at_once=False)
    assert publisher.due(T + 100) == []
    assert publisher.publish(slow, b"1", T, at_once=False)[0] == Header.at(2, 1, int(T * 1000))


def test_the_signer_gets_the_bytes_and_its_signature_is_in_the_trailer(team, database, often):
    signed: list[bytes] = []

    def sign(topic, covered: bytes) -> bytes:
        signed.append(topic.name.encode() + covered)
        return bytes([topic.topic_id]) * 64

    titan = team.robot("titan")
    publisher = Publisher(titan, team.topics_of("titan"), database, sign)
    _, (record,) = publisher.publish(often, b"grid", T, at_once=False)
    assert wire.check(record.body, ids_of(record)).signature == bytes(64)
    assert len(signed) == 1
    assert signed[0].startswith(b"/map")


# --- several messages in one: topics with `aggregate`


@pytest.fixture
def gathered(often):
    return often.model_copy(update={"name": "/gathered", "aggregate": True, "min_interval_s": 5.0})


@pytest.fixture
def gatherer(team, database, gathered) -> Publisher:
    return Publisher(team.robot("titan"), (gathered,), database)


def parts(database, topic) -> tuple[bytes, ...]:
    return unpack_batch(stored(database, topic))


def test_early_messages_wait_together(gatherer, database, gathered):
    """None is lost: they leave as one, with the time of the last one."""
    gatherer.publish(gathered, b"1", T, at_once=False)
    assert parts(database, gathered) == (b"1",)
    for second, data in enumerate((b"2", b"", b"4"), 1):
        header, nothing = gatherer.publish(gathered, data, T + second, at_once=False)
        assert nothing == []
    (record,) = gatherer.due(T + 5)
    assert parts(database, gathered) == (b"2", b"", b"4")
    assert (record.header, record.stamp_s) == (header, T + 3)
    gatherer.publish(gathered, b"5", T + 6, at_once=False)
    assert gatherer.flush(gathered, T + 6)
    assert parts(database, gathered) == (b"5",)
    gatherer.publish(gathered, b"6", T + 7, at_once=False)
    gatherer.publish(gathered, b"7", T + 8, at_once=True)
    assert parts(database, gathered) == (b"6", b"7")


def test_what_no_batch_can_hold_is_refused_at_once(gatherer, database, gathered, monkeypatch):
    """It was promised a header, and lost when its interval was over."""
    monkeypatch.setattr(wire, "MAX_BYTES", 100)
    gatherer.publish(gathered, b"1", T, at_once=False)
    with pytest.raises(PayloadError, match="101 bytes"):
        gatherer.publish(gathered, bytes(97), T + 1, at_once=False)
    gatherer.publish(gathered, bytes(96), T + 1, at_once=False)
    assert gatherer.due(T + 5)
    assert parts(database, gathered) == (bytes(96),)


def test_a_full_batch_does_not_wait(gatherer, database, gathered):
    half = bytes(publishing.FULL_BYTES // 2)
    gatherer.publish(gathered, b"first", T, at_once=False)
    gatherer.publish(gathered, half, T + 1, at_once=False)
    gatherer.publish(gathered, half, T + 1, at_once=False)
    header, (record,) = gatherer.publish(gathered, b"more", T + 1, at_once=False)
    assert parts(database, gathered) == (half, half)
    assert record.header != header  # what is returned is the header that this one will have
    (record,) = gatherer.due(T + 6)
    assert record.header == header
    assert parts(database, gathered) == (b"more",)
