"""Keeps other people's web pages, other people, and too many connections out of our pages.

A page on the internet can make a browser send requests to this machine, and by rebinding its name
in the DNS even read the answers. So requests must name this server as their host, and what a page
sends must come from a page of ours. On an address that other machines reach, a token is required.

A connection that is opened and left costs a file descriptor, and a process has a thousand of them:
the flight needs some. So each address has its share, all together theirs, and a connection on which
no whole request has come in time is closed; of too many the least used is closed. What is
refused is closed without a line in the log.
"""

import asyncio
import hmac
import secrets
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, cast
from urllib.parse import urlsplit
from weakref import WeakSet

from aiohttp import web

from mocha_link.loopback import is_loopback

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

TOKEN: Final = "token"  # noqa: S105 - the name of it

PER_ADDRESS: Final = 64
IN_ALL: Final = 128
BACKLOG: Final = 16
"""So many are accepted at once, before any of them can be refused."""
REQUEST_S: Final = 10.0
"""So long a new connection has for its first request."""

_HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
_LOCAL_NAMES: Final = ("localhost", "127.0.0.1", "::1")


class Guard:
    """Decides whose requests are let in.

    Attributes:
        token: what others must know; None where only this machine can connect.
    """

    def __init__(self, host: str, token: str | None = None) -> None:
        self._host = host
        self._local = is_loopback(host)  # only this machine can connect
        self.token = token or (None if self._local else secrets.token_urlsafe(16))

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Let a request in, or refuse it."""
        if not self._meant_for_us(request):
            raise web.HTTPForbidden(text="this server is not the one that the request names\n")
        if not _from_our_page(request):
            raise web.HTTPForbidden(text="the request comes from another site's page\n")
        if self.token is not None and not self._knows_token(request):
            raise web.HTTPUnauthorized(text="open the address that the program printed\n")
        if self.token is not None and TOKEN in request.query and request.method == "GET":
            return self._welcome(request, self.token)
        return await handler(request)

    def _meant_for_us(self, request: web.Request) -> bool:
        """Whether the Host header names an address that this server may have.

        Behind a token any name will do: a rebound name does not have the cookie.
        """
        if not self._local:
            return True
        name, _ = _own_host(request)
        return name is not None and (name in _LOCAL_NAMES or name == self._host)

    def _knows_token(self, request: web.Request) -> bool:
        token = (self.token or "").encode()
        given = (request.query.get(TOKEN, ""), request.cookies.get(_cookie(request), ""))
        return any(
            hmac.compare_digest(each.encode("utf-8", "surrogateescape"), token) for each in given
        )

    @staticmethod
    def _welcome(request: web.Request, token: str) -> web.Response:
        """Keep the token as a cookie, and out of the address bar."""
        answer = web.Response(status=303, headers={"Location": request.path})
        answer.set_cookie(_cookie(request), token, httponly=True, samesite="Strict", path="/")
        return answer


async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
    """What browsers shall not do with our answers."""
    del request
    for name, value in _HEADERS.items():
        response.headers.setdefault(name, value)


def cookie_of(port: int) -> str:
    """The name of the cookie of a page at that port: cookies do not know ports."""
    return f"air_router_{port}"


def _cookie(request: web.Request) -> str:
    return cookie_of(_own_host(request)[1] or 80)


def _own_host(request: web.Request) -> tuple[str | None, int | None]:
    return _host_of(f"//{request.headers.get('Host', '')}")


def _host_of(url: str) -> tuple[str | None, int | None]:
    """Host and port of an address; nothing of one that is none."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        return None, None
    return host, port


def _from_our_page(request: web.Request) -> bool:
    """Whether a page that sent this is ours; other programs send no such header."""
    origin = request.headers.get("Origin")
    if origin is not None:
        own = _own_host(request)
        return own != (None, None) and _host_of(origin) == own
    return request.method in ("GET", "HEAD") or "Sec-Fetch-Site" not in request.headers


class ConnectionLimit:
    """Makes the protocols of a server's connections, as long as there is room.

    Where there is none the connection goes that is least in use: one on which no request has come
    yet, the oldest first, else the one that has been idle for the longest time. So connections that
    a program of this machine holds keep no page of another user out, though all have one address.

    Args:
        make: The protocol of a connection that is let in.
    """

    def __init__(self, make: Callable[[], asyncio.BaseProtocol]) -> None:
        self._make = make
        self._open: list[asyncio.Transport] = []  # the one that was used last is the last one
        self._served: WeakSet[asyncio.BaseTransport] = WeakSet()  # those that have sent a request
        self._busy: Counter[asyncio.BaseTransport] = Counter()  # those that are being answered

    def __call__(self) -> asyncio.BaseProtocol:
        """For `create_server`."""
        return _Entrance(self)

    @contextmanager
    def answering(self, transport: asyncio.Transport | None) -> Iterator[None]:
        """A whole request has come on this connection, which is not idle meanwhile."""
        if transport is None:
            yield
            return
        self._served.add(transport)
        self._busy[transport] += 1
        try:
            yield
        finally:
            self._busy[transport] -= 1
            if not self._busy[transport]:
                del self._busy[transport]
            if transport in self._open:
                self._open.remove(transport)
                self._open.append(transport)

    def enter(self, transport: asyncio.Transport) -> None:
        """A connection was made: let it in, or close it."""
        self._open = [each for each in self._open if not each.is_closing()]
        address = _address(transport)
        same = [each for each in self._open if _address(each) == address]
        if not (self._room(same, PER_ADDRESS) and self._room(self._open, IN_ALL)):
            transport.abort()
            return
        self._open.append(transport)
        protocol = self._make()
        transport.set_protocol(protocol)
        protocol.connection_made(transport)
        asyncio.get_running_loop().call_later(REQUEST_S, self._look, transport)

    def _room(self, those: list[asyncio.Transport], most: int) -> bool:
        """Whether there is room for one more beside those, made by closing one if need be."""
        if len(those) < most:
            return True
        idle = [each for each in those if each not in self._busy]
        if not idle:
            return False
        victim = min(idle, key=lambda each: each in self._served)  # of equal ones the first
        victim.abort()
        if victim in self._open:
            self._open.remove(victim)
        return True

    def _look(self, transport: asyncio.Transport) -> None:
        if transport not in self._served and not transport.is_closing():
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
