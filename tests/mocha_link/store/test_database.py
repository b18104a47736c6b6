"""The database keeps the newest versions of every topic, across the wrap of the wire's time."""

import itertools
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import xor

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mocha_link.store.database import GROUPS, Database, digest
from mocha_link.store.record import Record, follows, today
from mocha_link.store.wire import WRAP_MS, WRAP_S, Header, HeaderError, as_ms, latest_ms

WRAP = 27392 * WRAP_S  # a wrap in the year 2026
HOUR = 3600
YEAR = 365 * 24 * HOUR


def record(stamp_s: float, *, robot_id: int = 0, topic_id: int = 0, priority: int = 0) -> Record:
    header = Header.at(robot_id, topic_id, as_ms(stamp_s))
    return Record(header, priority, b"\0\0x", as_ms(stamp_s), stamp_s)


def guessed(stamp_s: float, now_s: float) -> Record:
    """What an original peer hands over at `now_s`: its stamp is what our clock makes of it."""
    header = record(stamp_s).header
    return replace(record(stamp_s), stamp_ms=header.stamp_ms(now_s), extrapolated=True)


def wants(database: Database, record: Record, now_s: float) -> bool:
    """Whether a message would be stored whose time is known in full."""
    return database.wants(record.header, now_s, record.stamp_ms)


@pytest.mark.parametrize("gap_s", [300, 1200, 2 * HOUR])
@pytest.mark.parametrize("ahead_s", [0, -HOUR, -3 * HOUR, -3 * HOUR - 60, 5 * HOUR, -WRAP, -YEAR])
def test_whatever_our_clock_shows_the_next_message_of_an_original_node_is_newer(ahead_s, gap_s):
    """Also where the border between past and future runs between the two, and over the wrap."""
    database = Database()
    for number, time_s in enumerate(range(WRAP - 20 * HOUR + 7, WRAP + 20 * HOUR, gap_s)):
        now = time_s + ahead_s + (5, 90)[number % 2]  # it comes sooner or later
        each = guessed(time_s, now)
        assert database.wants(each.header, now)
        assert database.wanted(each.header.pack(), now)
        assert database.insert(each, now)
        before = guessed(time_s - gap_s, now)
        assert not database.wants(before.header, now)


def test_the_same_header_is_the_same_message():
    database = Database()
    database.insert(guessed(WRAP, WRAP + YEAR), WRAP + YEAR)
    assert not wants(database, record(WRAP), WRAP)
    assert not database.insert(record(WRAP), WRAP)
    assert wants(database, record(WRAP + 1), WRAP + 1)  # with today's eyes, older by the stamp
    assert not wants(database, record(WRAP - 1), WRAP + 1)
    assert database.insert(record(WRAP + 1), WRAP + 1)


def test_a_stamp_that_is_not_the_header_s_time_is_not_taken():
    database = Database()
    good = record(100)
    assert not database.insert(replace(good, stamp_ms=100_001), 100)
    assert not database.insert(replace(good, stamp_ms=100_000 - WRAP_MS), 100)
    assert not database.insert(replace(good, stamp_ms=100_000 + WRAP_MS * 2_200_000), 100)
    assert not database.insert(replace(good, received_s=float("nan")), 100)
    assert database.kept() == ()


# What a database does, as plainly as it can be: sort, cut, compare. For full stamps.


@dataclass
class Model:
    depth: int
    kept: list[Record] = field(default_factory=list)  # as they came

    def insert(self, record):
        if any(each.header == record.header for each in self.kept):
            return False
        newest = self.history(record, [*self.kept, record])[: self.depth]
        if record not in newest:
            return False
        rest = [each for each in self.kept if topic(each) != topic(record) or each in newest]
        self.kept = [*rest, record]
        return True

    @staticmethod
    def history(record, records):
        versions = [each for each in records if topic(each) == topic(record)]
        return sorted(versions, key=lambda each: each.stamp_ms, reverse=True)

    def records(self):
        newest = {self.history(each, self.kept)[0].header for each in self.kept}
        return sorted(
            (each for each in self.kept if each.header in newest),
            key=lambda each: (each.priority, each.stamp_ms, each.header.pack()),
            reverse=True,
        )


