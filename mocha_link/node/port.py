"""A node's port for one peer: requests over ZeroMQ, and datagrams on the same port number."""

from __future__ import annotations

import contextlib
import errno
import socket
from collections.abc import Container, Iterator
from functools import partial

import zmq

from mocha_link.errors import ListenError, PortInUseError
from mocha_link.hosts import SocketAddress, joined
from mocha_link.logs import NodeLog
from mocha_link.node import kernel
from mocha_link.node.curve import CurveServer
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.link_keys import LinkKeys
from mocha_link.node.router import ClientConnections, Router
from mocha_link.node.zmtp import Part
from mocha_link.sync import Route, Standing
from mocha_link.team import Robot

MAX_REQUEST_BYTES = 65_536 + 1024

_DATAGRAM_BUFFER_BYTES = 1024 * 1024


class Port:
    """A router that serves REQ and DEALER sockets like a REP socket, and a datagram socket.

    `datagram_address` is the source address of the peer's datagrams.

    Raises:
        PortInUseError: another process or node has the port.
        ListenError: the robot's `listen` is not an address of this machine.

    Args:
        poller: Also waits for the connections.
        clients: Shared by the ports of a node.
        keys: The keys of `me` and its peers. A protected port accepts only the peer's key; None:
            clients need no key.
    """

    TOGETHER_BYTES = 16 * 1024  # of frames that are sent in one system call
    DESCRIPTORS = 2  # the listener and the datagram socket

    def __init__(
        self,
        poller: Poller,
        clients: ClientConnections,
        me: Robot,
        peer: str,
        *,
        keys: LinkKeys | None = None,
    ) -> None:
        self.peer = peer
        self._keys = keys or LinkKeys()
        self.datagram_address: SocketAddress | None = None
        number = me.port_for(peer)
        mechanism = None
        if pair := self._keys.pair(peer):
            secret, key = pair
            mechanism = partial(CurveServer, secret.curve, key.curve)
        self._router = Router(
            _listener(me, peer, number), poller, clients, MAX_REQUEST_BYTES, mechanism
        )
        self._datagrams: socket.socket | None = None  # None: the UDP port is in use; ZeroMQ only
        try:
            self._datagrams = kernel.datagram_socket(me.listen, number, _DATAGRAM_BUFFER_BYTES)
        except OSError as error:
            NodeLog(me.name, peer).warning(
                "no datagrams on port %d of %s: %s", number, me.name, error.strerror
            )

    def watch(self, poller: Poller) -> None:
        """Register the listener and the datagram socket with the poller."""
        if self._datagrams:
            poller.register(self._datagrams.fileno(), zmq.POLLIN, self)
        self._router.watch(self)

    def expire(self, now_s: float) -> list[str]:
        """Close overdue connections; returns the refusals since the last call."""
        return self._router.expire(now_s)

    def requests(self, ready: Container[Polled]) -> Iterator[tuple[Route, list[bytes]]]:
        """Yield the requests to serve now, each with its route and its body parts.

        The caller replies before it fetches the next one; see `Router.requests`.
        """
        for name, parts in self._router.requests(ready):
            if b"" in parts[:-1]:  # REP sockets also ignore a request without an envelope
                body = parts.index(b"") + 1
                route = (name, *map(bytes, parts[:body]))
                yield route, [bytes(each) for each in parts[body:]]

    @property
    def wait_ms(self) -> int:
        """The time until the next turn if no socket becomes ready."""
        return self._router.wait_ms

    def reply(self, route: Route, frame: bytes) -> None:
        """Send a reply, or queue it; the reply is dropped if the connection is closed."""
        self._router.reply(route[0], route[1:], [frame])

    def push(self, route: Route, parts: list[Part]) -> None:
        """Queue a frame of a sync for the next `flush`."""
        self._router.push(route[0], [*route[1:], *parts])

    def standing(self, route: Route) -> Standing | None:
        """The kernel's measurements of a connection; None: it is closed."""
        return self._router.standing(route[0])

    def source(self, route: Route) -> str | None:
        """The client's address of a connection; None: the connection is closed."""
        return self._router.source(route[0])

    def own_addresses_changed(self) -> None:
        """Close the connections to addresses that this machine no longer has."""
        self._router.own_addresses_changed()

    def flush(self, route: Route | None) -> bool:
        """Send queued bytes of a connection; returns whether none are left."""
        return route is None or self._router.flush(route[0])

    def packets(self, limit: int) -> Iterator[tuple[bytes, SocketAddress]]:
        """Yield the received datagrams with their source addresses.

        On a link without keys anyone may have sent them.
        """
        if self._datagrams is None:
            return
        for packet, source in kernel.received(self._datagrams, limit):
            opened = self._keys.open(self.peer, packet)
            if opened is not None:
                yield opened, source

    @property
    def protected(self) -> bool:
        """Whether keys prove that received datagrams are the peer's."""
        return self._keys.protects(self.peer)

    def send_datagram(self, packet: bytes) -> None:
        """Send a datagram to the source address of the peer's datagrams."""
        if self._datagrams and self.datagram_address:
            with contextlib.suppress(OSError):
                self._datagrams.sendto(self._keys.seal(self.peer, packet), self.datagram_address)

    def close(self) -> None:
        """Close at once; queued bytes are dropped."""
        self._router.close()
        if self._datagrams:
            self._datagrams.close()


def provide_descriptors(me: Robot, count: int) -> None:
    """Make sure that the process may open `count` descriptors. Raises ListenError."""
    lacking = kernel.descriptors_lacking(count)
    if lacking:
        raise ListenError(
            f"{me.name} needs {count} open files for {len(me.peers)} peers, {lacking} more than "
            "this process may have; raise the limit (ulimit -n, LimitNOFILE= of a systemd "
            "unit), or list fewer clients in the team file"
        )


def _listener(me: Robot, peer: str, number: int) -> socket.socket:
    """Listen for a peer, if necessary on an address that the machine does not have yet.

    Raises PortInUseError or ListenError.
    """
    try:
        return kernel.listener(me.listen, number)
    except OSError as error:
        why = error
    if why.errno == errno.EADDRNOTAVAIL:
        try:
            listener = kernel.listener(me.listen, number, early=True)
        except OSError as error:
            why = error if error.errno == errno.EADDRINUSE else why
        else:
            NodeLog(me.name, peer).warning(
                "%s is no address of this machine now: no peer reaches port %d of %s before it is "
                "('listen' in the team file)",
                me.listen,
                number,
                me.name,
            )
            return listener
    what = f"{me.name} cannot listen for {peer} on tcp://{joined(me.listen, number)}"
    if why.errno == errno.EADDRINUSE:
        raise PortInUseError(
            f"{what}: port {number} is in use; end the other node or process on it "
            f"(ss -ltnp 'sport = :{number}' shows it), or change base_port of {me.name} in the "
            "team file of every robot"
        )
    raise ListenError(
        f"{what}: {why.strerror}; set 'listen' of {me.name} to * or to an "
        "address of this machine, and its base_port to one that you may use"
    )
