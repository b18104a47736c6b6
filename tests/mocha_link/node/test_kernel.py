"""What is borrowed from libzmq may be gone, or something else, at any time."""

from __future__ import annotations

import os
import resource
import socket
from pathlib import Path

import pytest

from mocha_link.errors import ListenError
from mocha_link.node import kernel
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio


def open_files() -> set[str]:
    return {each.name for each in Path("/proc/self/fd").iterdir()}


def test_a_connection_that_is_still_the_one():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as connection:
            with kernel.borrowed(connection.fileno(), remote=port) as found:
                assert found.getpeername()[1] == port
            with kernel.borrowed(connection.fileno(), remote=port ^ 1) as found:
                assert found is None
            assert connection.getpeername()[1] == port  # it was only borrowed


def test_a_number_that_is_something_else_by_now():
    ends = os.pipe()
    before = open_files()
    for each in ends:
        with kernel.borrowed(each, remote=1) as found:
            assert found is None
    assert open_files() == before
    for each in ends:
        os.close(each)


def test_a_number_that_is_nothing_by_now():
    ends = os.pipe()
    for each in ends:
        os.close(each)
    for each in (*ends, None):
        with kernel.borrowed(each, local=1) as found:
            assert found is None


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


def test_a_node_with_more_peers_than_descriptors_says_so(few, field):
    node = Node(field.team, "titan", radio=ManualRadio())
    with pytest.raises(ListenError, match=r"titan needs \d+ open files for 2 peers, .*ulimit -n"):
        node.start()
    node.close()
