"""Streams drop the oldest event of a slow reader and say how many."""

import asyncio

from mocha_link.links.metrics import RssiChanged
from mocha_link.node.broadcast import Broadcast


def test_a_slow_reader_loses_the_oldest():
    broadcast = Broadcast()
    stream = broadcast.stream(limit=3)
    for number in range(5):
        broadcast.send(RssiChanged("io", number, None))
    broadcast.close()

    async def read() -> list[float]:
        return [event.at_s async for event in stream]

    assert asyncio.run(read()) == [2, 3, 4]
    assert stream.dropped == 2


def test_a_closed_loop_is_no_error():
    broadcast = Broadcast()
    stream = broadcast.stream()

    async def read_one() -> None:
        broadcast.send(RssiChanged("io", 1, None))
        await anext(stream)

    asyncio.run(read_one())
    broadcast.send(RssiChanged("io", 2, None))
    broadcast.close()
