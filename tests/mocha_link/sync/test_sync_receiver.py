"""The pulling side: what it sends, what it takes, and what it makes of whatever comes."""

import random
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.links.metrics import MessageStored
from mocha_link.store import wire
from mocha_link.store.record import Knowledge
from mocha_link.store.wire import WRAP_MS, PayloadError
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.sync_messages import Digest, Done, Have, Hello, Open, Reception
from mocha_link.sync.sync_receiver import SyncReceiver
from tests.mocha_link.network import NOW, START_MS, Node, Pull, mutated, peer_of
from tests.mocha_link.original import packed

EPOCH = 99


def body(stamp_ms: int | None = START_MS, data: bytes = b"data", dtype: int = 0) -> bytes:
    if stamp_ms is None:
        return packed(dtype, 0, data)
    return wire.pack(dtype, 0, data, stamp_ms=stamp_ms)


LONG = sync.message_id_of(3, 4, START_MS)


class PullingSide:
    """A receiver whose peer sends what the test wants."""

    def __init__(self, node: Node | None = None, **options: object) -> None:
        self.node = node or Node("asker")
        verify = options.pop("verify", None)
        self.peer = self.node.peer("io")
        if verify:
            self.peer = peer_of(self.node.database, reassembly=self.node.reassembly, verify=verify)
        self.receiver = SyncReceiver(self.peer, **options)
        self.sync_messages = sync.MessageAssembler(sync.OPEN, sync.ANSWER, sync.SKIP, sync.END)
        self.sent: list[object] = []
        self.events: list[object] = []
        self.refusals: list[str] = []
        self.round = 0
        self.number = 0
        self.take(self.receiver.open(NOW))

    def take(self, frames: list[bytes]) -> None:
        self.events += self.peer.log.take_events()
        self.refusals += self.peer.log.take_refusals()
        for frame in frames:
            message = self.sync_messages.take(frame)
            if message:
                if message.round != self.round:
                    self.round, self.number = message.round, 0
                read = {
                    sync.OPEN: Open.decode,
                    sync.ANSWER: sync_messages.decode_answers,
                    sync.SKIP: sync_messages.decode_skip,
                    sync.END: lambda _: "END",
                }
                self.sent.append(read[message.kind](message.content))

    def receive(self, frame: bytes) -> None:
        self.take(self.receiver.receive(frame, NOW))

    def message(self, kind: int, content: bytes) -> None:
        for frame in sync.message_frames(kind, self.round, content, 500):
            self.receive(frame)

    def chunks(self, *wholes: tuple[int, bytes], pieces=()) -> bytes:
        """The next frame with these messages and (long id, body, start, end) of pieces."""
        self.number += 1
        return b"".join(
            sync.chunks_parts(
                (self.round, self.number - 1),
                [sync.WHOLE.pack(message_id, len(body)) for message_id, body in wholes],
                [
                    sync.PIECE.pack(message_id, len(b), start, end - start)
                    for message_id, b, start, end in pieces
                ],
                [body for _, body in wholes] + [b[start:end] for _, b, start, end in pieces],
            )
        )

    def done(self, *, cut_short: bool = False, frames: int | None = None) -> None:
        frames = self.number if frames is None else frames
        self.message(sync.DONE, Done(EPOCH, 50, frames, cut_short).encode())

    @property
    def knowledge(self):
        return self.sent[-1].knowledge


def test_of_many_new_ones_the_largest_are_listed_if_the_others_are_small():
    node = Node("asker")
    node.database.learn("io", Knowledge(EPOCH, 40, 0))
    for number in range(600):
        node.store(number % 256, number >> 8, START_MS, size=0 if number < 200 else 300)
    listed = PullingSide(node).knowledge.message_ids
    assert len(listed) == 512
    assert {sync.message_id_of(n % 256, n >> 8, START_MS) for n in range(200, 600)} <= set(listed)
    for number in range(600, 800):
        node.store(number % 256, number >> 8, START_MS, size=300)
    assert isinstance(PullingSide(node).knowledge, Digest)


