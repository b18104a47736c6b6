"""A node's link metrics as Prometheus reads them, and a small web server that hands them out."""

from __future__ import annotations

import contextlib
import logging
import socket
import sys
import threading
import time
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any

from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from mocha_link.errors import MochaLinkError
from mocha_link.forks import closed_in_children, parents_only
from mocha_link.hosts import family_of, joined
from mocha_link.lifetime import Startable
from mocha_link.links import LinkMetrics, LinkState, Unit
from mocha_link.node import Node

MAX_CONNECTIONS = 8
POLL_S = 0.1
REQUEST_S = 5.0  # from the connection to the end of the reply

LOG = logging.getLogger("mocha_link")

_SIGNALS = {Unit.DBM: "dbm", Unit.SNR_DB: "snr_decibels", Unit.DEVICE: "device_units"}
_TOTAL = "_total"  # how the names of counters end
_HELP = {
    "clock_timestamp_seconds": "The node's own clock.",
    "storage_failed": "1 while nothing gets to the disk.",
    "state": "1 for the state of the latest sync with the peer.",
    "path_info": "What the last exchange went over.",
    "protected": "1 if the link is encrypted.",
    "team_differs": "1 if the peer has another team file.",
    **{
        f"signal_{name}": f"Signal of the peer as received, in {name}, by source."
        for name in _SIGNALS.values()
    },
    "last_sync_timestamp_seconds": "When the last sync ended.",
    "rtt_seconds": "The last round trip.",
    "rtt_smoothed_seconds": "The smoothed round trip.",
    "bandwidth_bytes_per_second": "Rate of the last sync that was large enough to measure it.",
    "topic_age_seconds": "Age of the newest message of a peer's topic.",
    "bytes_total": "Bytes of replies received (in) and sent (out).",
    "syncs_total": "Syncs that ended.",
    "sync_timeouts_total": "Syncs that were aborted.",
    "refused_total": "Refused data of the peer, and refused connections.",
    "contacts_total": "Contacts with the peer.",
}


class PrometheusError(MochaLinkError):
    """The metrics cannot be served where they should be."""


def exposition(node: Node) -> str:
    """The metrics of a node in Prometheus' text format, version 0.0.4.

    Times are Unix seconds of the node's clock.
    """
    return generate_latest(_Metrics(node)).decode()


