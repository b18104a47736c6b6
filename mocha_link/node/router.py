"""The connections to a listening socket: a ROUTER that limits the memory of untrusted clients.

libzmq buffers all parts of a message until the last one is received, without a limit on their
number, and reads on from a client that does not read its replies; keys do not change that. Here
each connection has one buffer of the size of a request. It is not read while its client does not
read the replies. The number of connections and their queued bytes are limited.
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

MAX_CONNECTIONS = 32  # per listener; more are usually left over from broken links
MAX_ALL_CONNECTIONS = 256  # per node: each may buffer an incomplete request
MAX_WAITING_BYTES = 2 * wire.MAX_BYTES  # per node: replies that its peers have not read yet
HANDSHAKE_S = 30.0  # the default of libzmq
KEY_S = 10.0  # a client without a valid key is disconnected then; a slow radio needs seconds
OWED_BYTES = 256 * 1024  # above this many queued bytes of replies a connection is not read
BURST = 64  # requests served in a row per connection, so that none starves the others
DEAD_PEER_S = 60
IDLE_MS = 1000  # setting the clock does not wake the node; everything else does

_MAX_ACCEPTED = 8  # in a turn
_READ_BYTES = 16 * 1024
_MAX_REQUESTS = 1024  # per read; our pulls have at most 256 requests in flight


def _host(name: Callable[[], object]) -> str | None:
    """The address of one end of a connection; None: it is not an IP connection, or is closed."""
    try:
        found = name()
    except OSError:
        return None
    return host_of(found) if isinstance(found, tuple) else None


class ClientConnection:
    """A client's connection to a router: its requests, and its queued replies."""

    def __init__(
        self, connection: socket.socket, name: bytes, now_s: float, session: ZmtpSession
    ) -> None:
        self.name = name  # the first frame of its routes
        self.connection = connection
        self.number = connection.fileno()
        self.source = _host(connection.getpeername)
        self.requests: deque[list[Part]] = deque()  # not handed out yet
        self.began_s = now_s
        self.ended = False  # the client has closed, or the link failed
        self.moved = 0  # the node's counter at its last transfer of bytes, either way
        self.moved_s = now_s  # steady seconds at that transfer
        self.watched = 0  # the poller flags that are registered
        self._session = session
        self._broken = False  # the link failed; the client did not close the connection
        self._out = SendBuffer([session.hello])

    @property
    def ready(self) -> bool:
        """Whether its handshake is complete."""
        return self._session.ready

    @property
    def known(self) -> bool:
        """Whether its client has proven an accepted key."""
        return self._session.known

    @property
    def waiting_bytes(self) -> int:
        """Queued bytes that the kernel has not accepted yet."""
        return self._out.size

    @property
    def holds_bytes(self) -> int:
        """Its memory: incomplete requests and queued replies."""
        return self.waiting_bytes + self._session.held_bytes

    def is_to_here(self) -> bool:
        """Whether this machine still has the local address of the connection."""
        host = _host(self.connection.getsockname)
        return host is None or kernel.is_ours(host)

    @property
    def left_early(self) -> bool:
        """Whether the client closed before its greeting was complete.

        A client that reads our greeting and closes may have sent nothing.
        """
        return self.ended and not self._broken and self._session.received < GREETING_BYTES

    @property
    def is_late(self) -> bool:
        """Whether its requests wait because its client does not read the replies."""
        return self._out.reply_bytes > OWED_BYTES

    def read(self) -> bool:
        """Read once; returns whether bytes were received. Raises ZmtpError."""
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
        """Queue a reply for the next `flush`."""
        self._out.count_reply(sum(map(len, frames)))
        self.push([*envelope, *frames])

    def push(self, parts: Sequence[Part]) -> None:
        """Queue a frame of a sync; replies to requests do not wait for it."""
        self._out.extend(self._session.encoded(parts))

    def send_last(self, last: bytes) -> None:
        """Send an error before the connection is closed, if the kernel accepts it at once."""
        if last and not self._out:
            self._out.extend([last])
            self.flush()

    def flush(self) -> bool:
        """Send as much as the kernel accepts; returns whether it accepted anything."""
        before = self._out.size
        try:
            self._out.flush(self.connection)
        except OSError:  # the client has closed
            self.ended = True
            self._out.clear()
        return self._out.size < before


def _least_needed(clients: Collection[ClientConnection]) -> ClientConnection:
    """The connection to close when there are too many.

    Connections with a proven key are closed last. If more than half of all connections are still in
    the handshake, the idlest of these is closed: closing a connection after its handshake loses the
    requests that its client has sent. Otherwise the connection that has been idle for longest is
    closed.
    """
    unknown = [each for each in clients if not each.known] or list(clients)
    greeting = [each for each in unknown if not each.ready]
    if 2 * len(greeting) <= len(clients):
        greeting = []
    talking = [each for each in unknown if each.ready]
    return min(greeting or talking or unknown, key=lambda each: each.moved)


