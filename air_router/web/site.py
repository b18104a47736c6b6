"""A web server for one page: on this machine only unless told otherwise, and guarded."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

from aiohttp import web

from air_router.errors import AirRouterError
from air_router.web.assets import Assets
from air_router.web.backdrop import Backdrop
from air_router.web.connections import BACKLOG, ConnectionLimit
from air_router.web.guard import TOKEN, Guard, Handler, add_headers
from air_router.web.serving import HERE, Web
from air_router.web.tile_service import TileService

MAX_MESSAGE_BYTES = 64 * 1024
MAX_PAGES = 32
_HEARTBEAT_S = 20.0
_SHUTDOWN_S = 1.0
_KEEPALIVE_S = 15.0  # after an answer; browsers have a socket for what they follow
_EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104 - only where the user says so
_SOMEWHERE = "192.0.2.1"  # kept free for documentation

Talk = Callable[[web.Request, web.WebSocketResponse], Awaitable[None]]
"""Converses with one browser, until it has left."""


class ServeError(AirRouterError):
    """The page cannot be served where it should be."""


class Site:
    """The page's files, and sockets to the browsers that show it."""

    def __init__(self, guard: Guard, assets: Assets, start: str) -> None:
        self._guard = guard
        self._assets = assets
        self._start = start
        self._sockets: dict[web.WebSocketResponse, str] = {}  # open, with their paths
        self._limit: ConnectionLimit | None = None  # while it serves
        self.app = web.Application(
            middlewares=[self._note_request, guard.middleware], client_max_size=MAX_MESSAGE_BYTES
        )
        self.app.on_response_prepare.append(add_headers)
        self.app.on_shutdown.append(self._hang_up)
        self.app.add_routes([web.get("/", self._index), *assets.routes()])

    @classmethod
    def of_page(cls, package: str, name: str, where: Web) -> Site:
        """The site of the page in a package's folder `page`, with its picture under the map."""
        assets = Assets()
        assets.add("air_router.web", "page", "/page/")
        assets.add(package, "page", f"/{name}/")
        site = cls(Guard(where.host, where.token), assets, f"/{name}/index.html")
        if where.backdrop is not None:
            site.lay_under(where.backdrop)
        return site

    def add_socket(self, path: str, talk: Talk) -> None:
        """Converse with browsers there; before the serving begins."""

        async def answer(request: web.Request) -> web.StreamResponse:
            return await self._talk(request, talk)

        self.app.add_routes([web.get(path, answer)])

    def add_values(self, path: str, values: Callable[[], dict[str, Any]]) -> None:
        """Serve what a page reads once, as JSON; before the serving begins."""

        async def answer(request: web.Request) -> web.Response:
            del request
            return web.json_response(values(), dumps=as_json)

        self.app.add_routes([web.get(path, answer)])

    def lay_under(self, backdrop: Backdrop) -> None:
        """Serve the picture that lies under the map; before the serving begins."""
        if backdrop.tiles is not None:
            TileService(backdrop.tiles).add_to(self.app)
            return

        async def picture(request: web.Request) -> web.StreamResponse:
            del request
            return web.FileResponse(backdrop.path, headers={"Content-Type": backdrop.kind})

        self.app.add_routes([web.get("/backdrop", picture)])

    @asynccontextmanager
    async def serving(self, where: Web = HERE) -> AsyncIterator[str]:
        """Serve while in the context; gives the page's address.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """
        host, port = where.host, where.port
        runner = web.AppRunner(
            self.app,
            access_log=None,
            shutdown_timeout=_SHUTDOWN_S,
            keepalive_timeout=_KEEPALIVE_S,
            handle_signals=False,
        )
        await runner.setup()
        server: asyncio.Server | None = None
        try:
            try:
                assert runner.server is not None  # noqa: S101 - it was set up
                self._limit = ConnectionLimit(runner.server)
                loop = asyncio.get_running_loop()
                server = await loop.create_server(self._limit, host, port, backlog=BACKLOG)
            except (OSError, OverflowError) as error:
                reason = getattr(error, "strerror", None) or str(error)
                raise ServeError(
                    f"cannot serve the page on {host}:{port}: {reason}; choose another "
                    "port, or 0 for a free one"
                ) from None
            yield self._address(host, server.sockets[0].getsockname()[1])
        finally:
            if server is not None:
                server.close()
            await runner.cleanup()

    @web.middleware
    async def _note_request(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """A connection on which a request came is no longer one that was opened and left."""
        if self._limit is not None:
            self._limit.asked(request.transport)
        return await handler(request)

    def _address(self, host: str, port: int) -> str:
        name = _outward_address() if host in _EVERYWHERE else host
        name = f"[{name}]" if ":" in name else name
        token = f"?{TOKEN}={self._guard.token}" if self._guard.token else ""
        return f"http://{name}:{port}/{token}"

    async def _index(self, request: web.Request) -> web.Response:
        return await self._assets.page(self._start, request)

    async def _talk(self, request: web.Request, talk: Talk) -> web.StreamResponse:
        if list(self._sockets.values()).count(request.path) >= MAX_PAGES:
            raise web.HTTPServiceUnavailable(text="too many pages are open; close one\n")
        socket = web.WebSocketResponse(
            heartbeat=_HEARTBEAT_S, max_msg_size=MAX_MESSAGE_BYTES, compress=False
        )
        if not socket.can_prepare(request):
            raise web.HTTPBadRequest(text="this address is for the page's socket\n")
        self._sockets[socket] = request.path
        try:
            await socket.prepare(request)
            await talk(request, socket)
        finally:
            del self._sockets[socket]
        return socket

    async def _hang_up(self, app: web.Application) -> None:
        del app
        for open_socket in list(self._sockets):
            await open_socket.close()


def _outward_address() -> str:
    """The address of this machine that others reach; nothing is sent to find it out."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((_SOMEWHERE, 9))
        except OSError:  # no network
            return "127.0.0.1"
        return str(probe.getsockname()[0])


def as_json(message: dict[str, Any]) -> str:
    """A message as the pages read it."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False)
