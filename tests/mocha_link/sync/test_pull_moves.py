"""A sync that began over datagrams and was moved to the connection stays there."""

from __future__ import annotations

from mocha_link.links.metrics import Direction, SyncTimedOut
from tests.mocha_link.network_sim import Carried, NetworkSim
from tests.mocha_link.sync.test_pull import noise, until_some_came


def test_a_datagram_that_comes_late_does_not_hide_that_the_connection_is_lost(team):
    net = NetworkSim(team, datagrams=True, delay_s=0.008)
    net.publish("titan", "/map", noise(3_000_000))
    io = net.nodes["io"]
    io._path_stats["titan"].rtt_s = 0.03  # it was further away last time: datagrams go at once
    io._known["titan"].address_token = net.nodes["titan"]._known["io"].next_token
    held: list[bytes] = []

    def hold(piece: Carried) -> bool:
        if (
            piece[:3] == ("udp", "titan", "io")
            and len(piece.data) > 1000
            and (held or len(net.sent("udp", "titan", "io")) > 5)
        ):
            held.append(piece.data)
            return False
        return True

    net.lets_by = hold
    io.sync("titan", net.now)
    until_some_came(net, 1_000_000)
    assert net.sent("zmq", "titan", "io")
    io.packet_back("titan", held[0], net.now)
    io.lost("titan", "the peer closed the connection", net.now)
    net.wait(0.01)
    (broken,) = (e for e in net.told("io", SyncTimedOut) if e.direction is Direction.IN)
    assert broken.reason == "the peer closed the connection"
