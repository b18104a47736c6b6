"""Partial messages: pieces in any order make the whole, and nothing is kept beyond the limit."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.store.reassembly_buffer import MAX_RANGES, Partial, Shelf

WHOLE = random.Random(1).randbytes(1_000)


def piece(start: int, end: int) -> memoryview:
    return memoryview(WHOLE)[start:end]


@given(st.lists(st.tuples(st.integers(0, 999), st.integers(1, 400)), max_size=30))
def test_pieces_in_any_order_make_the_whole(pieces):
    partial = Partial(len(WHOLE))
    there = bytearray(len(WHOLE))
    for start, size in pieces:
        end = min(start + size, len(WHOLE))
        partial.add(start, piece(start, end))
        there[start:end] = b"\1" * (end - start)
        assert partial.held == sum(there)
    missing = partial.missing(limit=1_000)
    assert [n for n in range(1_000) if not there[n]] == [
        n for start, end in missing for n in range(start, end)
    ]
    for start, end in missing:
        assert partial.whole() is None
        partial.add(start, piece(start, end))
    assert partial.whole() == WHOLE
    assert partial.missing() == []


@given(st.sets(st.integers(0, 999), max_size=200))
def test_many_gaps_are_asked_for_together(places):
    partial = Partial(1_000)
    for place in places:
        partial.add(place, piece(place, place + 1))
    all_of_them = partial.missing(limit=1_000)
    few = partial.missing()
    assert len(few) == min(len(all_of_them), MAX_RANGES)
    assert all(end < start for (_, end), (start, _) in itertools.pairwise(few))
    for start, end in all_of_them:
        assert any(first <= start and end <= last for first, last in few)
    if all_of_them:
        assert few[0][0] == all_of_them[0][0]
        assert few[-1][1] == all_of_them[-1][1]


def test_the_closest_gaps_are_the_ones_taken_together():
    partial = Partial(1_000)
    partial.add(0, piece(0, 100))
    partial.add(101, piece(101, 102))
    partial.add(500, piece(500, 1_000))
    assert partial.missing() == [(100, 101), (102, 500)]
    assert partial.missing(limit=1) == [(100, 500)]


def test_the_whole_comes_out_once():
    shelf = Shelf()
    assert shelf.add(7, 1_000, 600, piece(600, 1_000)) is None
    assert shelf.add(7, 1_000, 0, piece(0, 600)) == WHOLE
    assert len(shelf) == 0
    assert shelf.cost == 0


def test_the_same_message_of_another_size_is_another_one():
    shelf = Shelf()
    shelf.add(7, 1_000, 0, piece(0, 600))
    assert shelf.add(7, 1_001, 600, piece(600, 1_000)) is None
    assert sorted(partial.total for _, partial in shelf) == [1_000, 1_001]
    shelf.drop(7)
    assert len(shelf) == 0
    assert shelf.cost == 0


def test_those_of_which_most_is_there_come_first():
    shelf = Shelf()
    for long in (1, 2, 3):
        shelf.add(long, 1_000, 0, piece(0, long % 3 * 100 + 1))
    assert [long for long, _ in shelf] == [2, 1, 3]


def test_what_has_not_grown_for_longest_goes():
    shelf = Shelf(limit=4_000)
    for long in (1, 2, 3):
        shelf.add(long, 1_000, 0, piece(0, 400))
    shelf.add(1, 1_000, 400, piece(400, 500))
    shelf.add(4, 1_000, 0, piece(0, 400))
    assert {long for long, _ in shelf} == {1, 3, 4}
    assert shelf.cost <= 4_000


@pytest.mark.parametrize("total", [2, 64 * 1024 * 1024])
def test_memory_grows_with_bytes_and_not_with_totals(total):
    shelf = Shelf(limit=1_000_000)
    for long in range(10_000):
        shelf.add(long, total, total - 1, piece(0, 1))
    assert shelf.cost <= 1_000_000
    assert len(shelf) < 1_300


def test_tiny_pieces_count_for_what_they_take():
    shelf = Shelf(limit=100_000)
    for place in range(0, 1_000, 2):
        shelf.add(1, 1_000, place, piece(place, place + 1))
    assert len(shelf) <= 1
    assert shelf.cost <= 100_000
