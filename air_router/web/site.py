"""A web server for one page: on this machine only by default, and guarded.

Its browsers, and the messages to and from them, are here too.
"""

import asyncio
import base64
import contextlib
import hashlib
import json
import logging
import mimetypes
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import partial
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, Final, NamedTuple

from aiohttp import ClientConnectionResetError, WSMsgType, web
from aiohttp.http import HttpProcessingError

from air_router.web.guard import BACKLOG, TOKEN, ConnectionLimit, Guard, Handler, add_headers
from air_router.web.serving import ServeError, Web
from air_router.web.tile_file import Tile, TileError, TileFile

_LOG = logging.getLogger(__name__)
_SERVER_LOG = logging.getLogger(f"{__name__}.server")


def _ours(record: logging.LogRecord) -> bool:
    """Whether something is a fault of ours: it is no bytes of a client's that are no request."""
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, HttpProcessingError)


_SERVER_LOG.addFilter(_ours)

MAX_MESSAGE_BYTES: Final = 64 * 1024
MAX_PAGES: Final = 32
_HEARTBEAT_S: Final = 20.0
_SHUTDOWN_S: Final = 1.0
_KEEPALIVE_S: Final = 15.0  # after an answer; browsers have a socket for what they follow
_NUMBER: Final = "[0-9]{1,9}"
_KEPT: Final = {"Cache-Control": "private, max-age=3600"}
_NOT_KEPT: Final = {"Cache-Control": "no-store"}
# One transparent pixel: for a browser, a missing tile is an error to be logged.
_NOTHING: Final = Tile(
    "image/png",
    base64.b64decode(
        "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mNgYAAAAAMAASsJTYQAAAAASUVORK5C"
        "YII="
    ),
)
_EVERYWHERE: Final = ("0.0.0.0", "::")  # noqa: S104 - only on request
_SOMEWHERE: Final = "192.0.2.1"  # kept free for documentation
_TYPES: Final = {
    ".js": "text/javascript",
    ".css": "text/css",
    ".html": "text/html",
    ".svg": "image/svg+xml",
}

Talk = Callable[[web.Request, web.WebSocketResponse], Awaitable[None]]
"""Converses with one browser, until it has left."""


class _PageFile(NamedTuple):
    """A file of a page, in memory."""

    content: bytes
    media_type: str
    tag: str  # ETag

    async def answer(self, request: web.Request) -> web.Response:
        if self.tag in request.headers.get("If-None-Match", ""):
            return web.Response(status=304, headers={"ETag": self.tag})
        return web.Response(
            body=self.content,
            content_type=self.media_type,
            charset="utf-8" if self.media_type.startswith("text/") else None,
            headers={"ETag": self.tag},
        )


class _Tiles:
    """The tiles under the map: read in a thread, for the loop may be that of a flight.

    A tile that is missing or cannot be read is an empty picture; the first fault is logged.
    """

    def __init__(self, tiles: TileFile) -> None:
        self._tiles = tiles
        self._worker = ThreadPoolExecutor(1, "map tiles")  # SQLite files stay on one thread
        self._logged = False  # the first fault was logged

    def add_to(self, app: web.Application) -> None:
        """Serve the tiles, until the application ends."""
        path = f"/backdrop/{{tag}}/{{zoom:{_NUMBER}}}/{{column:{_NUMBER}}}/{{row:{_NUMBER}}}"
        app.add_routes([web.get(path, self._answer)])
        app.on_cleanup.append(self._end)

    async def _answer(self, request: web.Request) -> web.Response:
        wanted = request.match_info
        tile, headers = _NOTHING, _NOT_KEPT
        if wanted["tag"] == self._tiles.tag:  # else of a page from before, of another file
            place = int(wanted["zoom"]), int(wanted["column"]), int(wanted["row"])
            loop = asyncio.get_running_loop()
            try:
                found = await loop.run_in_executor(self._worker, self._tiles.tile, *place)
                tile, headers = found or _NOTHING, _KEPT
            except TileError as error:
                if not self._logged:
                    _LOG.warning("the map stays empty in places: %s", error)
                self._logged = True
        return web.Response(body=tile.data, content_type=tile.kind, headers=headers)

    async def _end(self, app: web.Application) -> None:
        del app
        self._worker.shutdown(wait=False, cancel_futures=True)


