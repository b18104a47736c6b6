"""The limit of descriptors; what the poller reports as ready."""

import contextlib
import resource
import socket
from pathlib import Path

import pytest
import zmq

from mocha_link.errors import ListenError
from mocha_link.node import kernel
from mocha_link.node.kernel import Poller
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio

WAIT_MS = 20_000


@pytest.fixture
def few(monkeypatch):
    """So many descriptors as are open now, and so many more as the system grants on request."""
    taken = len(list(Path("/proc/self/fd").iterdir()))
    limits = [taken, taken]
    monkeypatch.setattr(resource, "getrlimit", lambda _: tuple(limits))
    monkeypatch.setattr(resource, "setrlimit", lambda _, wanted: limits.__setitem__(0, wanted[0]))
    return limits


def test_the_limit_of_descriptors_is_raised_where_that_is_allowed(few):
    few[1] = few[0] + 100
    before = few[0]
    assert kernel.descriptors_lacking(50) == 0
    assert before + 50 <= few[0] <= before + 51  # reading the folder takes one
    assert kernel.descriptors_lacking(120) in (20, 21)
    assert few[0] == few[1]


def test_a_node_with_more_peers_than_descriptors_reports_it(few, field):
    node = Node(field.team, "titan", radio=ManualRadio())
    with pytest.raises(ListenError, match=r"titan needs \d+ open files for 2 peers, .*ulimit -n"):
        node.start()
    node.close()


# --- the poller


@pytest.fixture
def poller():
    with contextlib.closing(Poller()) as poller:
        yield poller


@pytest.fixture
def pair():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ours, theirs


def test_what_is_ready_is_reported_with_its_owner(poller, pair):
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


@pytest.mark.skipif(not hasattr(socket, "TCP_INFO"), reason="only Linux has TCP_INFO")
def test_what_a_full_window_keeps_back_is_not_sent():
    """The peer does not read, so its window closes."""
    with kernel.listener("127.0.0.1", 0) as listening:
        ours = socket.create_connection(listening.getsockname())
        theirs, _ = listening.accept()
        with ours, theirs:
            assert kernel.standing(ours).unsent_bytes == 0
            ours.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    ours.send(bytes(65_536))
            measured = kernel.standing(ours)
            assert measured.unsent_bytes
            assert measured.rtt_s
            assert not measured.loses_much
    assert kernel.standing(ours) == kernel.standing(None)