def test_an_opening_comes_in_frames_that_fit():
    node = Node("asker")
    for number in range(400):
        node.store(number % 256, number >> 8, START_MS)
    frames = PullingSide(node, room=300).receiver.open(NOW)
    assert len(frames) == -(-(400 * 8 + 21) // 286)
    assert all(len(frame) <= 300 for frame in frames)


def test_a_message_is_stored_and_reported():
    pulling = PullingSide()
    pulling.message(sync.HELLO, Hello().encode())
    pulling.receive(pulling.chunks((LONG, body())))
    (record,) = pulling.node.database.kept()
    assert record.body == body()
    assert record.stamp_ms == START_MS
    assert record.received_s == NOW.unix_s
    assert not record.extrapolated
    assert pulling.events == [
        MessageStored("io", NOW.unix_s, "r003", "/t4", record.header, len(body()))
    ]
    assert pulling.receiver.messages == 1
    pulling.done()
    assert pulling.sent[-1] == "END"
    assert pulling.receiver.over
    assert pulling.receiver.complete
    assert pulling.refusals == []
    assert pulling.node.database.knowledge("io") == Knowledge(EPOCH, 50, 1)


def test_of_a_flood_of_messages_not_all_are_remembered():
    """What is not remembered to be the peer's is named to it in the next pull."""
    pulling = PullingSide(remembered=3)
    wholes = [(sync.message_id_of(3, 4, START_MS + n), body(START_MS + n)) for n in range(3)]
    pulling.receive(pulling.chunks(*wholes, (sync.message_id_of(5, 6, START_MS), body())))
    pulling.done()
    assert pulling.receiver.complete
    assert pulling.node.database.knowledge("io") == Knowledge(EPOCH, 50, 3)
    assert PullingSide(pulling.node).knowledge.message_ids == (sync.message_id_of(5, 6, START_MS),)


def test_a_pull_that_the_budget_cut_short_is_over_but_teaches_nothing():
    pulling = PullingSide(budget=100)
    pulling.done(cut_short=True)
    assert pulling.receiver.over
    assert not pulling.receiver.complete
    assert pulling.node.database.knowledge("io") is None
    assert pulling.sent[-1] == "END"


def test_a_server_that_never_remembers_is_not_requested_for_ever():
    pulling = PullingSide()
    for _ in range(20):
        pulling.message(sync.HELLO, Hello(Reception.UNKNOWN).encode())
    assert pulling.round == sync.ROUNDS - 1


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (b"\0", "a body of 1 bytes"),
        (b"\0\0garbage", "not an LZ4 frame"),
        (body()[:-5], "ends within its trailer"),
        (body().replace(b"data", b"dada"), "damaged on its way"),
        (body(None)[:-4], "ends within its LZ4 frame"),
        (body(START_MS + 1), f"of time {START_MS + 1} ms, but its id has {START_MS} ms"),
        (body(None, dtype=7), "type id 7, but /t4 is a/B (0) here"),
    ],
)
@pytest.mark.parametrize("in_pieces", [False, True])
def test_what_may_be_damaged_is_requested_once_more(bad, reason, in_pieces):
    pulling = PullingSide()

    def give(content: bytes) -> None:
        if in_pieces:
            half = len(content) // 2 or 1
            for start, end in ((0, half), (half, len(content))):
                if end > start:
                    piece = (LONG, content, start, end)
                    pulling.receive(pulling.chunks(pieces=[piece]))
        else:
            pulling.receive(pulling.chunks((LONG, content)))

    give(bad)
    assert len(pulling.refusals) == 1
    assert reason in pulling.refusals[0]
    assert len(pulling.node.reassembly) == 0
    pulling.done()
    assert pulling.round == 1
    assert pulling.knowledge == Have(())
    give(bad)
    pulling.done()
    assert pulling.receiver.over  # given up until the next pull
    assert not pulling.receiver.complete
    assert pulling.node.database.knowledge("io") is None
    pulling = PullingSide(pulling.node)
    give(bad)
    pulling.done()
    give(body())
    pulling.done()
    assert pulling.receiver.complete
    assert pulling.node.content == {LONG: body()}


