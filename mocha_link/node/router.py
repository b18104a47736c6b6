"""A ROUTER of our own: the connections to a listening socket, since anyone may connect to it.

libzmq keeps the parts of a message until its last part has come, however many there are, and takes
in all that a connection brings meanwhile, with keys, too. Here each connection has one buffer of
the size of a request, and is not read while it does not take its replies; there are so many
connections at most, and so much that waits for all of them together.
"""

from __future__ import annotations

import contextlib
import itertools
import socket
import time
from collections import deque
from collections.abc import Callable, Collection, Container, Hashable, Iterator, Sequence

import zmq

from mocha_link.hosts import host_of
from mocha_link.node import kernel
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.send_buffer import SendBuffer
from mocha_link.node.zmtp import (
    GREETING_BYTES,
    Mechanism,
    NoEncryptionError,
    Null,
    Part,
    WrongKeyError,
    ZmtpError,
    ZmtpSession,
)
from mocha_link.store import wire
from mocha_link.sync import Standing

MAX_CONNECTIONS = 32  # of a listener; most beyond that are of links that broke
MAX_ALL_CONNECTIONS = 256  # of a node: each may hold a request that has come in part
MAX_WAITING_BYTES = 2 * wire.MAX_BYTES  # replies of a node that its peers have not taken yet
HANDSHAKE_S = 30.0  # as libzmq has it
KEY_S = 10.0  # who has shown no key by then is sent away; a slow radio takes seconds
OWED_BYTES = 256 * 1024  # replies to a connection that wait before its requests do
BURST = 64  # requests of one connection in a row, so that none starves the others
DEAD_PEER_S = 60
IDLE_MS = 1000  # a clock may be set; all else that happens wakes the node

_MAX_ACCEPTED = 8  # in a turn
_READ_BYTES = 16 * 1024
_MAX_REQUESTS = 1024  # in one read; our pulls have up to 256 under way


def _host(name: Callable[[], object]) -> str | None:
    """The address of an end of a connection; None: it is not one of IP, or is closed."""
    try:
        found = name()
    except OSError:
        return None
    return host_of(found) if isinstance(found, tuple) else None


class ClientConnection:
    """A client's connection to a router: its requests, and replies that are not sent yet."""

    def __init__(
        self, connection: socket.socket, name: bytes, now_s: float, session: ZmtpSession
    ) -> None:
        self.name = name  # begins its routes
        self.connection = connection
        self.number = connection.fileno()
        self.source = _host(connection.getpeername)
        self.requests: deque[list[Part]] = deque()  # without a reply so far
        self.began_s = now_s
        self.ended = False  # nothing more comes
        self.moved = 0  # when it last took or brought something, by the count of the node
        self.moved_s = now_s  # the same in steady seconds, as far as it took something
        self.watched = 0  # for what the poller waits
        self._session = session
        self._broken = False  # the link failed: the client did not close it
        self._out = SendBuffer([session.hello])

    @property
    def ready(self) -> bool:
        """Whether its handshake is through."""
        return self._session.ready

    @property
    def known(self) -> bool:
        """Whether it has shown a key that is let in."""
        return self._session.known

    @property
    def waiting_bytes(self) -> int:
        """What waits for the kernel to take it."""
        return self._out.size

    @property
    def holds_bytes(self) -> int:
        """What is kept for it: what has come of a request, and what it has not taken."""
        return self.waiting_bytes + self._session.held_bytes

    def is_to_here(self) -> bool:
        """Whether this machine still has the address to which it came."""
        host = _host(self.connection.getsockname)
        return host is None or kernel.is_ours(host)

    @property
    def left_early(self) -> bool:
        """Whether the client closed before its greeting was complete.

        A client that closes after it has read our greeting may have sent nothing.
        """
        return self.ended and not self._broken and self._session.received < GREETING_BYTES

    @property
    def is_late(self) -> bool:
        """Whether its requests wait because it does not take its replies."""
        return self._out.reply_bytes > OWED_BYTES

    def read(self) -> bool:
        """Take in what has come; whether anything has. Raises ZmtpError."""
        try:
            data = self.connection.recv(_READ_BYTES)
        except BlockingIOError:
            return False
        except OSError as error:
            self._broken = not isinstance(error, ConnectionResetError)
            data = b""
        self.ended = not data
        reply = self._session.receive(data)
        if reply:
            self._out.reply(reply)
        self.requests.extend(self._session.messages())
        return bool(data)

    def reply(self, envelope: Sequence[bytes], frames: Sequence[Part]) -> None:
        """Have a reply sent with the next `flush`."""
        self._out.count_reply(sum(map(len, frames)))
        self.push([*envelope, *frames])

    def push(self, parts: Sequence[Part]) -> None:
        """Queue a frame of a sync; replies to requests do not wait for it."""
        self._out.extend(self._session.encoded(parts))

    def send_last(self, last: bytes) -> None:
        """Send an error before the connection is closed, if the kernel takes it at once."""
        if last and not self._out:
            self._out.extend([last])
            self.flush()

    def flush(self) -> bool:
        """Send as much as the kernel takes; whether it took anything."""
        before = self._out.size
        try:
            self._out.flush(self.connection)
        except OSError:  # the client has closed
            self.ended = True
            self._out.clear()
        return self._out.size < before


