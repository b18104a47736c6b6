"""The pulling side: checks everything that comes, keeps every whole message."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.fleet.network_sim import pair_of
from mocha_link.clock import Instant
from mocha_link.store import wire
from mocha_link.store.wire import Header, PayloadError
from mocha_link.sync.original import MAX_WINDOW, MIN_WINDOW, ClientSession
from mocha_link.sync.peer import Peer
from mocha_link.sync.peer_path import PathMemory
from tests.mocha_link.network import peer_of
from tests.mocha_link.original import packed

NOW_S = 1_795_175_900.0
TOPICS = 200
FIRST_WINDOW = 128  # requests of 512 bytes in 64 KB, as no message has come
TEAM = pair_of(TOPICS)
IO, TITAN = 0, 1


def at(steady_s: float) -> Instant:
    return Instant(NOW_S, steady_s)


def header(topic_id: int, *, robot_id: int = IO, age_s: int = 10) -> Header:
    return Header.at(robot_id, topic_id, int(NOW_S - age_s) * 1000)


def body(data: bytes = b"data", dtype: int = 0) -> bytes:
    return packed(dtype, 0, data)


class Pull:
    """titan's pull from io, with everything that it did so far."""

    def __init__(self, *, peer: Peer | None = None, budget: int = 0, verify: object = None) -> None:
        self.peer = peer or peer_of(team=TEAM, verify=verify)
        self.database = self.peer.node.database
        self.session = ClientSession(self.peer, budget)
        self.open: list[bytes] = []
        self.events: list[object] = []
        self.refusals: list[str] = []
        self.take([self.session.start(at(0))])

    def take(self, frames: list[bytes]) -> None:
        self.open += frames
        self.events += self.peer.log.take_events()
        self.refusals += self.peer.log.take_refusals()

    def answer(self, content: bytes, steady_s: float = 1) -> None:
        """Answer the oldest open request."""
        self.take(self.session.reply([self.open.pop(0)[:6] + content], at(steady_s)))

    def offer(self, *headers: Header | bytes) -> None:
        self.answer(b"".join(h.pack() if isinstance(h, Header) else h for h in headers))

    @property
    def requested(self) -> list[bytes]:
        return [frame[6:] for frame in self.open]


@pytest.fixture
def pull() -> Pull:
    return Pull()


def test_a_window_of_requests_is_under_way(pull):
    headers = [header(i) for i in range(TOPICS)]
    pull.offer(*headers)
    assert pull.requested == [b"GDATA" + h.pack() for h in headers[:FIRST_WINDOW]]
    large = body(random.Random(1).randbytes(20_000))
    for _ in range(FIRST_WINDOW):
        pull.answer(large, steady_s=2)
    for _ in range(20):
        pull.answer(large, steady_s=2)
        assert MIN_WINDOW <= len(pull.open) <= 3 * MIN_WINDOW
    while pull.requested != [b"DENDTtitan"]:
        pull.answer(large, steady_s=3)
    pull.answer(b"Ack")
    assert pull.session.messages == TOPICS
    assert pull.session.bandwidth_bytes_s == TOPICS * (6 + len(large)) / 2
    assert pull.peer.path.rate_bytes_s == pull.session.bandwidth_bytes_s
    assert pull.refusals == []


def test_small_messages_widen_the_window(pull):
    """64 KiB ahead: a link of 300 ms must not wait for a handful of small replies."""
    pull.offer(*[header(i) for i in range(TOPICS)])
    widest = 0
    while pull.requested != [b"DENDTtitan"]:
        pull.answer(body(), steady_s=1)
        assert len(pull.open) <= MAX_WINDOW
        widest = max(widest, len(pull.open))
    assert widest >= 10 * MIN_WINDOW


def test_what_the_last_contact_showed_sets_the_window():
    peer = peer_of(team=TEAM)
    peer.path.measured(1.0)
    peer.path.moved(1e9)
    pull = Pull(peer=peer)
    pull.offer(*[header(i) for i in range(TOPICS)])
    assert len(pull.open) == TOPICS > FIRST_WINDOW


def test_unknown_and_unsafe_headers_are_never_fetched(pull):
    unsafe = Header(IO, 3, 1, 0)
    wrong_ms = Header(IO, 4, 50, 999).pack()[:4] + (1000).to_bytes(2)
    pull.offer(header(TOPICS), header(0, robot_id=2), header(0, robot_id=255), unsafe, wrong_ms)
    assert pull.requested == [b"DENDTtitan"]
    assert len(pull.refusals) == 5
    assert "io has no topic with id 200 in the team file" in " ".join(pull.refusals)
    assert "no robot with topics has id 255 in the team file" in " ".join(pull.refusals)
    assert "original nodes stop for good" in " ".join(pull.refusals)


