"""The metrics as Prometheus reads them: checked by Prometheus' own parser, and over HTTP."""

import contextlib
import http.client
import json
import socket
import struct
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest
from prometheus_client.parser import text_string_to_metric_families

from mocha_link.links.metrics import LinkMetrics, LinkState
from mocha_link.links.reading import Reading, Unit
from mocha_link.service import prometheus
from mocha_link.service.prometheus import (
    MAX_CONNECTIONS,
    PrometheusError,
    PrometheusServer,
    exposition,
)
from tests.mocha_link.conftest import no_thread_left

IO = LinkMetrics(
    "io",
    state=LinkState.ENDED,
    last_sync_in_s=1000.5,
    rtt_s=0.05,
    rtt_smoothed_s=0.06,
    bandwidth_bytes_s=125_000.0,
    bytes_in=12_345,
    bytes_out=3,
    syncs_in=4,
    timeouts=1,
    signal=Reading(-61.5, Unit.DBM, "wifi"),
    topic_ages_s={"/pose": 1.5, '/a"b\\c\nd': 2.0},
    contacts_begun=2,
    path="udp",
    protected=True,
)


@pytest.fixture
def node(clock):
    signal = Reading(7, Unit.DEVICE, "rajant")
    links = {"io": IO, "europa": LinkMetrics("europa", signal=signal)}
    return SimpleNamespace(name="titan", clock=clock, storage_fault=None, links=lambda: links)


def samples(text):
    """Every sample, by its name and labels without the robot's; each family has its help."""
    found = {}
    for family in text_string_to_metric_families(text):
        assert family.documentation
        assert family.type in ("gauge", "counter")
        for sample in family.samples:
            labels = dict(sample.labels)
            assert labels.pop("robot") == "titan"
            key = sample.name, *sorted(labels.items())
            assert key not in found
            found[key] = sample.value
    return found


def test_what_prometheus_reads(node):
    assert samples(exposition(node))["mocha_link_storage_failed",] == 0
    node.storage_fault = "no room"
    found = samples(exposition(node))
    assert found["mocha_link_storage_failed",] == 1
    io = ("peer", "io")
    assert found["mocha_link_clock_timestamp_seconds",] == node.clock.now_s()
    assert found["mocha_link_state", io, ("state", "ended")] == 1
    assert found["mocha_link_state", io, ("state", "idle")] == 0
    assert found["mocha_link_state", ("peer", "europa"), ("state", "idle")] == 1
    assert found["mocha_link_signal_dbm", io, ("source", "wifi")] == -61.5
    device = "mocha_link_signal_device_units", ("peer", "europa"), ("source", "rajant")
    assert found[device] == 7
    assert sum(key[0].startswith("mocha_link_signal") for key in found) == 2
    assert found["mocha_link_last_sync_timestamp_seconds", ("direction", "in"), io] == 1000.5
    assert ("mocha_link_last_sync_timestamp_seconds", ("direction", "out"), io) not in found
    assert found["mocha_link_rtt_seconds", io] == 0.05
    assert found["mocha_link_rtt_smoothed_seconds", io] == 0.06
    assert found["mocha_link_bandwidth_bytes_per_second", io] == 125_000
    assert found["mocha_link_topic_age_seconds", io, ("topic", "/pose")] == 1.5
    assert found["mocha_link_topic_age_seconds", io, ("topic", '/a"b\\c\nd')] == 2
    assert found["mocha_link_bytes_total", ("direction", "in"), io] == 12_345
    assert found["mocha_link_syncs_total", ("direction", "in"), io] == 4
    assert found["mocha_link_sync_timeouts_total", io] == 1
    assert found["mocha_link_contacts_total", io] == 2
    assert found["mocha_link_path_info", ("path", "udp"), io] == 1
    assert found["mocha_link_protected", io] == 1
    assert found["mocha_link_protected", ("peer", "europa")] == 0


@pytest.fixture
def server(node):
    before = set(threading.enumerate())
    with PrometheusServer(node, "127.0.0.1:0") as server:
        yield server
    assert set(threading.enumerate()) <= before


def place(server):
    host, port = server.url.removeprefix("http://").removesuffix("/metrics").split(":")
    return host, int(port)


def fetch(server, method="GET", path="/metrics"):
    connection = http.client.HTTPConnection(*place(server))
    with contextlib.closing(connection):
        connection.request(method, path)
        reply = connection.getresponse()
        return reply, reply.read().decode()