def _least_needed(clients: Collection[ClientConnection]) -> ClientConnection:
    """Which of too many connections to close.

    Those that have shown a key are the last to go. Of the others, half of the places are for
    handshakes: if more are under way the oldest of these goes, since what a client has sent after
    its handshake is lost with its connection. Otherwise the one goes for which nothing has moved
    for the longest time.
    """
    unknown = [each for each in clients if not each.known] or list(clients)
    greeting = [each for each in unknown if not each.ready]
    if 2 * len(greeting) <= len(clients):
        greeting = []
    talking = [each for each in unknown if each.ready]
    return min(greeting or talking or unknown, key=lambda each: each.moved)


class ClientConnections:
    """The connections to all routers of a node: how many there may be, and what they hold.

    Those that have shown a key are the last to go.

    Args:
        most_bytes: the limit for all clients together; None: the default.
    """

    def __init__(self, most_bytes: int | None = None) -> None:
        self.routers: dict[ClientConnection, Router] = {}
        self._most_bytes = most_bytes
        self._moves = itertools.count(1)

    def moved(self, client: ClientConnection) -> None:
        """A client has sent or accepted bytes."""
        client.moved = next(self._moves)
        client.moved_s = time.monotonic()

    @property
    def _most(self) -> int:
        return MAX_WAITING_BYTES if self._most_bytes is None else self._most_bytes

    def check_limits(self, client: ClientConnection) -> None:
        """Free memory if a client holds more than its share of the limit."""
        if client.holds_bytes * len(self.routers) > self._most:
            self.relieve()

    def relieve(self) -> None:
        """Disconnect clients until both limits hold.

        Above the number of connections the least needed one is closed; above the memory, the
        largest.
        """
        most = self._most
        while len(self.routers) > MAX_ALL_CONNECTIONS:
            self._disconnect(_least_needed(self.routers))
        while sum(each.holds_bytes for each in self.routers) > most:
            self._disconnect(max(self.routers, key=lambda each: (each.holds_bytes, -each.moved)))

    def _disconnect(self, client: ClientConnection) -> None:
        self.routers[client].disconnect(client, "connected too often or did not take its replies")


