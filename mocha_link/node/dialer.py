"""The sockets of our pulls: one outgoing connection to each peer, and outgoing datagrams.

The dialer chooses the addresses; `connector` and `datagram_socket` open the sockets.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Container, Hashable, Iterator, Mapping
from functools import partial

from mocha_link.addresses import AddressBook, Mdns, Resolver
from mocha_link.loopback import is_loopback
from mocha_link.node.attempts import Attempts
from mocha_link.node.connection import Connection
from mocha_link.node.connector import Connector
from mocha_link.node.datagram_socket import DatagramSocket
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.link_keys import LinkKeys
from mocha_link.node.zmtp import Part
from mocha_link.sync import Standing
from mocha_link.team import Robot, Team

MOVED_S = 10.0  # at least this long between two replacements because a peer's address changed
MAX_COPIES = 3  # of a datagram, while the peer's current address is unknown


class Dialer:
    """Owns a connection to each peer that we pull from, and the socket for outgoing datagrams.

    For one thread. The caller drives the connections that `ready` yields.

    Args:
        me: the robot that connects.
        keys: of `me` and of protected peers.
        wake: called from another thread when an address was found or lost.
        lost: called with a peer and the reason why there is no connection to it.
        mdns: finds robots without an address in the team file.

    Attributes:
        book: the addresses of the peers.
    """

    def __init__(  # noqa: PLR0913 - the team, the poller and the callbacks
        self,
        team: Team,
        me: Robot,
        poller: Poller,
        *,
        keys: LinkKeys,
        wake: Callable[[], None],
        lost: Callable[[str, str], None],
        mdns: Mdns | None = None,
    ) -> None:
        self.book = AddressBook(team, keys.peers, Resolver(self.update), mdns)
        self._poller = poller
        self._connector = Connector(team, me, keys)
        self._datagrams = DatagramSocket(team, me, poller, keys)
        self._lost = lost
        self._wake = wake
        self._updated = False  # an address may have been found or lost
        self._connections: dict[str, Connection | Attempts] = {}
        self._stated: set[str] = set()  # peers dialed at an address of team file, DNS or mDNS
        self._reached: dict[str, str] = {}  # by peer: the address that worked in this contact
        self._moved_s: dict[str, float] = {}  # by peer: its last address change, steady seconds
        self._left_s: dict[str, float] = {}  # by peer: when we lost our address, steady seconds
        # Peers whose connections need a turn without a poller event.
        self._needs_polling: set[str] = set()

    def start(self) -> None:
        """Open the socket for datagrams, if possible."""
        self._datagrams.open()

    def close(self) -> None:
        """Close all sockets."""
        for peer in list(self._connections):
            self.hang_up(peer, void=True)
        self._datagrams.close()

    def update(self) -> None:
        """Note that an address may have been found or lost; from any thread."""
        self._updated = True
        self._wake()

    # --- connections

    def connect(self, peer: str) -> None:
        """Replace the connection to a peer by a new one, which opens with the first request."""
        self.hang_up(peer, void=True)
        self._reached.pop(peer, None)
        self._connections[peer] = self._attempts(peer)
        self._needs_polling.add(peer)

    def _attempts(self, peer: str) -> Attempts:
        connect = partial(self._connector.connect, peer)
        return Attempts(connect, self._poller, peer, trusted=partial(self.book.is_trusted, peer))

    def send(self, peer: str, frame: bytes) -> None:
        """Send a request on the connection to a peer."""
        connection = self._connections.get(peer)
        if isinstance(connection, Attempts):
            connection.frames.append(frame)
            self._open(peer, connection, (), time.monotonic())
        elif connection:
            connection.send(frame)
            self._watch(peer, connection)

    def standing(self, peer: str) -> Standing | None:
        """The kernel's measurements of the connection to a peer; None: it accepts no frames."""
        connection = self._connections.get(peer)
        if isinstance(connection, Connection) and connection.takes_frames:
            return connection.standing()
        return None

    def push(self, peer: str, parts: list[Part]) -> None:
        """Queue a frame of a sync for the next `flush`."""
        connection = self._connections.get(peer)
        if isinstance(connection, Connection) and connection.takes_frames:
            connection.push(parts)

    def flush(self, peer: str) -> bool:
        """Send queued bytes to a peer; returns whether none are left."""
        connection = self._connections.get(peer)
        if not isinstance(connection, Connection):
            return True
        takes_more = connection.flush()
        self._watch(peer, connection)
        return takes_more

    def hang_up(self, peer: str, *, void: bool) -> None:
        """Close the connection to a peer; if it is `void`, without what the kernel has not sent."""
        connection = self._connections.pop(peer, None)
        self._needs_polling.discard(peer)
        if isinstance(connection, Attempts):
            for host in connection:
                self.book.failed(peer, host)
            connection.close()
        elif connection:
            self._connector.closed(peer, connection, time.monotonic())
            if connection.failure or not connection.stands:
                self.book.failed(peer, connection.host)
            connection.forget(self._poller)
            if void:
                connection.abort()
            else:
                connection.close()

    def ready(
        self, ready: Mapping[Polled, Hashable], now_s: float
    ) -> Iterator[tuple[str, Connection]]:
        """Yield the connections that need a turn; opens those with a known address."""
        if self._updated:
            self._updated = False
            self._leave_old_addresses(now_s)
        polled = self._needs_polling.union(ready.values())
        for peer in [each for each in self._connections if each in polled]:
            connection = self._connections.get(peer)  # an earlier turn may have replaced it
            if isinstance(connection, Attempts):
                found = self._open(peer, connection, ready, now_s)
                if found:
                    yield peer, found
            elif connection and connection.is_ready(ready, now_s):
                yield peer, connection

    def keep(self, peer: str, connection: Connection) -> None:
        """Register a connection with the poller after its turn; close it if it has failed."""
        if self._connections.get(peer) is not connection:
            return
        if connection.failure:
            self.hang_up(peer, void=True)
        else:
            if connection.stands:
                self._note_reached(peer, connection.host)
            self._watch(peer, connection)

    def _note_reached(self, peer: str, host: str) -> None:
        if self._reached.get(peer) != host:
            self._reached[peer] = host
            self.book.reached(peer, host)

    def _watch(self, peer: str, connection: Connection) -> None:
        connection.watch(self._poller, peer)
        if connection.needs_polling:
            self._needs_polling.add(peer)
        else:
            self._needs_polling.discard(peer)

    def wait_s(self, now_s: float) -> float:
        """The time until the next turn if no socket becomes ready."""
        waits_s = [math.inf]
        for peer in self._needs_polling:
            connection = self._connections[peer]
            if isinstance(connection, Attempts):
                waits_s.append(connection.wake_s - now_s)
            elif connection.failure is not None:
                waits_s.append(0.0)
            elif connection.wake_s is not None:
                waits_s.append(connection.wake_s - now_s)
        return min(waits_s)

    def _open(
        self, peer: str, attempts: Attempts, ready: Container[Polled], now_s: float
    ) -> Connection | None:
        """Try the known addresses of a peer; returns the connection to use, once there is one."""
        hosts = self.book.hosts(peer)
        found = attempts.advance(hosts, ready, now_s)
        for host in attempts.settle():
            self.book.failed(peer, host)
        if found:
            attempts.close()
            self._connections[peer] = found
            if self.book.is_stated(peer, found.host):
                self._stated.add(peer)
            else:
                self._stated.discard(peer)
            for frame in attempts.frames:
                found.send(frame)
            self._watch(peer, found)
            return found
        why = attempts.failure if attempts.exhausted(hosts) else None
        if not hosts:
            why = self.book.failure(peer)
        if why:
            self.hang_up(peer, void=True)  # attempts may run at addresses that have expired
            self._lost(peer, why)
        return None

    # --- peers that move, and our own addresses

    def came_from(self, peer: str, host: str) -> None:
        """Note the source address of a peer, and reconnect if it differs from the one in use.

        A loopback address is ignored: it belongs to a relay on this machine.
        """
        if is_loopback(host) or not self.book.came_from(peer, host):
            return
        connection = self._connections.get(peer)
        if isinstance(connection, Connection) and connection.host != host:
            self._replace(peer, connection, time.monotonic())

    def expire(self, now_s: float) -> None:
        """Replace connections whose peer has another address by now; call it once a second."""
        for peer, connection in list(self._connections.items()):
            if not isinstance(connection, Connection):
                continue
            hosts = self.book.hosts(peer)  # also makes names in use resolve again
            if connection.unanswered():
                self.book.failed(peer)
                if hosts and hosts[0] != connection.host and self.book.is_stated(peer, hosts[0]):
                    self._replace(peer, connection, now_s)

    def own_addresses_changed(self, now_s: float) -> list[str]:
        """Close the connections from an address that this machine no longer has.

        Returns the peers that lost their connection this way and are not reconnected yet.
        """
        for peer, connection in self._connections.items():
            if isinstance(connection, Connection) and not connection.is_from_here():
                connection.leave("the address of this computer has changed")
                self._needs_polling.add(peer)
                self._left_s[peer] = now_s
        return [
            peer
            for peer, left_s in self._left_s.items()
            if now_s - left_s < MOVED_S and peer not in self._connections
        ]

    def _leave_old_addresses(self, now_s: float) -> None:
        """Close connections to addresses that DNS or mDNS no longer gives for their peer."""
        for peer, connection in list(self._connections.items()):
            if not isinstance(connection, Connection) or peer not in self._stated:
                continue
            if self.book.hosts(peer) and not self.book.is_stated(peer, connection.host):
                self._replace(peer, connection, now_s)

    def _replace(self, peer: str, connection: Connection, now_s: float) -> None:
        """Try the other addresses of a peer, in parallel if this connection is not established."""
        if now_s - self._moved_s.get(peer, -math.inf) < MOVED_S:
            return
        self._moved_s[peer] = now_s
        self._needs_polling.add(peer)
        if connection.stands or connection.failure:
            connection.leave("the peer's address has changed")
        else:
            attempts = self._connections[peer] = self._attempts(peer)
            attempts.adopt(connection, now_s)

    # --- datagrams

    def send_datagram(self, peer: str, packet: bytes) -> None:
        """Send a datagram to a peer's port for us; before it was reached, to several addresses."""
        reached = self._reached.get(peer)
        hosts = [reached] if reached else self.book.hosts(peer)[:MAX_COPIES]
        hosts = [host for host in hosts if reached or self.book.is_trusted(peer, host)]
        self._datagrams.send(peer, hosts, packet)

    def packets(self, ready: Container[Polled]) -> Iterator[tuple[str, bytes]]:
        """Yield the datagrams that peers have sent in reply to ours, each with its peer."""
        for peer, host, packet in self._datagrams.received(ready):
            self._note_reached(peer, host)
            yield peer, packet
