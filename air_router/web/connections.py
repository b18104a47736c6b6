"""How many connections a page's server has at once, and how long one may say nothing.

A connection that is opened and left costs a file descriptor, and a process has a thousand of them:
the flight needs some. So each address has its share, all together theirs, and a connection on which
no whole request has come in time is closed. What is refused is closed without a word in the log.
"""

import asyncio
from collections.abc import Callable
from typing import Any, Final, cast
from weakref import WeakSet

PER_ADDRESS: Final = 64
IN_ALL: Final = 128
BACKLOG: Final = 16
"""So many are accepted at once, before any of them can be refused."""
REQUEST_S: Final = 10.0
"""So long a new connection has for its first request."""


class ConnectionLimit:
    """Makes the protocols of a server's connections, as long as there is room.

    Args:
        make: The protocol of a connection that is let in.
    """

    def __init__(self, make: Callable[[], asyncio.BaseProtocol]) -> None:
        self._make = make
        self._open: list[asyncio.Transport] = []  # oldest first
        self._asked: WeakSet[asyncio.BaseTransport] = WeakSet()  # those that have sent a request

    def __call__(self) -> asyncio.BaseProtocol:
        """For `create_server`."""
        return _Entrance(self)

    def asked(self, transport: asyncio.BaseTransport | None) -> None:
        """A whole request has come on this connection."""
        if transport is not None:
            self._asked.add(transport)

    def enter(self, transport: asyncio.Transport) -> None:
        """A connection was made: let it in, or close it."""
        self._open = [each for each in self._open if not each.is_closing()]
        address = _address(transport)
        if sum(_address(each) == address for each in self._open) >= PER_ADDRESS:
            transport.abort()
            return
        if len(self._open) >= IN_ALL:
            idle = next((each for each in self._open if each not in self._asked), None)
            if idle is None:
                transport.abort()
                return
            idle.abort()
            self._open.remove(idle)
        self._open.append(transport)
        protocol = self._make()
        transport.set_protocol(protocol)
        protocol.connection_made(transport)
        asyncio.get_running_loop().call_later(REQUEST_S, self._look, transport)

    def _look(self, transport: asyncio.Transport) -> None:
        if transport not in self._asked and not transport.is_closing():
            transport.abort()


class _Entrance(asyncio.Protocol):
    """What a connection talks to until it is let in."""

    def __init__(self, limit: ConnectionLimit) -> None:
        self._limit = limit

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._limit.enter(cast("asyncio.Transport", transport))


def _address(transport: asyncio.Transport) -> Any:
    peer = transport.get_extra_info("peername")
    return peer[0] if peer else None
