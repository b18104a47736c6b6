"""Bytes leave in order, whatever the kernel takes of them."""

import socket

import pytest

from mocha_link.node.send_buffer import SendBuffer


@pytest.fixture
def pair():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        theirs.setblocking(False)
        yield ours, theirs


def test_bytes_arrive_in_order_though_the_kernel_takes_a_part_at_a_time(pair):
    ours, theirs = pair
    pieces = [bytes([number % 256]) * (number * 37 % 5_000) for number in range(1_000)]
    buffer = SendBuffer(pieces)
    assert buffer.size == len(buffer) == sum(map(len, pieces))
    arrived = b""
    while buffer:
        buffer.flush(ours)
        arrived += theirs.recv(1 << 20)
    assert arrived == b"".join(pieces)
    assert buffer.size == 0


def test_replies_count_until_all_is_sent(pair):
    ours, theirs = pair
    buffer = SendBuffer()
    buffer.reply(bytes(4_000_000))
    buffer.flush(ours)
    assert 0 < buffer.size < buffer.reply_bytes == 4_000_000
    while buffer:
        theirs.recv(1 << 20)
        buffer.flush(ours)
    assert buffer.reply_bytes == 0


def test_nothing_is_left_for_a_connection_that_has_broken(pair):
    ours, theirs = pair
    theirs.close()
    buffer = SendBuffer([b"greeting"])
    with pytest.raises(OSError, match="Broken pipe"):
        buffer.flush(ours)
    buffer.clear()
    assert not buffer
