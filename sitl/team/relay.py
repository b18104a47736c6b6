"""Links that can really be cut: TCP relays between gossip nodes.

Every robot dials its peers at their `address`, while their nodes listen on `listen`: between the
two stands a relay per ordered pair, which moves bytes only while the radio carries the pair. A cut
acts at once: `set_link` returns when no further byte will pass in either direction. What is under
way stalls, as TCP does without a carrier; if the cut lasts, the connections are closed. When the
link comes back, whatever waits goes on and new connections work at once.

One thread with a selector serves all pairs. Nothing is buffered without bounds: a relay reads from
one side only what the other side has taken.
"""

from __future__ import annotations

import contextlib
import errno
import selectors
import socket
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Self

from air_router.errors import AirRouterError
from mocha_link.team.team import Team
from sitl.team.relayed_flow import Flow, RadioLink, RelayedSocket, close_socket

CLOSE_AFTER_S = 2.0
"""Wall seconds that a cut may last before the connections over it are closed."""

_RATE_TICK_S = 0.01  # how often a limited link looks for new credit

Endpoint = tuple[str, int]


class RelayError(AirRouterError):
    """A relay cannot listen; the message says where and what to do."""


@dataclass(frozen=True, slots=True)
class RelayedPair:
    """`client` pulls from `server`: it dials `dialled`, where the server answers at `served`."""

    client: str
    server: str
    dialled: Endpoint
    served: Endpoint


def relayed_pairs(team: Team) -> tuple[RelayedPair, ...]:
    """Every ordered pair of a team, and where it meets."""
    return tuple(
        RelayedPair(
            client=client,
            server=server.name,
            dialled=(server.address, server.port_for(client)),
            served=(server.listen, server.port_for(client)),
        )
        for server in team.robots.values()
        for client in server.peers
    )


@dataclass(slots=True, eq=False)
class _Listener:
    socket: socket.socket
    pair: RelayedPair
    link: RadioLink


