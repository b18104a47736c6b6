"""Partial messages: pieces in any order make the whole, and nothing is kept beyond the limit."""

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.datagram.datagram import PACKET_BYTES
from mocha_link.store import reassembly_buffer
from mocha_link.store.reassembly_buffer import (
    MAX_RANGES,
    SLOW_S,
    STALL_S,
    Fragment,
    ReassemblyBuffer,
)
from mocha_link.store.wire import MAX_BODY_BYTES

WHOLE = random.Random(1).randbytes(1_000)


def piece(start: int, end: int) -> memoryview:
    return memoryview(WHOLE)[start:end]


@given(st.lists(st.tuples(st.integers(0, 999), st.integers(1, 400)), max_size=30))
def test_pieces_in_any_order_make_the_whole(pieces):
    fragment = Fragment(len(WHOLE))
    there = bytearray(len(WHOLE))
    for start, size in pieces:
        end = min(start + size, len(WHOLE))
        fragment.add(start, piece(start, end))
        there[start:end] = b"\1" * (end - start)
        assert fragment.held == sum(there)
    missing = fragment.missing(limit=1_000)
    assert [n for n in range(1_000) if not there[n]] == [
        n for start, end in missing for n in range(start, end)
    ]
    for start, end in missing:
        assert fragment.whole() is None
        fragment.add(start, piece(start, end))
    assert fragment.whole() == WHOLE
    assert fragment.missing() == []


@given(st.sets(st.integers(0, 999), max_size=200))
def test_many_gaps_are_requested_together(places):
    fragment = Fragment(1_000)
    for place in places:
        fragment.add(place, piece(place, place + 1))
    all_of_them = fragment.missing(limit=1_000)
    few = fragment.missing()
    assert len(few) == min(len(all_of_them), MAX_RANGES)
    assert all(end < start for (_, end), (start, _) in itertools.pairwise(few))
    for start, end in all_of_them:
        assert any(first <= start and end <= last for first, last in few)
    if all_of_them:
        assert few[0][0] == all_of_them[0][0]
        assert few[-1][1] == all_of_them[-1][1]


def test_the_closest_gaps_are_the_ones_taken_together():
    fragment = Fragment(1_000)
    fragment.add(0, piece(0, 100))
    fragment.add(101, piece(101, 102))
    fragment.add(500, piece(500, 1_000))
    assert fragment.missing() == [(100, 101), (102, 500)]
    assert fragment.missing(limit=1) == [(100, 500)]


def test_the_same_message_of_another_size_is_another_one():
    reassembly = ReassemblyBuffer()
    reassembly.add(7, 1_000, 0, piece(0, 600))
    assert reassembly.add(7, 1_001, 600, piece(600, 1_000)) is None
    assert sorted(fragment.total for _, fragment in reassembly.of("io")) == [1_000, 1_001]
    reassembly.drop(7)
    assert len(reassembly) == 0
    assert reassembly.cost == 0


def test_those_of_which_most_is_there_come_first():
    reassembly = ReassemblyBuffer()
    for message_id in (1, 2, 3):
        reassembly.add(message_id, 1_000, 0, piece(0, message_id % 3 * 100 + 1))
    assert [message_id for message_id, _ in reassembly.of("io")] == [2, 1, 3]


def test_what_has_not_grown_for_longest_goes():
    reassembly = ReassemblyBuffer(limit=4_000)
    for message_id in (1, 2, 3):
        reassembly.add(message_id, 1_000, 0, piece(0, 400))
    reassembly.add(1, 1_000, 400, piece(400, 500))
    reassembly.add(4, 1_000, 0, piece(0, 400))
    assert {message_id for message_id, _ in reassembly.of("io")} == {1, 3, 4}
    assert reassembly.cost <= 4_000


@pytest.mark.parametrize("total", [2, 64 * 1024 * 1024])
def test_memory_grows_with_bytes_and_not_with_totals(total):
    reassembly = ReassemblyBuffer(limit=1_000_000)
    for message_id in range(10_000):
        reassembly.add(message_id, total, total - 1, piece(0, 1))
    assert reassembly.cost <= 1_000_000
    assert len(reassembly) < 1_300


def test_there_are_not_more_than_a_pull_can_look_at():
    reassembly = ReassemblyBuffer()
    for message_id in range(10_000):
        reassembly.add(message_id, 2, 0, piece(0, 1))
    assert len(reassembly) <= 4_096


def test_tiny_pieces_count_for_what_they_take():
    reassembly = ReassemblyBuffer(limit=100_000)
    for place in range(0, 1_000, 2):
        reassembly.add(1, 1_000, place, piece(place, place + 1))
    assert len(reassembly) <= 1
    assert reassembly.cost <= 100_000


