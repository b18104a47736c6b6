"""Encrypted links: ZeroMQ's CURVE on the sockets, and who is let in at which port.

A port of a node serves one peer, so the key of that peer is the only one that opens it. Links
where one side has no key stay as they are in the original (NULL).
"""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
from collections.abc import Mapping
from typing import NamedTuple

import zmq
from zmq.utils.monitor import parse_monitor_message

from mocha_link.errors import MochaLinkError
from mocha_link.node import kernel
from mocha_link.team.keys import PublicKey, SecretKey

BURST = 256  # requests or events answered in a row
HANDSHAKE_S = 10.0  # who has shown no key by then is sent away; a slow radio takes seconds
MAX_STRANGERS = 64  # connections to the ports of a node that are younger than that
_ZAP = "inproc://zeromq.zap.01"  # where libzmq asks, https://rfc.zeromq.org/spec/27/
_ZAP_VERSION = b"1.0"
_ZAP_FRAMES = 6  # version, request id, domain, address, identity, mechanism; then the credentials

_WRONG_KEY, _NO_KEY, _NO_ZMTP, _TOO_OFTEN, _LEFT = (
    "with a wrong key",
    "without encryption",
    "not as a node of ours does",
    "too often",
    "and left before it had shown a key, as one without a key does",
)
_PROTOCOL_FAILURES: dict[int, str] = {
    zmq.PROTOCOL_ERROR_ZMTP_CRYPTOGRAPHIC: _WRONG_KEY,
    zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH: _NO_KEY,
}

LOG = logging.getLogger("mocha_link")


class CurveUnavailableError(MochaLinkError):
    """Keys are configured, and the ZeroMQ library here cannot encrypt."""


Refusal = tuple[str, str]
"""The peer at whose port a connection was not let in, and why."""


def protect_port(port: zmq.Socket[bytes], own: SecretKey, peer: str) -> None:
    """Have a ROUTER, before it binds, let in only who the `ZapHandler` allows for a peer.

    Raises:
        CurveUnavailableError: this libzmq is built without CURVE.
    """
    _require()
    port.setsockopt(zmq.CURVE_SERVER, 1)
    port.setsockopt(zmq.CURVE_SECRETKEY, own.curve)
    port.setsockopt(zmq.ZAP_DOMAIN, peer.encode())
    port.setsockopt(zmq.HANDSHAKE_IVL, int(HANDSHAKE_S * 1000))


def protect_contact(contact: zmq.Socket[bytes], own: SecretKey, peer: PublicKey) -> None:
    """Have a DEALER, before it connects, talk to the holder of the peer's key only, encrypted.

    Raises:
        CurveUnavailableError: this libzmq is built without CURVE.
    """
    _require()
    contact.setsockopt(zmq.CURVE_SERVERKEY, peer.curve)
    contact.setsockopt(zmq.CURVE_PUBLICKEY, own.public.curve)
    contact.setsockopt(zmq.CURVE_SECRETKEY, own.curve)


class _Watched(NamedTuple):
    """A port of which the monitor tells who comes and goes."""

    port: zmq.Socket[bytes]
    monitor: zmq.Socket[bytes]
    peer: str


