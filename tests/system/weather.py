"""What is between the robots of a field test: relays that delay, cut and damage what they carry.

Every link of the team runs through one, TCP and datagrams alike. What a relay does to an
interaction is in its `Weather`: drawn from the interaction's number, and counted in bytes, so it
does not depend on how fast the machine is. The relay keeps book of what it did (`Passage`).
"""

from __future__ import annotations

import contextlib
import errno
import heapq
import itertools
import random
import selectors
import socket
import struct
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Self

if TYPE_CHECKING:
    from collections.abc import Callable

    from mocha_link.team.team import Robot, Team

UP, DOWN = 0, 1  # from the asking side to the serving one, and back
MEDIA = ("tcp", "udp")
CHUNK_BYTES = 16 * 1024
AHEAD_BYTES = 256 * 1024  # that a connection may hold
DATAGRAM_BYTES = 2048
RESET = struct.pack("ii", 1, 0)

Media = Literal["tcp", "udp"]
Cut = Literal["silence", "reset", "close"]


@dataclass(frozen=True, slots=True)
class Weather:
    """What happens to one interaction.

    `cut_at` are bytes in one direction, TCP and datagrams each on its own, after which the link
    is cut: nothing passes any more, or connections are reset or closed as well. With
    `tcp_only` datagrams go on. `flips` are bits, by their place in each direction of each medium.
    """

    number: int = -1
    media: tuple[Media, ...] = MEDIA
    delay_s: float = 0.0
    cut: Cut | None = None
    cut_direction: int = DOWN
    cut_at: int = 0
    tcp_only: bool = False
    flips: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
    loss: float = 0.0  # shares of datagrams
    twice: float = 0.0
    late: float = 0.0

    @classmethod
    def of(cls, seed: int, number: int) -> Weather:
        """The weather of an interaction: two in three are spoilt, the others only slow."""
        rng = random.Random(f"{seed} weather {number}")
        kind = rng.choices(
            ("fair", "slow", "datagrams", "cut", "damage", "both"), (14, 10, 10, 34, 24, 8)
        )[0]
        slow = kind == "slow" or rng.random() < 0.2
        cut = kind in ("cut", "both")
        return cls(
            number=number,
            media=("udp",) if kind == "datagrams" or rng.random() < 0.1 else MEDIA,
            delay_s=rng.uniform(0.002, 0.03) if slow else 0.0,
            cut=rng.choice(("silence", "reset", "close")) if cut else None,
            cut_direction=rng.choice((UP, DOWN, DOWN)),
            cut_at=_anywhere(rng),
            tcp_only=rng.random() < 0.2,
            flips=_flips(rng) if kind in ("damage", "both") else ((), ()),
            loss=rng.choice((0.0, 0.0, 0.05, 0.3)),
            twice=rng.choice((0.0, 0.1)),
            late=rng.choice((0.0, 0.2)),
        )


def _anywhere(rng: random.Random) -> int:
    """In the handshake as likely as in the middle of a large message."""
    return int(10 ** rng.uniform(0.5, 4.8))


def _flips(rng: random.Random) -> tuple[tuple[int, ...], tuple[int, ...]]:
    places = [sorted({8 * _anywhere(rng) + rng.randrange(8) for _ in range(3)}) for _ in range(2)]
    chosen = rng.choice(((0, 1), (0, 1), (1, 0), (1, 1)))
    return tuple(places[UP] * chosen[UP]), tuple(places[DOWN] * chosen[DOWN])


