"""A node's link metrics as Prometheus reads them, and a small web server that hands them out."""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any, Protocol

from mocha_link.clock import Clock
from mocha_link.errors import MochaLinkError
from mocha_link.links.metrics import LinkMetrics, LinkState
from mocha_link.links.reading import Unit
from mocha_link.node.lifetime import Startable

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
MAX_CONNECTIONS = 8
POLL_S = 0.1
REQUEST_S = 5.0  # from the connection to the end of the reply

_SIGNALS = {Unit.DBM: "dbm", Unit.SNR_DB: "snr_decibels", Unit.DEVICE: "device_units"}


class PrometheusError(MochaLinkError):
    """The metrics cannot be served where they should be."""


class Measured(Protocol):
    """What is shown of a node."""

    name: str
    clock: Clock

    @property
    def storage_fault(self) -> str | None:
        """Why messages do not get to the disk now, if so."""

    def links(self) -> dict[str, LinkMetrics]:
        """The state of the link to every peer."""


@dataclass(slots=True)
class _Family:
    """All samples of one metric."""

    name: str
    kind: str
    help: str
    samples: list[tuple[Mapping[str, str], float]] = field(default_factory=list)

    def add(self, value: float | None, **labels: str) -> None:
        """Add a sample; nothing is known where there is none."""
        if value is not None:
            self.samples.append((labels, value))

    def lines(self) -> Iterable[str]:
        """The family as text."""
        yield f"# HELP {self.name} {_escaped(self.help)}"
        yield f"# TYPE {self.name} {self.kind}"
        for labels, value in self.samples:
            shown = ",".join(
                f'{key}="{_escaped(text, quote=True)}"' for key, text in labels.items()
            )
            yield f"{self.name}{{{shown}}} {_number(value)}"


def exposition(node: Measured) -> str:
    """The metrics of a node in Prometheus' text format, version 0.0.4.

    Times are Unix seconds of the node's clock.
    """
    robot = node.name
    clock = _Family("mocha_link_clock_timestamp_seconds", "gauge", "The node's own clock.")
    clock.add(node.clock.now_s(), robot=robot)
    storage = _Family("mocha_link_storage_failed", "gauge", "1 while nothing gets to the disk.")
    storage.add(float(node.storage_fault is not None), robot=robot)
    families = [clock, storage, *_families(robot, node.links())]
    lines = [line for family in families if family.samples for line in family.lines()]
    return "\n".join(lines) + "\n"


def _families(robot: str, links: Mapping[str, LinkMetrics]) -> Iterable[_Family]:
    def family(name: str, kind: str, text: str) -> _Family:
        return _Family(f"mocha_link_{name}", kind, text)

    state = family("state", "gauge", "1 for the state of the latest sync with the peer.")
    path = family("path_info", "gauge", "What the last exchange went over.")
    protected = family("protected", "gauge", "1 if the link is encrypted.")
    differs = family("team_differs", "gauge", "1 if the peer has another team file.")
    signals = {
        unit: family(f"signal_{name}", "gauge", f"How the peer is heard, in {name}, by source.")
        for unit, name in _SIGNALS.items()
    }
    last = family("last_sync_timestamp_seconds", "gauge", "When the last sync came to its end.")
    rtt = family("rtt_seconds", "gauge", "The last round trip.")
    smoothed = family("rtt_smoothed_seconds", "gauge", "The smoothed round trip.")
    bandwidth = family("bandwidth_bytes_per_second", "gauge", "What the last exchange moved.")
    age = family("topic_age_seconds", "gauge", "Age of the newest message of a peer's topic.")
    moved = family("bytes_total", "counter", "Bytes of replies received (in) and sent (out).")
    syncs = family("syncs_total", "counter", "Syncs that came to their end.")
    broken = family("sync_timeouts_total", "counter", "Syncs that broke off.")
    refused = family("refused_total", "counter", "What was not accepted from the peer.")
    contacts = family("contacts_total", "counter", "Contacts with the peer.")
    for peer, link in links.items():
        at = {"robot": robot, "peer": peer}
        for each in LinkState:
            state.add(float(link.state is each), **at, state=each.value)
        path.add(1.0 if link.path else None, **at, path=link.path or "")
        protected.add(float(link.protected), **at)
        differs.add(float(link.team_differs), **at)
        if link.signal:
            signals[link.signal.unit].add(link.signal.value, **at, source=link.signal.source)
        last.add(link.last_sync_in_s, **at, direction="in")
        last.add(link.last_sync_out_s, **at, direction="out")
        rtt.add(link.rtt_s, **at)
        smoothed.add(link.rtt_smoothed_s, **at)
        bandwidth.add(link.bandwidth_bytes_s, **at)
        for topic, age_s in link.topic_ages_s.items():
            age.add(age_s, **at, topic=topic)
        moved.add(link.bytes_in, **at, direction="in")
        moved.add(link.bytes_out, **at, direction="out")
        syncs.add(link.syncs_in, **at, direction="in")
        syncs.add(link.syncs_out, **at, direction="out")
        broken.add(link.timeouts, **at)
        refused.add(link.refused, **at)
        contacts.add(link.contacts_begun, **at)
    yield from (state, path, protected, differs, *signals.values(), last, rtt, smoothed, bandwidth)
    yield from (age, moved, syncs, broken, refused, contacts)


