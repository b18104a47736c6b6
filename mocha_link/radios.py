"""Where the node learns how well its radio hears the others."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import numbers
import selectors
import socket
import threading
from typing import TYPE_CHECKING, Protocol

from mocha_link.errors import MochaLinkError

if TYPE_CHECKING:
    from collections.abc import Callable

MAX_DATAGRAM_BYTES = 2048
LIMIT_DBM = 1000

LOG = logging.getLogger("mocha_link")


class RadioError(MochaLinkError):
    """A radio that cannot be used, or a report that is none."""


class Radio(Protocol):
    """Reports the RSSI of peers while it is started."""

    def start(self, report: Callable[[str, float | None], None]) -> None:
        """Begin: call `report(peer, rssi_dbm)`, from any thread; None: the peer is not heard.

        `report` raises UnknownRobotError for a name that is not linked to the robot, RadioError
        for a value that cannot be one in dBm.
        """

    def close(self) -> None:
        """Stop reporting and give up what is held; may be called twice."""


class ManualRadio:
    """A radio that says what it is told to; for embedding and tests."""

    def __init__(self) -> None:
        self._report: Callable[[str, float | None], None] | None = None

    def start(self, report: Callable[[str, float | None], None]) -> None:
        """Begin to pass reports on."""
        self._report = report

    def close(self) -> None:
        """Stop passing reports on."""
        self._report = None

    def report(self, peer: str, rssi_dbm: float | None) -> None:
        """Report a peer's RSSI (None: not heard). Lost while the node is not started.

        Raises:
            UnknownRobotError: the peer is not linked to the robot.
            RadioError: no number, or not within -1000 to 1000.
        """
        if self._report:
            self._report(peer, rssi_dbm)


class UdpRadio:
    """Receives reports as datagrams, each a JSON object ``{"peer": "io", "rssi_dbm": -61.5}``.

    ``null`` for `rssi_dbm`: the peer is not heard. `endpoint` is ``udp://host:port``, where to
    listen; port 0 takes a free one. Datagrams that are no reports are counted in `refused`.
    """

    def __init__(self, endpoint: str) -> None:
        scheme, _, rest = endpoint.partition("://")
        host, _, port = rest.rpartition(":")
        if scheme != "udp" or not host or not port.isdecimal() or int(port) > 65535:
            raise RadioError(f"'{endpoint}' is no radio; write udp://host:port")
        self.refused = 0
        self._address = (host, int(port))
        self._endpoint = endpoint
        self._socket: socket.socket | None = None
        self._stop: socket.socket | None = None
        self._thread: threading.Thread | None = None

    @property
    def port(self) -> int:
        """The port that it listens on."""
        port: int = self._socket.getsockname()[1] if self._socket else self._address[1]
        return port

    def start(self, report: Callable[[str, float | None], None]) -> None:
        """Begin to listen. Raises RadioError if the port is taken or the host is not ours."""
        receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            receiver.bind(self._address)
        except OSError as error:
            receiver.close()
            raise RadioError(
                f"cannot listen for radio reports on {self._endpoint}: {error.strerror}; end the "
                "process that uses the port, or change 'radio' in the team file"
            ) from None
        self._socket = receiver
        self._stop, stopped = socket.socketpair()
        self._thread = threading.Thread(
            target=self._listen, args=(receiver, stopped, report), name="mocha-link radio"
        )
        self._thread.daemon = True
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        if self._thread and self._stop:
            self._stop.close()
            self._thread.join()
            self._thread = self._stop = self._socket = None

    def _listen(
        self,
        receiver: socket.socket,
        stopped: socket.socket,
        report: Callable[[str, float | None], None],
    ) -> None:
        with receiver, stopped, selectors.DefaultSelector() as selector:
            selector.register(receiver, selectors.EVENT_READ)
            selector.register(stopped, selectors.EVENT_READ)
            while True:
                ready = {key.fileobj for key, _ in selector.select()}
                if stopped in ready:
                    return
                raw = b""
                with contextlib.suppress(OSError):  # e.g. an ICMP error of an earlier packet
                    raw = receiver.recv(MAX_DATAGRAM_BYTES)
                try:
                    report(*parse_report(raw))
                except MochaLinkError as error:
                    self.refused += 1
                    LOG.debug("radio report refused: %s", error)


def parse_report(raw: bytes) -> tuple[str, float | None]:
    """The peer and its RSSI from a datagram. Raises RadioError."""
    try:
        value = json.loads(raw)
        peer, rssi_dbm = value["peer"], value["rssi_dbm"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise RadioError(f"no JSON object with peer and rssi_dbm: {error!r}") from None
    if not isinstance(peer, str):
        raise RadioError("peer is no text")
    return peer, as_dbm(rssi_dbm)


def as_dbm(value: object) -> float | None:
    """A reported RSSI, checked. Raises RadioError."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise RadioError(f"rssi_dbm must be a number or nothing, not {type(value).__name__}")
    try:
        rssi_dbm = float(value)
    except OverflowError:
        rssi_dbm = math.inf
    if not -LIMIT_DBM <= rssi_dbm <= LIMIT_DBM:  # also NaN
        raise RadioError(f"rssi_dbm must be within -{LIMIT_DBM} to {LIMIT_DBM}")
    return rssi_dbm
