"""A relay between real nodes that has the channel of an experiment: one robot sends at a time.

Each request of a pull waits at the relay for its turn, stays on the air for the latency that the
channel's model draws, and goes on to the other node; the reply crosses with it. Contact that is
lost interrupts what is on the air. If it does not come back in time, connections are closed.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Self

from benchmarks.contention.messages import Cutter, Piece
from sitl.experiment.engine import (
    AirtimeStats,
    Link,
    Load,
    PaperChannel,
    Stage,
    Transmission,
    needs_turn,
    stage_of,
)
from sitl.team import RelayedPair

REPLY_S = 1.0
"""So long a reply may take on this machine before the channel is given to another exchange."""

NEXT_S = 0.5
"""So long the channel waits for the next request of the exchange that had it: in an experiment it
comes at once."""

TOGETHER_S = 0.03
"""A free channel is given away so long after the first request: what comes at one moment in an
experiment, as when two robots meet and both pull, comes within this time here."""

READ_BYTES = 65_536


class _Exchange:
    """One connection of a node that pulls.

    Args:
        link: Who pulls from whom.
        server: Takes what goes to the other node.

    Attributes:
        requests: What has not crossed yet.
        ready_s: Since when the first of them waits; None: there is none.
        turn: Its place among those that wait; None: it does not.
        changed: Set when a request comes, or a reply, or the end of contact or connection.
        replies: How many replies have come.
        reply_bytes: Their bytes.
        over: It is closed.
    """

    def __init__(self, link: Link, server: asyncio.StreamWriter) -> None:
        self.link = link
        self.server = server
        self.requests: deque[Piece] = deque()
        self.ready_s: float | None = None
        self.turn: tuple[tuple[float, ...], int] | None = None
        self.changed = asyncio.Event()
        self.replies = 0
        self.reply_bytes = 0
        self.over = False

    async def until(self, condition: Callable[[], bool], limit_s: float) -> None:
        """Wait until something holds, or the time is over."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(limit_s):
                while not condition():
                    self.changed.clear()
                    await self.changed.wait()


