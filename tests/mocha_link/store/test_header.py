"""Headers: six bytes, unwrapped to Unix time, never twice the same."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mocha_link.node.publisher import next_stamp_ms
from mocha_link.store.wire import AHEAD_MS, WRAP_MS, Header, HeaderError, as_ms

FAST = settings(deadline=None, max_examples=100)
HEADERS = st.builds(
    Header,
    st.integers(0, 255),
    st.integers(0, 255),
    st.integers(0, 65535),
    st.integers(0, 999),
)
UNIX_MS = st.integers(0, 4_000_000_000_000)


def test_the_captured_header():
    header = Header.parse(bytes.fromhex("030135db02b6"))
    assert header == Header(robot_id=3, topic_id=1, seconds=13787, milliseconds=694)
    assert str(header) == "030135db02b6"
    assert header.stamp_s(1795175900.0) == 1795175899.694  # the time in the captured message


@FAST
@given(HEADERS)
def test_parse_reads_what_pack_writes(header):
    assert Header.parse(header.pack()) == header


@FAST
@given(st.binary(max_size=12))
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
        assert not Header.at(0, 0, stamp).hangs_old_nodes
        last = stamp


def test_milliseconds_are_not_lost_to_binary_fractions():
    assert as_ms(13787.694) == 13787694
    assert as_ms(1795175899.694) == 1795175899694
    assert as_ms(1.9999999) == 2000
