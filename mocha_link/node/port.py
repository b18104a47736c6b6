"""The ports of a node, one for each peer: requests over ZeroMQ, datagrams of the same number.

`Port` is what both kinds are made from. A `ProtectedPort` is libzmq's, which encrypts; for peers
without a key see `open_port`.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
from collections import deque
from collections.abc import Container, Iterator
from dataclasses import dataclass, field

import zmq

from mocha_link.errors import ListenError, PortInUseError
from mocha_link.node import kernel
from mocha_link.node.curve import protect_port
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.zmtp import Part
from mocha_link.sync.protocol import Route
from mocha_link.team.keys import SecretKey
from mocha_link.team.team import Robot

MAX_REQUEST_BYTES = 65_536 + 1024
BURST = 64  # requests of one connection in a row, so that none starves the others
DEAD_PEER_S = 60
IDLE_MS = 1000  # a clock may be set; all else that happens wakes the node

QUEUE_REPLIES = 16  # to one connection of a protected port that does not read
QUEUE_REQUESTS = 256  # of one whose replies do not fit in that; further ones are dropped
_FULL_MS = 1  # libzmq does not tell when one of many connections takes more
_LATE_MS = 3  # the same for replies; a connection may sleep for a minute before it breaks
_DATAGRAM_BUFFER_BYTES = 1024 * 1024

LOG = logging.getLogger("mocha_link")


class Port:
    """A ROUTER, which a REQ or DEALER takes for a REP, and a datagram socket beside it.

    `caller` is where the peer's datagrams come from. Raises PortInUseError or ListenError.
    """

    def __init__(self, me: Robot, peer: str) -> None:
        self.peer = peer
        self.caller: tuple[str, int] | None = None
        number = me.port_for(peer)
        self._listener = _listener(me, peer, number)
        self._datagrams: socket.socket | None = None  # None: the port is taken, all goes by ZeroMQ
        try:
            self._datagrams = kernel.datagram_socket(me.listen, number, _DATAGRAM_BUFFER_BYTES)
        except OSError as error:
            LOG.warning("no datagrams on port %d of %s: %s", number, me.name, error.strerror)

    def watch(self, poller: Poller) -> None:
        """Have the poller wait for requests and datagrams."""
        if self._datagrams:
            poller.register(self._datagrams.fileno(), zmq.POLLIN, self)

    def look(self, _now_s: float) -> list[str]:
        """Who was sent away since the last call, and why; call it now and then."""
        return []

    def packets(self, limit: int) -> Iterator[tuple[bytes, tuple[str, int]]]:
        """The datagrams that have come, and where from."""
        return kernel.received(self._datagrams, limit) if self._datagrams else iter(())

    def send_datagram(self, packet: bytes) -> None:
        """Send a datagram to where the peer's come from."""
        if self._datagrams and self.caller:
            with contextlib.suppress(OSError):
                self._datagrams.sendto(packet, self.caller)

    def close(self) -> None:
        """Close at once; nothing that is queued is sent any more."""
        self._listener.close()
        if self._datagrams:
            self._datagrams.close()


@dataclass(slots=True)
class _Late:
    """A connection that does not take its replies: the one that waits, the requests behind it."""

    reply: bytes  # that the socket did not take
    requests: deque[list[bytes]] = field(default_factory=deque)  # not answered yet


