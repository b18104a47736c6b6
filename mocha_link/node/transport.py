"""The I/O of a node: one thread and one poller for the TCP and UDP sockets of all peers."""

from __future__ import annotations

import threading
from collections.abc import Callable, Container, Hashable, Mapping

import zmq

from mocha_link.addresses import Mdns, OwnAddresses
from mocha_link.clock import Instant
from mocha_link.errors import Guard
from mocha_link.hosts import host_of
from mocha_link.links import LinkEvent
from mocha_link.logs import NodeLog
from mocha_link.node.connection import Connection
from mocha_link.node.dialer import Dialer
from mocha_link.node.gossip import Gossip
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.link_keys import LinkKeys
from mocha_link.node.port import Port
from mocha_link.node.ports import Ports
from mocha_link.node.router import BURST, IDLE_MS
from mocha_link.node.shared_lock import SharedLock
from mocha_link.node.waker import Waker
from mocha_link.sync import (
    DIALLED,
    Action,
    Connect,
    Disconnect,
    Frame,
    Reply,
    ReplyDatagram,
    Route,
    Send,
    SendDatagram,
    Standing,
)
from mocha_link.team import PublicKey, SecretKey, Team

TICK_MS = 20  # the longest wait with a simulated clock, which may run fast
EXPIRE_S = 1.0  # between checks for overdue connections
CLOSE_S = 0.9


