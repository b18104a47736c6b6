"""The frames of the sync: what goes in comes out, and nothing else comes out."""

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.store import wire
from mocha_link.store.reassembly_buffer import is_alone
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.frames import LARGE_BYTES, Chunks, SyncFrameError, read_chunks
from mocha_link.sync.sync_messages import (
    VERSION,
    Digest,
    Done,
    FragmentRequest,
    Have,
    HeldGroups,
    Hello,
    Open,
    Reception,
    Since,
    VersionError,
    decode_topics,
    encode_topics,
)

U64 = st.integers(0, 2**64 - 1)
LONG = st.builds(
    sync.message_id_of, st.integers(0, 255), st.integers(0, 255), st.integers(0, 2**47 - 1)
)
LONGS = st.lists(LONG, max_size=20).map(tuple)


@st.composite
def wishes(draw):
    bounds = draw(st.sets(st.integers(0, 2**20), min_size=2, max_size=32).map(sorted))
    missing = list(zip(bounds[::2], bounds[1::2], strict=False))
    return FragmentRequest(draw(LONG), draw(st.integers(bounds[-1], 2**26)), missing)


OPENS = st.builds(
    Open,
    U64,
    U64,
    st.one_of(
        st.builds(Since, U64, U64, LONGS),
        st.builds(Have, LONGS),
        st.builds(Digest, st.dictionaries(st.integers(0, 255), U64, max_size=20)),
    ),
    st.lists(wishes(), max_size=5).filter(lambda each: all(w.total for w in each)),
    U64,
    U64,
)


def test_an_answer_that_is_too_long_for_a_message_leaves_some_out():
    answers = [HeldGroups(robot, 0xFFFF, [robot << 56] * 2_000) for robot in range(256)]
    content = sync_messages.encode_answers(answers)
    assert len(content) <= sync.MAX_SYNC_MESSAGE_BYTES
    read = sync_messages.decode_answers(content)
    assert [answer.robot_id for answer in read] == list(range(256))
    assert sum(len(answer.message_ids) for answer in read) > 140_000


@given(st.binary(max_size=3_000), st.integers(300, 2_000), st.randoms(use_true_random=False))
def test_messages_come_together_in_any_order(content, room, rng):
    frames = sync.message_frames(sync.OPEN, 3, content, room)
    assert all(len(frame) <= room for frame in frames)
    collector = sync.MessageAssembler(sync.OPEN)
    stream = frames * 3
    rng.shuffle(stream)
    found = [message for frame in stream if (message := collector.take(frame))]
    assert found == [sync.SyncMessage(sync.OPEN, 3, content)]


@pytest.mark.parametrize(
    "frame",
    [
        b"",
        b"\1",
        sync.message_frames(sync.HELLO, 0, b"", 300)[0],
        sync.message_frames(sync.OPEN, sync.ROUNDS, b"", 300)[0],
        sync.message_frames(sync.OPEN, 0, bytes(sync.MAX_SYNC_MESSAGE_BYTES + 1), 300)[0],
        sync.message_frame(sync.OPEN, 0, bytes(1_000), 0, sync.MESSAGE_HEADER_BYTES + 100),
        sync.message_frames(sync.OPEN, 0, b"abc", 300)[0][:-1],
    ],
)
def test_frames_that_are_no_messages(frame):
    with pytest.raises(SyncFrameError):
        sync.MessageAssembler(sync.OPEN).take(frame)


def contents(chunks: Chunks) -> list[memoryview]:
    return [each[-1] for each in (*chunks.wholes, *chunks.pieces)]


def chunks(rng: random.Random) -> tuple[bytes, int]:
    """A frame of chunks, and where its data begin."""
    wholes = [(sync.message_id_of(1, 2, number), rng.randint(1, 90)) for number in range(3)]
    pieces = [(sync.message_id_of(1, 3, number), 1_000, number * 10, 50) for number in range(2)]
    data = [rng.randbytes(size) for _, size in wholes] + [rng.randbytes(50) for _ in pieces]
    frame = b"".join(
        sync.chunks_parts(
            (2, 9),
            [sync.WHOLE.pack(*each) for each in wholes],
            [sync.PIECE.pack(*each) for each in pieces],
            data,
            b"prefix",
        )
    )
    assert frame[:6] == b"prefix"
    read = read_chunks(frame[6:])
    bodies = [(message_id, body) for (message_id, _), body in zip(wholes, data, strict=False)]
    cut = [(*piece[:3], part) for piece, part in zip(pieces, data[3:], strict=True)]
    assert read == (2, 9, bodies, cut)
    assert read == read_chunks(memoryview(frame)[6:])
    return frame[6:], len(frame) - 6 - sum(map(len, data))


