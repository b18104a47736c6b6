"""Who begins in the peer's name by a datagram makes us send the peer little."""

import random

import pytest

from benchmarks.fleet.network_sim import NetworkSim
from mocha_link.datagram import packet as wire
from mocha_link.datagram.datagram import Flow
from mocha_link.links.metrics import SyncEnded, SyncTimedOut
from mocha_link.store.database import Database
from mocha_link.sync.server import Server
from tests.mocha_link.network import peer_of
from tests.mocha_link.sync.test_server import TEAM, PullingPeer, at, fill

FAR_S = 0.05


@pytest.fixture
def database() -> Database:
    database = Database()
    fill(database)
    return database


@pytest.fixture
def server(database) -> Server:
    return Server(peer_of(database, team=TEAM))


def opening(server: Server, *, padded: int, address_token: int) -> bytes:
    """The first datagram of a sender that claims to be io."""
    io = PullingPeer(server, address_token=address_token)
    frames = io.receiver.open(at(0)) + ([bytes(padded)] if padded else [])
    flow = Flow(io.id, lambda _: frames.pop(0) if frames else None)
    (packet,) = flow.transmit(at(0).steady_s)
    return packet


def sent_by(server: Server, *, seconds: float = 60) -> list[bytes]:
    """All that it sends by datagrams, whatever it waits for."""
    packets, time_s = server.transmit(at(0)), 0.0
    while time_s < seconds:
        time_s += 0.02
        server.tick(at(time_s))
        packets += server.transmit(at(time_s))
    return packets


@pytest.mark.parametrize("address_token", [0, 12345])
@pytest.mark.parametrize("padded", [0, 500, 1_100])
def test_little_is_sent_to_who_has_not_been_reached(server, padded, address_token):
    packet = opening(server, padded=padded, address_token=address_token)
    assert server.packet(packet, at(0))
    packets = sent_by(server)
    assert packets
    assert sum(map(len, packets)) <= 3 * len(packet)


def test_acknowledgements_that_guess_prove_nothing(server):
    packet = opening(server, padded=1_000, address_token=0)
    server.packet(packet, at(0))
    sent, received, rng = sum(map(len, server.transmit(at(0)))), len(packet), random.Random(1)
    for number in range(2_000):
        first = 0 if number % 2 else rng.getrandbits(31)
        ack = wire.only_ack(b"ididid", wire._ACK.pack(first, 0, 0, 1) + b"\xff")
        server.packet(ack, at(number / 1000))
        received += len(ack)
        sent += sum(map(len, server.transmit(at(number / 1000))))
    assert sent <= 3 * received


def test_who_shows_a_ticket_is_served_at_once(server):
    address_token = server.peer.tokens.next
    server.packet(opening(server, padded=0, address_token=address_token), at(0))
    assert sum(map(len, server.transmit(at(0)))) > 10_000


def test_a_ticket_is_good_for_a_few_syncs():
    """So a copy of an opening is of use for that long only."""
    known = peer_of()
    address_token = known.tokens.next
    assert not known.tokens.verify(0)
    for _ in range(3):
        assert known.tokens.verify(address_token)
        known.tokens.renew()
    assert not known.tokens.verify(address_token)
    assert known.tokens.next != address_token


def test_only_syncs_that_got_through_use_tokens_up(server):
    address_token = server.peer.tokens.next
    for number in range(4):
        io = PullingPeer(server, number.to_bytes(6))
        io.cast(at(100 * number))
        sent_by(server)
        server.tick(at(100 * number + 50))
    assert server.peer.tokens.verify(address_token)
    for number in range(3):
        io = PullingPeer(server, (100 + number).to_bytes(6))
        io.cast(at(1000 + 100 * number))
        io.run(1000 + 100 * number, FAR_S)
        server.tick(at(1000 + 100 * number + 50))
    assert not server.peer.tokens.verify(address_token)


@pytest.fixture
def net(team) -> NetworkSim:
    net = NetworkSim(team, datagrams=True, delay_s=FAR_S)
    net.link("io", "titan").peer.path.measured(2 * FAR_S)  # so that datagrams go at once
    return net


@pytest.mark.parametrize("path", ["udp", "zmq"])
def test_copies_neither_end_what_goes_on_nor_change_the_peers_address(net, path):
    """Of any pull so far, while the peer follows and while it pulls over its connection."""
    titan = net.nodes["titan"]
    net.pull("io", "titan")
    if path == "zmq":
        net.blocked = {("udp", "titan", "io")}  # the connection serves, and stands from then on
    else:
        net.blocked = {("zmq", "io", "titan")}
    for _ in range(25):
        net.publish("titan", "/map", b"grid")
        net.pull("io", "titan")
    assert net.nodes["io"].links(net.now)["titan"].path == path
    recorded = net.sent("udp", "io", "titan")
    assert recorded
    for pulls in (False, True):
        if pulls:
            net.publish("titan", "/map", random.Random(1).randbytes(500_000))
            net.nodes["io"].sync("titan", net.now)
            net.wait(3 * FAR_S)
        before = len(net.events_of("titan", SyncTimedOut))
        for packet in recorded:
            assert not titan.packet_in("io", packet, net.now)
            net.wait(0.02)
        assert len(net.events_of("titan", SyncTimedOut)) == before
        net.settle()
        net.publish("titan", "/slow", b"pushed %d" % pulls)
        titan.flush(net.team.topic("titan", "/slow"), net.now)
        net.wait(1)
        assert net.held("io")["titan", "/slow"] == b"pushed %d" % pulls


def pulled_s(net: NetworkSim) -> float:
    net.publish("titan", "/map", random.Random(1).randbytes(15_000))
    net.pull("io", "titan")
    net.wait(5)
    end = net.events_of("io", SyncEnded)[-1]
    assert (end.messages, end.complete) == (1, True)
    return end.duration_s


def test_a_round_trip_at_the_first_contact_and_nothing_later(net):
    net.blocked = {("zmq", "io", "titan")}  # else the connection carries the rest of the first
    first = pulled_s(net)
    later = [pulled_s(net) for _ in range(5)]
    assert net.nodes["io"].links(net.now)["titan"].path == "udp"
    assert max(later) < 1.5 * 2 * FAR_S
    assert first < max(later) + 1.3 * 2 * FAR_S