def test_a_message_in_too_many_pieces_begins_anew(monkeypatch):
    """Each would take longer than the one before; and who brings it well must not find it full."""
    monkeypatch.setattr(reassembly_buffer, "MAX_SEGMENTS", 100)
    reassembly = ReassemblyBuffer()
    for place in range(0, 998, 2):
        reassembly.add(1, 1_000, place, piece(place, place + 1), "hostile")
        ((_, fragment),) = reassembly.of("hostile")
        assert fragment.held <= 100
        assert reassembly.cost == fragment.cost
    assert fragment.held == 499 % 100
    whole = None
    while whole is None:
        ((_, fragment),) = reassembly.of("other")
        start, end = fragment.missing()[0]
        whole = reassembly.add(1, 1_000, start, piece(start, end), "other")
    assert whole == WHOLE


def test_the_largest_message_comes_whole_though_every_second_datagram_is_late():
    """Late pieces are parts of their own between the others, which are there already."""
    total, size = MAX_BODY_BYTES, PACKET_BYTES - 100
    fragment = Fragment(total)
    data = bytes(size)
    for first in (0, size):
        for start in range(first, total, 2 * size):
            fragment.add(start, memoryview(data)[: total - start], "io" if first else "titan")
    assert fragment.held == total


@given(st.lists(st.tuples(st.integers(0, 999), st.integers(1, 400), st.sampled_from("abc"))))
def test_it_is_known_who_has_brought_what(pieces):
    fragment = Fragment(len(WHOLE))
    there = [""] * len(WHOLE)
    for start, size, peer in pieces:
        end = min(start + size, len(WHOLE))
        fragment.add(start, piece(start, end), peer)
        there[start:end] = [old or peer for old in there[start:end]]
    for peer, part in fragment.split().items():
        lacking = {n for start, end in part.missing(limit=1_000) for n in range(start, end)}
        assert [n for n in range(1_000) if n not in lacking] == [
            n for n in range(1_000) if there[n] == peer
        ]
    assert sum(part.held for part in fragment.split().values()) == fragment.held


def test_what_makes_a_wrong_message_is_kept_apart_by_who_brought_it():
    reassembly = ReassemblyBuffer()
    reassembly.add(7, 1_000, 0, memoryview(bytes(100)), "bad")
    assert reassembly.add(7, 1_000, 100, piece(100, 1_000), "good")
    assert reassembly.fail(7)
    assert [each.missing() for _, each in reassembly.of("good")] == [[(0, 100)]]
    assert [each.missing() for _, each in reassembly.of("bad")] == [[(100, 1_000)]]
    assert reassembly.of("other") == []
    reassembly.add(7, 1_000, 0, memoryview(bytes(500)), "bad")
    reassembly.add(7, 1_000, 0, memoryview(bytes(999)), "other")
    assert reassembly.add(7, 1_000, 0, piece(0, 100), "good") == WHOLE
    reassembly.drop(7)
    assert (len(reassembly), reassembly.cost) == (0, 0)


def test_what_one_peer_alone_has_brought_goes_if_it_is_wrong():
    reassembly = ReassemblyBuffer()
    reassembly.add(7, 1_000, 0, piece(0, 400), "bad")
    reassembly.add(7, 1_000, 400, piece(400, 1_000), "bad")
    assert not reassembly.fail(7)
    assert (len(reassembly), reassembly.cost) == (0, 0)


def test_a_message_comes_from_one_peer_at_a_time():
    reassembly = ReassemblyBuffer()
    assert reassembly.assign(7, "io", 0.0)
    assert not reassembly.assign(7, "titan", STALL_S - 0.1)
    assert reassembly.elsewhere("titan", 0.1) == {7}
    assert reassembly.elsewhere("io", 0.1) == set()
    assert reassembly.assign(7, "titan", STALL_S)  # io has stalled
    for tenth in range(50):
        assert reassembly.assign(7, "titan", STALL_S + tenth / 10)
        assert not reassembly.assign(7, "io", STALL_S + tenth / 10)
    assert reassembly.assign(7, "io", STALL_S + SLOW_S)  # titan is slow
    reassembly.drop(7)
    assert reassembly.assign(7, "titan", STALL_S + SLOW_S)
    reassembly.release("io")
    assert not reassembly.assign(7, "io", STALL_S + SLOW_S)
    reassembly.release("titan")
    assert reassembly.assign(7, "io", STALL_S + SLOW_S)


def test_who_brings_what_is_forgotten_before_it_takes_memory():
    reassembly = ReassemblyBuffer()
    for message_id in range(10_000):
        assert reassembly.assign(message_id, "io", 0.0)
    assert len(reassembly.elsewhere("titan", 0.0)) <= 1_024


def test_as_much_as_may_be_kept_is_kept():
    needs = ReassemblyBuffer()
    needs.add(7, 5000, 0, memoryview(bytes(1000)))
    for limit, kept in ((needs.cost, 1), (needs.cost - 1, 0)):
        buffer = ReassemblyBuffer(limit)
        buffer.add(7, 5000, 0, memoryview(bytes(1000)))
        assert len(buffer) == kept
