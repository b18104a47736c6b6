"""A robot behind a firewall: it reaches nobody, and gets what it lacks over a peer's connection."""

import socket

import pytest

from mocha_link.links.metrics import MessageStored
from mocha_link.node.node import Node
from tests.mocha_link.conftest import Witness, field, noise  # noqa: F401 - a fixture


@pytest.mark.parametrize("datagrams", [True, False])
@pytest.mark.parametrize("dialler", ["io", "titan"])
def test_both_get_all_though_one_cannot_dial_the_other(field, dialler, datagrams):  # noqa: F811
    """The dialled port of the other one is another process's, which sends nothing."""
    deaf = "titan" if dialler == "io" else "io"
    host, port = field.host, field.team.robot(dialler).port_for(deaf)
    unreachable = field.team.with_robots({dialler: {"address": "127.255.255.254"}})
    with (
        Node(field.team, dialler, datagrams=datagrams) as far,
        Node(unreachable, deaf, datagrams=datagrams) as near,
    ):
        assert socket.create_connection((host, port)).close() is None
        here, there = Witness(near), Witness(far)
        far.publish("/map" if dialler == "titan" else "/pose", noise(200_000, 1))
        near.publish("/map" if deaf == "titan" else "/pose", noise(200_000, 2))
        here.wait(MessageStored, peer=dialler)
        there.wait(MessageStored, peer=deaf)
        far.publish("/map" if dialler == "titan" else "/pose", b"pushed")
        near.publish("/map" if deaf == "titan" else "/pose", b"pushed")
        here.wait(MessageStored, peer=dialler)
        there.wait(MessageStored, peer=deaf)
