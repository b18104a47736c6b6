"""What the poller says is ready, and whose it is."""

from __future__ import annotations

import contextlib
import socket

import pytest
import zmq

from mocha_link.node.kernel import Poller

WAIT_MS = 20_000


@pytest.fixture
def poller():
    with contextlib.closing(Poller()) as poller:
        yield poller


@pytest.fixture
def pair():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ours, theirs


def test_what_is_ready_is_told_with_its_owner(poller, pair):
    ours, theirs = pair
    poller.register(ours.fileno(), zmq.POLLIN, "io")
    assert poller.poll(0) == {}
    theirs.send(b"x")
    assert poller.poll(WAIT_MS) == {ours.fileno(): "io"}
    ours.recv(1)
    poller.register(ours.fileno(), zmq.POLLIN | zmq.POLLOUT, "io")
    assert poller.poll(0) == {ours.fileno(): "io"}


def test_what_waits_for_nothing_is_not_looked_at(poller, pair):
    ours, theirs = pair
    theirs.send(b"x")
    poller.register(ours.fileno(), zmq.POLLIN)
    poller.register(ours.fileno(), 0)
    assert poller.poll(0) == {}
    with pytest.raises(KeyError):
        poller.unregister(ours.fileno())


def test_a_socket_of_libzmq_is_ready_as_long_as_a_message_waits(poller):
    with zmq.Context() as context, context.socket(zmq.PAIR) as ours, context.socket(zmq.PAIR) as to:
        ours.bind("inproc://a")
        to.connect("inproc://a")
        poller.register(ours, zmq.POLLIN, "io")
        for _ in range(2):
            to.send(b"x")
        for _ in range(2):
            assert poller.poll(WAIT_MS)[ours] == "io"
            ours.recv()
        assert "io" not in poller.poll(0).values()
        poller.unregister(ours)
        to.send(b"x")
        assert ours not in poller.poll(0)
