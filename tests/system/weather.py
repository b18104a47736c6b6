"""What is between the robots of a field test: relays that delay, cut and damage what they carry.

Every link of the team runs through one, TCP and datagrams alike. What a relay does to an
interaction is in its `Weather`: drawn from the interaction's number, and counted in bytes, so it
does not depend on how fast the machine is. The relay keeps book of what it did (`Passage`).
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import itertools
import random
import socket
import struct
import threading
from collections.abc import Coroutine
from dataclasses import dataclass, field
from typing import Any, Literal, Self

from mocha_link.team.team import Robot, Team

UP, DOWN = 0, 1  # from the pulling side to the serving one, and back
MEDIA = ("tcp", "udp")
CHUNK_BYTES = 16 * 1024
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


class _Datagrams(asyncio.DatagramProtocol):
    """Hands on what comes in, each with the way it goes and where it came from."""

    def __init__(self, link: _Link, direction: int) -> None:
        self.datagram_received = functools.partial(link.take, direction)


@dataclass(slots=True, eq=False)
class _Connection:
    """A relayed connection: who carries it, and its ends, of which the far one may be missing."""

    task: asyncio.Task[None]
    ends: list[asyncio.StreamWriter]

    def drop(self, *, reset: bool = True) -> None:
        self.close(reset=reset)
        self.task.cancel()

    def close(self, *, reset: bool = True) -> None:
        for end in self.ends:
            if reset:
                with contextlib.suppress(OSError):
                    linger = socket.SOL_SOCKET, socket.SO_LINGER, RESET
                    end.get_extra_info("socket").setsockopt(*linger)
            end.transport.abort()


class _Link:
    """One robot pulls from another: a place for connections, and sockets for datagrams both ways.

    All of it is for the loop's thread.
    """

    def __init__(self, client: Robot, server: Robot) -> None:
        self.passage = Passage(Weather())
        number = server.port_for(client.name)
        self._served, self._dialled = (server.listen, number), (server.address, number)
        # A node takes datagrams of a peer only from the address in the team file.
        self._from = client.address, 0
        self._caller: Any = None  # where the last datagram of the pulling side came from
        self._connections: set[_Connection] = set()

    async def open(self) -> None:
        datagrams = asyncio.get_running_loop().create_datagram_endpoint
        self._server = await asyncio.start_server(self._accept, *self._dialled, backlog=16)
        self._near, _ = await datagrams(lambda: _Datagrams(self, UP), self._dialled)
        self._far, _ = await datagrams(lambda: _Datagrams(self, DOWN), self._from)

    async def begin(self, weather: Weather) -> Passage:
        """What is left of the interaction before is gone."""
        for connection in tuple(self._connections):
            connection.drop()
        self.passage = Passage(weather)
        return self.passage

    async def close(self) -> None:
        self._server.close()
        self._near.close()
        self._far.close()
        while self._connections:
            await self.begin(Weather())
            await asyncio.sleep(0)
        await asyncio.sleep(0)  # until the sockets are closed

    def take(self, direction: int, packet: bytes, source: Any) -> None:
        """Pass a datagram on, as the weather has it."""
        if direction == UP:
            self._caller = source
        passage, weather = self.passage, self.passage.weather
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
            _after(delay_s, self._cast, passage, direction, packet)

    def _cast(self, passage: Passage, direction: int, packet: bytes) -> None:
        if self.passage is not passage or self._near.is_closing():
            return
        if direction == UP:
            self._far.sendto(packet, self._served)
        elif self._caller:
            self._near.sendto(packet, self._caller)

    async def _accept(self, reader: asyncio.StreamReader, near: asyncio.StreamWriter) -> None:
        passage, task = self.passage, asyncio.current_task()
        assert task is not None
        connection = _Connection(task, [near])
        self._connections.add(connection)
        try:
            if "tcp" in passage.cut and passage.weather.cut != "silence":
                connection.drop()
            if "tcp" not in passage.weather.media or "tcp" in passage.cut:
                await asyncio.Event().wait()  # it stands, and nothing ever comes
            far_reader, far = await asyncio.open_connection(*self._served)
            connection.ends.append(far)
            async with asyncio.TaskGroup() as both:
                both.create_task(self._carry(passage, UP, reader, far))
                both.create_task(self._carry(passage, DOWN, far_reader, near))
            for end in connection.ends:
                end.close()
                await end.wait_closed()
        except* OSError:
            connection.close()
        except* asyncio.CancelledError:
            pass  # it was dropped
        finally:
            self._connections.discard(connection)

    async def _carry(
        self,
        passage: Passage,
        direction: int,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        """One way of a connection, until its end or the link's; the last bytes are written."""
        delay_s = passage.weather.delay_s
        while "tcp" not in passage.cut and (data := await reader.read(CHUNK_BYTES)):
            if "tcp" in passage.cut:
                break
            data = passage.take("tcp", direction, data)
            if "tcp" not in passage.cut or passage.weather.cut != "reset":
                _after(delay_s, _write, writer, data)
            await writer.drain()
        if "tcp" in passage.cut:
            self._cut(passage)
            await asyncio.Event().wait()  # until it is dropped
        _after(delay_s, _end, writer)
        await asyncio.sleep(delay_s)

    def _cut(self, passage: Passage) -> None:
        if self.passage is not passage:
            return
        for connection in tuple(self._connections):
            if passage.weather.cut == "reset":
                connection.drop()
            elif passage.weather.cut == "close":
                _after(passage.weather.delay_s + 0.001, connection.drop, reset=False)


def _after(delay_s: float, action: Any, *arguments: Any, **named: Any) -> None:
    """Do it later; at once if there is no delay."""
    act = functools.partial(action, *arguments, **named)
    if delay_s:
        asyncio.get_running_loop().call_later(delay_s, act)
    else:
        act()


def _write(writer: asyncio.StreamWriter, data: bytes) -> None:
    if not writer.is_closing():
        writer.write(data)


def _end(writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):  # the other side may be gone
        writer.write_eof()


class RoughAir:
    """The relays of a team: robots are dialled at their `address`, and `listen` elsewhere.

    A context manager; one thread carries everything.
    """

    def __init__(self, team: Team) -> None:
        self._loop = asyncio.new_event_loop()
        self._links = {
            (client, server.name): _Link(team.robot(client), server)
            for server in team.robots.values()
            for client in server.peers
        }
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="rough air", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        for link in self._links.values():
            self._do(link.open())
        return self

    def __exit__(self, *_: object) -> None:
        for link in self._links.values():
            self._do(link.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def begin(self, client: str, server: str, weather: Weather) -> Passage:
        """The next interaction on a link; what is left of the one before is gone."""
        return self._do(self._links[client, server].begin(weather))

    def _do(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()
