"""A message on the wire: a header, a body unpacked within bounds, its trailer; several in one."""

import contextlib
import random
import struct
import tracemalloc

import lz4.frame
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mocha_link.node.publisher import next_stamp_ms
from mocha_link.store import message as messages
from mocha_link.store import wire
from mocha_link.store.message import BatchError
from mocha_link.store.wire import (
    AHEAD_MS,
    UNSAFE_MS,
    WRAP_MS,
    Header,
    HeaderError,
    PayloadError,
    Trailer,
    as_ms,
)
from tests.mocha_link.original import packed

STAMP_MS = 1_795_175_905_123
SIGNATURE = bytes(range(64))
IDS = (3, 7)
SMALL = wire.pack(1, 2, b"a message " * 8, stamp_ms=STAMP_MS)
NAMED = wire.pack(1, 2, b"a message " * 8, stamp_ms=STAMP_MS, ids=IDS)
SIGNED = wire.pack(1, 2, b"a message " * 8, stamp_ms=STAMP_MS, sign=lambda _: SIGNATURE)
LARGE = wire.pack(1, 2, random.Random(1).randbytes(70_000) * 2, stamp_ms=STAMP_MS)
KIB, MIB = 1024, 1024 * 1024
FAST = settings(deadline=None, max_examples=100)
HEADERS = st.builds(
    Header,
    st.integers(0, 255),
    st.integers(0, 255),
    st.integers(0, 65535),
    st.integers(0, 999),
)
UNIX_MS = st.integers(0, 4_000_000_000_000)


# The header


def test_the_captured_header():
    header = Header.parse(bytes.fromhex("030135db02b6"))
    assert header == Header(robot_id=3, topic_id=1, seconds=13787, milliseconds=694)
    assert str(header) == "030135db02b6"
    assert header.stamp_s(1795175900.0) == 1795175899.694  # the time in the captured message


@given(HEADERS.map(Header.pack) | st.binary(max_size=12))
def test_any_bytes_are_a_header_or_a_header_error(raw):
    try:
        assert Header.parse(raw).pack() == raw
    except HeaderError:
        assert len(raw) != 6 or int.from_bytes(raw[4:]) > 999


@pytest.mark.parametrize(
    "values", [(256, 0, 0, 0), (0, -1, 0, 0), (0, 0, 65536, 0), (0, 0, 0, 1000), (0, 0, 500, 65535)]
)
def test_values_out_of_range_are_refused(values):
    with pytest.raises(HeaderError, match="is not within"):
        Header(*values)


@FAST
@given(UNIX_MS, st.integers(0, WRAP_MS - 1))
@example(27 * WRAP_MS, 0)
@example(27 * WRAP_MS + 10 * 3600 * 1000, 10 * 3600 * 1000 + 1)  # seen 10 h after the wrap
def test_a_stamp_unwraps_to_the_time_it_was_made_from(now_ms, age_ms):
    made_ms = max(0, now_ms + AHEAD_MS - age_ms)  # nothing was made before 1970
    header = Header.at(1, 2, made_ms)
    assert as_ms(header.stamp_s(now_ms / 1000)) == made_ms


@FAST
@given(st.lists(UNIX_MS, min_size=1, max_size=20))
def test_new_stamps_rise_whatever_the_clock_does(clock_ms):
    last = None
    for now_ms in clock_ms:
        stamp = next_stamp_ms(now_ms / 1000, last)
        assert last is None or stamp > last
        assert stamp >= now_ms
        assert stamp % WRAP_MS > UNSAFE_MS
        last = stamp


def test_milliseconds_are_not_lost_to_binary_fractions():
    assert as_ms(13787.694) == 13787694
    assert as_ms(1795175899.694) == 1795175899694
    assert as_ms(1.9999999) == 2000


# The body


def with_size(frame: bytes, size: int) -> bytes:
    """An LZ4 frame that states another content size, with a header checksum that fits."""
    assert frame[4] & 0x08
    for checksum in range(256):
        lie = frame[:6] + struct.pack("<QB", size, checksum) + frame[15:]
        with contextlib.suppress(RuntimeError):
            lz4.frame.get_frame_info(lie)
            return lie
    raise AssertionError