class _Metrics(Collector):
    """Collects the metrics of a node on request; a metric without a value is left out."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._families = {  # by name, without the prefix
            name: Metric(
                f"mocha_link_{name.removesuffix(_TOTAL)}",
                text,
                "counter" if name.endswith(_TOTAL) else "gauge",
            )
            for name, text in _HELP.items()
        }

    def collect(self) -> list[Metric]:
        """All metrics, by their names."""
        self._add("clock_timestamp_seconds", self._node.clock.now_s())
        self._add("storage_failed", self._node.storage_fault is not None)
        for peer, link in self._node.links().items():
            self._add_link(peer, link)
        return [family for family in self._families.values() if family.samples]

    def _add(self, name: str, value: float | None, **labels: str) -> None:
        if value is not None:
            labels["robot"] = self._node.name
            self._families[name].add_sample(f"mocha_link_{name}", labels, float(value))

    def _add_link(self, peer: str, link: LinkMetrics) -> None:
        add = partial(self._add, peer=peer)
        for state in LinkState:
            add("state", link.state is state, state=state.value)
        add("path_info", 1.0 if link.path else None, path=link.path or "")
        add("protected", link.protected)
        add("team_differs", link.team_differs)
        if link.signal:
            name = f"signal_{_SIGNALS[link.signal.unit]}"
            add(name, link.signal.value, source=link.signal.source)
        for topic, age_s in link.topic_ages_s.items():
            add("topic_age_seconds", age_s, topic=topic)
        for direction, synced_s, size, count in (
            ("in", link.last_sync_in_s, link.bytes_in, link.syncs_in),
            ("out", link.last_sync_out_s, link.bytes_out, link.syncs_out),
        ):
            add("last_sync_timestamp_seconds", synced_s, direction=direction)
            add("bytes_total", size, direction=direction)
            add("syncs_total", count, direction=direction)
        add("rtt_seconds", link.rtt_s)
        add("rtt_smoothed_seconds", link.rtt_smoothed_s)
        add("bandwidth_bytes_per_second", link.bandwidth_bytes_s)
        add("sync_timeouts_total", link.timeouts)
        add("refused_total", link.refused)
        add("contacts_total", link.contacts_begun)


class _Handler(BaseHTTPRequestHandler):
    """Serves GET and HEAD of /metrics."""

    server: _Server
    timeout = REQUEST_S
    server_version = "mocha-link"
    sys_version = ""

    def do_GET(self) -> None:
        """The metrics; for HEAD only their length."""
        if self.path.partition("?")[0] not in ("/", "/metrics"):
            self.send_error(HTTPStatus.NOT_FOUND, "the metrics are at /metrics")
            return
        body = exposition(self.server.node).encode()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", CONTENT_TYPE_PLAIN_0_0_4)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(body)

    do_HEAD = do_GET  # noqa: N815 - the name that the library calls

    def log_message(self, *_: Any) -> None:
        """Do not log requests."""


class _Server(ThreadingTCPServer):
    """At most so many connections at a time, and none for long."""

    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], node: Node) -> None:
        self.node = node
        self.address_family = family_of(address[0])
        self._open: dict[socket.socket, float] = {}  # when each was accepted, monotonic
        self._lock = threading.Lock()
        super().__init__(address, _Handler)
        closed_in_children(self.socket)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Whether there is room for one more."""
        del client_address
        with self._lock:
            if len(self._open) >= MAX_CONNECTIONS:
                return False
            self._open[request] = time.monotonic()
        return True

    def shutdown_request(self, request: Any) -> None:
        """A connection has come to its end."""
        super().shutdown_request(request)
        with self._lock:
            self._open.pop(request, None)

    def service_actions(self) -> None:
        """Called ten times a second: hang up on a client that takes too long."""
        self.hang_up(older_s=REQUEST_S)

    def hang_up(self, *, older_s: float) -> None:
        """Break off connections of that age; their threads then end by themselves."""
        with self._lock:
            now_s = time.monotonic()
            for connection, since_s in self._open.items():
                if now_s - since_s >= older_s:
                    with contextlib.suppress(OSError):  # closed already
                        connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log what ended a request, unless its reader has hung up."""
        del request, client_address
        error = sys.exception()
        if not isinstance(error, OSError):
            LOG.error("serving metrics to Prometheus: an error", exc_info=error)


class PrometheusServer(Startable):
    """Serves ``http://HOST:PORT/metrics``; port 0 takes a free one. Use as a context manager.

    There is no protection: name an address of your own machine unless others shall read it.
    """

    def __init__(self, node: Node, address: str) -> None:
        host, _, port = address.rpartition(":")
        if not port.isdecimal() or int(port) > 65535:
            raise PrometheusError(f"'{address}' is no address; write host:port")
        self._node = node
        self._address = (host.strip("[]") or "127.0.0.1", int(port))  # as requested
        self._server: _Server | None = None  # while it serves
        self._thread: threading.Thread | None = None  # while it serves
        parents_only(self)

    @property
    def url(self) -> str:
        """Where the metrics are."""
        host, port = self._server.server_address[:2] if self._server else self._address
        return f"http://{joined(str(host), int(port))}/metrics"

    def start(self) -> None:
        """Begin to serve. Raises PrometheusError if the address is taken or not ours."""
        try:
            server = _Server(self._address, self._node)
        except OSError as error:
            raise PrometheusError(
                f"cannot serve metrics on {joined(*self._address)}: {error.strerror}; "
                "choose another port, or an address of this machine"
            ) from None
        thread = threading.Thread(
            target=server.serve_forever, args=(POLL_S,), name="mocha-link prometheus", daemon=True
        )
        try:
            thread.start()
        except BaseException:
            server.server_close()
            raise
        self._server, self._thread = server, thread

    def close(self) -> None:
        """Stop serving; may be called twice."""
        if self._server and self._thread:
            self._server.shutdown()
            self._thread.join()
            self._server.hang_up(older_s=0)
            self._server.server_close()  # waits for the threads
            self._server = self._thread = None