class Relay:
    """All relays of a team; links are down until `set_link` says otherwise.

    Args:
        pairs: Who dials whom where.
        rate_bytes_s: What one link carries in both directions together; None: no limit.
        now_s: The clock of `rate_bytes_s` (the simulation's, so that rates are per simulated
            second); only used with a rate.
        close_after_s: Wall seconds of a cut after which its connections are closed.

    Raises:
        RelayError: a place to listen is taken, does not exist, or is where the node itself listens.
    """

    def __init__(
        self,
        pairs: Iterable[RelayedPair],
        *,
        rate_bytes_s: float | None = None,
        now_s: Callable[[], float] = time.monotonic,
        close_after_s: float = CLOSE_AFTER_S,
    ) -> None:
        self._limited = rate_bytes_s is not None  # else no link needs credit
        self._now_s = now_s
        self._close_after_s = close_after_s
        self._selector = selectors.DefaultSelector()
        self._links: dict[frozenset[str], RadioLink] = {}  # one for both directions
        self._listeners: list[_Listener] = []  # one for each pair, to the end
        self._lock = threading.Lock()  # of links, listeners, flows
        self._closing = False  # under `_lock`, like all that the thread shares
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_in.setblocking(False)
        self._wake_out.setblocking(False)
        self._selector.register(self._wake_out, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)
        try:
            for pair in pairs:
                key = frozenset((pair.client, pair.server))
                link = self._links.setdefault(key, RadioLink(rate_bytes_s))
                self._listeners.append(_Listener(_listen(pair), pair, link))
        except BaseException:
            self._release()
            raise
        self._thread.start()

    def set_link(self, a: str, b: str, *, up: bool) -> None:
        """Cut or restore the radio between two robots, in both directions.

        Pairs that have no relay are ignored. When this returns after a cut, no byte passes.
        """
        link = self._links.get(frozenset((a, b)))
        with self._lock:
            if link is None or self._closing or link.up == up:
                return
            link.up = up
            link.down_since_s = time.monotonic()
            link.restart_credit(self._now_s())
            for listener in self._listeners:
                if listener.link is not link:
                    continue
                if up:
                    self._selector.register(listener.socket, selectors.EVENT_READ, listener)
                else:
                    self._selector.unregister(listener.socket)
            for flow in link.flows:
                self._watch(flow)
        self._wake()

    def close(self) -> None:
        """Stop the thread and close every socket."""
        with self._lock:
            if self._closing:
                return
            self._closing = True
        self._wake()
        self._thread.join()
        self._release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # full: it is awake; closed: no thread to wake
            self._wake_in.send(b"\0")

    def _run(self) -> None:
        timeout_s: float | None = 0.0
        while True:
            ready = self._selector.select(timeout_s)
            with self._lock:
                if self._closing:
                    return
                for key, mask in ready:
                    if isinstance(key.data, _Listener):
                        self._accept(key.data)
                    elif isinstance(key.data, RelayedSocket):
                        self._serve(key.data, mask)
                    else:
                        self._wake_out.recv(4096)
                timeout_s = self._tick()

    def _tick(self) -> float | None:
        """Close what was cut for too long, earn credit; returns when to look again."""
        now_s = time.monotonic()
        again_s: list[float] = []
        for link in self._links.values():
            if not link.up:
                left_s = link.down_since_s + self._close_after_s - now_s
                if left_s <= 0:
                    self._hang_up(link)
                    link.down_since_s = now_s  # dials may still queue up in the kernel
                    left_s = self._close_after_s
                again_s.append(left_s)
            elif self._limited and link.flows:
                link.earn_credit(self._now_s())
                for flow in link.flows:
                    self._watch(flow)
                again_s.append(_RATE_TICK_S)
        return min(again_s, default=None)

    def _hang_up(self, link: RadioLink) -> None:
        for flow in tuple(link.flows):
            self._drop(flow)
        for listener in self._listeners:
            if listener.link is link:
                _refuse(listener.socket)

    def _accept(self, listener: _Listener) -> None:
        if not listener.link.up:
            return  # cut since the selector saw it
        try:
            accepted, _ = listener.socket.accept()
        except OSError:
            return  # the client gave up before we came
        dialling = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        for end in (accepted, dialling):
            end.setblocking(False)
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        flow = Flow(accepted, dialling, listener.link)
        listener.link.flows.add(flow)
        if dialling.connect_ex(listener.pair.served) in (0, errno.EINPROGRESS):
            self._watch(flow)
        else:
            self._drop(flow)

    def _serve(self, side: RelayedSocket, mask: int) -> None:
        flow = side.flow
        if flow not in flow.link.flows or not flow.link.up:
            return  # gone or cut since the selector saw it
        if not flow.serve(side, mask):
            self._drop(flow)
        elif flow.ended:
            self._drop(flow, reset=False)
        else:
            self._watch(flow)

    def _watch(self, flow: Flow) -> None:
        """Tell the selector what each side is waiting for."""
        for side in flow.sides:
            wanted = flow.wanted(side)
            if wanted == side.watched:
                continue
            if not side.watched:
                self._selector.register(side.socket, wanted, side)
            elif not wanted:
                self._selector.unregister(side.socket)
            else:
                self._selector.modify(side.socket, wanted, side)
            side.watched = wanted

    def _drop(self, flow: Flow, *, reset: bool = True) -> None:
        flow.link.flows.discard(flow)
        for side in flow.sides:
            if side.watched:
                self._selector.unregister(side.socket)
                side.watched = 0
        flow.close(reset=reset)

    def _release(self) -> None:
        for link in self._links.values():
            for flow in tuple(link.flows):
                self._drop(flow)
        for listener in self._listeners:
            listener.socket.close()
        self._selector.close()
        self._wake_in.close()
        self._wake_out.close()


def _listen(pair: RelayedPair) -> socket.socket:
    where = f"{pair.dialled[0]}:{pair.dialled[1]}"
    if pair.served[0] in ("*", pair.dialled[0]):
        raise RelayError(
            f"no relay from {pair.client} to {pair.server}: the node of {pair.server} listens on "
            f"{where} itself; give it a 'listen' that differs from its 'address' in the team file "
            "(for instance listen: 127.0.0.4, address: 127.0.1.4), or use --free-ports"
        )
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setblocking(False)
        listener.bind(pair.dialled)
        listener.listen()
    except OSError as error:
        listener.close()
        raise RelayError(
            f"the relay from {pair.client} to {pair.server} cannot listen on {where}: "
            f"{error.strerror}; end the other simulation, change base_port or address in the "
            "team file, or use --free-ports"
        ) from None
    return listener


def _refuse(listener: socket.socket) -> None:
    """Reset the connections that the kernel took in while the link was cut."""
    while True:
        try:
            waiting, _ = listener.accept()
        except OSError:
            return
        close_socket(waiting, reset=True)
