"""Links that can really be cut: TCP relays between gossip nodes.

Every robot dials its peers at their `address`, while their nodes listen on `listen`: between the
two stands a relay per ordered pair, which moves bytes only while the radio carries the pair. A cut
acts at once: `set_link` returns when no further byte will pass in either direction. What is under
way stalls, as TCP does without a carrier; if the cut lasts, the connections are closed. When the
link comes back, whatever waits goes on and new connections work at once.

One thread with an event loop serves all pairs. Nothing is buffered without bounds: a relay reads
from one side only what the other side has taken.
"""

import asyncio
import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from air_router.errors import AirRouterError
from mocha_link.lifetime import Closeable
from mocha_link.team import Team

CLOSE_AFTER_S = 2.0
"""Wall seconds that a cut may last before the connections over it are closed."""

CHUNK_BYTES = 64 * 1024

_RATE_TICK_S = 0.01  # how often a limited link checks for new credit
_RATE_BURST_S = 0.05  # a limited link may send this much of its rate at once
_ACCEPT_AGAIN_S = 0.1  # after a connection could not be accepted
_RESET = struct.pack("ii", 1, 0)  # SO_LINGER that closes with a reset: the peer learns of it

Endpoint = tuple[str, int]


class RelayError(AirRouterError):
    """A relay cannot listen; the message has the address and a remedy."""


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
            dialled=(server.address or server.listen, server.port_for(client)),
            served=(server.listen, server.port_for(client)),
        )
        for server in team.robots.values()
        for client in server.peers
    )


class _RadioLink:
    """The radio between two robots: both directions, all their connections.

    Args:
        rate_bytes_s: What it carries in both directions together; None: no limit.
        now_s: The clock of that rate.

    Attributes:
        up: Set while it carries anything.
        connections: Those over it.
        hang_up: Closes them if the cut lasts; None: it is up, or never was.
    """

    def __init__(self, rate_bytes_s: float | None, now_s: Callable[[], float]) -> None:
        self._rate_bytes_s = rate_bytes_s
        self._now_s = now_s
        self._credit_bytes = 0.0  # what a limited link may carry before it earns more
        self._earned_until_s = 0.0  # of `now_s`
        self.up = asyncio.Event()
        self.connections: set[asyncio.Task[None]] = set()
        self.hang_up: asyncio.TimerHandle | None = None

    def restart_credit(self) -> None:
        """Earn from now on only."""
        self._earned_until_s = self._now_s()

    async def pump(self, source: socket.socket, sink: socket.socket) -> None:
        """Carry bytes from one side to the other until the source has sent all."""
        loop = asyncio.get_running_loop()
        while data := await loop.sock_recv(source, await self._allowance()):
            self._credit_bytes -= len(data)
            while data:
                await self.up.wait()  # nothing else may come between this and the sending
                try:
                    data = data[sink.send(data) :]
                except BlockingIOError:
                    await _writable(sink)
        await self.up.wait()
        sink.shutdown(socket.SHUT_WR)

    async def _allowance(self) -> int:
        """How many bytes may be read, once there are some."""
        await self.up.wait()
        if self._rate_bytes_s is None:
            return CHUNK_BYTES
        while (credit := self._credit(self._rate_bytes_s)) < 1:
            await asyncio.sleep(_RATE_TICK_S)
            await self.up.wait()
        return min(CHUNK_BYTES, credit)

    def _credit(self, rate_bytes_s: float) -> int:
        """Credit for the time that has passed; a little may be saved up."""
        now_s = self._now_s()
        earned = max(0.0, now_s - self._earned_until_s) * rate_bytes_s
        self._earned_until_s = now_s
        most = max(1.0, rate_bytes_s * _RATE_BURST_S)
        self._credit_bytes = min(self._credit_bytes + earned, most)
        return int(self._credit_bytes)


