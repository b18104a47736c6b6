"""The ports of a node, one for each peer: requests over ZeroMQ, datagrams of the same number."""

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
    """A ROUTER, which serves REQ and DEALER sockets like a REP, and a datagram socket.

    `datagram_address` is the source address of the peer's datagrams.

    Raises:
        PortInUseError: another process or node has the port.
        ListenError: the robot's `listen` is not an address of this machine.

    Args:
        poller: Waits for its connections, too.
        clients: Shared by the ports of a node.
        keys: Of `me` and the peer, which alone opens a protected port; None: clients need no key.
    """

    TOGETHER_BYTES = 16 * 1024  # of frames that leave in one system call
    DESCRIPTORS = 2  # a listener and datagrams

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
        self._datagrams: socket.socket | None = None  # None: the port is taken, all goes by ZeroMQ
        try:
            self._datagrams = kernel.datagram_socket(me.listen, number, _DATAGRAM_BUFFER_BYTES)
        except OSError as error:
            NodeLog(me.name, peer).warning(
                "no datagrams on port %d of %s: %s", number, me.name, error.strerror
            )

    def watch(self, poller: Poller) -> None:
        """Have the poller wait for requests and datagrams."""
        if self._datagrams:
            poller.register(self._datagrams.fileno(), zmq.POLLIN, self)
        self._router.watch(self)

    def expire(self, now_s: float) -> list[str]:
        """Who was sent away since the last call, and why; call it now and then."""
        return self._router.expire(now_s)

    def requests(self, ready: Container[Polled]) -> Iterator[tuple[Route, list[bytes]]]:
        """Those whose turn it is: on which connection each came, and its body parts.

        Reply before you fetch the next; see `Router.requests`.
        """
        for name, parts in self._router.requests(ready):
            if b"" in parts[:-1]:  # without an envelope REP sockets ignore it, too
                body = parts.index(b"") + 1
                route = (name, *map(bytes, parts[:body]))
                yield route, [bytes(each) for each in parts[body:]]

    @property
    def wait_ms(self) -> int:
        """How long nothing is to be done here if nothing comes."""
        return self._router.wait_ms

    def reply(self, route: Route, frame: bytes) -> None:
        """Send a reply, or queue it; the reply is dropped if the connection is closed."""
        self._router.reply(route[0], route[1:], [frame])

    def push(self, route: Route, parts: list[Part]) -> None:
        """Have a frame of a sync sent with the next `flush`."""
        self._router.push(route[0], [*route[1:], *parts])

    def standing(self, route: Route) -> Standing | None:
        """How a connection stands; None: it is closed."""
        return self._router.standing(route[0])

    def source(self, route: Route) -> str | None:
        """The address from which a connection comes; None: it is closed."""
        return self._router.source(route[0])

    def own_addresses_changed(self) -> None:
        """Close the connections to addresses that this machine has no longer."""
        self._router.own_addresses_changed()

    def flush(self, route: Route | None) -> bool:
        """Try to send what waits for a connection; whether it takes more."""
        return route is None or self._router.flush(route[0])

    def packets(self, limit: int) -> Iterator[tuple[bytes, SocketAddress]]:
        """The datagrams that the peer has sent, and where from.

        Where the link is not protected anyone may have sent them.
        """
        if self._datagrams is None:
            return
        for packet, source in kernel.received(self._datagrams, limit):
            opened = self._keys.open(self.peer, packet)
            if opened is not None:
                yield opened, source

    @property
    def protected(self) -> bool:
        """Whether what comes is the peer's for sure."""
        return self._keys.protects(self.peer)

    def send_datagram(self, packet: bytes) -> None:
        """Send a datagram to where the peer's come from."""
        if self._datagrams and self.datagram_address:
            with contextlib.suppress(OSError):
                self._datagrams.sendto(self._keys.seal(self.peer, packet), self.datagram_address)

    def close(self) -> None:
        """Close at once; nothing that is queued is sent any more."""
        self._router.close()
        if self._datagrams:
            self._datagrams.close()


def provide_descriptors(me: Robot, count: int) -> None:
    """Have so many descriptors for the node of a robot. Raises ListenError if it may not."""
    lacking = kernel.descriptors_lacking(count)
    if lacking:
        raise ListenError(
            f"{me.name} needs {count} open files for {len(me.peers)} peers, {lacking} more than "
            "this process may have; raise the limit (ulimit -n, LimitNOFILE= of a systemd "
            "unit), or list fewer clients in the team file"
        )


def _listener(me: Robot, peer: str, number: int) -> socket.socket:
    """Listens for a peer, if need be at an address that the machine does not have (yet).

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
