"""A port for a peer without a key: a ROUTER of our own, since anyone may connect to it.

libzmq keeps the parts of a message until its last part has come, however many there are, and takes
in all that a connection brings meanwhile. Here each connection has one buffer of the size
of a request, and is not read while it does not take its replies; a node has so many connections at
most, and so much that waits for all of them together.
"""

from __future__ import annotations

import contextlib
import itertools
import socket
import time
from collections import deque
from collections.abc import Container, Iterator, Sequence

import zmq

from mocha_link.node import kernel
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.port import BURST, DEAD_PEER_S, IDLE_MS, MAX_REQUEST_BYTES, Port
from mocha_link.node.zmtp import Part, ZmtpError, ZmtpSession, encoded
from mocha_link.store import wire
from mocha_link.sync.protocol import Route
from mocha_link.team.team import Robot

MAX_CONNECTIONS = 32  # of a port; most beyond that are of links that broke
MAX_ALL_CONNECTIONS = 256  # of a node: each may hold a request that has come in part
MAX_WAITING_BYTES = 2 * wire.MAX_BYTES  # replies of a node that its peers have not taken yet
HANDSHAKE_S = 30.0  # as libzmq has it
OWED_BYTES = 256 * 1024  # replies to a connection that wait before its requests do

_MAX_ACCEPTED = 8  # in a turn
_READ_BYTES = 16 * 1024
_MAX_REQUESTS = 1024  # in what is read at once; our pulls have up to 256 under way
_MAX_PIECES = 64  # in a system call


class Caller:
    """A connection to the port: what it asks, and what it has not taken yet."""

    def __init__(self, connection: socket.socket, name: bytes, now_s: float) -> None:
        self.name = name  # begins its routes
        self.connection = connection
        self.number = connection.fileno()
        self.requests: deque[list[Part]] = deque()  # not answered yet
        self.waiting_bytes = 0  # for the kernel to take them
        self.began_s = now_s
        self.ended = False  # nothing more comes
        self.moved = 0  # when it last took or brought something, by the count of the node
        self.watched = 0  # for what the poller waits
        self._session = ZmtpSession(MAX_REQUEST_BYTES, _MAX_REQUESTS)
        self._owed = 0  # bytes of replies since it took all
        self._out: deque[memoryview] = deque()
        self._put(ZmtpSession.hello_of_router)

    @property
    def ready(self) -> bool:
        """Whether its handshake came."""
        return self._session.ready

    @property
    def is_late(self) -> bool:
        """Whether its requests wait because it does not take its replies."""
        return self._owed > OWED_BYTES

    def read(self) -> bool:
        """Take in what has come; whether anything has. Raises ZmtpError."""
        try:
            data = self.connection.recv(_READ_BYTES)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        self.ended = not data
        answer = self._session.receive(data)
        if answer:
            self._put(answer)
            self._owed += len(answer)
        self.requests.extend(self._session.messages())
        return bool(data)

    def reply(self, envelope: Sequence[bytes], frame: bytes) -> None:
        """Have a reply sent with the next `flush`."""
        self._owed += len(frame)
        self.push([*envelope, frame])

    def push(self, parts: Sequence[Part]) -> None:
        """Likewise a frame of a sync, which the replies to its requests do not wait for."""
        for piece in encoded(parts):
            self._put(piece)

    def _put(self, piece: Part) -> None:
        self._out.append(memoryview(piece))
        self.waiting_bytes += len(piece)

    def flush(self) -> bool:
        """Send what the kernel takes; whether it has taken anything."""
        before = self.waiting_bytes
        while self._out:
            try:
                sent = self.connection.sendmsg(itertools.islice(self._out, _MAX_PIECES))
            except BlockingIOError:
                break
            except OSError:  # it is gone
                self.ended = True
                self._out.clear()
                self.waiting_bytes = 0
                break
            self.waiting_bytes -= sent
            while sent:
                piece = self._out.popleft()
                if len(piece) > sent:
                    self._out.appendleft(piece[sent:])
                sent -= min(len(piece), sent)
        if not self._out:
            self._owed = 0
        return self.waiting_bytes < before


class Callers:
    """The connections to all open ports of a node: how many there may be, and what they hold."""

    def __init__(self) -> None:
        self.ports: dict[Caller, OpenPort] = {}
        self._moves = itertools.count(1)

    def moved(self, caller: Caller) -> None:
        """It has taken or brought something."""
        caller.moved = next(self._moves)

    def relieve(self) -> None:
        """Send away those that are too much.

        Of too many the one goes for which nothing has moved for the longest time; of too much the
        one that holds most.
        """
        while len(self.ports) > MAX_ALL_CONNECTIONS:
            self._send_away(min(self.ports, key=lambda each: each.moved))
        while sum(each.waiting_bytes for each in self.ports) > MAX_WAITING_BYTES:
            self._send_away(max(self.ports, key=lambda each: (each.waiting_bytes, -each.moved)))

    def _send_away(self, caller: Caller) -> None:
        self.ports[caller].send_away(caller, "connected too often or did not take its replies")