class ZapHandler:
    """Answers libzmq's question, whether a key may enter, for all protected ports of a context.

    libzmq takes any number of connections, and descriptors for them, until they have shown a key:
    of more than `MAX_STRANGERS` the oldest is closed.

    Make it before the ports are bound. Its `sockets` (`socket`, and a monitor of every watched
    port) go into the poller of the ports' thread; call `serve` when one of them is readable.

    Args:
        context: of the ports; a context has one handler at most.
        allowed: the key that opens the port for a peer, by the peer's name.
    """

    def __init__(
        self, context: zmq.Context[zmq.Socket[bytes]], allowed: Mapping[str, PublicKey]
    ) -> None:
        self._allowed = {peer.encode(): key.curve for peer, key in allowed.items()}
        self._watched: list[_Watched] = []
        # by peer and descriptor, the oldest first: when they came, steady seconds
        self._strangers: dict[tuple[str, int], float] = {}
        self._sent_away: set[tuple[str, int]] = set()  # by us, until libzmq tells that they left
        self._warned: set[str] = set()  # peers of whose port one refusal was logged
        self._broken_off: set[str] = set()  # ports of which it tells next which connection did
        self.socket = context.socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.LINGER, 0)
        try:
            self.socket.bind(_ZAP)
        except zmq.ZMQError:
            self.socket.close(0)
            raise

    @property
    def sockets(self) -> tuple[zmq.Socket[bytes], ...]:
        """What the poller has to watch."""
        return (self.socket, *(each.monitor for each in self._watched))

    def watch(self, port: zmq.Socket[bytes], peer: str) -> None:
        """Count also who fails at a port before its key is known, e.g. because it has none."""
        monitor = port.get_monitor_socket(
            zmq.Event.ACCEPTED
            | zmq.Event.DISCONNECTED
            | zmq.Event.HANDSHAKE_FAILED_PROTOCOL
            | zmq.Event.HANDSHAKE_FAILED_NO_DETAIL
        )
        self._watched.append(_Watched(port, monitor, peer))

    def serve(self, now_s: float) -> list[Refusal]:
        """Answer what is asked at this steady time, without waiting; who was refused since."""
        refusals = self._answer()
        for each in self._watched:
            refusals += [(each.peer, why) for why in self._failures(each, now_s)]
        for peer, why in refusals:
            if peer not in self._warned:
                self._warned.add(peer)
                LOG.warning("refused at the port for %s: it came %s", peer, why)
        return refusals

    def close(self) -> None:
        """Close its sockets; before the ports that it watches are closed."""
        for port, monitor, _peer in self._watched:
            if not port.closed:
                port.disable_monitor()
            monitor.close(0)
        self._watched.clear()
        self.socket.close(0)

    def _answer(self) -> list[Refusal]:
        refusals = []
        for _ in range(BURST):
            try:
                identity, delimiter, *frames = self.socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                break
            if delimiter or len(frames) < _ZAP_FRAMES or frames[0] != _ZAP_VERSION:
                continue  # only libzmq of this process asks here
            request, domain, mechanism, credentials = frames[1], frames[2], frames[5], frames[6:]
            key = self._allowed.get(domain)
            allowed = mechanism == b"CURVE" and key is not None and credentials == [key]
            status = [b"200", b"OK", domain] if allowed else [b"400", b"unknown key", b""]
            reply = [identity, b"", _ZAP_VERSION, request, *status, b""]
            self.socket.send_multipart(reply, zmq.NOBLOCK)
            if not allowed:
                refusals.append((domain.decode("utf-8", "replace"), _WRONG_KEY))
        return refusals

    def _failures(self, watched: _Watched, now_s: float) -> list[str]:
        """What its monitor tells of those who did not get in, and who is sent away now."""
        failures: list[str] = []
        for _ in range(BURST):
            try:
                event = parse_monitor_message(watched.monitor.recv_multipart(zmq.NOBLOCK))
            except zmq.Again:
                break
            kind, value = event["event"], event["value"]
            if kind == zmq.Event.ACCEPTED:
                self._strangers[watched.peer, value] = now_s
                failures += [_TOO_OFTEN] * self._send_away(now_s)
            elif kind == zmq.Event.DISCONNECTED:
                connection = (watched.peer, value)
                self._strangers.pop(connection, None)
                # Whom we sent away is counted as that, once.
                if watched.peer in self._broken_off and connection not in self._sent_away:
                    failures.append(_LEFT)
                self._broken_off.discard(watched.peer)
                self._sent_away.discard(connection)
            elif kind == zmq.Event.HANDSHAKE_FAILED_PROTOCOL:
                failures.append(_PROTOCOL_FAILURES.get(value, _NO_ZMTP))
            # A client that sees from our greeting what we want may hang up before we have read its
            # own. A link that breaks shows another error.
            elif value == errno.EPIPE:
                self._broken_off.add(watched.peer)
        return failures

    def _send_away(self, now_s: float) -> int:
        """Close the oldest of too many that may have shown no key yet; how many there were.

        libzmq does not say of which connection a key was right; of those it has not closed by
        `HANDSHAKE_S` it was.
        """
        strangers, closed = self._strangers, 0
        while strangers and next(iter(strangers.values())) < now_s - HANDSHAKE_S:
            del strangers[next(iter(strangers))]
        while len(strangers) > MAX_STRANGERS:
            peer, descriptor = oldest = next(iter(strangers))
            del strangers[oldest]
            (port,) = (each.port for each in self._watched if each.peer == peer)
            number = int(port.getsockopt_string(zmq.LAST_ENDPOINT).rstrip("\0").rpartition(":")[2])
            with kernel.borrowed(descriptor, local=number) as connection:
                if connection:
                    self._sent_away.add(oldest)
                    with contextlib.suppress(OSError):  # it has gone meanwhile
                        connection.shutdown(socket.SHUT_RDWR)
            closed += 1
        return closed


def _require() -> None:
    if not zmq.has("curve"):
        raise CurveUnavailableError(
            "the team file has keys, and the ZeroMQ library here is built without CURVE; "
            "run: pip install --force-reinstall pyzmq"
        )