class Transport:
    """Moves frames between the sockets and a `Gossip`, which it drives under `lock`.

    `deliver` is called with each event on the transport's thread. With `secret`, links to peers
    that have a key in the team file are encrypted. `simulated`: the clock of `now` may run at
    another rate. Without `serves` it pulls from peers but serves none, beside a running node.

    Raises:
        SealError: a peer's key is invalid.
    """

    def __init__(  # noqa: PLR0913 - the node, its clock and its keys
        self,
        gossip: Gossip,
        team: Team,
        *,
        lock: threading.Lock,
        now: Callable[[], Instant],
        deliver: Callable[[LinkEvent], None],
        secret: SecretKey | None = None,
        keys: dict[str, PublicKey] | None = None,
        simulated: bool = False,
        serves: bool = True,
    ) -> None:
        me = gossip.me
        link_keys = LinkKeys(secret, keys)
        self._mdns = Mdns.needed(team, me, announces=serves, wake=self._found)
        self._gossip = gossip
        self._lock = SharedLock(lock)  # protects the gossip, which other threads also call
        self._now = now
        self._deliver = deliver
        self._simulated = simulated  # the clock may run fast
        self._poller = Poller()
        self._ports = Ports(self._poller, me, link_keys, serves=serves)
        self._own_addresses = OwnAddresses()
        self._dialer = Dialer(
            team,
            me,
            self._poller,
            keys=link_keys,
            wake=self.wake,
            lost=self._lose,
            mdns=self._mdns,
        )
        self._waker = Waker()
        self._expired_s = 0.0  # when connections were last checked, steady clock
        # Bad input from one peer must not stop the node for the others.
        self._guard = Guard(f"{me.name}: an error in the node", log=NodeLog(me.name))
        self._stopping = False  # set by `close`
        self._starting = threading.Lock()  # held by `start`, for which `close` waits
        self._thread = threading.Thread(target=self._run, name=f"mocha-link {me.name}", daemon=True)

    def start(self) -> None:
        """Bind the ports and start the thread.

        Raises PortInUseError, ListenError, or RuntimeError (the system has no thread left), and
        closes everything in that case. After `close` it does nothing.
        """
        with self._starting:
            if self._stopping:
                return
            try:
                self._ports.provide_descriptors()
                self._ports.open()
                self._dialer.start()
                if self._mdns:
                    self._mdns.start()
                self._ports.watch()
                self._waker.watch(self._poller)
                if self._own_addresses.number is not None:
                    self._poller.register(self._own_addresses.number, zmq.POLLIN)
                self._thread.start()
            except BaseException:
                self._close_all()
                raise

    def wake(self) -> None:
        """Wake the thread for a turn; from any thread."""
        self._waker.wake()

    def _found(self) -> None:
        """Called on the mDNS thread: an address was found or lost."""
        self._dialer.update()

    def is_current_thread(self) -> bool:
        """Whether this is the thread that must not wait."""
        return self._thread is threading.current_thread()

    def close(self) -> None:
        """Stop and close everything; from any thread, also from a callback."""
        self._stopping = True
        self.wake()
        if self._thread is threading.current_thread():
            return
        with self._starting:
            started = self._thread.ident is not None
            if not started:
                self._close_all()
        if started:
            self._thread.join(CLOSE_S)
            if self._thread.is_alive():
                name = self._gossip.me.name
                NodeLog(name).error(
                    "%s: a listener has not returned for %g s; the ports close when it does",
                    name,
                    CLOSE_S,
                )

    def _run(self) -> None:
        wait_ms = 0
        try:
            while not self._stopping:
                ready = self._poller.poll(wait_ms)
                wait_ms, errors = TICK_MS, self._guard.errors
                with self._guard:
                    wait_ms = self._turn(ready)
                if self._guard.errors > errors:  # the error may recur at once: do not spin
                    wait_ms = max(wait_ms, TICK_MS)
        finally:
            self._close_all()

    def _turn(self, ready: Mapping[Polled, Hashable]) -> int:
        """Run one turn; returns the milliseconds to wait for the next."""
        self._lock.yielded()
        self._waker.clear(ready)
        if self._own_addresses.number in ready and self._own_addresses.changed():
            self._leave_old_addresses()
        active = self._ports.active(ready)
        for peer in active:
            with self._guard:
                self._serve(self._ports[peer], ready)
        for peer, packet in self._dialer.packets(ready):
            with self._guard, self._lock:
                self._gossip.packet_back(peer, packet, self._now())
            self._act()
        now = self._now()
        if now.steady_s - self._expired_s > EXPIRE_S:
            self._expired_s = now.steady_s
            self._expire_clients(now)
        for peer, connection in self._dialer.ready(ready, now.steady_s):
            active.add(peer)
            with self._guard:
                self._attend(connection, peer, now)
        with self._lock:
            active |= self._gossip.tick(now, self._guard)
        self._act()
        waits_ms = {port.peer: self._supply(port) for port in self._ports.of(active)}
        self._act()
        return min(self._ports.finished(waits_ms), self._wait_ms())

    def _wait_ms(self) -> int:
        """The time until the next turn if no socket becomes ready."""
        now = self._now()
        with self._lock:
            wake_s, due_in_s = self._gossip.wake_s, self._gossip.due_in_s(now)
        waits_s = [
            (TICK_MS if self._simulated else IDLE_MS) / 1000,
            due_in_s,
            self._dialer.wait_s(now.steady_s),
        ]
        if wake_s is not None:
            waits_s.append(wake_s - now.steady_s)
        return int(max(min(waits_s), 0.0) * 1000 + 0.999)

    def _serve(self, port: Port, ready: Container[Polled]) -> None:
        for route, parts in port.requests(ready):
            with self._guard, self._lock:
                self._gossip.request(port.peer, route, parts, self._now())
            self._came_from(port.peer, port.source(route))
            self._act()
            self._lock.give_way()
        for packet, source in port.packets(BURST):
            host = host_of(source)
            # Without a key only the address identifies a peer.
            if not port.protected and not self._dialer.book.is_at(port.peer, host):
                continue
            with self._guard, self._lock:
                accepted = self._gossip.packet_in(port.peer, packet, self._now())
            if accepted:
                port.datagram_address = source
                self._came_from(port.peer, host)
            self._act()

    def _came_from(self, peer: str, host: str | None) -> None:
        if host:
            with self._guard:
                self._dialer.came_from(peer, host)

    def _leave_old_addresses(self) -> None:
        """Close connections that use an address which this machine has lost."""
        now = self._now()
        for peer in self._dialer.own_addresses_changed(now.steady_s):
            with self._lock:
                self._gossip.sync(peer, now)
        self._ports.own_addresses_changed()
        if self._mdns:
            self._mdns.addresses_changed()

    def _expire_clients(self, now: Instant) -> None:
        self._dialer.expire(now.steady_s)
        for port in self._ports:
            for why in port.expire(now.steady_s):
                with self._lock:
                    self._gossip.refused(port.peer, why)

    def _supply(self, port: Port) -> int:
        """Send frames of a sync while the connection accepts them; the wait for the next, in ms."""

        def standing(route: Route) -> Standing | None:
            return self._dialer.standing(port.peer) if route == DIALLED else port.standing(route)

        with self._guard:
            for _ in range(BURST):
                with self._lock:
                    route = self._gossip.route(port.peer, standing)
                if not self._flush(port, route):
                    return port.wait_ms
                frames = self._next_frames(port)
                for frame in filter(None, frames):
                    if frame[0] == DIALLED:
                        self._dialer.push(port.peer, frame[1])
                    else:
                        port.push(*frame)
                if frames[-1] is None:
                    self._flush(port, route)
                    return port.wait_ms
        return 0

    def _flush(self, port: Port, route: Route | None) -> bool:
        return self._dialer.flush(port.peer) if route == DIALLED else port.flush(route)

    def _next_frames(self, port: Port) -> list[tuple[Route, list[Frame]] | None]:
        """Frames to send in one system call, since each packet wakes the peer; None ends them."""
        frames: list[tuple[Route, list[Frame]] | None] = []
        size = 0
        with self._lock:
            while not frames or size < port.TOGETHER_BYTES:
                supplied = self._gossip.supply(port.peer)
                frames.append(supplied)
                if supplied is None:
                    break
                size += sum(map(len, supplied[1]))
        return frames

    def _attend(self, connection: Connection, peer: str, now: Instant) -> None:
        arrived = connection.turn(now.steady_s)
        rtt_s = connection.rtt_s() if arrived else None
        with self._lock:  # another thread may have begun a new pull, even between two replies
            if arrived and not self._gossip.leaves(peer):
                self._gossip.progress(peer, now, rtt_s)
        for parts in connection.replies():
            with self._guard, self._lock:
                if not self._gossip.leaves(peer):
                    self._gossip.reply(peer, parts, self._now())
            self._lock.give_way()
        with self._lock:
            if connection.failure and not self._gossip.leaves(peer):
                self._gossip.lost(peer, connection.failure, now)
                if connection.left:  # the contact continues on a new connection
                    self._gossip.sync(peer, now)
        self._act()
        self._dialer.keep(peer, connection)

    def _lose(self, peer: str, why: str) -> None:
        with self._lock:
            self._gossip.lost(peer, why, self._now())

    def _act(self) -> None:
        with self._lock:
            actions, events = self._gossip.take()
        for action in actions:
            with self._guard:
                self._do(action)
        for event in events:
            self._deliver(event)

    def _do(self, action: Action) -> None:
        peer = action.peer
        match action:
            case Connect():
                self._dialer.connect(peer)
            case Send():
                self._dialer.send(peer, action.frame)
            case Disconnect():
                self._dialer.hang_up(peer, void=action.void)
            case Reply() if action.route == DIALLED:
                self._dialer.send(peer, action.frame)
            case Reply():
                self._ports[peer].reply(action.route, action.frame)
            case SendDatagram():
                self._dialer.send_datagram(peer, action.packet)
            case ReplyDatagram():
                self._ports[peer].send_datagram(action.packet)

    def _close_all(self) -> None:
        if self._mdns:
            self._mdns.close()
        self._dialer.close()
        self._own_addresses.close()
        self._ports.close()
        self._poller.close()
        self._waker.close()