def topic(record):
    return record.header.robot_id, record.header.topic_id


TOPICS = st.sampled_from([(0, 0), (0, 1), (0, 17), (3, 1), (255, 255)])
# Close together, around a wrap, a few wraps apart: collisions of headers included.
STAMPS_MS = st.builds(
    lambda wraps, offset: (27392 + wraps) * WRAP_MS + offset,
    st.integers(-2, 2),
    st.integers(-3, 3) | st.integers(-WRAP_MS // 2, WRAP_MS // 2),
)
CLOCK_S = st.sampled_from([0, WRAP - YEAR, WRAP, WRAP + 16 * HOUR, WRAP + YEAR])


def made(topic, priority, stamp_ms):
    return Record(Header.at(*topic, stamp_ms), priority, b"\0\0x", stamp_ms, 0.0)


RECORDS = st.builds(made, TOPICS, st.integers(0, 3), STAMPS_MS)


@given(
    st.integers(1, 3),
    st.lists(st.tuples(RECORDS, CLOCK_S, st.booleans()), max_size=40),
    st.lists(RECORDS, max_size=20),
)
def test_the_indexes_agree_with_a_plain_model(depth, inserts, others):
    database = Database(dict.fromkeys(range(1 << 16), depth))
    model = Model(depth)
    numbers = {}
    for each, now_s, looked_at in inserts:
        expected = model.insert(each)
        assert wants(database, each, now_s) == expected
        assert database.insert(each, now_s) == expected
        if expected:
            numbers[each.header] = database.sequence
        if looked_at:  # the wire order is kept up to date, or made anew
            assert database.records() == tuple(model.records())
    assert database.records() == tuple(model.records())
    assert database.header_list() == b"".join(r.header.pack() for r in model.records())
    assert database.kept() == tuple(model.kept)
    for number in range(database.sequence + 1):
        late = [each for each in model.kept if numbers[each.header] > number]
        assert database.since(number) == late
        assert database.numbered_since(number) == [(numbers[r.header], r) for r in late]
    snapshot = database.snapshot()
    assert {raw: each.record for raw, each in snapshot.items()} == {
        each.header.pack(): each for each in model.kept
    }
    for each in others:
        versions = model.history(each, model.kept)
        assert database.history(*topic(each)) == tuple(versions)
        assert database.newest(*topic(each)) == (versions[0] if versions else None)
        found = [kept for kept in model.kept if kept.header == each.header]
        assert database.get(each.header) == (found[0] if found else None)
        would = Model(depth, list(model.kept)).insert(each)
        assert wants(database, each, 0) == would
    check_digests(database, model.kept)


def check_digests(database, kept):
    robots = {each.header.robot_id for each in kept}
    assert set(database.digests()) == robots
    for robot_id in {*robots, 9}:
        groups = [[r for r in kept if group_of(r) == (robot_id, g)] for g in range(GROUPS)]
        expected = tuple(reduce(xor, (digest(r.header.pack()) for r in g), 0) for g in groups)
        assert database.group_digests(robot_id) == expected
        assert database.digests().get(robot_id, 0) == reduce(xor, expected)
        for number, group in enumerate(groups):
            found = database.headers_in(robot_id, number)
            assert sorted(found, key=repr) == sorted(group, key=repr)


def group_of(record):
    return record.header.robot_id, record.header.topic_id % GROUPS


AGES_S = st.sampled_from([WRAP, WRAP + 200 * YEAR])


@given(
    st.integers(1, 3),
    st.lists(st.tuples(TOPICS, AGES_S, st.integers(0, 40_000), AGES_S), max_size=30),
)
def test_messages_of_a_clock_that_was_centuries_ahead_give_way_when_it_is_right(depth, inserts):
    database = Database(dict.fromkeys(range(1 << 16), depth))
    model = Model(depth)
    for ids, stamp_s, offset_s, now_s in inserts:
        each = made(ids, 1, round((stamp_s + offset_s) * 1000))
        if stamp_s <= now_s == WRAP:  # it is of a time that nodes take: what none takes is gone
            model.kept = [
                old for old in model.kept if topic(old) != ids or old.stamp_s < WRAP + 100 * YEAR
            ]
        assert database.insert(each, now_s) == model.insert(each)
        assert database.records() == tuple(model.records())
        assert database.kept() == tuple(model.kept)
    check_digests(database, model.kept)


@given(
    st.integers(1, 3),
    st.lists(st.tuples(RECORDS, CLOCK_S, st.booleans()), max_size=30),
    st.lists(RECORDS.map(lambda r: r.header.pack()) | st.binary(min_size=6, max_size=6)),
    CLOCK_S,
)
@example(1, [(made((0, 0), 0, WRAP * 1000), WRAP + YEAR, True)], [], 0)
def test_what_is_wanted_would_be_stored_whatever_the_clock_does(depth, inserts, headers, now_s):
    database = Database(dict.fromkeys(range(1 << 16), depth))
    for each, then_s, from_original in inserts:
        taken = each
        if from_original:
            taken = replace(each, stamp_ms=each.header.stamp_ms(then_s), extrapolated=True)
            would = database.wants(each.header, then_s)
        else:
            would = wants(database, each, then_s)
        assert database.insert(taken, then_s) == would
        assert not database.insert(taken, then_s)
    check_digests(database, database.kept())
    assert len(database.records()) == len({topic(r) for r in database.kept()})
    expected = {}
    for raw in headers:
        try:
            header = Header.parse(raw)
        except HeaderError:
            continue
        before = expected.get(raw[:2])
        if database.wants(header, now_s) and (
            before is None or header.stamp_ms(now_s) > before.stamp_ms(now_s)
        ):
            expected[raw[:2]] = header
    possible = b"".join(raw for raw in headers if int.from_bytes(raw[4:]) < 1000)
    assert database.wanted(possible, now_s) == [h.pack() for h in expected.values()]


@given(STAMPS_MS, STAMPS_MS, CLOCK_S | st.integers(0, 3 * WRAP))
def test_two_nodes_with_the_same_clock_agree_which_one_is_newer(one, other, now_s):
    latest = latest_ms(now_s)
    if (one - other) % WRAP_MS:
        assert follows(one, other, latest) != follows(other, one, latest)
    else:
        assert follows(one, other, latest) == (today(one, latest) > today(other, latest))


def test_a_clock_that_was_never_set_takes_the_shorter_way_round():
    for now_s, earlier_h, later_h in itertools.product((0, 12 * HOUR, YEAR), range(18), (1, 5, 9)):
        earlier_ms, apart_ms = earlier_h * HOUR * 1000, later_h * HOUR * 1000
        assert follows((earlier_ms + apart_ms) % WRAP_MS, earlier_ms, latest_ms(now_s))


def test_long_lists_agree_with_single_questions():
    now = WRAP + HOUR
    database = Database()
    for key in range(2000):
        database.insert(record(WRAP + key % 700, robot_id=key >> 8, topic_id=key & 255), now)
    database.header_list()
    for key in range(0, 2000, 3):  # few enough, and then too many, to be moved one by one
        database.insert(record(WRAP + 800 + key, robot_id=key >> 8, topic_id=key & 255), now)
        if key % 60 == 0:
            assert len(database.header_list()) == 2000 * 6
    expected = sorted(database.kept(), key=lambda r: (r.stamp_ms, r.header.pack()), reverse=True)
    assert database.records() == tuple(expected)
    offered = [
        record(WRAP + key % 1700, robot_id=key >> 8, topic_id=key & 255).header
        for key in range(2100)
    ]
    wanted = database.wanted(b"".join(header.pack() for header in offered), now)
    assert wanted == [header.pack() for header in offered if database.wants(header, now)]
    assert 100 < len(wanted) < 2000
