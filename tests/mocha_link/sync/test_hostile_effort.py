"""How much a node does for one frame of a hostile peer: counted, not timed.

While a frame is taken in, the node does nothing else, and a program that publishes waits.
"""

import struct
import sys

import pytest

from benchmarks.fleet.network_sim import team_of
from mocha_link.store.database import GROUPS, Database
from mocha_link.store.record import Record
from mocha_link.store.wire import Header
from mocha_link.sync import frames as sync
from mocha_link.sync.credit import MAX_CHUNK
from mocha_link.sync.frames import MAX_CHUNKS, SyncFrameError, message_id_of, read_chunks
from mocha_link.sync.peer import Peer
from mocha_link.sync.sync_messages import (
    MAX_OPENED,
    MAX_ROBOTS,
    Digest,
    Have,
    Open,
    Since,
    decode_answers,
)
from mocha_link.sync.sync_receiver import SyncReceiver
from mocha_link.sync.sync_sender import SyncSender
from tests.mocha_link.network import NOW, START_MS, Node, Pull, peer_of

HISTORY = 500
ROBOT = 2


DEEP = team_of(
    "robots:\n"
    + "".join(
        f"  r{robot}: {{kind: k, address: a{robot}, base_port: 10, clients: []}}\n"
        for robot in range(ROBOT + 1)
    )
    + "kinds: {k: {topics: ["
    + ", ".join(f"{{name: /t{topic}, type: a/B, history: {HISTORY}}}" for topic in range(4))
    + "]}}\n"
)


def opened(peer: Peer, knowledge: Have | Digest) -> SyncSender:
    sender = SyncSender(peer)
    deliver(sender, sync.OPEN, Open(7, 0, knowledge).encode())
    return sender


def deliver(sender: SyncSender, kind: int, content: bytes) -> None:
    for frame in sync.message_frames(kind, 0, content, 60_000):
        sender.receive(frame)


def test_an_answer_that_repeats_itself_is_looked_at_once(monkeypatch):
    """A compromised robot stopped a node for half a minute with one megabyte."""
    node = Node("titan")
    for topic_id in range(40):
        node.store(ROBOT, topic_id, START_MS)
    sender = opened(peer_of(node.database), Digest({ROBOT: 1}))
    looks = []
    headers_in = Database.headers_in

    def noted(database: Database, robot_id: int, group: int) -> list[Record]:
        looks.append(group)
        return headers_in(database, robot_id, group)

    monkeypatch.setattr(Database, "headers_in", noted)
    answers = [struct.pack(">BHH", ROBOT, 1 << each % GROUPS, 0) for each in range(MAX_ROBOTS)]
    with pytest.raises(SyncFrameError, match="more robots"):
        decode_answers(b"".join([*answers, answers[0]]))
    deliver(sender, sync.ANSWER, b"".join(answers))
    assert sorted(looks) == list(range(GROUPS))
    while sender.next(60_000):
        pass
    assert sender.messages == 40


@pytest.mark.parametrize("more", [0, 1])
def test_an_opening_lists_no_more_than_any_node_does(more):
    ids = [message_id_of(ROBOT, 3, START_MS + each) for each in range(MAX_OPENED + more)]
    for knowledge in (Have(ids), Since(1, 2, ids)):
        content = Open(7, 0, knowledge).encode()
        if more:
            with pytest.raises(SyncFrameError, match="4097 messages in an OPEN"):
                Open.decode(content)
        else:
            assert list(Open.decode(content).knowledge.message_ids) == ids


def test_what_a_peer_lists_of_a_topic_is_sorted_once():
    """Not once for each of 65,535 ids, in the midst of all that is known of the topic."""
    sorts = 0

    def noted(_: object, event: str, called: object) -> None:
        nonlocal sorts
        sorts += event == "c_call" and called is sorted

    ids = [message_id_of(ROBOT, 3, START_MS + each) for each in range(4 * HISTORY)]
    peer = peer_of(team=DEEP)
    sys.setprofile(noted)
    try:
        opened(peer, Have(ids))
    finally:
        sys.setprofile(None)
    assert 1 <= sorts <= 2
    assert peer.holdings.stamps_ms(ids[0] >> 48) == tuple(
        START_MS + each for each in reversed(range(3 * HISTORY, 4 * HISTORY))
    )


@pytest.mark.parametrize("more", [0, 1])
@pytest.mark.parametrize("layout", [sync.WHOLE, sync.PIECE])
def test_a_frame_has_so_many_messages_at_most(layout, more):
    count = MAX_CHUNKS + more
    message_id = message_id_of(ROBOT, 3, START_MS)
    rest = (1,) if layout is sync.WHOLE else (2 * count, 0, 1)
    heads = [layout.pack(message_id, *rest)] * count
    both = ([], heads) if layout is sync.PIECE else (heads, [])
    frame = b"".join(sync.chunks_parts((0, 0), *both, [bytes(count)]))
    if more:
        with pytest.raises(SyncFrameError, match="a frame with"):
            read_chunks(frame)
    else:
        assert len(read_chunks(frame).wholes) + len(read_chunks(frame).pieces) == count


def test_more_messages_than_fit_in_a_frame_go_in_several():
    titan, io = Node("titan"), Node("io")
    count = MAX_CHUNKS + 10
    for each in range(count):
        header = Header.at(each >> 8, each & 255, START_MS)
        titan.database.insert(Record(header, 0, b"x", START_MS, NOW.unix_s), NOW.unix_s)
    pull = Pull(io, titan)
    pull.deliver_up()
    sizes = []
    while frame := pull.give(MAX_CHUNK):
        if frame[0] == sync.CHUNKS:
            sizes.append(struct.unpack_from(">H", frame, 10)[0])
    assert sizes == [MAX_CHUNKS, 10]


def test_a_frame_larger_than_any_that_was_requested_is_not_read():
    """What it holds may unpack to 255 times as much."""
    io = Node("io").peer("titan")
    receiver = SyncReceiver(io)
    receiver.open(NOW)
    body = bytes(MAX_CHUNK + 1)
    heads = [sync.WHOLE.pack(message_id_of(ROBOT, 3, START_MS), len(body))]
    parts = sync.chunks_parts((0, 0), heads, [], [body])
    receiver.receive(parts[0], NOW, parts[1:])
    (refusal,) = io.log.refusals
    assert f"{MAX_CHUNK + 1} bytes in a frame" in refusal
