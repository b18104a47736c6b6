"""Packets byte by byte, and what the receiving end knows of them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocha_link.datagram import packet as wire
from mocha_link.datagram.packet import ACK_DELAY_S, MAX_NUMBER, WINDOW, Arrivals, Packet
from tests.mocha_link.conftest import DATA

TOKEN = b"abcdef"
PACKETS = (DATA.parent / "refused" / "packets.txt").read_text().splitlines()
FAST = settings(deadline=None, max_examples=100)
FRAMES = st.lists(st.binary(max_size=50), max_size=5)


def numbered(number, *, floor=0, content=None, frames=(b"x",)):
    return Packet(None, number, floor, number if content is None else content, list(frames))


def test_a_repeated_packet_with_an_acknowledgement_byte_by_byte():
    arrivals = Arrivals()
    for number in (0, 1, 3):
        arrivals.take(numbered(number), 10.0)
    ack = arrivals.acknowledge(10.025)
    raw = wire.data(TOKEN, 260, floor=256, content=257, body=wire.join([b"z"]), ack=ack)
    assert raw == bytes.fromhex(
        "57 616263646566 00000002 0000 00fa 01 02 00000104 0004 0003 0001 7a"
    )
    parsed = wire.parse(raw)
    assert parsed == Packet((2, 2, 2, pytest.approx(0.025)), 260, 256, 257, [b"z"])


@FAST
@given(st.integers(0, MAX_NUMBER), st.data(), FRAMES)
def test_what_is_packed_is_parsed(number, data, frames):
    floor = data.draw(st.integers(max(0, number - WINDOW + 1), number))
    content = data.draw(st.integers(floor, number))
    raw = wire.data(TOKEN, number, floor=floor, content=content, body=wire.join(frames), ack=b"")
    assert raw[1:7] == TOKEN
    assert wire.parse(raw) == Packet(None, number, floor, content, frames)


@pytest.mark.parametrize("raw", [line.partition("#")[0] for line in PACKETS])
def test_what_is_not_as_it_has_to_be(raw):
    assert wire.parse(bytes.fromhex(raw)) is None


@FAST
@given(st.lists(st.integers(0, 300), max_size=200))
def test_arrivals_are_reported_as_they_are(numbers):
    arrivals = Arrivals()
    known = set()
    for number in numbers:
        assert arrivals.take(numbered(number), 0.0) == (number not in known)
        known.add(number)
    if not known:
        return
    ack = wire.parse(wire.only_ack(TOKEN, arrivals.acknowledge(0.0))).ack
    assert known == {
        number
        for number in range(400)
        if number < ack.below or (number >= ack.start and ack.bits >> (number - ack.start) & 1)
    }


EDGES = (0, 1, 2, WINDOW - 1, WINDOW, 2**31, 2**32 - WINDOW, 2**32 - 3, 2**32 - 2, 2**32 - 1)


@FAST
@given(st.lists(st.tuples(*[st.sampled_from(EDGES)] * 3), max_size=12), st.data())
def test_whatever_is_taken_can_be_acknowledged(packets, data):
    """Numbers, floors and first numbers at both ends of what fits, far apart, in any order."""
    arrivals = Arrivals()
    for number, behind, back in packets:
        frames = data.draw(FRAMES)
        parts = {"floor": number - behind % WINDOW, "content": number - back % WINDOW}
        parsed = wire.parse(wire.data(TOKEN, number, body=wire.join(frames), ack=b"", **parts))
        if parsed is not None:
            arrivals.take(parsed, 0.0)
        ack = wire.parse(wire.only_ack(TOKEN, arrivals.acknowledge(0.0))).ack
        assert ack.below <= MAX_NUMBER + 1
        assert arrivals._seen.bit_length() <= WINDOW


def test_frames_that_come_in_two_packets_count_once():
    arrivals = Arrivals()
    assert arrivals.take(numbered(7, content=2), 0.0)
    assert not arrivals.take(numbered(2), 0.0)
    assert not arrivals.take(numbered(9, content=2), 0.0)
    assert arrivals.take(numbered(4), 0.0)
    assert not arrivals.take(numbered(12, content=4), 0.0)


def test_numbers_beyond_the_window_are_not_kept():
    arrivals = Arrivals()
    assert not arrivals.take(numbered(WINDOW), 0.0)
    assert arrivals.take(numbered(WINDOW - 1), 0.0)
    assert arrivals.take(numbered(MAX_NUMBER, floor=MAX_NUMBER - 9), 0.0)
    assert arrivals._seen.bit_length() <= WINDOW
    assert not arrivals.take(Packet(None, None, 0, 0, []), 0.0)


def test_many_gaps_are_reported_from_the_newest_end():
    arrivals = Arrivals()
    for number in range(0, 4000, 2):
        arrivals.take(numbered(number), 0.0)
    assert arrivals.acknowledge(0.0, room=8) == b""  # it does not fit: later, alone
    ack = wire.parse(wire.only_ack(TOKEN, arrivals.acknowledge(0.0))).ack
    assert ack.below == 1
    assert ack.start + ack.bits.bit_length() == 3999
    assert ack.bits.bit_count() > wire.MAX_MASK * 4 - 8


def test_when_an_acknowledgement_is_due():
    arrivals = Arrivals()
    arrivals.take(numbered(0), 1.0)
    assert arrivals.due_s == 1.0 + ACK_DELAY_S
    arrivals.take(numbered(1), 1.01)
    assert arrivals.due_s == 1.01  # two of them
    arrivals.acknowledge(1.01)
    assert arrivals.due_s is None
    arrivals.take(numbered(3), 1.02)
    assert arrivals.due_s == 1.02  # one is missing
    arrivals.acknowledge(1.02)
    arrivals.take(numbered(3), 1.03)
    assert arrivals.due_s == 1.03  # the other end does not know that it came
    arrivals.acknowledge(1.03)
    arrivals.take(numbered(4, frames=()), 1.04)
    assert arrivals.due_s == 1.04  # a probe