class ChannelRelay:
    """All relays of a team. Use it inside of `async with`.

    Args:
        pairs: Who dials whom where.
        numbers: The robots' numbers, by name.
        channel: The model.
        airtime: Takes every transmission; times are since `start_clock`.
    """

    def __init__(
        self,
        pairs: Iterable[RelayedPair],
        numbers: Mapping[str, int],
        channel: PaperChannel,
        airtime: AirtimeStats,
    ) -> None:
        self._pairs = tuple(pairs)
        self._numbers = numbers
        self._channel = channel
        self._airtime = airtime
        self._began_s = 0.0  # of the event loop's clock
        self._contacts: dict[frozenset[int], float] = {}  # those that last: since when
        self._partings: dict[frozenset[int], asyncio.TimerHandle] = {}  # when patience ends
        self._exchanges: set[_Exchange] = set()
        self._waiting: set[_Exchange] = set()  # for the channel
        self._count = 0  # of turns
        self._wake = asyncio.Event()  # one waits

    async def __aenter__(self) -> Self:
        """Listen wherever nodes will dial."""
        self._servers = [
            await asyncio.start_server(partial(self._carry, pair), *pair.dialled)
            for pair in self._pairs
        ]
        self._grants = asyncio.create_task(self._grant())
        return self

    async def __aexit__(self, *error: object) -> None:
        """Close everything."""
        self._grants.cancel()
        for server in self._servers:
            server.close()
        for exchange in tuple(self._exchanges):
            exchange.server.close()
        await asyncio.gather(self._grants, return_exceptions=True)

    def start_clock(self) -> None:
        """The run begins now."""
        self._began_s = asyncio.get_running_loop().time()

    @property
    def now_s(self) -> float:
        """Since the beginning of the run."""
        return asyncio.get_running_loop().time() - self._began_s

    def in_contact(self, a: str, b: str) -> bool:
        """Whether two robots are."""
        return frozenset((self._numbers[a], self._numbers[b])) in self._contacts

    def set_contact(self, a: str, b: str, *, up: bool) -> None:
        """Two robots come into contact, or lose it."""
        pair = frozenset((self._numbers[a], self._numbers[b]))
        own = [exchange for exchange in self._exchanges if pair == set(exchange.link)]
        if up:
            self._contacts[pair] = self.now_s
            if parting := self._partings.pop(pair, None):
                parting.cancel()
            for exchange in own:
                self._arm(exchange)
            return
        del self._contacts[pair]
        for exchange in own:
            self._waiting.discard(exchange)
            exchange.turn = None
            exchange.changed.set()
        loop = asyncio.get_running_loop()
        self._partings[pair] = loop.call_later(self._channel.patience_s, self._hang_up, pair)

    def _hang_up(self, pair: frozenset[int]) -> None:
        for exchange in self._exchanges:
            if pair == set(exchange.link):
                exchange.server.close()

    async def _carry(
        self, pair: RelayedPair, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """One connection, from its dialling to its end."""
        link = Link(self._numbers[pair.client], self._numbers[pair.server])
        with contextlib.suppress(OSError):
            replies, server = await asyncio.open_connection(*pair.served)
            exchange = _Exchange(link, server)
            self._exchanges.add(exchange)
            both = (
                asyncio.create_task(self._take_requests(exchange, reader)),
                asyncio.create_task(self._take_replies(exchange, replies, writer)),
            )
            try:
                await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)  # an end hung up
            finally:
                for task in both:
                    task.cancel()
                await asyncio.gather(*both, return_exceptions=True)
                exchange.over = True
                exchange.changed.set()
                self._exchanges.discard(exchange)
                self._waiting.discard(exchange)
                server.close()
        writer.close()

    async def _take_requests(self, exchange: _Exchange, reader: asyncio.StreamReader) -> None:
        cutter = Cutter()
        while data := await reader.read(READ_BYTES):
            for piece in cutter.feed(data):
                if piece.body is not None and needs_turn(piece.body):
                    exchange.requests.append(piece)
                    self._arm(exchange)
                    exchange.changed.set()
                else:
                    exchange.server.write(piece.raw)

    async def _take_replies(
        self, exchange: _Exchange, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        cutter = Cutter()
        while data := await reader.read(READ_BYTES):
            writer.write(data)
            replies = [piece for piece in cutter.feed(data) if piece.body is not None]
            exchange.replies += len(replies)
            exchange.reply_bytes += sum(len(piece.raw) for piece in replies)
            exchange.changed.set()

    def _arm(self, exchange: _Exchange) -> None:
        """Have an exchange wait for the channel if it has something to send."""
        if not exchange.requests or frozenset(exchange.link) not in self._contacts:
            return
        if exchange.ready_s is None:
            exchange.ready_s = self.now_s
        if exchange.turn is None:
            self._count += 1
            exchange.turn = self._channel.turn(exchange.link, exchange.ready_s), self._count
            self._waiting.add(exchange)
            self._wake.set()

    async def _grant(self) -> None:
        """Let one after the other send."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            await asyncio.sleep(TOGETHER_S)
            while self._waiting:
                exchange = min(self._waiting, key=lambda each: each.turn or ((), 0))
                self._waiting.discard(exchange)
                await self._send(exchange)

    async def _send(self, exchange: _Exchange) -> None:
        """Have the first request of an exchange cross, with its reply."""
        request, ready_s, start_s = exchange.requests[0], exchange.ready_s, self.now_s
        body = request.body
        if ready_s is None or body is None:
            raise AssertionError("what waits is a request, and has a time")
        stage = stage_of(body)
        load = Load(stage, int(stage is Stage.DATA), len(request.raw), 1)
        took_s = self._channel.duration_s(exchange.link, load, start_s)
        pair = frozenset(exchange.link)
        since_s = self._contacts[pair]

        def is_cut() -> bool:
            return exchange.over or self._contacts.get(pair) != since_s

        await exchange.until(is_cut, took_s)
        complete = not is_cut()
        before, before_bytes = exchange.replies, exchange.reply_bytes
        if complete:
            exchange.requests.popleft()
            exchange.server.write(request.raw)
            await exchange.until(lambda: exchange.replies > before or exchange.over, REPLY_S)
            exchange.ready_s = None
        self._airtime.transmissions.append(
            Transmission(
                *(ready_s, start_s, self.now_s, *exchange.link, int(stage)),
                load.messages if complete else 0,
                len(request.raw) + exchange.reply_bytes - before_bytes if complete else 0,
                complete=complete,
            )
        )
        exchange.turn = None
        if complete and stage is not Stage.END:
            await exchange.until(lambda: bool(exchange.requests) or exchange.over, NEXT_S)
        if not exchange.over:
            self._arm(exchange)
