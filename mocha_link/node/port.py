"""The port of a node for one peer: requests over ZeroMQ, datagrams of the same number."""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import zmq

from mocha_link.errors import ListenError, PortInUseError
from mocha_link.node import kernel
from mocha_link.node.connection_limiter import ConnectionLimiter
from mocha_link.node.curve import protect_port
from mocha_link.sync.frames import Frame
from mocha_link.sync.server import Route
from mocha_link.team.keys import SecretKey
from mocha_link.team.team import Robot

MAX_REQUEST_BYTES = 65_536 + 1024
QUEUE_REPLIES = 16  # to one connection that does not read
QUEUE_REQUESTS = 256  # of one whose replies do not fit in that; further ones are dropped
IGNORED = 256  # messages in a row that are not for the node
DEAD_PEER_S = 60
DATAGRAM_BUFFER_BYTES = 1024 * 1024

LOG = logging.getLogger("mocha_link")


@dataclass(slots=True)
class _Late:
    """A connection that does not take its replies: the one that waits, the requests behind it."""

    reply: bytes  # that the socket did not take
    requests: deque[list[bytes]] = field(default_factory=deque)  # not answered yet


class Port:
    """A ROUTER, which a REQ or DEALER takes for a REP, and a datagram socket beside it.

    `caller` is where the peer's datagrams come from. Raises PortInUseError or ListenError.
    """

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        me: Robot,
        peer: str,
        secret: SecretKey | None,
    ) -> None:
        self.peer = peer
        self.caller: tuple[str, int] | None = None
        # pushed frames that the socket did not take
        self._stuck: tuple[Route, list[Frame]] | None = None
        self._late: dict[Route, _Late] = {}  # by connection
        number = me.port_for(peer)
        self.socket = context.socket(zmq.ROUTER)
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
        try:
            if secret:
                protect_port(self.socket, secret, peer)
            _bind(self.socket, me, number)
        except zmq.ZMQError as error:
            self.socket.close(0)
            raise _listen_error(me, peer, number, error) from None
        except BaseException:
            self.socket.close(0)
            raise
        # protected ports have none
        self._limiter = None if secret else ConnectionLimiter(self.socket, number)
        self._datagrams = _datagram_socket(me, number)  # None: none are taken

    def watch(self, poller: zmq.Poller) -> None:
        """Have the poller wait for requests and datagrams."""
        poller.register(self.socket, zmq.POLLIN)
        if self._datagrams:
            poller.register(self._datagrams, zmq.POLLIN)

    def is_ready(self, ready: set[object]) -> bool:
        """Whether anything has come."""
        datagrams = self._datagrams
        return self.socket in ready or (datagrams is not None and datagrams.fileno() in ready)

    def look(self) -> int:
        """Look who is connected, a few times a second; how many had to be sent away."""
        return self._limiter.look() if self._limiter else 0

    def receive(self) -> tuple[Route, list[bytes]] | None:
        """The next request: on which connection it came, and its body parts.

        Those of a connection that has not taken its last reply wait, see `resumed`.
        """
        for _ in range(IGNORED):  # then the others have their turn
            try:
                frames = self.socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return None
            if b"" in frames[1:-1]:  # without an envelope REP sockets ignore it, too
                body = frames.index(b"", 1) + 1
                route, parts = tuple(frames[:body]), frames[body:]
                late = self._late.get(route)
                if late is None:
                    return route, parts
                if len(late.requests) < QUEUE_REQUESTS:
                    late.requests.append(parts)
        return None

    @property
    def is_late(self) -> bool:
        """Whether replies wait."""
        return bool(self._late)

    def resumed(self) -> Iterator[tuple[Route, list[bytes]]]:
        """The requests whose turn it is because their connection takes replies again."""
        for route in list(self._late):
            late = self._late.pop(route)
            self.reply(route, late.reply)
            while late.requests and route not in self._late:
                yield route, late.requests.popleft()
            if route in self._late:
                self._late[route].requests = late.requests

    def packets(self, limit: int) -> Iterator[tuple[bytes, tuple[str, int]]]:
        """The datagrams that have come, and where from."""
        return kernel.received(self._datagrams, limit) if self._datagrams else iter(())

    def reply(self, route: Route, frame: bytes) -> None:
        """Send a reply, or keep it until the connection takes it; if that is gone, it goes, too."""
        try:
            self.socket.send_multipart([*route, frame], flags=zmq.NOBLOCK)
        except zmq.Again:
            self._late[route] = _Late(frame)
        except zmq.ZMQError:
            pass

    def push(self, route: Route, parts: list[Frame]) -> None:
        """Send a frame of a sync, or keep it until `flush` gets it out."""
        try:
            self.socket.send_multipart([*route, *parts], flags=zmq.NOBLOCK)
        except zmq.Again:
            self._stuck = (route, parts)
        except zmq.ZMQError:
            pass  # the peer is gone; it comes again and asks for what is missing

    def flush(self, route: Route | None) -> bool:
        """Try to send what waits; whether nothing waits any more.

        What is for another connection than `route` goes: that one sleeps, the peer has a new one.
        """
        if self._stuck:
            (to, parts), self._stuck = self._stuck, None
            if to == route:
                self.push(to, parts)
        return self._stuck is None

    def send_datagram(self, packet: bytes) -> None:
        """Send a datagram to where the peer's come from."""
        if self._datagrams and self.caller:
            with contextlib.suppress(OSError):
                self._datagrams.sendto(packet, self.caller)

    def close(self) -> None:
        """Close at once; nothing that is queued is sent any more."""
        if self._limiter:
            self._limiter.close()
        self.socket.close(0)
        if self._datagrams:
            self._datagrams.close()


def _bind(router: zmq.Socket[bytes], me: Robot, number: int) -> None:
    """Bind; if the machine does not have the address (yet), be there when it comes."""
    endpoint = f"tcp://{me.listen}:{number}"
    try:
        router.bind(endpoint)
    except zmq.ZMQError as error:
        if error.errno != errno.EADDRNOTAVAIL:
            raise
        try:
            listener = kernel.early_listener(me.listen, number)
        except OSError as why:
            raise (zmq.ZMQError(why.errno) if why.errno == errno.EADDRINUSE else error) from None
        router.setsockopt(zmq.USE_FD, listener.detach())  # closed by libzmq
        router.bind(endpoint)
        LOG.warning(
            "%s is no address of this machine now: no peer reaches port %d of %s before it is "
            "('listen' in the team file)",
            me.listen,
            number,
            me.name,
        )


def _datagram_socket(me: Robot, number: int) -> socket.socket | None:
    """None if the port is taken: then all goes over ZeroMQ."""
    try:
        return kernel.datagram_socket(me.listen, number, DATAGRAM_BUFFER_BYTES)
    except OSError as error:
        LOG.warning("no datagrams on port %d of %s: %s", number, me.name, error.strerror)
        return None


def _listen_error(
    me: Robot, peer: str, number: int, error: zmq.ZMQError
) -> PortInUseError | ListenError:
    what = f"{me.name} cannot listen for {peer} on tcp://{me.listen}:{number}"
    if error.errno == errno.EADDRINUSE:
        return PortInUseError(
            f"{what}: port {number} is in use; end the other node or process on it "
            f"(ss -ltnp 'sport = :{number}' shows it), or change base_port of {me.name} in the "
            "team file of every robot"
        )
    return ListenError(
        f"{what}: {zmq.strerror(error.errno or 0)}; set 'listen' of {me.name} to * or to an "
        "address of this machine, and its base_port to one that you may use"
    )