def test_every_damaged_bit_but_in_the_data_is_seen():
    frame, begin = chunks(random.Random(1))
    message = sync.message_frames(sync.DONE, 2, Done(1, 2, 3, cut_short=False).encode(), 300)[0]
    for place in range(begin * 8):
        damaged = bytearray(frame)
        damaged[place // 8] ^= 1 << place % 8
        with pytest.raises(SyncFrameError):
            read_chunks(bytes(damaged))
    for place in range(len(message) * 8):
        damaged = bytearray(message)
        damaged[place // 8] ^= 1 << place % 8
        with pytest.raises(SyncFrameError):
            sync.MessageAssembler(*range(8)).take(bytes(damaged))


@pytest.mark.parametrize("cut", range(0, 60, 3))
def test_a_frame_of_chunks_is_all_there_or_refused(cut):
    frame, _ = chunks(random.Random(2))
    with pytest.raises(SyncFrameError):
        read_chunks(frame[: -1 - cut])
    with pytest.raises(SyncFrameError):
        read_chunks(frame + bytes(1 + cut))


@pytest.mark.parametrize(
    ("wholes", "pieces", "size"),
    [
        ([(1, 0)], [], 0),
        ([(1, 2**32 - 1)], [], 10),
        ([], [(1, 100, 100, 1)], 1),
        ([], [(1, 100, 0, 101)], 101),
        ([], [(1, 100, 2**32 - 1, 1)], 1),
        ([], [(1, 100, 0, 0)], 0),
        ([], [(1, wire.MAX_BODY_BYTES + 1, 0, 1)], 1),
        ([], [(1 << 47, 100, 0, 1)], 1),
    ],
)
def test_impossible_chunks(wholes, pieces, size):
    frame = b"".join(
        sync.chunks_parts(
            (0, 0),
            [sync.WHOLE.pack(*each) for each in wholes],
            [sync.PIECE.pack(*each) for each in pieces],
            [bytes(size)],
        )
    )
    with pytest.raises(SyncFrameError):
        read_chunks(frame)


@pytest.mark.parametrize(
    "missing",
    [
        [],
        [(0, 0)],
        [(5, 3)],
        [(0, 101)],
        [(10, 20), (15, 30)],
        [(10, 20), (20, 30)],
        [(n * 2, n * 2 + 1) for n in range(17)],
    ],
)
def test_impossible_requests(missing):
    opening = Open(1, 0, Have(()), [FragmentRequest(1, 100, missing)])
    with pytest.raises(SyncFrameError):
        Open.decode(opening.encode())


@given(U64, st.dictionaries(st.integers(0, 65_535), st.integers(0, 2**32 - 1), max_size=50))
def test_definitions_of_topics(config_hash, definitions):
    content = encode_topics(config_hash, definitions)
    assert decode_topics(content) == (config_hash, definitions)
    for bad in (content[:7], content + b"12345"):
        with pytest.raises(SyncFrameError, match="a TOPICS of"):
            decode_topics(bad)


def test_another_version_is_refused():
    content = Open(1, 0, Have(())).encode()
    for version in (VERSION - 1, VERSION + 1):
        with pytest.raises(VersionError, match=f"version 0{version} of the sync; ours is"):
            Open.decode(bytes((version,)) + content[1:])
    with pytest.raises(VersionError):
        Open.decode(b"")


def test_of_another_versions_hello_only_that_is_read():
    hello = Hello.decode(bytes((0, VERSION + 1)) + b"anything")
    assert hello == Hello(Reception.UNREADABLE, 0, VERSION + 1)
    with pytest.raises(SyncFrameError, match="a reception of sort 9"):
        Hello.decode(b"\x09" + Hello().encode()[1:])


SIZES = st.lists(
    st.sampled_from((1, 100, LARGE_BYTES - 1, LARGE_BYTES, 2 * LARGE_BYTES)), max_size=9
)


@given(SIZES, SIZES, st.integers(0, 99))
def test_large_data_are_parts_of_their_own(whole_sizes, piece_sizes, seed):
    """However it is cut then, the same comes out; a part that is one message is not copied."""
    rng = random.Random(seed)
    wholes = [(sync.message_id_of(1, n % 256, n), size) for n, size in enumerate(whole_sizes)]
    pieces = [
        (sync.message_id_of(2, n % 256, n), 1 << 20, 5, size) for n, size in enumerate(piece_sizes)
    ]
    data = [rng.randbytes(size) for size in whole_sizes + piece_sizes]
    packed = [sync.WHOLE.pack(*each) for each in wholes], [sync.PIECE.pack(*e) for e in pieces]
    parts = sync.chunks_parts((0, 1), *packed, data, b"prefix")
    large = [each for each in data if len(each) >= LARGE_BYTES]
    assert [each for each in parts if any(each is one for one in large)] == large
    read = read_chunks(parts[0][6:], parts[1:])
    assert contents(read) == data
    kept = [each for each in contents(read) if is_alone(each)]
    assert kept == large
    assert all(each.obj in large for each in kept)
    whole = b"".join(parts)[6:]
    head = len(whole) - sum(map(len, data))
    cuts = sorted(rng.choices(range(head, len(whole) + 1), k=5))
    again = [whole[a:b] for a, b in itertools.pairwise([0, *cuts, len(whole)])]
    assert contents(read_chunks(again[0], again[1:])) == data
    with pytest.raises(SyncFrameError):
        read_chunks(again[0], [*again[1:], b"x"])


@given(
    st.one_of(
        st.binary(max_size=200),
        st.builds(
            lambda opening, place, value: (
                (raw := opening.encode())[: place % len(raw)] + value + raw[place % len(raw) + 1 :]
            ),
            OPENS,
            st.integers(0, 10_000),
            st.binary(max_size=3),
        ),
    )
)
def test_any_content_is_read_or_refused(content):
    for read in (
        Open.decode,
        Hello.decode,
        Done.decode,
        sync_messages.decode_groups,
        sync_messages.decode_answers,
        sync_messages.decode_skip,
    ):
        try:
            read(content)
        except SyncFrameError:
            continue


def test_many_partial_messages_are_refused():
    wish = FragmentRequest(1, 100, [(0, 100)])
    assert len(Open.decode(Open(1, 0, Have(()), [wish] * 64).encode()).requests) == 64
    with pytest.raises(SyncFrameError):
        Open.decode(Open(1, 0, Have(()), [wish] * 65).encode())
