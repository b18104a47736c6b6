"""An original peer that is not named as one: what is new falls silent once it has refused."""

from __future__ import annotations

from tests.mocha_link.network_sim import NetworkSim, OldNode
from tests.mocha_link.sync.test_pull import FAR_S, UP, noise


def test_no_datagrams_to_a_peer_that_has_refused_the_sync(team):
    """A long pull on a slow link: each of them would take of it."""
    net = NetworkSim(team, datagrams=True, delay_s=FAR_S)
    OldNode(net, "titan").publish("/map", noise(100_000))
    net.lets_by = lambda piece: piece[:3] != ("zmq", "titan", "io") or len(piece.data) < 10_000
    io = net.nodes["io"]
    io.sync("titan", net.now)
    net.wait(1)
    before = len(net.sent(*UP))
    assert before
    for _ in range(30):  # the reply is coming in
        io.progress("titan", net.now)
        net.wait(1)
    assert len(net.sent(*UP)) == before
    assert io.wake_s is None