class ClientConnections:
    """The connections to all routers of a node, with limits on their number and memory.

    Connections with a proven key are closed last.

    Args:
        most_bytes: the limit for all clients together; None: the default.
    """

    def __init__(self, most_bytes: int | None = None) -> None:
        self.routers: dict[ClientConnection, Router] = {}
        self._most_bytes = most_bytes
        self._moves = itertools.count(1)

    def moved(self, client: ClientConnection) -> None:
        """Note that a client has sent or accepted bytes."""
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
        """Disconnect clients until both limits are met.

        With too many connections the least needed one is closed; with too much memory, the largest.
        """
        most = self._most
        while len(self.routers) > MAX_ALL_CONNECTIONS:
            self._disconnect(_least_needed(self.routers))
        while sum(each.holds_bytes for each in self.routers) > most:
            self._disconnect(max(self.routers, key=lambda each: (each.holds_bytes, -each.moved)))

    def _disconnect(self, client: ClientConnection) -> None:
        self.routers[client].disconnect(client, "connected too often or did not read its replies")


class Router:
    """Serves the connections to a listening socket, which it owns.

    Call `watch` once, `requests` when something is ready, and `expire` about once a second.

    Args:
        listener: The non-blocking listening socket.
        poller: Also waits for the connections.
        clients: Shared by the routers of a node.
        max_bytes: The limit for a request, all its parts together.
        mechanism: Makes the mechanism of a new connection; None: clients need no key.
        burst: The number of requests that one connection may have served in a row.
    """

    def __init__(  # noqa: PLR0913 - its socket, its limits and its surroundings
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
        self._owner: Hashable = self  # reported by the poller
        self._inside: dict[bytes, ClientConnection] = {}  # open connections, by name
        self._names = itertools.count(1)
        self._refusals: list[str] = []
        self._served: ClientConnection | None = None  # flushed once after its requests

    def watch(self, owner: Hashable) -> None:
        """Register with the poller; it reports `owner` for every ready socket."""
        self._owner = owner
        self._poller.register(self._listener.fileno(), zmq.POLLIN, owner)

    @staticmethod
    def _has_turn(client: ClientConnection, ready: Container[Polled]) -> bool:
        return client.number in ready or bool(client.requests and not client.is_late)

    def requests(self, ready: Container[Polled]) -> Iterator[tuple[bytes, list[Part]]]:
        """Yield the requests to serve now, each with the name of its connection.

        The caller replies before it fetches the next one. The requests of a client that does not
        read its replies wait, as with a REP socket.
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
            return "used a wrong key"
        if isinstance(error, NoEncryptionError):
            return "used no encryption"
        return "violated the protocol" if self._protected else "sent an invalid request"

    def _accept(self) -> None:
        for _ in range(_MAX_ACCEPTED):
            try:
                connection, _ = self._listener.accept()
            except BlockingIOError:
                break
            except OSError:  # the client has closed, or there are no descriptors left
                if self._inside:
                    self._drop_oldest()
                else:  # the listener would stay ready: stop polling it until `expire`
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
        """The time until the next turn if no socket becomes ready."""
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
        """Close connections with queued bytes of which none was sent for `after_s`."""
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
        """Queue a frame of a sync for the next `flush`."""
        client = self._inside.get(name)
        if client:
            client.push(parts)

    def stands(self, name: bytes) -> bool:
        """Whether a connection is still open."""
        return name in self._inside

    def source(self, name: bytes) -> str | None:
        """The client's address of a connection; None: the connection is closed."""
        client = self._inside.get(name)
        return client.source if client else None

    def own_addresses_changed(self) -> None:
        """Close the connections to addresses that this machine no longer has."""
        for client in list(self._inside.values()):
            if not client.is_to_here():
                self._drop(client)

    def standing(self, name: bytes) -> Standing | None:
        """The kernel's measurements of a connection; None: it is closed."""
        client = self._inside.get(name)
        if client is None:
            return None
        return kernel.standing(client.connection)

    def flush(self, name: bytes) -> bool:
        """Send queued bytes of a connection; returns whether none are left."""
        client = self._inside.get(name)
        if client and client.waiting_bytes:
            self._settle(client)
        return client is None or not client.waiting_bytes

    def close(self) -> None:
        """Close at once; queued bytes are dropped."""
        for client in list(self._inside.values()):
            self._drop(client)
        self._listener.close()