def test_an_intact_message_of_another_type_is_refused_for_good():
    pulling = PullingSide()
    pulling.receive(pulling.chunks((LONG, body(dtype=7))))
    pulling.done()
    assert "type id 7, but /t4 is a/B (0) here; use the same team file" in pulling.refusals[0]
    assert pulling.receiver.complete
    assert pulling.node.content == {}
    assert pulling.node.database.knowledge("io")


def test_what_the_team_does_not_trust_is_refused_for_good():
    def verify(header, content, trailer) -> None:
        assert content == body()
        assert trailer.stamp_ms == START_MS
        raise PayloadError(f"{header.robot_id} did not sign it")

    pulling = PullingSide(verify=verify)
    pulling.receive(pulling.chunks((LONG, body())))
    pulling.done()
    assert "3 did not sign it" in pulling.refusals[0]
    assert pulling.receiver.complete
    assert pulling.node.content == {}


@pytest.mark.parametrize("pieces", [False, True])
@pytest.mark.parametrize(
    ("message_id", "why"),
    [
        (LONG - LONG % (1 << 48) + 2**47, "years ahead of this clock"),
        (sync.message_id_of(3, 4, START_MS - START_MS % WRAP_MS + 1_000), "original nodes stop"),
        (sync.message_id_of(3, 4, 0), "original nodes stop"),
    ],
)
def test_impossible_and_unsafe_times_are_refused(message_id, why, pieces):
    pulling = PullingSide()
    if pieces:
        pulling.receive(pulling.chunks(pieces=[(message_id, body(), 0, 10)]))
    else:
        pulling.receive(pulling.chunks((message_id, body())))
    assert len(pulling.refusals) == 1
    assert why in pulling.refusals[0] or (pieces and "a piece of" in pulling.refusals[0])
    assert pulling.node.content == {}
    assert len(pulling.node.reassembly) == 0


def test_robots_and_topics_that_the_team_does_not_know_are_refused(team):
    node = Node("asker")
    peer = peer_of(node.database, team=team)
    receiver = SyncReceiver(peer)
    receiver.open(NOW)
    pulling = PullingSide()
    for robot_id, topic_id, why in (
        (3, 0, "no robot with topics has id 3 in the team file"),
        (0, 3, "callisto has no topic with id 3 in the team file"),
        (255, 255, "no robot with topics has id 255 in the team file"),
    ):
        message_id = sync.message_id_of(robot_id, topic_id, START_MS)
        frame = pulling.chunks((message_id, body()), pieces=[(message_id, body(), 0, 10)])
        receiver.receive(frame, NOW)
        assert len(peer.log.refusals) == 2
        assert why in peer.log.refusals[0]
        peer.log.take_refusals()
    assert node.content == {}
    done = Done(EPOCH, 50, pulling.number, cut_short=False).encode()
    receiver.receive(sync.message_frames(sync.DONE, 0, done, 500)[0], NOW)
    assert receiver.complete  # there is nothing to be had by requesting again


def test_a_peer_that_damages_everything_is_not_requested_for_ever():
    pulling = PullingSide()
    for _ in range(10):
        pulling.chunks()
        pulling.receive(b"junk")
        pulling.done()
    assert pulling.receiver.over
    assert not pulling.receiver.complete
    assert pulling.round == 2


@pytest.mark.parametrize("kind", [sync.HELLO, sync.ANNOUNCE])
def test_a_damaged_sync_message_does_not_count_as_a_frame_of_messages(kind):
    pulling = PullingSide()
    damaged = bytearray(sync.message_frame(kind, 0, Hello().encode(), 0, 500))
    damaged[-1] ^= 1
    pulling.receive(bytes(damaged))
    last = pulling.chunks((LONG, body()))
    pulling.done()
    assert pulling.round == 0  # the frame is still under way
    pulling.receive(last)
    assert pulling.round == 1
    assert len(pulling.refusals) == 1


