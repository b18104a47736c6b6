"""Which transactions bring a backlog to the disk: none is large, and none loses anything."""

from mocha_link.store.changes import PIECE_BYTES, Changes
from mocha_link.store.record import Knowledge, Record
from mocha_link.store.wire import Header

T_MS = 1_795_000_000_000


def record(topic_id: int, size: int) -> Record:
    return Record(Header.at(1, topic_id, T_MS), 0, bytes(size), T_MS, T_MS / 1000)


def key(topic_id: int) -> int:
    return record(topic_id, 1).header.key


def of(found: list[Changes]) -> list[tuple[list[int], list[int]]]:
    return [(sorted(each.puts), sorted(each.drops)) for each in found]


def test_a_little_is_one_transaction():
    changes = Changes(
        drops={1: key(1), 2: key(9)},
        puts={7: record(1, 100), 3: record(2, 100)},
        knowledge={"io": Knowledge(1, 2, 3)},
    )
    (piece,) = changes.pieces()
    assert piece == changes
    changes.settle(piece)
    assert changes == Changes()


def test_a_backlog_is_written_in_order_and_what_was_learnt_with_it_at_last():
    half = PIECE_BYTES // 2
    changes = Changes(
        puts={number: record(number, half) for number in (5, 1, 3, 2)},
        knowledge={"io": Knowledge(1, 2, 3)},
    )
    pieces = changes.pieces()
    assert of(pieces) == [([1], []), ([2], []), ([3], []), ([5], [])]
    assert [each.knowledge for each in pieces] == [{}, {}, {}, {"io": Knowledge(1, 2, 3)}]
    for each in pieces[:2]:
        changes.settle(each)
    assert changes.puts.keys() == {3, 5}
    assert changes.knowledge


def test_messages_go_with_the_last_one_that_replaces_them():
    large = PIECE_BYTES - 4000
    changes = Changes(
        drops={1: key(1), 2: key(2), 3: key(1)},
        puts={10: record(1, 10), 11: record(3, large), 12: record(1, 10), 13: record(2, large)},
    )
    assert of(changes.pieces()) == [([10, 11], []), ([12], [1, 3]), ([13], [2])]


def test_many_that_only_go_are_many_transactions():
    changes = Changes(drops=dict.fromkeys(range(2000), key(1)))
    pieces = changes.pieces()
    assert 3 <= len(pieces) <= 8
    for each in pieces:
        changes.settle(each)
    assert changes == Changes()


def test_a_body_that_is_too_large_is_a_transaction_of_its_own():
    sizes = {1: 10, 2: 3 * PIECE_BYTES, 3: 10}
    changes = Changes(puts={number: record(number, size) for number, size in sizes.items()})
    assert of(changes.pieces()) == [([1], []), ([2], []), ([3], [])]


def test_where_numbers_stand_for_others_all_is_one_transaction():
    """The message that number 1 stood for has another number now, beyond all of ours."""
    changes = Changes(
        drops={1: key(1)},
        puts={1: record(2, PIECE_BYTES), 2: record(3, PIECE_BYTES), 90: record(1, 10)},
    )
    (piece,) = changes.pieces()
    assert piece == changes
    changes.settle(piece)
    assert changes == Changes()


def test_what_was_not_written_waits_with_what_has_come_since():
    earlier = Changes(
        drops={1: key(1), 2: key(2)},
        puts={3: record(1, 10), 4: record(2, 10)},
        knowledge={"io": Knowledge(1, 2, 3), "titan": Knowledge(4, 5, 6)},
    )
    later = Changes(
        drops={3: key(1)}, puts={5: record(1, 20)}, knowledge={"io": Knowledge(1, 7, 3)}
    )
    later.put_back(earlier)
    assert of([later]) == [([4, 5], [1, 2, 3])]
    assert later.knowledge == {"io": Knowledge(1, 7, 3), "titan": Knowledge(4, 5, 6)}