@dataclass(slots=True)
class Passage:
    """What an interaction met on its way."""

    weather: Weather
    carried: dict[tuple[Media, int], int] = field(
        default_factory=lambda: dict.fromkeys(itertools.product(MEDIA, (UP, DOWN)), 0)
    )
    packets: dict[int, int] = field(default_factory=lambda: {UP: 0, DOWN: 0})
    flipped: int = 0
    cut: set[Media] = field(default_factory=set)

    @property
    def interrupted(self) -> bool:
        """Something was taken from it, or changed."""
        return bool(self.flipped or self.cut)

    def _may_cut(self, media: Media, direction: int) -> bool:
        weather = self.weather
        if weather.cut is None or direction != weather.cut_direction:
            return False
        return media == "tcp" or not weather.tcp_only

    def take(self, media: Media, direction: int, data: bytes) -> bytes:
        """What of the next bytes gets through, and how; cuts the link when its time has come."""
        weather = self.weather
        begin = self.carried[media, direction]
        left = weather.cut_at - begin
        if self._may_cut(media, direction) and len(data) > left:
            data = data[: max(left, 0)] if media == "tcp" else b""
            self.cut.update(("tcp",) if weather.tcp_only else MEDIA)
        end = self.carried[media, direction] = begin + len(data)
        hits = [bit for bit in weather.flips[direction] if begin * 8 <= bit < end * 8]
        if hits:
            damaged = bytearray(data)
            for bit in hits:
                damaged[bit // 8 - begin] ^= 1 << bit % 8
            data = bytes(damaged)
            self.flipped += len(hits)
        return data


@dataclass(slots=True, eq=False)
class _End:
    """One end of a relayed connection, and what it has yet to take."""

    socket: socket.socket
    direction: int  # of what is read here
    out: bytearray = field(default_factory=bytearray)
    scheduled: int = 0  # bytes that are on their way to it
    ended: bool = False  # nothing more will be read here
    end_due: bool = False  # nothing more will be written here
    told: bool = False
    watched: int = 0


class _Connection:
    def __init__(self, link: _Link, near: socket.socket, far: socket.socket) -> None:
        self.link = link
        self.passage = link.passage
        self.near, self.far = _End(near, UP), _End(far, DOWN)
        self.connected = self.closed = False

    def other(self, end: _End) -> _End:
        return self.far if end is self.near else self.near


class _Link:
    """One robot asks another: a place for connections, and sockets for datagrams both ways."""

    def __init__(self, client: Robot, server: Robot) -> None:
        self.passage = Passage(Weather())
        number = server.port_for(client.name)
        self.served = server.listen, number
        self.caller: tuple[str, int] | None = None
        self.connections: set[_Connection] = set()
        self.listener = socket.create_server((server.address, number), backlog=16)
        self.near = _datagrams(server.address, number)
        # A node takes datagrams of a peer only from the address that the team file says.
        self.far = _datagrams(client.address, 0)
        self.listener.setblocking(False)

    @property
    def sockets(self) -> tuple[socket.socket, ...]:
        return self.listener, self.near, self.far


def _datagrams(host: str, port: int) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind((host, port))
    made.setblocking(False)
    return made


class RoughAir:
    """The relays of a team: robots are dialled at their `address`, and `listen` elsewhere.

    A context manager; one thread carries everything.
    """

    def __init__(self, team: Team) -> None:
        self._lock = threading.Lock()
        self._selector = selectors.DefaultSelector()
        self._later: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._links = {
            (client, server.name): _Link(team.robot(client), server)
            for server in team.robots.values()
            for client in server.peers
        }
        self._woken, self._waker = socket.socketpair()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="rough air")

    def __enter__(self) -> Self:
        self._selector.register(self._woken, selectors.EVENT_READ, self._wake)
        for link in self._links.values():
            for each, action in zip(
                link.sockets, (self._accept, self._datagram_up, self._datagram_down), strict=True
            ):
                self._selector.register(each, selectors.EVENT_READ, (action, link))
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        self._waker.send(b"\0")
        self._thread.join()
        for link in self._links.values():
            self._drop_all(link)
            for each in link.sockets:
                each.close()
        self._selector.close()
        self._waker.close()
        self._woken.close()

    def begin(self, client: str, server: str, weather: Weather) -> Passage:
        """The next interaction on a link; what is left of the one before is gone."""
        link = self._links[client, server]
        with self._lock:
            self._drop_all(link)
            link.passage = Passage(weather)
            return link.passage

    # --- all below on the thread

    def _run(self) -> None:
        wait_s: float | None = None
        while not self._closing:
            ready = self._selector.select(wait_s)
            with self._lock:
                for key, mask in ready:
                    action, *arguments = key.data if isinstance(key.data, tuple) else (key.data,)
                    if arguments and isinstance(arguments[0], _Connection):
                        arguments.append(mask)
                    action(*arguments)
                now_s = time.monotonic()
                while self._later and self._later[0][0] <= now_s:
                    heapq.heappop(self._later)[2]()
                wait_s = max(self._later[0][0] - now_s, 0) if self._later else None

    def _wake(self) -> None:
        self._woken.recv(16)

    def _after(self, delay_s: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._later, (time.monotonic() + delay_s, next(self._order), action))

    # datagrams

    def _datagram_up(self, link: _Link) -> None:
        for packet, source in _received(link.near):
            link.caller = source
            self._pass(link, UP, packet)

    def _datagram_down(self, link: _Link) -> None:
        for packet, _ in _received(link.far):
            self._pass(link, DOWN, packet)

    def _pass(self, link: _Link, direction: int, packet: bytes) -> None:
        passage, weather = link.passage, link.passage.weather
        number = passage.packets[direction]
        passage.packets[direction] += 1
        if "udp" not in weather.media or "udp" in passage.cut:
            return
        packet = passage.take("udp", direction, packet)
        luck = random.Random(f"{weather.number} {direction} {number}")
        if not packet or luck.random() < weather.loss:
            return
        delays_s = [weather.delay_s]
        if luck.random() < weather.twice:
            delays_s.append(weather.delay_s + luck.uniform(0, 0.01))
        if luck.random() < weather.late:
            delays_s[0] += luck.uniform(0, 0.01)
        for delay_s in delays_s:
            if delay_s:
                self._after(delay_s, lambda: self._cast(link, passage, direction, packet))
            else:
                self._cast(link, passage, direction, packet)

    def _cast(self, link: _Link, passage: Passage, direction: int, packet: bytes) -> None:
        if link.passage is not passage:
            return
        with contextlib.suppress(OSError):
            if direction == UP:
                link.far.sendto(packet, link.served)
            elif link.caller:
                link.near.sendto(packet, link.caller)

    # connections

    def _accept(self, link: _Link) -> None:
        with contextlib.suppress(OSError):
            near, _ = link.listener.accept()
            passage = link.passage
            if "tcp" in passage.cut and passage.weather.cut != "silence":
                _close(near, reset=True)
                return
            near.setblocking(False)
            far = socket.socket()
            far.setblocking(False)
            for each in (near, far):
                each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection = _Connection(link, near, far)
            link.connections.add(connection)
            if "tcp" not in passage.weather.media or "tcp" in passage.cut:
                return  # it stands, and nothing ever comes
            if far.connect_ex(link.served) not in (0, errno.EINPROGRESS):
                self._drop(connection)
                return
            self._watch(connection)

    def _watch(self, connection: _Connection) -> None:
        for end in (connection.near, connection.far):
            other = connection.other(end)
            wanted = 0
            if not connection.closed and "tcp" not in connection.passage.cut:
                dialling = end is connection.far and not connection.connected
                if dialling or end.out:
                    wanted |= selectors.EVENT_WRITE
                held = len(other.out) + other.scheduled
                if not dialling and not end.ended and held < AHEAD_BYTES:
                    wanted |= selectors.EVENT_READ
            if wanted == end.watched:
                continue
            if not wanted:
                self._selector.unregister(end.socket)
            elif end.watched:
                self._selector.modify(end.socket, wanted, (self._turn, connection, end))
            else:
                self._selector.register(end.socket, wanted, (self._turn, connection, end))
            end.watched = wanted

    def _turn(self, connection: _Connection, end: _End, mask: int) -> None:
        if connection.closed:
            return
        try:
            if end is connection.far and not connection.connected:
                if end.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                    raise ConnectionError
                connection.connected = True
            if mask & selectors.EVENT_WRITE:
                self._write(connection, end)
            if mask & selectors.EVENT_READ:
                self._read(connection, end)
        except BlockingIOError:
            pass
        except OSError:
            self._drop(connection)
            return
        self._watch(connection)

    def _read(self, connection: _Connection, end: _End) -> None:
        data = end.socket.recv(CHUNK_BYTES)
        passage, other = connection.passage, connection.other(end)
        if data:
            data = passage.take("tcp", end.direction, data)
        else:
            end.ended = True
        if "tcp" in passage.cut and connection.link.passage is passage:
            self._cut(connection.link)
            if passage.weather.cut == "reset":
                return
        delay_s = passage.weather.delay_s
        if delay_s:
            other.scheduled += len(data)
            self._after(delay_s, lambda: self._arrive(connection, other, data, len(data)))
        else:
            self._arrive(connection, other, data, 0)

    def _arrive(self, connection: _Connection, end: _End, data: bytes, scheduled: int) -> None:
        end.scheduled -= scheduled
        if connection.closed:
            return
        end.out += data
        end.end_due = connection.other(end).ended and not end.scheduled
        try:
            self._write(connection, end)
        except BlockingIOError:
            pass
        except OSError:
            self._drop(connection)
            return
        self._watch(connection)

    def _write(self, connection: _Connection, end: _End) -> None:
        if end is connection.far and not connection.connected:
            return
        while end.out:
            del end.out[: end.socket.send(end.out)]
        if end.end_due and not end.told:
            end.told = True
            end.socket.shutdown(socket.SHUT_WR)
        if connection.near.told and connection.far.told:
            self._drop(connection, reset=False)

    def _cut(self, link: _Link) -> None:
        """The link is cut; what of the last bytes got through is still written."""
        how = link.passage.weather.cut
        for connection in tuple(link.connections):
            if how == "reset":
                self._drop(connection)
            elif how == "close":
                self._after(
                    link.passage.weather.delay_s + 0.001,
                    lambda each=connection: self._drop(each, reset=False),
                )
            self._watch(connection)

    def _drop_all(self, link: _Link) -> None:
        for connection in tuple(link.connections):
            self._drop(connection)

    def _drop(self, connection: _Connection, *, reset: bool = True) -> None:
        if connection.closed:
            return
        connection.closed = True
        connection.link.connections.discard(connection)
        self._watch(connection)
        for end in (connection.near, connection.far):
            _close(end.socket, reset=reset)


def _received(source: socket.socket) -> list[tuple[bytes, tuple[str, int]]]:
    packets: deque[tuple[bytes, tuple[str, int]]] = deque()
    for _ in range(64):
        try:
            packets.append(source.recvfrom(DATAGRAM_BYTES))
        except BlockingIOError:
            break
        except OSError:
            continue  # an ICMP error of an earlier one
    return list(packets)


def _close(connection: socket.socket, *, reset: bool) -> None:
    if reset:
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
    connection.close()