def _escaped(text: str, *, quote: bool = False) -> str:
    text = text.replace("\\", "\\\\").replace("\n", "\\n")
    return text.replace('"', '\\"') if quote else text


def _number(value: float) -> str:
    if math.isfinite(value):
        return repr(float(value))
    return "NaN" if math.isnan(value) else f"{'+' if value > 0 else '-'}Inf"


class _Handler(BaseHTTPRequestHandler):
    """Answers GET and HEAD of /metrics."""

    server: _Server
    timeout = REQUEST_S
    server_version = "mocha-link"
    sys_version = ""

    def do_GET(self) -> None:
        """The metrics."""
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        """How long the metrics are."""
        self._answer(with_body=False)

    def _answer(self, *, with_body: bool) -> None:
        if self.path.partition("?")[0] not in ("/", "/metrics"):
            self.send_error(HTTPStatus.NOT_FOUND, "the metrics are at /metrics")
            return
        body = exposition(self.server.node).encode()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", CONTENT_TYPE)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Requests are not news."""


class _Server(ThreadingTCPServer):
    """At most so many connections at a time, and none for long."""

    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], node: Measured) -> None:
        self.node = node
        self._open: dict[socket.socket, float] = {}
        self._lock = threading.Lock()
        super().__init__(address, _Handler)

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
                    with contextlib.suppress(OSError):  # gone already
                        connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A reader that goes away is none of our business."""


class PrometheusServer(Startable):
    """Serves ``http://HOST:PORT/metrics``; port 0 takes a free one. Use as a context manager.

    There is no protection: name an address of your own machine unless others shall read it.
    """

    def __init__(self, node: Measured, address: str) -> None:
        host, _, port = address.rpartition(":")
        if not port.isdecimal() or int(port) > 65535:
            raise PrometheusError(f"'{address}' is no address; write host:port")
        self._node = node
        self._address = (host or "127.0.0.1", int(port))
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """Where the metrics are."""
        host, port = self._server.server_address[:2] if self._server else self._address
        return f"http://{host!s}:{port}/metrics"

    def start(self) -> None:
        """Begin to serve. Raises PrometheusError if the address is taken or not ours."""
        try:
            self._server = _Server(self._address, self._node)
        except OSError as error:
            raise PrometheusError(
                f"cannot serve metrics on {self._address[0]}:{self._address[1]}: {error.strerror}; "
                "choose another port, or an address of this machine"
            ) from None
        self._thread = threading.Thread(
            target=self._server.serve_forever,
            args=(POLL_S,),
            name="mocha-link prometheus",
            daemon=True,
        )
        self._thread.start()

    def close(self) -> None:
        """Stop serving; may be called twice."""
        if self._server and self._thread:
            self._server.shutdown()
            self._thread.join()
            self._server.hang_up(older_s=0)
            self._server.server_close()  # waits for the threads
            self._server = self._thread = None