class OpenPort(Port):
    """A port that asks for no key.

    Args:
        poller: waits for its connections, too.
        callers: shared by the open ports of a node.
    """

    TOGETHER_BYTES = 16 * 1024  # of frames that leave in one system call
    DESCRIPTORS = 2  # a listener and datagrams

    def __init__(self, poller: Poller, callers: Callers, me: Robot, peer: str) -> None:
        self._poller = poller
        self._callers = callers
        self._inside: dict[bytes, Caller] = {}  # by name
        self._names = itertools.count(1)
        self._refusals: list[str] = []
        self._served: Caller | None = None  # flushed when its requests are through
        super().__init__(me, peer)

    def watch(self, poller: Poller) -> None:
        """Have the poller wait for requests and datagrams."""
        super().watch(poller)
        poller.register(self._listener.fileno(), zmq.POLLIN, self)

    @staticmethod
    def _has_turn(caller: Caller, ready: Container[Polled]) -> bool:
        return caller.number in ready or bool(caller.requests and not caller.is_late)

    def requests(self, ready: Container[Polled]) -> Iterator[tuple[Route, list[bytes]]]:
        """Those whose turn it is; see `ProtectedPort.requests`."""
        if self._listener.fileno() in ready:
            self._accept()
        for caller in [each for each in self._inside.values() if self._has_turn(each, ready)]:
            if caller.name in self._inside:  # none before it has sent it away
                self._flush(caller)
                self._served = caller
                try:
                    yield from self._requests_of(caller, ready)
                finally:
                    self._served = None
                    self._settle(caller)

    def _requests_of(
        self, caller: Caller, ready: Container[Polled]
    ) -> Iterator[tuple[Route, list[bytes]]]:
        if caller.number in ready and not caller.requests and not caller.is_late:
            try:
                if caller.read():
                    self._callers.moved(caller)
            except ZmtpError:
                self.send_away(caller, "sent what is no request")
                return
        for _ in range(BURST):
            if caller.is_late:
                self._flush(caller)
            if caller.is_late or not caller.requests:
                break
            parts = caller.requests.popleft()
            if b"" in parts[:-1]:  # without an envelope REP sockets ignore it, too
                body = parts.index(b"") + 1
                route = (caller.name, *map(bytes, parts[:body]))
                yield route, [bytes(each) for each in parts[body:]]

    def _accept(self) -> None:
        for _ in range(_MAX_ACCEPTED):
            try:
                connection, _ = self._listener.accept()
            except BlockingIOError:
                break
            except OSError:  # it has gone again, or there are no descriptors left
                if self._inside:
                    self._drop_oldest()
                else:  # it would be ready all the time
                    self._poller.register(self._listener.fileno(), 0)
                break
            kernel.tune(connection, DEAD_PEER_S)
            name = b"\0" + next(self._names).to_bytes(8, "big")
            caller = Caller(connection, name, time.monotonic())
            self._inside[name] = caller
            self._callers.ports[caller] = self
            self._callers.moved(caller)
            self._settle(caller)
            if len(self._inside) > MAX_CONNECTIONS:
                self._drop_oldest()
        self._callers.relieve()

    def _drop_oldest(self) -> None:
        if self._inside:
            oldest = min(self._inside.values(), key=lambda each: each.moved)
            self.send_away(oldest, "connected too often")

    def _flush(self, caller: Caller) -> None:
        if caller.flush():
            self._callers.moved(caller)
        if caller.waiting_bytes > OWED_BYTES:
            self._callers.relieve()

    def _settle(self, caller: Caller) -> None:
        """Send what waits, and have the poller wait for what is to come."""
        self._flush(caller)
        if caller.name not in self._inside:
            return
        if caller.ended and not caller.requests:
            self._drop(caller)
            return
        wanted = 0 if caller.requests or caller.is_late or caller.ended else zmq.POLLIN
        wanted |= zmq.POLLOUT if caller.waiting_bytes else 0
        if wanted != caller.watched:
            caller.watched = wanted
            self._poller.register(caller.number, wanted, self)

    def send_away(self, caller: Caller, why: str) -> None:
        """Close a connection that does what no node does."""
        self._refusals.append(f"a client {why}")
        self._drop(caller)

    def _drop(self, caller: Caller) -> None:
        if self._inside.pop(caller.name, None):
            del self._callers.ports[caller]
            caller.requests.clear()
            with contextlib.suppress(KeyError):
                self._poller.unregister(caller.number)
            caller.connection.close()

    @property
    def wait_ms(self) -> int:
        """How long nothing is to be done here if nothing comes."""
        return 0 if any(self._has_turn(each, ()) for each in self._inside.values()) else IDLE_MS

    def look(self, now_s: float) -> list[str]:
        """Who was sent away since the last call; call it now and then."""
        self._poller.register(self._listener.fileno(), zmq.POLLIN, self)
        for caller in list(self._inside.values()):
            if not caller.ready and now_s - caller.began_s > HANDSHAKE_S:
                self._drop(caller)
        refusals, self._refusals = self._refusals, []
        return refusals

    def reply(self, route: Route, frame: bytes) -> None:
        """Send a reply, or keep it until the connection takes it; if that is gone, it goes, too."""
        caller = self._inside.get(route[0])
        if caller:
            caller.reply(route[1:], frame)
            if caller is not self._served:
                self._settle(caller)

    def push(self, route: Route, parts: list[Part]) -> None:
        """Have a frame of a sync sent with the next `flush`."""
        caller = self._inside.get(route[0])
        if caller:
            caller.push([*route[1:], *parts])

    def stands(self, route: Route) -> bool:
        """Whether a connection is still there."""
        return route[0] in self._inside

    def flush(self, route: Route | None) -> bool:
        """Try to send what waits for a connection; whether it takes more."""
        caller = self._inside.get(route[0]) if route else None
        if caller and caller.waiting_bytes:
            self._settle(caller)
        return caller is None or not caller.waiting_bytes

    def close(self) -> None:
        """Close at once; nothing that is queued is sent any more."""
        super().close()
        for caller in list(self._inside.values()):
            self._drop(caller)