class Site:
    """A page's files, sockets to the browsers that show it, and the ground under its map.

    Of files only those in the folders `page` of `air_router.web` and of `package` can be had.

    Args:
        where: The address to serve on, and the tiles under the map.
        package: The package with the page in its folder `page`, and `index.html` in there.
        name: The page's files are served under ``/name/``, its `index.html` at ``/`` too.
    """

    def __init__(self, where: Web, package: str, name: str) -> None:
        self._where = where
        self._guard = Guard(where.host, where.token)
        self._sockets: dict[web.WebSocketResponse, str] = {}  # open, with their paths
        self._limit: ConnectionLimit | None = None  # while it serves
        self._app = web.Application(
            middlewares=[self._note_request, self._guard.middleware],
            client_max_size=MAX_MESSAGE_BYTES,
        )
        self._app.on_response_prepare.append(add_headers)
        self._app.on_shutdown.append(self._hang_up)
        self._add_page(package, name)
        if where.tiles is not None:
            _Tiles(where.tiles).add_to(self._app)

    def add_socket(self, path: str, talk: Talk) -> None:
        """Converse with `MAX_PAGES` browsers at once there; before the serving begins."""
        self._app.add_routes([web.get(path, partial(self._talk, talk))])

    def add_values(self, path: str, values: Callable[[], dict[str, Any]]) -> None:
        """Serve as JSON what `values` gives when a page requests it; before the serving begins."""

        async def answer(request: web.Request) -> web.Response:
            del request
            return web.json_response(values(), dumps=as_json)

        self._app.add_routes([web.get(path, answer)])

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[str]:
        """Serve while in the context; gives the page's address, with the token if one is needed.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """
        host, port = self._where.host, self._where.port
        runner = web.AppRunner(
            self._app,
            access_log=None,
            logger=_SERVER_LOG,
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
        if self._limit is None:
            return await handler(request)
        with self._limit.answering(request.transport):
            return await handler(request)

    def _add_page(self, package: str, name: str) -> None:
        known = dict(_files_of(files("air_router.web") / "page", "/page/"))
        known |= _files_of(files(package) / "page", f"/{name}/")
        known["/"] = known[f"/{name}/index.html"]
        self._app.add_routes([web.get(path, file.answer) for path, file in known.items()])

    def _address(self, host: str, port: int) -> str:
        name = _outward_address() if host in _EVERYWHERE else host
        name = f"[{name}]" if ":" in name else name
        token = f"?{TOKEN}={self._guard.token}" if self._guard.token else ""
        return f"http://{name}:{port}/{token}"

    async def _talk(self, talk: Talk, request: web.Request) -> web.StreamResponse:
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


def _files_of(folder: Traversable, prefix: str) -> Iterator[tuple[str, _PageFile]]:
    """The files of a folder, and of those in it, by the path under which they are served."""
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _files_of(entry, f"{prefix}{entry.name}/")
        elif not entry.name.startswith("."):
            content = entry.read_bytes()
            suffix = f".{entry.name.rpartition('.')[2]}"
            kind = _TYPES.get(suffix) or mimetypes.guess_type(entry.name)[0] or "text/plain"
            tag = f'"{hashlib.sha256(content).hexdigest()[:20]}"'
            yield f"{prefix}{entry.name}", _PageFile(content, kind, tag)


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


# All browsers that show a page, and the messages to and from them.


_MOST_WAITING: Final = 1_000


class PageOutbox:
    """Sends texts to a page, in order; one that waits gives way to a newer one of its kind.

    So a page that is slow is never behind. One for which 1,000 kinds wait is hung up on.
    """

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self._socket = socket
        self._waiting: dict[str, str] = {}  # text by kind, in order
        self._waits = asyncio.Event()  # set while something waits
        self._full = False  # the page reads nothing

    def post(self, kind: str, text: str) -> None:
        """Send a text as soon as may be; replaces what still waits of that kind."""
        if len(self._waiting) >= _MOST_WAITING:
            self._full = True
        else:
            self._waiting.pop(kind, None)
            self._waiting[kind] = text
        self._waits.set()

    async def run(self) -> None:
        """Send until the page has closed or reads no more."""
        with contextlib.suppress(ClientConnectionResetError, ConnectionResetError):
            while not self._socket.closed and not self._full:
                await self._waits.wait()
                self._waits.clear()
                while self._waiting and not self._full:
                    kind = next(iter(self._waiting))
                    await self._socket.send_str(self._waiting.pop(kind))
        await self._socket.close()


class Browsers:
    """All browsers that show a page, each with an outbox.

    `receive` takes a text from a page, `welcome` sends a new page everything; both are called
    in the server's event loop and must be quick. After each text a page is not read for `pause_s`.
    """

    def __init__(
        self,
        receive: Callable[[PageOutbox, str], None],
        welcome: Callable[[PageOutbox], None],
        *,
        pause_s: float = 0.0,
    ) -> None:
        self._receive = receive
        self._welcome = welcome
        self._pause_s = pause_s
        self._outboxes: set[PageOutbox] = set()  # one for each browser

    def broadcast(self, kind: str, text: str) -> None:
        """Send a text to every page; one of its kind that still waits is replaced."""
        for outbox in self._outboxes:
            outbox.post(kind, text)

    async def converse(self, request: web.Request, socket: web.WebSocketResponse) -> None:
        """Serve a page until it has left."""
        del request
        outbox = PageOutbox(socket)
        self._outboxes.add(outbox)
        sending = asyncio.create_task(outbox.run())
        try:
            self._welcome(outbox)
            async for message in socket:
                if message.type is not WSMsgType.TEXT:
                    break
                self._receive(outbox, message.data)
                if self._pause_s:
                    await asyncio.sleep(self._pause_s)
        finally:
            self._outboxes.discard(outbox)
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)
