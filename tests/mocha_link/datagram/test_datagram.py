"""Flows of frames over a model of a link: rate, round trip, queue, losses, times when it is up."""

import itertools
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.link.flow_sim import MBIT, TOKEN, End, Way, World
from mocha_link.datagram import packet as wire
from mocha_link.datagram.datagram import PACKET_BYTES, Flow
from mocha_link.datagram.pacing import TRUSTED_BYTES
from mocha_link.datagram.silence import MAX_PROBE_S


def endless(room):
    return bytes(room)


def numbered(count, size=None):
    """A source of so many different frames."""
    numbers = iter(range(count))

    def source(room):
        number = next(numbers, None)
        return (
            None if number is None else number.to_bytes(4, "big") * (min(size or room, room) // 4)
        )

    return source


def link(rate=MBIT, rtt_s=0.05, **faults):
    world = World()
    faults.setdefault("queue_bytes", max(20 * 1220, rate / 10 if not callable(rate) else 0))
    return world, Way(world, rate, rtt_s / 2, **faults), Way(world, rate, rtt_s / 2, **faults)


def contacts(mbit, rtt_s, contact_s, *, count=4, **faults):
    """What arrives in each of several contacts, as a share of rate x (contact - round trip).

    One end pulls when the contact begins; the other one knows the link from the contact before.
    """
    up = [(k * (contact_s + 3), k * (contact_s + 3) + contact_s) for k in range(count)]
    world, there, back = link(mbit * MBIT, rtt_s, up=up, **faults)
    known = {}
    shares = []
    for begin_s, end_s in up:
        world.run(begin_s)
        requests = []

        def answer(room, requests=requests):
            return bytes(room) if requests else None

        request = numbered(1, 64)
        server = End(world, there, answer, **known, got=requests)
        client = End(world, back, request).join(server)
        client.flow.on_contact(world.now_s)
        client.go()
        world.run(end_s)
        shares.append(client.bytes / (mbit * MBIT * (contact_s - rtt_s)))
        flow = server.flow
        known = {"rate_bytes_s": flow.rate_bytes_s, "rtt_s": flow.rtt_s}
        world.run(end_s + 1)
        client.closed = server.closed = True
    return shares


@pytest.mark.parametrize(
    ("mbit", "rtt_s", "contact_s", "queue_packets", "first", "others"),
    [
        (0.25, 0.005, 1, 20, 0.93, 0.93),
        (0.25, 0.3, 1, 160, 0.6, 0.9),
        (1, 0.05, 10, 20, 0.95, 0.95),
        (1, 0.3, 1, 20, 0.5, 0.93),
        (10, 0.05, 1, 20, 0.85, 0.9),
        (10, 0.3, 3, 160, 0.6, 0.9),
    ],
)
def test_a_contact_is_used(  # noqa: PLR0913, PLR0917 - the columns of the table above
    mbit, rtt_s, contact_s, queue_packets, first, others
):
    shares = contacts(mbit, rtt_s, contact_s, count=3, queue_bytes=queue_packets * 1220)
    assert shares[0] >= first
    assert min(shares[1:]) >= others


@pytest.mark.parametrize(("loss", "share"), [(0.01, 0.93), (0.1, 0.79), (0.3, 0.5)])
def test_losses_cost_little_more_than_what_is_lost(loss, share):
    shares = [s for seed in range(3) for s in contacts(1, 0.05, 10, count=2, loss=loss, seed=seed)]
    assert sum(shares) / len(shares) >= share


class Receiver(End):
    """Counts the packets whose frames have arrived before."""

    repeated = 0

    def arrive(self, packet: bytes) -> None:
        before = len(self.got)
        super().arrive(packet)
        self.repeated += bool(wire.parse(packet).frames) and len(self.got) == before


def test_what_is_only_overtaken_is_hardly_sent_again():
    world, there, back = link(jitter_s=0.05)
    a = End(world, there, endless).join(b := Receiver(world, back))
    a.go()
    world.run(10)
    assert b.repeated < 0.05 * len(b.got)
    assert b.bytes > 0.8 * MBIT * 10


@pytest.mark.parametrize("contact", [True, False])
def test_a_cut_and_what_comes_after(contact):
    rtt_s = 0.1
    world, there, back = link(rtt_s=rtt_s, up=[(0, 2.05), (8, 10)])
    a = End(world, there, numbered(10_000)).join(b := Receiver(world, back))
    a.go()
    world.run(3)
    assert a.flow.down
    before = there.offered
    world.run(7.999)
    assert there.offered - before < 12  # it does not flood a link that is down
    before = b.bytes
    world.run(8)
    (a if contact else b).flow.on_contact(world.now_s)  # the side that notices the contact
    (a if contact else b).go()
    world.run(8 + rtt_s + 0.05)
    assert not a.flow.down
    assert b.bytes > before
    world.run(10)
    assert b.bytes - before > 0.9 * MBIT * (2 - rtt_s)
    assert b.repeated <= (6 if contact else 0)  # it could not be known what had arrived
    numbers = [int.from_bytes(frame[:4], "big") for frame in b.got]
    assert len(set(numbers)) == len(numbers)


def test_contacts_do_not_flood_a_link_that_is_down():
    world, there, back = link(up=[(100, 101)])
    a = End(world, there, endless, rate_bytes_s=MBIT, rtt_s=0.05).join(End(world, back))
    for tenth in range(200):
        world.run(tenth / 10)
        a.flow.on_contact(world.now_s)
        a.go()
    assert there.offered < 20 * 40
    assert len(a.flow._outbox._contents) < 64


@pytest.mark.parametrize(
    ("mbit", "rtt_s", "queue_bytes", "known"),
    [
        (1, 0.05, 24_400, True),
        (1, 0.05, 125_000, True),
        (10, 0.05, 24_400, False),
    ],
)
def test_two_flows_share_a_link(mbit, rtt_s, queue_bytes, known):
    world, there, back = link(mbit * MBIT, rtt_s, queue_bytes=queue_bytes)
    memory = {"rate_bytes_s": mbit * MBIT, "rtt_s": rtt_s} if known else {}
    flows = [(End(world, there, endless, **memory), End(world, back)) for _ in range(2)]
    for number, (sender, receiver) in enumerate(flows):
        sender.join(receiver)
        world.at(2.0 * number, sender.go)
    world.run(3)
    before = [receiver.bytes for _, receiver in flows]
    dropped = there.dropped
    world.run(11)
    shares = [
        (receiver.bytes - size) / (mbit * MBIT * 8)
        for (_, receiver), size in zip(flows, before, strict=True)
    ]
    assert sum(shares) > 0.9
    assert min(shares) > 0.25
    assert there.dropped - dropped < 0.2 * mbit * MBIT * 8 / 1220


@pytest.mark.parametrize("queue_bytes", [24_400, 1_000_000])
def test_a_link_that_becomes_ten_times_slower(queue_bytes):
    rtt_s = 0.05
    world, there, back = link(
        lambda now_s: 10 * MBIT if now_s < 3 else MBIT, rtt_s, queue_bytes=queue_bytes
    )
    urgent = []
    a = End(world, there, lambda room: urgent.pop() if urgent else bytes(room))
    a.join(b := End(world, back)).go()
    world.run(3.2)
    urgent.append(b"urgent")
    world.run(6)
    index = b.got.index(b"urgent")
    assert b.got_s[index] - 3.2 < 1 + rtt_s
    assert sum(map(len, b.got[index:])) > 0.8 * MBIT * (6 - b.got_s[index])
    assert there.free_s - world.now_s < 0.3  # and the queue is short again


@pytest.mark.parametrize(
    ("mbit", "rtt_s", "memory", "share"),
    [
        (10, 0.05, {"rate_bytes_s": MBIT / 4, "rtt_s": 0.05}, 0.45),
        (1, 0.05, {"rate_bytes_s": 10 * MBIT, "rtt_s": 0.05}, 0.85),
        (1, 0.3, {"rate_bytes_s": MBIT, "rtt_s": 0.005}, 0.7),
        (1, 0.005, {"rate_bytes_s": MBIT, "rtt_s": 0.3}, 0.9),
        (1, 0.05, {"rate_bytes_s": 1e300}, 0.7),
        (1, 0.05, {"rate_bytes_s": 1e-300, "rtt_s": 1e-9}, 0.7),
    ],
)
def test_a_memory_that_is_wrong(mbit, rtt_s, memory, share):
    world, there, back = link(mbit * MBIT, rtt_s)
    a = End(world, there, endless, **memory).join(b := End(world, back))
    a.go()
    world.run(5)
    assert b.bytes > share * mbit * MBIT * 5


def test_a_sender_with_little_data_does_not_forget_the_rate():
    world, there, back = link()
    queue = []
    a = End(world, there, lambda _: queue.pop() if queue else None, rate_bytes_s=MBIT, rtt_s=0.05)
    a.join(b := End(world, back))
    for tenth in range(100):
        world.run(tenth / 10)
        queue.append(bytes(100))
        a.go()
    world.run(11)
    assert len(b.got) == 100
    assert a.flow.rate_bytes_s == pytest.approx(MBIT, rel=0.05)
    assert a.flow.rtt_s == pytest.approx(0.05, rel=0.1)
    assert a.flow.wake_s is None


# --- step by step


def test_room_is_kept():
    rooms = []

    def source(room):
        rooms.append(room)
        return bytes(room) if len(rooms) < 5 else None

    for packet in Flow(TOKEN, source).transmit(0.0):
        assert len(packet) <= PACKET_BYTES
    assert rooms[0] >= 1_170
    with pytest.raises(ValueError, match="a frame of 1500 bytes where"):
        Flow(TOKEN, lambda _: bytes(1500)).transmit(0.0)
    with pytest.raises(ValueError, match="a token has 6 bytes, not 3"):
        Flow(b"abc", source)


def test_a_lost_tail_is_sent_again_within_two_round_trips():
    sender = Flow(TOKEN, numbered(1, 500), rate_bytes_s=MBIT, rtt_s=0.1)
    (lost,) = sender.transmit(0.0)
    assert 0.1 < sender.wake_s < 0.2
    assert sender.transmit(0.09) == []
    (again,) = sender.transmit(sender.wake_s)
    assert len(again) == len(lost) + 2
    receiver = Flow(TOKEN, lambda _: None)
    assert receiver.receive(again, 0.2) == [bytes(500)]
    assert receiver.receive(lost, 0.3) == []
    for packet in receiver.transmit(0.3):
        sender.receive(packet, 0.4)
    assert sender.settled


def test_of_a_remembered_window_not_all_leaves_unconfirmed():
    sender = Flow(TOKEN, endless, rate_bytes_s=125e6, rtt_s=1.0)
    sent = sum(len(sender.transmit(k / 1000)) for k in range(500))
    assert 0 < sent <= TRUSTED_BYTES / PACKET_BYTES + 1


def test_a_peer_that_is_gone_is_tried_rarely_and_never_less_than_once_a_second():
    flow = Flow(TOKEN, endless)
    left_s = [tick / 50 for tick in range(1, 3_000) if flow.transmit(tick / 50)]
    gaps_s = [later - sooner for sooner, later in itertools.pairwise(left_s)]
    assert gaps_s[-10:] == pytest.approx([MAX_PROBE_S] * 10)
    assert max(gaps_s) < MAX_PROBE_S + 0.021


def test_a_flow_ends_with_its_numbers():
    """Neither frames nor probes leave then, though nothing of it was acknowledged."""
    flow = Flow(TOKEN, numbered(9), first_number=wire.MAX_NUMBER - 2)
    sent = [packet for k in range(100) for packet in flow.transmit(k / 10)]
    flow.on_contact(10.0)
    assert flow.transmit(10.0) == []
    numbers = [wire.parse(packet).number for packet in sent]
    assert numbers == [wire.MAX_NUMBER - 2, wire.MAX_NUMBER - 1, wire.MAX_NUMBER]


# --- what comes from elsewhere


def probe(number: int) -> bytes:
    return wire.data(TOKEN, number, floor=0, content=number, body=b"", ack=b"")


@pytest.mark.parametrize("source", [endless, numbered(0)])
@pytest.mark.parametrize(
    "numbers",
    [
        pytest.param([8 * number for number in range(200)], id="gaps"),
        pytest.param([0, 1_000] + [0] * 200, id="copies"),
    ],
)
def test_an_unproven_address_gets_three_times_its_bytes_acknowledgements_included(source, numbers):
    """Spread numbers make an acknowledgement ten times as long as the packet that requests it."""
    flow = Flow(TOKEN, source, proven=False)
    received = sent = 0
    for count, number in enumerate(numbers):
        now_s = count / 1000
        flow.receive(probe(number), now_s)
        received += len(probe(number))
        sent += sum(map(len, flow.transmit(now_s)))
        assert sent <= 3 * received
        assert flow.wake_s is None or flow.wake_s > now_s
    assert sent > received


def test_with_data_as_well_an_unproven_address_gets_three_times_its_bytes():
    flow = Flow(TOKEN, endless, proven=False)
    received = sent = 0
    for count in range(40):
        body = wire.join([bytes(30)])
        packet = wire.data(TOKEN, 8 * count, floor=0, content=8 * count, body=body, ack=b"")
        flow.receive(packet, count / 1000)
        received += len(packet)
        sent += sum(map(len, flow.transmit(count / 1000)))
        assert sent <= 3 * received


def test_acknowledgements_of_what_was_never_sent_are_refused():
    flow = Flow(TOKEN, numbered(2))
    flow.transmit(0.0)
    for below, skip, bits in ((3, 0, b""), (0, 8000, b"\1"), (0, 0, b"\4"), (2**32 - 1, 0, b"")):
        ack = struct.pack(">IHHB", below, skip, 0, len(bits)) + bits
        assert flow.receive(wire.only_ack(TOKEN, ack), 0.1) == []
    assert flow.refused == 4
    assert not flow.settled
    assert flow._outbox.in_flight_bytes > 0


@given(
    st.lists(st.booleans(), max_size=60),
    st.lists(st.booleans(), max_size=60),
    st.integers(1, 40),
    st.sampled_from([None, 900, 200]),
)
def test_every_frame_arrives_once_whatever_is_lost(there_lost, back_lost, count, size):
    world, there, back = link(2 * MBIT, 0.02, jitter_s=0.03, twice=0.1)
    drop(there, there_lost)
    drop(back, back_lost)
    a = End(world, there, numbered(count, size)).join(
        b := End(world, back, numbered(count // 2, size))
    )
    a.go()
    b.go()
    world.run(90)
    for end, sent in ((a, count // 2), (b, count)):
        assert sorted(int.from_bytes(frame[:4], "big") for frame in end.got) == list(range(sent))
        assert end.flow.settled
        assert (end.flow._outbox.in_flight_bytes, end.flow.refused) == (0, 0)


def drop(way, lost):
    """The first packets of a way get lost as given, the others arrive."""
    pattern = iter(lost)
    send = way.send
    way.send = lambda packet, to: None if next(pattern, False) else send(packet, to)


@given(st.lists(st.binary(max_size=60), max_size=20), st.randoms(use_true_random=False))
def test_whatever_is_received(junk, generator):
    """Random bytes, and real packets, changed, cut off or repeated: no harm, no growth."""
    a, b = Flow(TOKEN, numbered(30)), Flow(TOKEN, numbered(30))
    now_s = 0.0
    for rest in [*junk, b"", b""]:
        now_s += 0.05
        packets = a.transmit(now_s) + b.transmit(now_s)
        packets += [rest, bytes([wire.VERSION | generator.randrange(8)]) + TOKEN + rest]
        for packet in packets:
            bad = bytearray(packet)
            for _ in range(generator.randrange(4)):
                if bad:
                    bad[generator.randrange(len(bad))] = generator.randrange(256)
            cut = bytes(bad[: generator.randrange(len(bad) + 1)])
            for flow in (a, b):
                for raw in (bytes(bad), cut, packet):
                    assert all(len(frame) < 1500 for frame in flow.receive(raw, now_s))
                wake_s = flow.wake_s
                assert wake_s is None or math.isfinite(wake_s)
        assert max(flow._outbox.in_flight_bytes for flow in (a, b)) < 100 * PACKET_BYTES
        assert max(flow._arrivals._seen.bit_length() for flow in (a, b)) <= wire.WINDOW
