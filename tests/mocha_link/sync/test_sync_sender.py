"""The serving side: what it gives, in which order, and what it makes of whatever comes."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.sync import frames as sync
from mocha_link.sync import send_queue, sync_messages
from mocha_link.sync.frames import Chunks, SyncFrameError, read_chunks, record_id
from mocha_link.sync.peer_holdings import PeerHoldings
from mocha_link.sync.send_queue import SendQueue
from mocha_link.sync.send_states import SendState
from mocha_link.sync.sync_messages import (
    Digest,
    Done,
    FragmentRequest,
    Have,
    Hello,
    Open,
    Reception,
    Since,
)
from mocha_link.sync.sync_sender import MIN_ROOM, SyncSender
from tests.mocha_link.network import START_MS, Node, Pull, mutated, peer_of


class Served:
    """A sender whose peer sends what the test wants."""

    def __init__(self, node: Node, knowledge=None, *, requests=(), budget=0, peer=None) -> None:
        self.node = node
        self.peer = peer or peer_of(node.database, boot_id=5)
        self.sender = SyncSender(self.peer)
        self.round = -1
        self.open(knowledge or Have(()), requests=requests, budget=budget)

    def deliver(self, kind: int, content: bytes = b"") -> None:
        for frame in sync.message_frames(kind, self.round, content, 1_000):
            self.sender.receive(frame)

    def open(self, knowledge, *, requests=(), budget=0) -> None:
        self.round += 1
        self.deliver(sync.OPEN, Open(77, budget, knowledge, requests).encode())

    def sent(self, room: int = 65_536) -> list:
        """All that it sends now, read."""
        collector = sync.MessageAssembler(sync.HELLO, sync.GROUPS, sync.DONE)
        sent = []
        while frame := self.sender.next(room):
            assert len(frame) <= room
            if frame[0] == sync.CHUNKS:
                sent.append(read_chunks(frame))
            elif message := collector.take(frame):
                assert message.round == self.round
                read = {
                    sync.HELLO: Hello.decode,
                    sync.DONE: Done.decode,
                    sync.GROUPS: sync_messages.decode_groups,
                }
                sent.append(read[message.kind](message.content))
        return sent

    def wholes(self) -> list[int]:
        return [
            message_id
            for each in self.sent()
            if isinstance(each, Chunks)
            for message_id, _ in each.wholes
        ]


@pytest.fixture
def node() -> Node:
    return Node("server")


def test_the_most_urgent_first_then_the_newest(node):
    message_ids = [
        record_id(node.store(0, topic, START_MS + age, priority=priority))
        for topic, (priority, age) in enumerate([(1, 9), (3, 1), (3, 2), (0, 50), (1, 10)])
    ]
    assert Served(node).wholes() == [message_ids[n] for n in (2, 1, 4, 0, 3)]


def test_what_the_peer_has_in_part_comes_before_the_rest_of_its_priority(node):
    urgent = record_id(node.store(0, 0, START_MS, priority=2))
    newer = record_id(node.store(0, 1, START_MS + 9))
    body = node.store(0, 2, START_MS, size=1_000).body
    begun = sync.message_id_of(0, 2, START_MS)
    request = FragmentRequest(begun, len(body), [(100, 150), (900, len(body))])
    served = Served(node, requests=[request])
    _, chunks, done = served.sent()
    assert [message_id for message_id, _ in chunks.wholes] == [urgent, newer]
    assert chunks.pieces == [
        (begun, len(body), 100, body[100:150]),
        (begun, len(body), 900, body[900:]),
    ]
    assert served.sender.messages == 3
    assert done.sequence == node.database.sequence
    served = Served(node, requests=[request])  # in small frames the order is to be seen
    first = [each for each in served.sent(MIN_ROOM) if isinstance(each, Chunks)][:2]
    assert first[0].wholes[0][0] == urgent
    assert next(piece[0] for chunks in first for piece in chunks.pieces) == begun


@pytest.mark.parametrize(("left", "first"), [(30_000, True), (16_000, False)])
def test_one_small_message_comes_before_a_long_rest(node, left, first):
    urgent = record_id(node.store(0, 0, START_MS, priority=2))
    newer = record_id(node.store(0, 1, START_MS + 9, size=3_000))
    small = record_id(node.store(0, 2, START_MS, size=2_000))
    total = len(node.store(0, 3, START_MS, size=40_000).body)
    begun = sync.message_id_of(0, 3, START_MS)
    served = Served(node, requests=[FragmentRequest(begun, total, [(total - left, total)])])
    order = []
    for each in served.sent(MIN_ROOM):
        if isinstance(each, Chunks):
            order += [whole[0] for whole in each.wholes] + [piece[0] for piece in each.pieces]
    order = list(dict.fromkeys(order))
    assert order == ([urgent, small, begun, newer] if first else [urgent, begun, newer, small])


def test_frames_are_filled_but_small_messages_are_not_cut(node):
    for number in range(150):
        node.store(number, 0, START_MS, size=number)
    frames = []
    served = Served(node)
    while frame := served.sender.next(1_000):
        frames.append(frame)
    chunks = [read_chunks(frame) for frame in frames if frame[0] == sync.CHUNKS]
    assert not any(each.pieces for each in chunks)
    assert all(len(frame) > 750 for frame in frames[1:-2])


def test_what_was_not_begun_is_dropped_for_the_newer_version(node):
    node.store(0, 0, START_MS, size=5_000, priority=1)
    node.store(0, 1, START_MS, size=5_000)
    served = Served(node)
    served.sender.next(1_000)
    served.sender.next(1_000)
    newer = [record_id(node.store(0, topic, START_MS + 5)) for topic in (0, 1)]
    pieces = [piece[0] for each in served.sent(1_000)[:-1] for piece in each.pieces]
    assert set(pieces) == {sync.message_id_of(0, 0, START_MS)}
    assert served.sender.messages == 3
    assert len(newer) == 2


def test_what_was_begun_is_finished_in_the_next_contact_though_it_was_replaced(node):
    peer = peer_of(node.database)
    body = node.store(0, 0, START_MS, size=5_000).body
    served = Served(node, peer=peer)
    served.sent(1_000)
    newer = node.store(0, 0, START_MS + 5)
    begun = sync.message_id_of(0, 0, START_MS)
    request = FragmentRequest(begun, len(body), [(2_000, len(body))])
    _, chunks, _ = Served(node, requests=[request], peer=peer).sent()
    assert chunks.pieces == [(begun, len(body), 2_000, body[2_000:])]
    assert chunks.wholes == [(record_id(newer), newer.body)]
    Served(node, peer=peer)  # the peer does not want it any more
    assert peer.holdings.begun(begun) is None


def test_what_is_kept_of_what_was_begun_is_bounded(node):
    holdings = PeerHoldings({}, peer_of(node.database).agreement, begun_bytes=64_000)
    for number in range(6):
        holdings.begin(number, node.store(number, 0, START_MS, size=20_000))
    assert [number for number in range(6) if holdings.begun(number)] == [3, 4, 5]


def test_a_budget_is_never_exceeded(node):
    for number in range(50):
        node.store(number, 0, START_MS, size=500)
    served = Served(node, budget=5_000)
    *_, done = served.sent(1_000)
    assert done.cut_short
    assert served.sender.state is SendState.CUT_SHORT
    assert 4_000 < served.sender.sent_bytes <= 5_000


@pytest.mark.parametrize("of", [(1, 0), (0, 1)])
def test_an_unknown_epoch_or_number_is_answered_with_unknown_and_opened_again(node, of):
    node.store(0, 0, START_MS)
    body = node.store(0, 1, START_MS, size=5_000).body
    request = FragmentRequest(
        sync.message_id_of(0, 1, START_MS), len(body), [(0, 10), (4_000, len(body))]
    )
    since = Since(node.database.epoch + of[0], node.database.sequence + of[1], ())
    served = Served(node, since, requests=[request])
    address_token = served.peer.tokens.next
    assert served.sent() == [Hello(Reception.UNKNOWN, address_token=address_token, boot_id=5)]
    node.store(0, 2, START_MS)
    assert served.sent() == []
    assert served.sender.state is SendState.WAITING
    served.open(Have(()), requests=[request])
    hello, chunks, done = served.sent()
    assert hello.reception is Reception.WELCOME
    assert len(chunks.wholes) == 2
    assert len(chunks.pieces) == 2
    assert (chunks.round, chunks.number, done.frames) == (1, 0, 1)


@pytest.mark.parametrize(("topic_id", "history"), [(0, 1), (3, 3)])
def test_on_a_slow_link_the_queue_holds_no_more_than_the_database(node, topic_id, history):
    """A new version comes before the one before is begun: only what was begun goes to its end."""
    served = Served(node)
    for version in range(30):
        newest = node.store(0, topic_id, START_MS + version, size=9_000)
        served.sender.next(1_100)
    chunks = [each for each in served.sent() if isinstance(each, Chunks)]
    given = {part[0] for each in chunks for part in (*each.wholes, *each.pieces)}
    assert record_id(newest) in given
    assert served.sender.state is SendState.DONE
    assert served.sender.messages <= 30 // 9 + 1 + history


@pytest.mark.parametrize(("topic_id", "history"), [(0, 1), (3, 3)])
def test_a_slow_queue_is_as_long_as_the_history_of_a_topic(node, topic_id, history):
    queue = SendQueue(peer_of(node.database))
    for version in range(30):
        queue.add([node.store(0, topic_id, START_MS + version, size=9_000)])
        queue.fill(1_100, 0, b"", may_be_replaced=True)
        assert len(queue) <= history + 2


def test_what_the_peer_gave_us_is_not_given_back(node):
    peer = peer_of(node.database)
    peer.opened(77)
    record = node.store(0, 0, START_MS)
    peer.holdings.add(record_id(record))
    since = Since(node.database.epoch, 0, ())
    assert Served(node, since, peer=peer).wholes() == []
    assert Served(node, peer=peer).wholes() == [record_id(record)]  # its list is empty


def test_a_peer_that_was_restarted_may_have_lost_what_it_had(node):
    peer = peer_of(node.database)
    peer.opened(76)
    record = node.store(0, 0, START_MS)
    peer.holdings.add(record_id(record))
    since = Since(node.database.epoch, 0, ())
    assert Served(node, since, peer=peer).wholes() == [record_id(record)]


def test_of_topics_with_a_history_older_versions_count_as_well(node):
    message_ids = [record_id(node.store(0, 3, START_MS + version)) for version in range(3)]
    peer = node.peer("asker")
    newer = sync.message_id_of(0, 3, START_MS + 5)
    assert Served(node, Have((newer,)), peer=peer).wholes() == message_ids[::-1]
    both = (newer, newer + 1, newer + 2)
    assert Served(node, Have(both), peer=peer).wholes() == []


def test_a_time_that_was_inferred_is_compared_as_its_header_is(node):
    record = node.store(0, 0, START_MS)
    elsewhere = START_MS + 65_536_000 * 3
    with_time = Have((sync.message_id_of(0, 0, elsewhere + 1),))
    assert Served(node, with_time).wholes() == []
    guessed = Node("other")
    guessed.store(0, 0, START_MS, extrapolated=True)
    # The peer's time may be a wrong guess, so it does not count as newer; the same one counts.
    assert Served(guessed, with_time).wholes() == [record_id(record)]
    assert Served(guessed, Have((sync.message_id_of(0, 0, elsewhere),))).wholes() == []


def pulling_frames(seed: int) -> tuple[Node, list[bytes]]:
    """What a pulling side sends in pulls of all sorts, and who served them."""
    server, asker = Node("server", seed), Node("asker", seed)
    for number in range(30):
        server.store(number % 5, number, START_MS, size=number * 40)
    frames: list[bytes] = []
    for _ in range(2):
        pull = Pull(asker, server)
        frames += pull.up
        pull.deliver_up()
        for _ in range(4):
            pull.give(500)
            pull.deliver()
        frames += pull.up
    digest = Open(1, 0, Digest({n: n for n in range(5)})).encode()
    since = Open(1, 0, Since(server.database.epoch, 3, (1, 2, 3))).encode()
    answer = sync_messages.encode_answers(
        [sync_messages.HeldGroups(n, 0xFFFF, [n << 56]) for n in range(5)]
    )
    for round_, (kind, content) in enumerate(
        [
            (sync.OPEN, since),
            (sync.OPEN, digest),
            (sync.ANSWER, answer),
            (sync.SKIP, sync_messages.encode_skip(1 << 56)),
            (sync.END, b""),
        ]
    ):
        frames += sync.message_frames(kind, min(round_, 1), content, 400)
    return server, frames


@given(st.integers(0, 2**32))
def test_whatever_comes_a_sender_only_raises_frame_errors(seed):
    rng = random.Random(seed)
    server, frames = pulling_frames(0)
    sender = SyncSender(server.peer("asker"))
    for _ in range(40):
        frame = rng.choice(frames)
        frame = frame if rng.random() < 0.3 else mutated(rng, frame)
        try:
            sender.receive(rng.randbytes(rng.randrange(60)) if rng.random() < 0.1 else frame)
        except SyncFrameError:
            continue
        for _ in range(rng.randrange(4)):
            out = sender.next(300)
            assert out is None or len(out) <= 300
    assert len(server.content) == 30


def test_what_was_skipped_in_an_earlier_round_may_be_wanted_now():
    server = Node("server")
    record = server.store(0, 0, START_MS, size=50_000)
    sender = SyncSender(server.peer("asker"))
    for round_ in (0, 1):
        opening = sync_messages.Open(9, 0, sync_messages.Have(())).encode()
        sender.receive(sync.message_frame(sync.OPEN, round_, opening, 0, 1000))
        assert sender.next(1000)
        assert sender.next(1000)
    skip = sync_messages.encode_skip(record_id(record))
    sender.receive(sync.message_frame(sync.SKIP, 0, skip, 0, 1000))
    while sender.next(10_000):
        pass
    assert sender.messages == 1


def test_what_a_peer_that_follows_was_given_is_not_remembered_for_ever(node):
    """It may follow for days; a message beyond those that are remembered may go out twice."""
    queue = SendQueue(peer_of(node.database), remembered=3)
    records = [node.store(number, 2, START_MS) for number in range(10)]
    for _ in range(2):
        queue.add(records)
        queue.fill(65_536, 0, b"", may_be_replaced=False)
    assert queue.messages == 10 + 7


def test_one_message_more_is_not_looked_at_beside_all_that_wait(monkeypatch):
    """What is stored while a long queue leaves joined it one by one, each time all was sorted."""
    looks = 0

    class Rank(int):
        def __and__(self, other):
            nonlocal looks
            looks += 1
            return int(self) & other

        def __lt__(self, other):
            nonlocal looks
            looks += 1
            return int(self) < int(other)

        __hash__ = int.__hash__

    rank = send_queue._rank
    monkeypatch.setattr(send_queue, "_rank", lambda *at, **begun: Rank(rank(*at, **begun)))
    server = Node("server")
    queue = send_queue.SendQueue(peer_of(server.database))
    queue.add([server.store(robot, topic, START_MS) for robot in range(4) for topic in range(256)])
    looks = 0
    for topic in range(256):
        queue.add([server.store(4, topic, START_MS)])
    assert looks < 256 * 32  # 1,280 of them wait at the end