def test_a_frame_with_parts_of_too_many_messages_counts_once():
    pulling = PullingSide()
    for number in range(1_025):
        pulling.receive(pulling.chunks(pieces=[(LONG + number, body(), 0, 1)]))
    last = pulling.chunks((LONG + 2_000, body(START_MS + 2_000)))
    pulling.done()
    assert pulling.round == 0  # the frame is still under way
    pulling.receive(last)
    assert pulling.round == 1
    assert pulling.refusals == ["parts of too many messages"]


def test_parts_of_too_many_messages_are_refused():
    pulling = PullingSide()
    for number in range(1_030):
        pulling.receive(pulling.chunks(pieces=[(LONG + number, body(), 0, 1)]))
    assert pulling.refusals == ["parts of too many messages"] * 6
    assert len(pulling.node.reassembly) == 1_024


def test_one_frame_is_not_complained_of_for_ever():
    pulling = PullingSide()
    pulling.receive(pulling.chunks(*[(LONG + number, b"\0") for number in range(1_000)]))
    assert len(pulling.refusals) == 100


def serving_frames() -> list[bytes]:
    """What a serving side sends in pulls of all sorts."""
    server, asker = Node("server"), Node("asker")
    for number in range(30):
        server.store(number % 5, number, START_MS, size=number * 40)
    pull = Pull(asker, server)
    pull.deliver_up()
    while pull.give(500):
        pass
    groups = [(robot_id, range(16)) for robot_id in range(9)]
    frames = pull.down
    frames += sync.message_frames(sync.HELLO, 0, Hello(Reception.UNKNOWN).encode(), 400)
    frames += sync.message_frames(sync.GROUPS, 1, sync_messages.encode_groups(groups), 400)
    frames += sync.message_frames(sync.DONE, 1, Done(1, 2, 3, cut_short=True).encode(), 400)
    return frames


@given(st.integers(0, 2**32))
def test_whatever_comes_an_receiver_keeps_only_good_messages(seed):
    rng = random.Random(seed)
    frames = serving_frames()
    node = Node("asker")
    pulling = PullingSide(node)
    for _ in range(60):
        frame = rng.choice(frames)
        if rng.random() < 0.7:
            frame = mutated(rng, frame)
        pulling.receiver.receive(frame, NOW)
        if pulling.receiver.over:
            pulling = PullingSide(node)
    for record in node.database.kept():
        wire.check(record.body)
        assert record.body[0] == 0
        assert record.header.wrapped_ms > wire.UNSAFE_MS


def test_memory_grows_with_what_came_and_not_with_what_was_announced():
    rng = random.Random(1)
    pulling = PullingSide()
    came = 0
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for number in range(2_000):
        message_id = sync.message_id_of(number % 256, number >> 8, START_MS)
        offset = rng.randrange(60_000_000)
        frame = b"".join(
            sync.chunks_parts(
                (0, rng.randrange(2**32)),
                [],
                [sync.PIECE.pack(message_id, 2**26, offset, 1)],
                [b"?"],
            )
        )
        frame = (
            frame
            if number % 2
            else sync.message_frame(
                sync.GROUPS, number % 8, bytes(2**20), rng.randrange(2**10) * 300, 300
            )
        )
        came += len(frame)
        pulling.receiver.receive(frame, NOW)
    after, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 8 * came
    assert peak - before < 8 * came + 2**21


@pytest.mark.parametrize("ahead", [False, True])
def test_a_damaged_message_that_the_network_repeats_is_requested_again(ahead):
    """Twice in one pull it would be hopeless; the same frame twice is not twice."""
    pulling = PullingSide()
    first = pulling.chunks((sync.message_id_of(3, 3, START_MS), body()))
    damaged = bytearray(pulling.chunks((LONG, body())))
    damaged[-1] ^= 1
    for frame in [damaged, damaged, first] if ahead else [first, damaged, damaged]:
        pulling.receive(bytes(frame))
    pulling.done()
    assert len(pulling.refusals) == 1
    assert not pulling.receiver.over
    assert pulling.round == 1