@pytest.mark.parametrize("content", [b"SERRM", b"1234567", bytes(6 * 65537)])
def test_a_list_that_is_none_ends_the_pull(pull, content):
    pull.answer(content)
    assert pull.session.over
    assert pull.requested == []
    assert pull.session.failure
    assert len(pull.refusals) == 1


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "a body of 0 bytes"),
        (b"\0\0", "a body of 2 bytes"),
        (b"\0\0garbage", "not an LZ4 frame"),
        (body()[:-5], "ends within its LZ4 frame"),
        (body(dtype=7), "type id 7, but /t0 is a/B (0) here"),
        (body() + b"behind", ""),
    ],
)
def test_bodies_are_checked(pull, content, reason):
    pull.offer(header(0))
    pull.answer(content)
    assert pull.requested == [b"DENDTtitan"]
    if reason:
        assert reason in pull.refusals[0]
        assert pull.database.records() == ()
    else:
        assert pull.database.newest(IO, 0).body == content


def cut(pull: Pull) -> None:
    """A part of the message comes, then nothing any more."""
    pull.session.progress(at(1.5))
    pull.session.break_off()


def test_a_message_that_was_cut_lets_the_others_go_first():
    """It was too large for the contact: the next one must not begin with it again."""
    first = Pull()
    first.offer(header(0), header(1), header(2))
    first.answer(body())
    cut(first)
    again = Pull(peer=first.peer)
    again.offer(header(1), header(2), header(3))
    assert again.requested == [b"GDATA" + header(i).pack() for i in (2, 3, 1)]
    cut(again)
    third = Pull(peer=first.peer)
    third.offer(header(1), header(2), header(3))
    assert third.requested == [b"GDATA" + header(i).pack() for i in (3, 1, 2)]
    for _ in range(3):
        third.answer(body())
    assert [third.peer.path.cuts(header(i).key) for i in (1, 2, 3)] == [0, 0, 0]


def test_a_topic_that_is_always_too_large_starves_no_other_though_it_is_new_each_time():
    memory = PathMemory()
    for contact in range(3):
        pull = Pull()
        pull.peer.path = memory
        large = header(1, age_s=100 - contact)
        pull.offer(large, header(2), header(3))
        if contact:
            assert pull.requested == [
                b"GDATA" + each.pack() for each in (header(2), header(3), large)
            ]
            pull.answer(body())
            pull.answer(body())
        cut(pull)
    assert [memory.cuts(header(i).key) for i in (1, 2, 3)] == [3, 0, 0]


def test_what_was_only_requested_when_the_link_broke_keeps_its_place():
    """An urgent message of some bytes is not put behind a map because it was the first to miss."""
    first = Pull()
    first.offer(header(0), header(1))
    first.answer(body())
    first.session.break_off()
    again = Pull(peer=first.peer)
    again.offer(header(1), header(2))
    assert again.requested == [b"GDATA" + header(i).pack() for i in (1, 2)]


def test_nothing_more_is_requested_beyond_the_budget():
    large = body(random.Random(1).randbytes(1_000))
    pull = Pull(budget=3_500)
    pull.offer(*[header(i) for i in range(50)])
    while pull.requested != [b"DENDTtitan"]:
        pull.answer(large)
    pull.answer(b"Ack")
    assert pull.session.cut_short
    # What was under way when the budget was reached still comes: an original peer sends it anyway.
    assert 3 <= pull.session.messages <= 6
    assert pull.session.over


def test_a_message_with_its_full_time(pull):
    """The trailer's time counts, whatever our clock shows; another message's is refused."""
    stamp_ms = 1000 * int(NOW_S - 10 * 86_400) + 7
    own = Header.at(IO, 0, stamp_ms)
    pull.offer(own, header(1))
    pull.answer(wire.pack(0, 0, b"old", stamp_ms=stamp_ms))
    record = pull.database.newest(IO, 0)
    assert (record.stamp_ms, record.extrapolated) == (stamp_ms, False)
    pull.answer(wire.pack(0, 0, b"other", stamp_ms=stamp_ms))
    assert pull.database.newest(IO, 1) is None
    assert "the time of another message" in pull.refusals[0]


def test_messages_that_this_peer_may_not_hand_us():
    def verify(own: Header, content: bytes, trailer: object) -> None:
        assert (content, trailer) == (body(), None)
        if own.topic_id == 1:
            raise PayloadError("not signed")

    pull = Pull(verify=verify)
    pull.offer(header(0), header(1), header(2))
    for _ in range(3):
        pull.answer(body())
    assert pull.requested == [b"DENDTtitan"]
    assert [record.header.topic_id for record in pull.database.records()] == [2, 0]
    assert "not signed" in pull.refusals[0]


@given(
    st.lists(
        st.one_of(
            st.binary(max_size=40),
            st.sampled_from([b"SERRM", b"Ack", b"", body(), header(0).pack() * 2]),
            st.lists(
                st.builds(header, st.integers(0, TOPICS + 1), robot_id=st.integers(0, 3)),
                max_size=6,
            ).map(lambda headers: b"".join(h.pack() for h in headers)),
        ),
        max_size=12,
    )
)
def test_any_replies_leave_only_good_messages(contents):
    pull = Pull()
    for content in contents:
        if not pull.open:
            break
        pull.answer(content)
    for record in pull.database.records():
        assert TEAM.by_ids(record.header.robot_id, record.header.topic_id)
        wire.unpack(record.body)
