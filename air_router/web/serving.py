"""Where a page is served, for how long, and with which tiles under its map; no server itself.

Also the address of a flight's page, as a flight prints it.
"""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager, contextmanager, suppress
from dataclasses import dataclass
from threading import Thread
from typing import Any, Final, Protocol
from urllib.parse import parse_qs, urlsplit

from air_router.errors import AirRouterError, UsageError
from air_router.web.tile_file import TileFile
from mocha_link.cli import PATH, Decorator, Options, Parsed, option, optional, together

_END_S: Final = 5.0
"""A page that has not ended by then ends with the program."""

SHOWN_AT: Final = "the flight is shown at "
"""What a flight prints before its page's address."""

DEFAULT_PORT: Final = 8425

Say = Callable[[str], None]


class ServeError(AirRouterError):
    """The page cannot be served where it should be."""


@dataclass(frozen=True, slots=True)
class Web:
    """Where a page is served, and the tiles that lie under its map.

    Attributes:
        host: The address to serve on; at one that other machines reach a token is required.
        port: 0 takes a free one.
        tiles: The file with the tiles; None: nothing lies under the map.
        token: The required token, on any address; None: made up where one is needed.
    """

    host: str = "127.0.0.1"
    port: int = 0
    tiles: TileFile | None = None
    token: str | None = None

    @property
    def backdrop(self) -> dict[str, Any] | None:
        """The backdrop of the map, as pages receive it; None: none."""
        return None if self.tiles is None else self.tiles.view()


HERE: Final = Web()
"""On this machine only, at any free port."""


class Served(Protocol):
    """A page with a server of its own."""

    def serving(self, say: Say) -> AbstractAsyncContextManager[object]:
        """Serve while in the context; `say` takes the address.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """


def page_port(text: str) -> int:
    """The port of a page on the command line.

    Raises:
        ValueError: it is none.
    """
    if not text.isdecimal() or int(text) > 65535:
        raise ValueError(f"{text} is not a port; choose 1 to 65535, or 0")
    return int(text)


def page_options(prefix: str = "") -> Decorator:
    """`--host` and `--image`, with a prefix such as "web-" in each."""
    return together(
        option(
            f"--{prefix}host",
            "web_host",
            default="127.0.0.1",
            metavar="ADDRESS",
            help="address to serve the page on (default 127.0.0.1: this machine only; on "
            "any other address the page requires a token)",
        ),
        option(
            f"--{prefix}image",
            "web_image",
            type=PATH,
            metavar="F",
            help="MBTiles file with the background of the map",
        ),
    )


def web_options(*, always: bool = False) -> Decorator:
    """`--web` and what belongs to it; `always`: a page is what the command is for."""
    alone = {"default": DEFAULT_PORT} if always else optional(DEFAULT_PORT)
    return together(
        option(
            "--web",
            type=Parsed(page_port),
            metavar="PORT" if always else "[PORT]",
            help=f"{'serve the page' if always else 'show the flight on a map page'} at this "
            f"port (default {DEFAULT_PORT}; 0: any free port)",
            **alone,
        ),
        page_options("web-"),
    )


def web_of(arguments: Options) -> Web | None:
    """Where the page is served; None without a port, `arguments.web`.

    Raises:
        UsageError: the file with the tiles is none, or is for no page.
    """
    image = arguments.web_image
    if arguments.web is None:
        if image is not None:
            raise UsageError("--web-image lies under the map of a page; add --web")
        return None
    tiles = None if image is None else TileFile.read(image)
    return Web(arguments.web_host, arguments.web, tiles)


def show(page: Served, say: Say) -> None:
    """Serve a page until Ctrl-C or SIGTERM, its terminal is closed, or it fails.

    Raises:
        ServeError: the address is taken, or none of this machine's.
    """

    async def serve() -> None:
        loop, end = asyncio.get_running_loop(), asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, end.set)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as `nohup` has it
            loop.add_signal_handler(signal.SIGHUP, end.set)
        async with page.serving(say):
            await end.wait()

    asyncio.run(serve())


@contextmanager
def shown_beside(page: Served, say: Say) -> Iterator[None]:
    """Serve a page from a thread of its own, while in the context.

    Raises:
        ServeError: the address is taken, or none of this machine's.
    """
    started: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = Future()

    async def serve() -> None:
        end = asyncio.Event()
        async with page.serving(say):
            started.set_result((asyncio.get_running_loop(), end))
            await end.wait()

    def work() -> None:
        try:
            asyncio.run(serve())
        except Exception as error:
            if started.done():
                raise
            started.set_exception(error)

    thread = Thread(target=work, name="page", daemon=True)
    thread.start()
    loop, end = started.result()
    try:
        yield
    finally:
        with suppress(RuntimeError):  # it has ended by itself, and reported why
            loop.call_soon_threadsafe(end.set)
        thread.join(_END_S)


# The address of a flight's page, as `fly --web` prints it and `watch` takes it.


@dataclass(frozen=True, slots=True)
class PageAddress:
    """The address of a flight's page.

    Attributes:
        host: A name or an IP address, as URLs have it.
        port: Where it is served.
        token: What the page requires; None if only its own machine reaches it.
    """

    host: str
    port: int
    token: str | None = None

    @classmethod
    def of(cls, text: str) -> PageAddress:
        """Read http://HOST:PORT/?token=..., or HOST:PORT, or HOST at `DEFAULT_PORT`.

        Raises:
            UsageError: it is none.
        """
        whole = text if "://" in text else f"http://{text}"
        try:
            parts = urlsplit(whole)
            host, port = parts.hostname, parts.port
        except ValueError:
            host = port = None
        if not host or parts.scheme != "http" or parts.path not in {"", "/"}:
            raise UsageError(
                f"'{text}' is not the address of a flight's page; give what `fly --web` prints, "
                "http://HOST:PORT/"
            )
        if port is None:
            port = 80 if whole == text else DEFAULT_PORT
        (token,) = parse_qs(parts.query).get("token", [None])[:1]
        return cls(f"[{host}]" if ":" in host else host, port, token)

    @classmethod
    def in_line(cls, line: str) -> PageAddress | None:
        """The address in a line that a flight printed; None if there is none."""
        _, _, address = line.partition(SHOWN_AT)
        with suppress(UsageError):
            return cls.of(address.strip())
        return None

    @property
    def place(self) -> str:
        """Host and port, without the token: "127.0.0.1:8425"."""
        return f"{self.host}:{self.port}"

    @property
    def socket(self) -> str:
        """Where its page's socket is."""
        return f"http://{self.place}/socket"
