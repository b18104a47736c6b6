"""Bodies: packed as the original packs them, unpacked within bounds."""

from __future__ import annotations

import contextlib

import lz4.frame
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocha_link import payload
from mocha_link.payload import PayloadError


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 255), st.integers(0, 255), st.binary(max_size=2000), st.binary(max_size=9))
def test_unpack_reads_what_pack_writes(dtype, priority, data, behind):
    body = payload.pack(dtype, priority, data)
    assert body[:2] == bytes((dtype, priority))
    assert payload.unpack(body) == data
    assert payload.unpack(body + behind) == data  # later formats may add something there


@settings(deadline=None, max_examples=150)
@given(st.binary(max_size=60))
def test_any_bytes_are_a_body_or_a_payload_error(raw):
    for body in (raw, b"\1\2" + lz4.frame.compress(b"abc" * 9)[:12] + raw):
        with contextlib.suppress(PayloadError):  # and nothing else
            payload.unpack(body)


def test_large_data_in_linked_blocks():
    data = bytes(range(256)) * 5000
    body = payload.pack(5, 0, data, checksum=False)
    assert body[6] == 0x48  # linked blocks, as the original writes above 64 KiB
    assert payload.unpack(body) == data
    frame = lz4.frame.compress(data, store_size=False, block_linked=False)
    assert payload.unpack(b"\0\0" + frame) == data


def test_a_bomb_is_refused():
    body = payload.pack(0, 0, bytes(5_000_000))
    assert len(body) < 25_000
    assert len(payload.unpack(body, limit=5_000_000)) == 5_000_000
    with pytest.raises(PayloadError, match="unpacks to more than 4999999 bytes"):
        payload.unpack(body, limit=4_999_999)


@pytest.mark.parametrize("body", [b"", b"\0", b"\0\0", b"SERRM", b"\0\0not lz4 at all"])
def test_what_is_no_message(body):
    with pytest.raises(PayloadError):
        payload.unpack(body)


def test_a_cut_frame_is_refused():
    body = payload.pack(0, 0, bytes(range(256)) * 100)
    for end in range(len(body) - 1, 2, -97):
        with pytest.raises(PayloadError):
            payload.unpack(body[:end])


def test_too_large_to_send(monkeypatch):
    monkeypatch.setattr(payload, "MAX_BYTES", 10)
    with pytest.raises(PayloadError, match="11 bytes; at most 10 can be sent"):
        payload.pack(0, 0, bytes(11))