class ProtectedPort(Port):
    """A port that only the holder of the peer's key can open: no other fills our memory there."""

    TOGETHER_BYTES = 0  # it may be full after any frame
    DESCRIPTORS = 5  # a listener, datagrams, and three of libzmq

    def __init__(
        self, context: zmq.Context[zmq.Socket[bytes]], me: Robot, peer: str, secret: SecretKey
    ) -> None:
        super().__init__(me, peer)
        # pushed frames that the socket did not take
        self._stuck: tuple[Route, list[Part]] | None = None
        self._late: dict[Route, _Late] = {}  # by connection
        self._gone: Route | None = None  # the last one of which it was noticed
        self.socket = context.socket(zmq.ROUTER)
        try:
            self.socket.setsockopt(zmq.LINGER, 0)
            self.socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
            self.socket.setsockopt(zmq.MAXMSGSIZE, MAX_REQUEST_BYTES)
            self.socket.setsockopt(zmq.SNDHWM, QUEUE_REPLIES)
            # Links break without a word: do not keep the connections of peers that are gone.
            self.socket.setsockopt(zmq.TCP_KEEPALIVE, 1)
            self.socket.setsockopt(zmq.TCP_KEEPALIVE_IDLE, DEAD_PEER_S // 2)
            self.socket.setsockopt(zmq.TCP_KEEPALIVE_INTVL, DEAD_PEER_S // 6)
            self.socket.setsockopt(zmq.TCP_KEEPALIVE_CNT, 3)
            self.socket.setsockopt(zmq.TCP_MAXRT, DEAD_PEER_S * 1000)
            protect_port(self.socket, secret, peer)
            self.socket.setsockopt(zmq.USE_FD, self._listener.detach())  # closed by libzmq
            self.socket.bind(f"tcp://{me.listen}:{me.port_for(peer)}")
        except BaseException:
            self.close()
            raise

    def watch(self, poller: Poller) -> None:
        """Have the poller wait for requests and datagrams."""
        super().watch(poller)
        poller.register(self.socket, zmq.POLLIN, self)

    def requests(self, _ready: Container[Polled]) -> Iterator[tuple[Route, list[bytes]]]:
        """Those whose turn it is: on which connection each came, and its body parts.

        Reply before you fetch the next. Those of a connection that does not take its replies wait,
        as with REP, whose turn does not come while its reply does not leave.
        """
        yield from self._resumed()
        for _ in range(BURST):
            try:
                frames = self.socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            if b"" in frames[1:-1]:  # without an envelope REP sockets ignore it, too
                body = frames.index(b"", 1) + 1
                route, parts = tuple(frames[:body]), frames[body:]
                late = self._late.get(route)
                if late is None:
                    yield route, parts
                elif len(late.requests) < QUEUE_REQUESTS:
                    late.requests.append(parts)

    def _resumed(self) -> Iterator[tuple[Route, list[bytes]]]:
        """The requests whose turn it is because their connection takes replies again."""
        for route in list(self._late):
            late = self._late.pop(route)
            self.reply(route, late.reply)
            while late.requests and route not in self._late:
                yield route, late.requests.popleft()
            if route in self._late:
                self._late[route].requests = late.requests

    @property
    def wait_ms(self) -> int:
        """How long nothing is to be done here if nothing comes."""
        if self._stuck:
            return _FULL_MS
        return _LATE_MS if self._late else IDLE_MS

    def reply(self, route: Route, frame: bytes) -> None:
        """Send a reply, or keep it until the connection takes it; if that is gone, it goes, too."""
        try:
            self.socket.send_multipart([*route, frame], flags=zmq.NOBLOCK)
        except zmq.Again:
            self._late[route] = _Late(frame)
        except zmq.ZMQError:
            pass

    def push(self, route: Route, parts: list[Part]) -> None:
        """Send a frame of a sync, or keep it until `flush` gets it out."""
        try:
            self.socket.send_multipart([*route, *parts], flags=zmq.NOBLOCK)
        except zmq.Again:
            self._stuck = (route, parts)
        except zmq.ZMQError:
            self._gone = route  # it comes again on another one and asks for what is missing

    def stands(self, route: Route) -> bool:
        """Whether a connection is still there, as far as is known."""
        return route != self._gone

    def flush(self, route: Route | None) -> bool:
        """Try to send what waits for a connection; whether it takes more.

        What is for another connection goes: that one sleeps, the peer has a new one.
        """
        if self._stuck:
            (to, parts), self._stuck = self._stuck, None
            if to == route:
                self.push(to, parts)
        return self._stuck is None

    def close(self) -> None:
        """Close at once; nothing that is queued is sent any more."""
        super().close()
        self.socket.close(0)


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
    address = "" if me.listen == "*" else me.listen
    try:
        return kernel.listener(address, number)
    except OSError as error:
        why = error
    if why.errno == errno.EADDRNOTAVAIL:
        try:
            listener = kernel.listener(address, number, early=True)
        except OSError as error:
            why = error if error.errno == errno.EADDRINUSE else why
        else:
            LOG.warning(
                "%s is no address of this machine now: no peer reaches port %d of %s before it is "
                "('listen' in the team file)",
                me.listen,
                number,
                me.name,
            )
            return listener
    what = f"{me.name} cannot listen for {peer} on tcp://{me.listen}:{number}"
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