@contextlib.contextmanager
def at_most(limit_bytes: int):
    """Nothing inside may need more memory at once."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit_bytes
    finally:
        tracemalloc.stop()


@given(st.integers(0, 255), st.integers(0, 255), st.binary(max_size=2000), st.binary(max_size=9))
def test_unpack_reads_what_pack_writes(dtype, priority, data, behind):
    body = wire.pack(dtype, priority, data, stamp_ms=STAMP_MS)
    assert body[:2] == bytes((dtype, priority))
    assert wire.unpack(body) == data
    assert wire.unpack(body + behind) == data  # later formats may add something there


@given(st.binary(max_size=60))
def test_any_bytes_are_a_body_or_a_payload_error(raw):
    cut = b"\1\2" + lz4.frame.compress(b"abc" * 9)[:12]
    for body in (raw, cut + raw, SMALL[:-18] + raw, SMALL[:-14] + raw):
        for read in (wire.unpack, wire.check):
            with contextlib.suppress(PayloadError):  # and nothing else
                read(body)


@pytest.mark.parametrize("size", [0, 1, 65_536, 65_537, 3_000_000])
@pytest.mark.parametrize(
    "options",
    [
        {"store_size": False},
        {"store_size": False, "block_linked": False},
        {"content_checksum": True, "block_checksum": True},
        {"store_size": False, "content_checksum": True, "block_checksum": True},
        {"block_size": lz4.frame.BLOCKSIZE_MAX256KB},
        {"block_size": lz4.frame.BLOCKSIZE_MAX1MB, "compression_level": 9},
        {"block_size": lz4.frame.BLOCKSIZE_MAX4MB, "block_linked": False},
    ],
)
def test_any_form_of_the_frame(size, options):
    for data in (bytes(size), random.Random(size).randbytes(size)):
        body = b"\0\0" + lz4.frame.compress(data, **options) + b"behind"
        assert wire.unpack(body) == data
        assert wire.check(body) is None


def test_a_bomb_is_refused():
    body = packed(0, 0, bytes(5_000_000))
    assert len(body) < 25_000
    assert len(wire.unpack(body, limit=5_000_000)) == 5_000_000
    with pytest.raises(PayloadError, match="unpacks to more than 4999999 bytes"):
        wire.unpack(body, limit=4_999_999)


def test_a_bomb_without_its_size_is_refused_within_bounds():
    bomb = b"\0\0" + lz4.frame.compress(bytes(60 * MIB), store_size=False)
    for read in (wire.unpack, wire.check):
        with (
            at_most(8 * MIB),
            pytest.raises(PayloadError, match=f"unpacks to more than {MIB} bytes"),
        ):
            read(bomb, limit=MIB)


@pytest.mark.parametrize("stated", [1, 10, 99_999])
def test_more_than_the_stated_size_is_refused_within_bounds(stated):
    frame = lz4.frame.compress(bytes(50 * MIB))
    with at_most(8 * MIB), pytest.raises(PayloadError, match=r"unpacks to more than|not an LZ4"):
        wire.check(b"\0\0" + with_size(frame, stated))


def test_less_than_the_stated_size_is_refused_within_bounds():
    frame = lz4.frame.compress(random.Random(1).randbytes(10_000))
    with at_most(MIB), pytest.raises(PayloadError, match="do not fit in its blocks"):
        wire.check(b"\0\0" + with_size(frame, 60 * MIB))
    with at_most(MIB), pytest.raises(PayloadError, match="not an LZ4 frame"):
        wire.check(b"\0\0" + with_size(lz4.frame.compress(bytes(10_000)), 10_100))
    for size in (wire.MAX_BYTES + 1, 2**64 - 1):
        with at_most(MIB), pytest.raises(PayloadError, match="unpacks to more than"):
            wire.check(b"\0\0" + with_size(frame, size))


def test_a_frame_of_countless_blocks_is_refused():
    header = lz4.frame.compress(b"", store_size=False)[:7]
    blocks = struct.pack("<IB", 1 << 31 | 1, 7)
    body = b"\0\0" + header + blocks * 1000 + bytes(4)
    assert wire.unpack(body) == b"\7" * 1000
    body = b"\0\0" + header + blocks * (wire.MAX_BLOCKS + 1) + bytes(4)
    with pytest.raises(PayloadError, match="cut into more than 65536 blocks"):
        wire.check(body)


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"\0",
        b"\0\0",
        b"SERRM",
        b"\0\0not lz4 at all",
        b"\0\0" + struct.pack("<II", 0x184D2A50, 4) + b"skip",  # an empty message to an original
        b"\0\0\x04\x22\x4d\x18\xa8\x40" + bytes(20),
        b"\0\0\x04\x22\x4d\x18\x68\x30" + bytes(20),
    ],
)
def test_what_is_no_message(body):
    for read in (wire.unpack, wire.check):
        with pytest.raises(PayloadError):
            read(body)


def test_too_large_to_send(monkeypatch):
    monkeypatch.setattr(wire, "MAX_BYTES", 10)
    with pytest.raises(PayloadError, match="11 bytes; at most 10 can be sent"):
        wire.pack(0, 0, bytes(11), stamp_ms=STAMP_MS)


@given(
    st.binary(max_size=300),
    st.integers(0, 2**47 - 1),
    st.none() | st.binary(min_size=64, max_size=64),
    st.binary(max_size=9),
    st.none() | st.tuples(st.integers(0, 255), st.integers(0, 255)),
)
def test_the_trailer_has_what_pack_was_given(data, stamp_ms, signature, behind, ids):
    sign = None if signature is None else lambda _: signature
    body = wire.pack(3, 1, data, stamp_ms=stamp_ms, ids=ids, sign=sign)
    given = Trailer(stamp_ms, signature, 2 if ids else 1)
    for each in (body, body + behind):
        assert wire.check(each, ids) == given
        assert wire.unpack(each) == data
        assert lz4.frame.decompress(each[2:]) == data  # as an original node reads it
    plain = packed(3, 1, data)
    assert body.startswith(plain)
    assert len(body) - len(plain) == (82 if signature else 18)


def test_bodies_of_original_nodes_have_no_trailer():
    body = packed(3, 1, b"data")
    for behind in (b"", b"\xd6", b"something of another program"):
        assert wire.check(body + behind) is None


def test_the_trailer_of_a_later_version_is_carried_on_unread():
    later = bytearray(SMALL)
    later[-14:-12] = (3, 252)
    assert wire.check(bytes(later)) is None
    assert wire.unpack(bytes(later)) == b"a message " * 8


@pytest.mark.parametrize("stamp_ms", [-1, 2**47])
def test_a_stamp_that_is_no_time(stamp_ms):
    with pytest.raises(PayloadError, match="set the clock"):
        wire.pack(0, 0, b"", stamp_ms=stamp_ms)


def test_a_message_of_another_robot_or_topic_is_refused():
    """Of the same time, perhaps, so that nothing else in it shows it."""
    assert wire.check(NAMED, IDS) == Trailer(STAMP_MS)
    for ids in ((2, 7), (3, 6), (7, 3), None):
        with pytest.raises(PayloadError, match="its checksum is another one"):
            wire.check(NAMED, ids)


def test_what_was_made_before_the_checksum_covered_the_ids_still_passes():
    """Storages hold it, and relays hand it on."""
    for body in (SMALL, SIGNED):
        found = wire.check(body, IDS)
        assert found == wire.check(body)
        assert found.version == 1


@pytest.mark.parametrize("body", [SMALL, SIGNED], ids=["bare", "signed"])
def test_any_one_damaged_byte_is_found(body):
    for at in range(len(body)):
        for bits in (1, 0x80, 0xFF):
            damaged = bytearray(body)
            damaged[at] ^= bits
            with pytest.raises(PayloadError):
                wire.check(bytes(damaged))


@given(
    st.sampled_from([SMALL, SIGNED, LARGE]),
    st.integers(0),
    st.integers(0),
    st.integers(1, 255),
)
def test_two_damaged_bytes_never_change_its_content(body, first, second, bits):
    damaged = bytearray(body)
    damaged[first % len(body)] ^= bits
    damaged[-1 - second % min(90, len(body))] ^= bits
    if damaged != body:
        with contextlib.suppress(PayloadError):
            # At the most it lost its trailer (the two bytes of the version, hit alike).
            assert wire.check(bytes(damaged)) is None
            assert damaged[:2] == body[:2]
            assert wire.unpack(bytes(damaged)) == wire.unpack(body)


def test_a_cut_trailer_is_found():
    for body in (SMALL, SIGNED):
        for end in range(len(packed(1, 2, b"a message " * 8)) + 2, len(body)):
            with pytest.raises(PayloadError, match="trailer"):
                wire.check(body[:end])


# Several messages in one


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_what_goes_into_a_batch_comes_out(parts):
    assert messages.unpack_batch(messages.pack_batch(parts)) == tuple(parts)


def test_the_bytes_of_a_batch():
    assert messages.pack_batch([]) == b""
    assert messages.pack_batch([b"ab", b""]) == b"\0\0\0\2ab\0\0\0\0"
    assert messages.unpack_batch(b"") == ()


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"\0\0\0", "ends within a length"),
        (b"\0\0\0\1", "ends within a message"),
        (b"\0\0\0\1a\0", "ends within a length"),
        (b"\xff\xff\xff\xff" + bytes(100), "ends within a message"),
    ],
)
def test_what_is_no_batch(data, why):
    with pytest.raises(BatchError, match=why):
        messages.unpack_batch(data)
