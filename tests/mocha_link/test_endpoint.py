"""Where a node and its bridges serve other programs: nobody's endpoint is taken away."""

from __future__ import annotations

import socket

import pytest
import zmq

from mocha_link.endpoint import bind
from mocha_link.port import ListenError, PortInUseError


@pytest.fixture
def server():
    with zmq.Context() as context, context.socket(zmq.ROUTER) as found:
        yield found


@pytest.fixture
def other():
    with zmq.Context() as context, context.socket(zmq.ROUTER) as found:
        yield found


def test_a_free_port_is_told(server):
    assert bind(server, "tcp://127.0.0.1:*").rpartition(":")[2].isdecimal()


@pytest.mark.parametrize("kind", ["ipc", "abstract", "tcp"])
def test_what_another_program_has_stays_its_own(server, other, tmp_path, kind):
    endpoints = {"ipc": f"ipc://{tmp_path}/s", "abstract": f"ipc://@{tmp_path}"}
    endpoint = bind(other, endpoints.get(kind, "tcp://127.0.0.1:*"))
    with pytest.raises(PortInUseError, match="in use; choose another one"):
        bind(server, endpoint)
    with zmq.Context() as context, context.socket(zmq.DEALER) as client:
        client.linger = 0
        client.connect(endpoint)
        client.send(b"still there?")
        assert other.poll(10_000)
        assert other.recv_multipart()[1] == b"still there?"


def test_what_a_process_that_is_gone_has_left_is_cleared_away(server, tmp_path):
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(f"{tmp_path}/s")
        left.listen()
    assert bind(server, f"ipc://{tmp_path}/s") == f"ipc://{tmp_path}/s"


def test_a_file_is_not_deleted(server, tmp_path):
    path = tmp_path / "team.yaml"
    path.write_text("robots: {}")
    with pytest.raises(ListenError, match="there is a file of that name"):
        bind(server, f"ipc://{path}")
    assert path.read_text() == "robots: {}"


@pytest.mark.parametrize(
    "endpoint", ["nonsense", "tcp://127.0.0.1", "ipc:///no/such/place", "tcp://192.0.2.1:5"]
)
def test_what_cannot_be_served(server, endpoint):
    with pytest.raises(ListenError, match=f"cannot serve news on {endpoint}: .*; write ipc://path"):
        bind(server, endpoint, "cannot serve news")
