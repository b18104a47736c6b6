"""Metrics for other processes: a snapshot at once, then events."""

from __future__ import annotations

import itertools
import threading

import pytest
import zmq

from mocha_link.errors import ListenError
from mocha_link.service.endpoint import bind
from mocha_link.service.server import MetricsServer
from mocha_link.service.service_client import MetricsError, watch


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


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp://203.0.113.7:1"])
def test_an_endpoint_that_is_none(server, endpoint):
    with pytest.raises(ListenError, match="cannot serve metrics on"):
        MetricsServer(server.node, endpoint).start()


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
