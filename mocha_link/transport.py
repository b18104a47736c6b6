"""The ZeroMQ shell of a node: one thread, one poller, a port for every peer."""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
import threading
from typing import TYPE_CHECKING

import zmq

from mocha_link.contact import Contact
from mocha_link.errors import MochaLinkError
from mocha_link.gossip import Dial, HangUp, Send

if TYPE_CHECKING:
    from collections.abc import Callable

    from mocha_link.clock import Instant
    from mocha_link.gossip import Action, Gossip
    from mocha_link.metrics import LinkEvent
    from mocha_link.team import Robot, Team

TICK_MS = 20  # the node's clock may be a simulated one: look at it often
OBSERVE_S = 0.25
BURST = 64  # frames of one peer in a row, so that no peer starves the others
CLOSE_S = 0.9
MAX_REQUEST_BYTES = 65_536
QUEUE_REPLIES = 16  # to one connection that does not read; further ones are dropped
DEAD_PEER_S = 60

LOG = logging.getLogger("mocha_link")


class PortInUseError(MochaLinkError):
    """A port that the node needs is taken by another process or node."""


class ListenError(MochaLinkError):
    """A port or address on which the node cannot listen for another reason."""


class Transport:
    """Moves frames between the sockets and a `Gossip`, which it drives under `lock`.

    `deliver` gets the events on the transport's thread.
    """

    def __init__(
        self,
        gossip: Gossip,
        team: Team,
        *,
        lock: threading.Lock,
        now: Callable[[], Instant],
        deliver: Callable[[LinkEvent], None],
    ) -> None:
        self._gossip = gossip
        self._team = team
        self._me = gossip.me
        self._lock = lock
        self._now = now
        self._deliver = deliver
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._poller = zmq.Poller()
        self._ports: dict[zmq.Socket[bytes], str] = {}
        self._contacts: dict[str, Contact] = {}
        self._waker, self._woken = socket.socketpair()
        self._observed_s = 0.0
        self._stopping = False
        self._thread = threading.Thread(
            target=self._run, name=f"mocha-link {self._me.name}", daemon=True
        )

    def start(self) -> None:
        """Bind the ports and begin. Raises PortInUseError or ListenError, and is closed then."""
        try:
            for peer in self._me.peers:
                self._ports[self._bind(peer)] = peer
        except BaseException:
            self._close_all()
            raise
        for port in self._ports:
            self._poller.register(port, zmq.POLLIN)
        self._waker.setblocking(False)
        self._woken.setblocking(False)
        self._poller.register(self._woken, zmq.POLLIN)
        self._thread.start()

    def wake(self) -> None:
        """Have the thread look at the gossip now; from any thread."""
        with contextlib.suppress(OSError):  # full: it is about to wake anyway; closed: too late
            self._waker.send(b"\0")

    def close(self) -> None:
        """Stop and close everything; from any thread, also from a callback."""
        self._stopping = True
        self.wake()
        if self._thread.ident is None:
            self._close_all()
        elif self._thread is not threading.current_thread():
            self._thread.join(CLOSE_S)
            if self._thread.is_alive():
                LOG.error(
                    "%s: a listener has not returned for %g s; the ports close when it does",
                    self._me.name,
                    CLOSE_S,
                )

    def _bind(self, peer: str) -> zmq.Socket[bytes]:
        number = self._me.port_for(peer)
        port = self._context.socket(zmq.ROUTER)
        port.setsockopt(zmq.LINGER, 0)
        port.setsockopt(zmq.MAXMSGSIZE, MAX_REQUEST_BYTES)
        port.setsockopt(zmq.SNDHWM, QUEUE_REPLIES)
        # Links break without a word: do not keep the connections of peers that are gone.
        port.setsockopt(zmq.TCP_KEEPALIVE, 1)
        port.setsockopt(zmq.TCP_KEEPALIVE_IDLE, DEAD_PEER_S // 2)
        port.setsockopt(zmq.TCP_KEEPALIVE_INTVL, DEAD_PEER_S // 6)
        port.setsockopt(zmq.TCP_KEEPALIVE_CNT, 3)
        port.setsockopt(zmq.TCP_MAXRT, DEAD_PEER_S * 1000)
        try:
            port.bind(f"tcp://{self._me.listen}:{number}")
        except zmq.ZMQError as error:
            port.close(0)
            raise _listen_error(self._me, peer, number, error) from None
        return port

    def _run(self) -> None:
        try:
            while not self._stopping:
                ready = self._poller.poll(TICK_MS)
                try:
                    self._turn(ready)
                except Exception:  # nothing that comes from outside may end the node
                    LOG.exception("%s: an error in the node", self._me.name)
        finally:
            self._close_all()

    def _turn(self, ready: list[tuple[object, int]]) -> None:
        sockets = {each for each, _ in ready}
        if self._woken.fileno() in sockets:
            with contextlib.suppress(BlockingIOError):
                self._woken.recv(4096)
        for port, peer in self._ports.items():
            if port in sockets:
                self._serve(port, peer)
        for peer, contact in list(self._contacts.items()):
            if contact.socket in sockets or contact.monitor in sockets or contact.failure:
                self._attend(contact, peer)
        now = self._now()
        if now.steady_s - self._observed_s > OBSERVE_S:
            self._observed_s = now.steady_s
            self._observe(now)
        with self._lock:
            self._gossip.tick(now)
        self._act()

    def _serve(self, port: zmq.Socket[bytes], peer: str) -> None:
        for _ in range(BURST):
            try:
                frames = port.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            if b"" not in frames[1:-1]:
                continue  # no envelope: REP sockets ignore it, too
            body = frames.index(b"", 1) + 1
            with self._lock:
                reply = self._gossip.request(peer, frames[body:], self._now())
            # The peer may be gone, or not read its replies: then they are dropped, as with REP.
            with contextlib.suppress(zmq.ZMQError):
                port.send_multipart([*frames[:body], reply], flags=zmq.NOBLOCK)

    def _attend(self, contact: Contact, peer: str) -> None:
        contact.listen()
        for _ in range(BURST):
            parts = contact.receive()
            if parts is None:
                break
            with self._lock:
                self._gossip.reply(peer, parts, self._now())
            self._act()
            if self._contacts.get(peer) is not contact:
                return
        else:
            return  # there may be more; the other peers come first
        if contact.failure:
            with self._lock:
                self._gossip.lost(peer, contact.failure, self._now())
            self._act()

    def _observe(self, now: Instant) -> None:
        for peer, contact in self._contacts.items():
            if contact.has_progressed():
                with self._lock:
                    self._gossip.progress(peer, now)

    def _act(self) -> None:
        with self._lock:
            actions, events = self._gossip.take()
        for action in actions:
            self._do(action)
        for event in events:
            self._deliver(event)

    def _do(self, action: Action) -> None:
        peer = action.peer
        match action:
            case Dial():
                self._hang_up(peer)
                self._dial(peer)
            case Send():
                if peer in self._contacts:
                    self._contacts[peer].send(action.frame)
            case HangUp():
                self._hang_up(peer)

    def _dial(self, peer: str) -> None:
        robot = self._team.robot(peer)
        port = robot.port_for(self._me.name)
        try:
            contact = Contact(self._context, robot.address, port)
        except zmq.ZMQError as error:
            why = f"cannot connect to {robot.address}:{port}: {zmq.strerror(error.errno or 0)}"
            with self._lock:
                self._gossip.lost(peer, why, self._now())
            return
        self._contacts[peer] = contact
        self._poller.register(contact.socket, zmq.POLLIN)
        self._poller.register(contact.monitor, zmq.POLLIN)

    def _hang_up(self, peer: str) -> None:
        contact = self._contacts.pop(peer, None)
        if contact:
            self._poller.unregister(contact.socket)
            self._poller.unregister(contact.monitor)
            contact.close()

    def _close_all(self) -> None:
        for peer in list(self._contacts):
            self._hang_up(peer)
        for port in self._ports:
            port.close(0)
        self._context.term()
        self._waker.close()
        self._woken.close()


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