def test_over_http(node, server):
    reply, body = fetch(server)
    assert reply.headers["Content-Type"] == "text/plain; version=0.0.4; charset=utf-8"
    assert body == exposition(node)
    for method, path, code in [
        ("HEAD", "/metrics?name=x", 200),
        ("GET", "/", 200),
        ("GET", "/etc/passwd", 404),
        ("POST", "/metrics", 501),
    ]:
        assert fetch(server, method, path)[0].status == code


def test_over_ipv6(node):
    with PrometheusServer(node, "[::1]:0") as server:
        port = int(server.url.removeprefix("http://[::1]:").removesuffix("/metrics"))
        with contextlib.closing(http.client.HTTPConnection("::1", port)) as connection:
            connection.request("GET", "/metrics")
            assert connection.getresponse().read().decode() == exposition(node)


def test_a_node_of_the_command_line(field, tmp_path):
    """Radio reports come on standard input, and Prometheus reads them."""
    team = tmp_path / "team.yaml"
    team.write_text(field.team.with_robots({"io": {"radio": "stdin:"}}).dump())
    command = [str(team), "--robot", "io", "--json", "--prometheus", f"{field.host}:0"]
    with (
        subprocess.Popen(
            [sys.executable, "-m", "mocha_link.cli.cli", "node", *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process,
        contextlib.ExitStack() as stack,
    ):
        stack.callback(process.kill)
        lines = iter(process.stderr.readline, "")
        url = next(line for line in lines if line.startswith("metrics on http://")).split()[-1]
        process.stdin.write("titan 9.5 dB\n")
        process.stdin.flush()
        assert json.loads(process.stdout.readline())["signal"]["unit"] == "dB"
        shown = 'mocha_link_signal_snr_decibels{peer="titan",robot="io",source="stdin"} 9.5'
        assert shown in fetch(SimpleNamespace(url=url))[1].splitlines()


def test_no_more_than_so_many_at_a_time(server):
    idle = [socket.create_connection(place(server)) for _ in range(MAX_CONNECTIONS)]
    for connection in idle:
        connection.sendall(b"GET ")  # and nothing more
    with socket.create_connection(place(server)) as another:
        assert another.recv(1) == b""
    idle.pop().close()
    while True:  # until its thread notices
        try:
            assert fetch(server)[0].status == 200
            break
        except (http.client.HTTPException, ConnectionError):
            continue
    for connection in idle:
        connection.close()


def test_no_client_holds_a_connection_for_long(node, monkeypatch):
    monkeypatch.setattr(prometheus, "REQUEST_S", 0.05)
    with (
        PrometheusServer(node, "127.0.0.1:0") as server,
        socket.create_connection(place(server)) as slow,
    ):
        slow.sendall(b"GET ")
        assert slow.recv(1) == b""


def test_an_error_of_ours_is_logged(node, server, caplog):
    """The reader only sees that the connection is closed."""
    node.links = lambda: {}["io"]
    with pytest.raises(http.client.RemoteDisconnected):
        fetch(server)
    (record,) = caplog.records
    assert record.getMessage() == "serving metrics to Prometheus: an error"
    assert record.exc_info[0] is KeyError


def test_a_reader_that_hangs_up_is_not_logged(node, server, caplog):
    requested, closed = threading.Event(), threading.Event()

    def links():
        requested.set()
        assert closed.wait(60)
        return {str(number): IO for number in range(2000)}  # more than the kernel takes

    node.links = links
    with socket.create_connection(place(server)) as reader:
        reader.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        assert requested.wait(60)
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    closed.set()
    server.close()
    assert not caplog.records


def test_a_server_whose_thread_cannot_start_gives_its_port_back(node, server):
    host, port = place(server)
    server.close()
    again = PrometheusServer(node, f"{host}:{port}")
    with no_thread_left(), pytest.raises(RuntimeError, match="thread"), again:
        pass
    with again:
        assert fetch(again)[0].status == 200


def test_addresses_that_cannot_be_served(node, server):
    for address in ("{}:{}".format(*place(server)), "203.0.113.7:1"):
        with pytest.raises(PrometheusError, match="cannot serve metrics on"):
            PrometheusServer(node, address).start()
    PrometheusServer(node, ":0").close()
    assert PrometheusServer(node, ":9464").url == "http://127.0.0.1:9464/metrics"