class Relay(Closeable):
    """All relays of a team; links are down until `set_link` raises them.

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
        self._close_after_s = close_after_s
        self._links: dict[frozenset[str], _RadioLink] = {}  # one for both directions
        self._lock = threading.Lock()  # of `_closed`
        self._closed = False  # the loop takes nothing more
        with contextlib.ExitStack() as stack:
            listeners = [(stack.enter_context(_listen(pair)), pair) for pair in pairs]
            self._sockets = stack.pop_all()  # that listen
        self._loop = asyncio.new_event_loop()
        for listener, pair in listeners:
            key = frozenset((pair.client, pair.server))
            link = self._links.setdefault(key, _RadioLink(rate_bytes_s, now_s))
            self._loop.create_task(self._accept(listener, pair, link))
        self._thread = threading.Thread(target=self._loop.run_forever, name="relay", daemon=True)
        self._thread.start()

    def set_link(self, a: str, b: str, *, up: bool) -> None:
        """Cut or restore the radio between two robots, in both directions.

        Pairs that have no relay are ignored. When this returns after a cut, no byte passes.
        """
        link = self._links.get(frozenset((a, b)))
        with self._lock:
            if link is not None and not self._closed and link.up.is_set() != up:
                self._do(self._restore if up else self._cut, link)

    def close(self) -> None:
        """Stop the thread and close every socket."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._sockets.close()

    def _do(self, what: Callable[[_RadioLink], None], link: _RadioLink) -> None:
        """Have the thread do something, and wait until it has."""
        done = threading.Event()
        self._loop.call_soon_threadsafe(what, link)
        self._loop.call_soon_threadsafe(done.set)
        done.wait()

    def _restore(self, link: _RadioLink) -> None:
        if link.hang_up is not None:
            link.hang_up.cancel()
        link.restart_credit()
        link.up.set()

    def _cut(self, link: _RadioLink) -> None:
        def hang_up() -> None:
            for connection in link.connections:
                connection.cancel()

        link.up.clear()
        link.hang_up = self._loop.call_later(self._close_after_s, hang_up)

    async def _end(self) -> None:
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _accept(self, listener: socket.socket, pair: RelayedPair, link: _RadioLink) -> None:
        while True:
            try:
                accepted, _ = await self._loop.sock_accept(listener)
            except OSError:  # no descriptor is left: raised at once, without a turn of the loop
                await asyncio.sleep(_ACCEPT_AGAIN_S)
                continue
            connection = self._loop.create_task(self._carry(accepted, pair, link))
            link.connections.add(connection)
            connection.add_done_callback(link.connections.discard)

    async def _carry(self, accepted: socket.socket, pair: RelayedPair, link: _RadioLink) -> None:
        """One connection from its dialling to its end; broken, both ends learn of it at once."""
        dialling = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        with accepted, dialling:
            for end in (accepted, dialling):
                end.setblocking(False)
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            with contextlib.suppress(OSError, ExceptionGroup, TimeoutError):
                async with asyncio.timeout(self._close_after_s):
                    await link.up.wait()
                await self._loop.sock_connect(dialling, pair.served)
                async with asyncio.TaskGroup() as pumps:
                    pumps.create_task(link.pump(accepted, dialling))
                    pumps.create_task(link.pump(dialling, accepted))
                for end in (accepted, dialling):  # all was sent: no reset
                    end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))


async def _writable(sink: socket.socket) -> None:
    """Wait until a socket takes bytes again."""
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    loop.add_writer(sink, ready.set)
    try:
        await ready.wait()
    finally:
        loop.remove_writer(sink)


def _listen(pair: RelayedPair) -> socket.socket:
    where = f"{pair.dialled[0]}:{pair.dialled[1]}"
    if pair.served[0] in ("*", pair.dialled[0]):
        raise RelayError(
            f"no relay from {pair.client} to {pair.server}: the node of {pair.server} listens on "
            f"{where} itself; give it a 'listen' that differs from its 'address' in the team file "
            "(for instance listen: 127.0.0.4, address: 127.0.1.4), or use --free-ports"
        )
    try:
        listener = socket.create_server(pair.dialled)
    except OSError as error:
        raise RelayError(
            f"the relay from {pair.client} to {pair.server} cannot listen on {where}: "
            f"{error.strerror}; end the other simulation, change base_port or address in the "
            "team file, or use --free-ports"
        ) from None
    listener.setblocking(False)
    return listener
