"""The sockets of our pulls: addresses of peers, a connection to each, and outgoing datagrams."""

from __future__ import annotations

import contextlib
import logging
import math
import socket
import threading
import time
from collections.abc import Callable, Container, Hashable, Iterator, Mapping

import zmq

from mocha_link.node import kernel
from mocha_link.node.connection import Connection
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.router import BURST
from mocha_link.node.zmtp import Part
from mocha_link.sync import Standing
from mocha_link.team import PublicKey, Robot, Seal, SecretKey, Team

FRESH_S = 60.0
RETRY_S = 5.0
RESOLVE_AGAIN_S = 0.02  # whether the address of a peer is known by now
WAIT_FOR_READY_S = 300.0

LOG = logging.getLogger("mocha_link")


class Resolver:
    """Turns host names into IPv4 addresses in threads of its own; numbers at once.

    A resolver thread calls `wake` when it has a result.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._found: dict[str, tuple[str | None, str, float]] = {}  # address, why not, when
        self._resolving: set[str] = set()  # names that a thread resolves

    def address(self, host: str) -> str | None:
        """The address if it is resolved; None.

        Resolution is under way, or `failure` has the reason.
        """
        try:
            socket.inet_pton(socket.AF_INET, host)
        except (OSError, ValueError):
            pass
        else:
            return host
        with self._lock:
            address, why, since_s = self._found.get(host, (None, "", -math.inf))
            stale = time.monotonic() - since_s > (RETRY_S if why else FRESH_S)
            if stale and host not in self._resolving:
                self._resolving.add(host)
                threading.Thread(target=self._resolve, args=(host,), daemon=True).start()
            return address

    def failure(self, host: str) -> str | None:
        """Why resolution failed; None while it is under way, or when there is an address."""
        with self._lock:
            address, why, _ = self._found.get(host, (None, "", 0.0))
            return None if address or host in self._resolving else why or None

    def _resolve(self, host: str) -> None:
        address, why = None, ""
        try:
            found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
            address = str(found[0][4][0])
        except (OSError, UnicodeError) as error:
            why = f"no address for '{host}': {error}"
        with self._lock:
            if address is None:  # name servers go out of reach as robots do
                address = self._found.get(host, (None, "", 0.0))[0]
            self._found[host] = (address, why, time.monotonic())
            self._resolving.discard(host)
        self._wake()


class Dialer:
    """Owns a connection to each peer that we pull from, and the socket of outgoing datagrams.

    For one thread. The caller drives the connections that `ready` gives it.

    Args:
        me: whose connections they are.
        secret: of `me`; None: no link is protected.
        keys: of protected peers.
        seals: for the datagrams of protected peers.
        wake: called from another thread when a name has an address.
        lost: called with a peer and why there is no connection to it.
    """

    def __init__(  # noqa: PLR0913 - what it stands between
        self,
        team: Team,
        me: Robot,
        poller: Poller,
        *,
        secret: SecretKey | None,
        keys: Mapping[str, PublicKey],
        seals: Mapping[str, Seal],
        wake: Callable[[], None],
        lost: Callable[[str, str], None],
    ) -> None:
        self._team = team
        self._me = me
        self._poller = poller
        self._secret = secret
        self._keys = keys
        self._seals = seals
        self._lost = lost
        self._resolver = Resolver(wake)
        self._connections: dict[
            str, Connection | list[bytes]
        ] = {}  # frames: the address is not known yet
        # Peers whose connections need a turn without a poller event; all others wait for one.
        self._needs_polling: set[str] = set()
        self._wait_until_s: dict[str, float] = {}  # peers that requests must not hurry to
        self._datagrams: socket.socket | None = None
        self._peers_at: dict[tuple[str, int], str] = {}  # by address and port

    def start(self) -> None:
        """Open the socket for datagrams, if there can be one."""
        try:
            self._datagrams = kernel.datagram_socket(self._me.listen)
        except OSError as error:
            LOG.warning("no datagrams: %s", error)
        else:
            self._poller.register(self._datagrams.fileno(), zmq.POLLIN)

    def close(self) -> None:
        """Give up everything that it holds open."""
        for peer in list(self._connections):
            self.hang_up(peer, void=True)
        if self._datagrams:
            self._datagrams.close()

    def address(self, peer: str) -> str | None:
        """The address of a peer, if it is known."""
        return self._resolver.address(self._team.robot(peer).address)

    # --- connections

    def connect(self, peer: str) -> None:
        """Replace the connection to a peer by a fresh one; it opens when something is sent."""
        self.hang_up(peer, void=True)
        self._connections[peer] = []
        self._needs_polling.add(peer)

    def send(self, peer: str, frame: bytes) -> None:
        """Send a request on the connection to a peer."""
        connection = self._connections.get(peer)
        if isinstance(connection, list):
            connection.append(frame)
            self._open(peer, connection)
        elif connection:
            connection.send(frame)
            self._watch(peer, connection)

    def standing(self, peer: str) -> Standing | None:
        """How the connection to a peer stands; None: it does not."""
        connection = self._connections.get(peer)
        if isinstance(connection, Connection) and connection.stands:
            return Standing(loses_much=connection.loses_much())
        return None

    def push(self, peer: str, parts: list[Part]) -> None:
        """Have a frame of a sync sent with the next `flush`."""
        connection = self._connections.get(peer)
        if isinstance(connection, Connection) and connection.stands:
            connection.push(parts)

    def flush(self, peer: str) -> bool:
        """Try to send what waits for the connection to a peer; whether it takes more."""
        connection = self._connections.get(peer)
        if not isinstance(connection, Connection):
            return True
        takes_more = connection.flush()
        self._watch(peer, connection)
        return takes_more

    def hang_up(self, peer: str, *, void: bool) -> None:
        """Close the connection to a peer: when what was sent is out, or at once if it is `void`."""
        connection = self._connections.pop(peer, None)
        self._needs_polling.discard(peer)
        if connection and not isinstance(connection, list):
            now_s = time.monotonic()
            if not connection.send_before_ready and now_s >= self._wait_until_s.get(peer, 0.0):
                self._wait_until_s[peer] = now_s + WAIT_FOR_READY_S
            connection.forget(self._poller)
            if void:
                connection.abort()
            else:
                connection.close()

    def ready(
        self, ready: Mapping[Polled, Hashable], now_s: float
    ) -> Iterator[tuple[str, Connection]]:
        """The connections that need a turn; opens those with a resolved address."""
        polled = self._needs_polling.union(ready.values())
        for peer in [each for each in self._connections if each in polled]:
            connection = self._connections.get(peer)  # those before may have closed or replaced it
            if isinstance(connection, list):
                self._open(peer, connection)
            elif connection and connection.is_ready(ready, now_s):
                yield peer, connection

    def keep(self, peer: str, connection: Connection) -> None:
        """Wait for more on a connection after its turn; close it if it has failed."""
        if self._connections.get(peer) is not connection:
            return
        if connection.failure:
            self.hang_up(peer, void=True)
        else:
            self._watch(peer, connection)

    def _watch(self, peer: str, connection: Connection) -> None:
        connection.watch(self._poller, peer)
        if connection.needs_polling:
            self._needs_polling.add(peer)
        else:
            self._needs_polling.discard(peer)

    def wait_s(self, now_s: float) -> float:
        """How long nothing is to be done if nothing comes."""
        waits_s = [math.inf]
        for peer in self._needs_polling:
            connection = self._connections[peer]
            if isinstance(connection, list):
                waits_s.append(RESOLVE_AGAIN_S)
            elif connection.failure is not None:
                waits_s.append(0.0)
            elif connection.wake_s is not None:
                waits_s.append(connection.wake_s - now_s)
        return min(waits_s)

    def _open(self, peer: str, frames: list[bytes]) -> None:
        """Open the connection to a peer and send what waits for it, once its address is known."""
        robot = self._team.robot(peer)
        address = self._resolver.address(robot.address)
        port = robot.port_for(self._me.name)
        why = self._resolver.failure(robot.address)
        if address:
            try:
                connection = self._new_connection(peer, address, port)
            except OSError as error:
                why = f"cannot connect to {robot.address}:{port}: {error}"
            else:
                self._connections[peer] = connection
                for frame in frames:
                    connection.send(frame)
                self._watch(peer, connection)
                return
        if why:
            self._connections.pop(peer, None)
            self._needs_polling.discard(peer)
            self._lost(peer, why)

    def _new_connection(self, peer: str, address: str, port: int) -> Connection:
        send_before_ready = time.monotonic() >= self._wait_until_s.get(peer, 0.0)
        key = self._keys.get(peer)
        keys = (self._secret, key) if self._secret and key else None
        return Connection(address, port, send_before_ready=send_before_ready, keys=keys)

    # --- datagrams

    def send_datagram(self, peer: str, packet: bytes) -> None:
        """Send a datagram to a peer's port for us."""
        address = self.address(peer)
        if address and self._datagrams:
            place = (address, self._team.robot(peer).port_for(self._me.name))
            self._peers_at[place] = peer
            seal = self._seals.get(peer)
            with contextlib.suppress(OSError):  # full, or no way there now: it is a datagram
                self._datagrams.sendto(seal.seal(packet) if seal else packet, place)

    def packets(self, ready: Container[Polled]) -> Iterator[tuple[str, bytes]]:
        """The datagrams that peers have sent in reply to ours, each with its peer."""
        if self._datagrams is None or self._datagrams.fileno() not in ready:
            return
        for packet, source in kernel.received(self._datagrams, BURST):
            peer = self._peers_at.get(source)
            if peer is None:
                continue
            seal = self._seals.get(peer)
            opened = seal.open(packet) if seal else packet
            if opened is not None:
                yield peer, opened
