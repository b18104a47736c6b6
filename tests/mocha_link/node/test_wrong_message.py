"""A request of the original protocol that is damaged in the header that it requests."""

import pytest

from benchmarks.fleet.network_sim import NetworkSim, team_of
from mocha_link.sync.protocol import GDATA

A, B, C = range(3)
TEAM = team_of(
    "robots:\n"
    "  a: {kind: rover, address: a, base_port: 10, clients: [b, c]}\n"
    "  b: {kind: rover, address: b, base_port: 10, clients: [a, c]}\n"
    "  c: {kind: rover, address: c, base_port: 10, clients: [a, b], original: true}\n"
    "kinds:\n"
    "  rover: {topics: [{name: /pose, type: json/Pose}, {name: /goal, type: json/Pose}]}\n"
)


@pytest.mark.parametrize(
    ("place", "value"), [(11, C), (12, 1)], ids=["another robot", "another topic"]
)
def test_the_message_of_another_one_of_the_same_time_is_refused(place, value):
    """Nothing else in it would show it: type, time and size may be the same."""
    net = NetworkSim(TEAM, names="abc")
    net.publish("b", "/pose", b"b is here")
    net.publish("b", "/goal", b"b goes there")
    net.publish("c", "/pose", b"c is here")
    net.pull("c", "b")
    requested = []

    def alter(piece):
        data = piece.data
        if piece[:3] == ("zmq", "a", "c") and data[6:13] == GDATA + bytes((B, 0)):
            requested.append(data)
            data = data[:place] + bytes((value,)) + data[place + 1 :]
        return data

    net.alter = alter
    net.pull("a", "c")
    assert len(requested) == 1
    assert net.held("a") == {("b", "/goal"): b"b goes there", ("c", "/pose"): b"c is here"}
    assert net.nodes["a"].links(net.now)["c"].refused == 1
    net.alter = lambda piece: piece.data
    net.pull("a", "c")
    assert net.held("a")["b", "/pose"] == b"b is here"
