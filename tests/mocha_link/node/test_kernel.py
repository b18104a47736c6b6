"""What is borrowed from libzmq may be gone, or something else, at any time."""

from __future__ import annotations

import os
import socket
from pathlib import Path

from mocha_link.node import kernel


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
