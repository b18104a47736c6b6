"""Several messages in one: they come out as they went in, and nothing else is taken for a batch."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.store import message as messages
from mocha_link.store.message import BatchError


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_what_goes_in_comes_out(parts):
    assert messages.unpack_batch(messages.pack_batch(parts)) == tuple(parts)


def test_the_bytes():
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
def test_what_is_none(data, why):
    with pytest.raises(BatchError, match=why):
        messages.unpack_batch(data)