class Router:
    """The connections to a listening socket, which it closes.

    Call `watch` once, then `requests` when something is ready, and `expire` now and then.

    Args:
        listener: Where they connect; it does not block.
        poller: Waits for its connections, too.
        clients: Shared by the routers of a node.
        max_bytes: Of a request, all its parts together.
        mechanism: of a new connection; None: clients need no key.
        burst: Requests of one connection in a row.
    """

    def __init__(  # noqa: PLR0913 - what it stands between
        self,
        listener: socket.socket,
        poller: Poller,
        clients: ClientConnections,
        max_bytes: int,
        mechanism: Callable[[], Mechanism] | None = None,
        *,
        burst: int = BURST,
    ) -> None:
        self._listener = listener
        self._poller = poller
        self._clients = clients
        self._max_bytes = max_bytes
        self._mechanism = mechanism or (lambda: Null(b"ROUTER"))
        self._protected = mechanism is not None
        self._burst = burst
        self._owner: Hashable = self  # in the poller
        self._inside: dict[bytes, ClientConnection] = {}  # by name
        self._names = itertools.count(1)
        self._refusals: list[str] = []
        self._served: ClientConnection | None = None  # flushed when its requests are through

    def watch(self, owner: Hashable) -> None:
        """Register with the poller; it reports `owner` for every ready socket."""
        self._owner = owner
        self._poller.register(self._listener.fileno(), zmq.POLLIN, owner)

    @staticmethod
    def _has_turn(client: ClientConnection, ready: Container[Polled]) -> bool:
        return client.number in ready or bool(client.requests and not client.is_late)

    def requests(self, ready: Container[Polled]) -> Iterator[tuple[bytes, list[Part]]]:
        """Those whose turn it is: on which connection each came, and its parts.

        Reply before you fetch the next. Those of a connection that does not take its replies wait,
        as with REP, whose turn does not come while its reply does not leave.
        """
        if self._listener.fileno() in ready:
            self._accept()
        for client in [each for each in self._inside.values() if self._has_turn(each, ready)]:
            if client.name in self._inside:  # no earlier one has disconnected it
                self._flush(client)
                self._served = client
                try:
                    yield from self._requests_of(client, ready)
                finally:
                    self._served = None
                    self._settle(client)

    def _requests_of(
        self, client: ClientConnection, ready: Container[Polled]
    ) -> Iterator[tuple[bytes, list[Part]]]:
        if client.number in ready and not client.requests and not client.is_late:
            try:
                if client.read():
                    self._clients.moved(client)
            except ZmtpError as error:
                client.send_last(error.reply)
                self.disconnect(client, self._why(error))
                return
        for _ in range(self._burst):
            if client.is_late:
                self._flush(client)
            if client.is_late or not client.requests:
                break
            yield client.name, client.requests.popleft()

    def _why(self, error: ZmtpError) -> str:
        if isinstance(error, WrongKeyError):
            return "came with a wrong key"
        if isinstance(error, NoEncryptionError):
            return "came without encryption"
        return "came not as a node of ours does" if self._protected else "sent what is no request"

    def _accept(self) -> None:
        for _ in range(_MAX_ACCEPTED):
            try:
                connection, _ = self._listener.accept()
            except BlockingIOError:
                break
            except OSError:  # the client has closed, or there are no descriptors left
                if self._inside:
                    self._drop_oldest()
                else:  # it would be ready all the time
                    self._poller.register(self._listener.fileno(), 0)
                break
            kernel.tune(connection, DEAD_PEER_S)
            name = b"\0" + next(self._names).to_bytes(8, "big")
            session = ZmtpSession(self._max_bytes, _MAX_REQUESTS, self._mechanism())
            client = ClientConnection(connection, name, time.monotonic(), session)
            self._inside[name] = client
            self._clients.routers[client] = self
            self._clients.moved(client)
            self._settle(client)
            if len(self._inside) > MAX_CONNECTIONS:
                self._drop_oldest()
        self._clients.relieve()

    def _drop_oldest(self) -> None:
        if self._inside:
            self.disconnect(_least_needed(self._inside.values()), "connected too often")

    def _flush(self, client: ClientConnection) -> None:
        if client.flush():
            self._clients.moved(client)
        self._clients.check_limits(client)

    def _settle(self, client: ClientConnection) -> None:
        """Send queued bytes, and register the events that the connection waits for."""
        self._flush(client)
        if client.name not in self._inside:
            return
        if client.ended and not client.requests:
            if self._protected and client.left_early:
                why = "left before it had shown a key, as one without a key does"
                self.disconnect(client, why)
            self._drop(client)
            return
        wanted = 0 if client.requests or client.is_late or client.ended else zmq.POLLIN
        wanted |= zmq.POLLOUT if client.waiting_bytes else 0
        if wanted != client.watched:
            client.watched = wanted
            self._poller.register(client.number, wanted, self._owner)

    def disconnect(self, client: ClientConnection, why: str) -> None:
        """Close a connection whose client violates the protocol."""
        self._refusals.append(f"a client {why}")
        self._drop(client)

    def _drop(self, client: ClientConnection) -> None:
        if self._inside.pop(client.name, None):
            del self._clients.routers[client]
            client.requests.clear()
            with contextlib.suppress(KeyError):
                self._poller.unregister(client.number)
            client.connection.close()

    @property
    def wait_ms(self) -> int:
        """How long nothing is to be done here if nothing comes."""
        return 0 if any(self._has_turn(each, ()) for each in self._inside.values()) else IDLE_MS

    def expire(self, now_s: float) -> list[str]:
        """Close connections with an overdue handshake; returns refusals since the last call."""
        self._poller.register(self._listener.fileno(), zmq.POLLIN, self._owner)
        most_s = KEY_S if self._protected else HANDSHAKE_S
        for client in list(self._inside.values()):
            if not client.ready and now_s - client.began_s > most_s:
                self._drop(client)
        refusals, self._refusals = self._refusals, []
        return refusals

    def drop_stopped(self, now_s: float, after_s: float) -> None:
        """Close connections that have taken nothing for so long of what waits for them."""
        for client in list(self._inside.values()):
            if client.waiting_bytes and now_s - client.moved_s > after_s:
                self._drop(client)

    def reply(self, name: bytes, envelope: Sequence[bytes], frames: Sequence[Part]) -> None:
        """Send a reply, or queue it; the reply is dropped if the connection is closed."""
        client = self._inside.get(name)
        if client:
            client.reply(envelope, frames)
            if client is not self._served:
                self._settle(client)

    def push(self, name: bytes, parts: Sequence[Part]) -> None:
        """Have a frame of a sync sent with the next `flush`."""
        client = self._inside.get(name)
        if client:
            client.push(parts)

    def stands(self, name: bytes) -> bool:
        """Whether a connection is still there."""
        return name in self._inside

    def source(self, name: bytes) -> str | None:
        """The address from which a connection comes; None: it is closed."""
        client = self._inside.get(name)
        return client.source if client else None

    def own_addresses_changed(self) -> None:
        """Close the connections to addresses that this machine has no longer."""
        for client in list(self._inside.values()):
            if not client.is_to_here():
                self._drop(client)

    def standing(self, name: bytes) -> Standing | None:
        """How a connection stands; None: it is closed."""
        client = self._inside.get(name)
        if client is None:
            return None
        connection = client.connection
        return Standing(kernel.loses_much(connection), kernel.rtt_s(connection))

    def flush(self, name: bytes) -> bool:
        """Try to send what waits for a connection; whether it takes more."""
        client = self._inside.get(name)
        if client and client.waiting_bytes:
            self._settle(client)
        return client is None or not client.waiting_bytes

    def close(self) -> None:
        """Close at once; nothing that is queued is sent any more."""
        for client in list(self._inside.values()):
            self._drop(client)
        self._listener.close()
