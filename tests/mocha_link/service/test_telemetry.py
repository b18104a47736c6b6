"""Metrics for other processes: a snapshot at once, then events."""

import itertools
import select
import socket
import threading
from decimal import Decimal

import numpy as np
import pytest
import zmq

from mocha_link.errors import ListenError
from mocha_link.links.metrics import RssiChanged
from mocha_link.links.reading import Reading, Unit
from mocha_link.node.zmtp import Null, ZmtpSession
from mocha_link.service import server as server_module
from mocha_link.service.server import MetricsServer
from mocha_link.service.service_client import MetricsError, watch
from tests.mocha_link.conftest import no_thread_left
from tests.mocha_link.libzmq import bind


@pytest.fixture
def server(field):
    node, radio, _ = field.node("titan")
    with MetricsServer(node, f"tcp://{field.host}:*") as server:
        server.node, server.radio = node, radio
        yield server


def test_a_snapshot_then_events(server):
    stream = watch(server.endpoint, timeout_s=20)
    kind, fields = next(stream)
    assert kind == "links"
    assert fields["robot"] == "titan"
    assert fields["links"]["io"]["state"] == "idle"
    server.radio.report("io", -90.0)
    header = server.node.publish("/map", b"grid")
    events = list(itertools.islice((f for kind, f in stream if kind == "event"), 2))
    assert {"event": "RssiChanged", "peer": "io", "rssi_dbm": -90.0}.items() <= events[0].items()
    assert events[1]["header"] == str(header)
    stream.close()
    kind, fields = next(stream2 := watch(server.endpoint, timeout_s=20))
    assert fields["links"]["io"]["rssi_dbm"] == -90.0
    stream2.close()


def subscriber(path) -> socket.socket:
    """A socket that has subscribed to everything, as libzmq does it."""
    found = socket.socket(socket.AF_UNIX)
    found.settimeout(20)
    found.connect(str(path))
    session = ZmtpSession(1000, mechanism=Null(b"SUB"))
    found.sendall(session.hello + b"\4\x0a\x09SUBSCRIBE")
    return found


def test_a_subscriber_that_has_stopped_is_cut_off(field, tmp_path, monkeypatch):
    """What waits for it must not grow for as long as it stands still."""
    monkeypatch.setattr(server_module, "SNAPSHOT_S", 0.0002)
    monkeypatch.setattr(server_module, "STOPPED_S", 0.05)
    node, _, _ = field.node("titan")
    path = tmp_path / "metrics"
    with MetricsServer(node, f"ipc://{path}"), subscriber(path) as stopped:
        hung_up = select.poll()
        hung_up.register(stopped, select.POLLHUP)
        assert hung_up.poll(20_000)


def test_what_waits_for_subscribers_is_bounded(field, tmp_path, monkeypatch):
    """Also while they are given the time that a stopped one has."""
    monkeypatch.setattr(server_module, "SNAPSHOT_S", 0.0002)
    monkeypatch.setattr(server_module, "MAX_UNREAD_BYTES", 300_000)
    node, _, _ = field.node("titan")
    path = tmp_path / "metrics"
    with MetricsServer(node, f"ipc://{path}"), subscriber(path) as stopped:
        hung_up = select.poll()
        hung_up.register(stopped, select.POLLHUP)
        assert hung_up.poll(20_000)


def test_an_event_that_cannot_be_encoded_is_left_out(server, caplog):
    stream = watch(server.endpoint, timeout_s=20)
    next(stream)
    for number in range(3):
        bad = RssiChanged("io", 1.0, Decimal(number))  # no number of JSON's
        server._note(bad)
    server.radio.report("io", np.float32(-90.5))
    server.radio.report("callisto", Reading(np.int64(-70), Unit.DBM, "a program"))
    events = list(itertools.islice((f for kind, f in stream if kind == "event"), 2))
    assert [event["signal"]["value"] for event in events] == [-90.5, -70.0]
    assert caplog.text.count("serving metrics: an error") == 1
    stream.close()


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp://203.0.113.7:1"])
def test_an_endpoint_that_is_none(server, endpoint):
    with pytest.raises(ListenError, match="cannot serve metrics on"):
        MetricsServer(server.node, endpoint).start()


def test_a_server_whose_thread_cannot_start_gives_its_endpoint_back(field, tmp_path):
    node, _, _ = field.node("titan")
    endpoint = f"ipc://{tmp_path / 'metrics'}"
    with (
        no_thread_left(),
        pytest.raises(RuntimeError, match="start new thread"),
        MetricsServer(node, endpoint),
    ):
        pass
    with MetricsServer(node, endpoint) as server:
        stream = watch(server.endpoint, timeout_s=20)
        assert next(stream)[0] == "links"
        stream.close()


def test_no_answer(field):
    with pytest.raises(MetricsError, match="is a node running there with --metrics"):
        next(watch(f"tcp://{field.host}:9", timeout_s=0.05))
    with pytest.raises(MetricsError, match="is no endpoint"):
        next(watch("nonsense"))


@pytest.mark.parametrize("frames", [[b"links"], [b"links", b"{"], [b"\xff", b"{}"], [b"", b"[]"]])
def test_something_else_there(field, frames):
    with zmq.Context() as context, context.socket(zmq.XPUB) as other:
        other.setsockopt(zmq.LINGER, 0)
        stream = watch(bind(other, f"tcp://{field.host}:*"), timeout_s=20)

        def answer() -> None:
            other.recv()
            other.send_multipart(frames)

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(MetricsError, match="is not a node's metrics"):
            next(stream)
        thread.join()
