"""Whether flights are shown on a live page, and where; `air_router.live` is the page itself."""

from __future__ import annotations

import argparse
import asyncio
import signal
from collections.abc import Callable, Coroutine, Iterable, Iterator
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from threading import Thread
from typing import Any, Final, Protocol

from air_router.control.command_request import Grants
from air_router.controller.controller import Controller
from air_router.controller.model.actions import Action
from air_router.controller.model.events import Event
from air_router.errors import UsageError
from air_router.gossip.gossip import Gossip
from air_router.gossip.mapper import Mapper
from air_router.live.page_address import DEFAULT_PORT, PageAddress, Web
from air_router.mission.mission import Mission
from air_router.record.log import Log
from air_router.web.backdrop import Backdrop

_MISSING: Final = "the page needs aiohttp, which is not installed; pip install 'air-router[web]'"

_END_S: Final = 5.0
"""A page that has not ended by then ends with the program."""

Say = Callable[[str], None]


class Served(Protocol):
    """A page with a server of its own."""

    def serving(self, say: Say) -> AbstractAsyncContextManager[object]:
        """Serve while in the context; `say` is told where.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """


class Page(Served, Protocol):
    """Shows a flight while it lasts."""

    def event(self, event: Event, now_s: float) -> None:
        """Take in what happened."""

    def action(self, action: Action, now_s: float) -> None:
        """Take in what was decided."""


class Joined(Served, Protocol):
    """A page for several flights."""

    def found(self, name: str, address: PageAddress) -> None:
        """A flight's page is there; may be called from any thread."""


class Shown(Protocol):
    """What a page needs of a flight: its decisions, and where requests are handed in."""

    @property
    def controller(self) -> Controller:
        """Read for what the mission does now."""

    @property
    def commands(self) -> Grants:
        """Takes what the page asks for."""


class NoPage:
    """The page of a flight that is not shown."""

    def event(self, event: Event, now_s: float) -> None:
        """No page is open."""

    def action(self, action: Action, now_s: float) -> None:
        """No page is open."""

    def serving(self, say: Say) -> AbstractAsyncContextManager[object]:
        """Nothing is served."""
        del say
        return nullcontext()


def add_web(parser: argparse.ArgumentParser) -> None:
    """Add `--web` and `--web-host`."""
    parser.add_argument(
        "--web",
        type=_port,
        nargs="?",
        const=DEFAULT_PORT,
        metavar="PORT",
        help=f"show the flight on a map page there (default port {DEFAULT_PORT}, 0: any free one)",
    )
    _add_more(parser)


def add_joint_web(parser: argparse.ArgumentParser) -> None:
    """Add `--web` where it is what the command is for."""
    parser.add_argument(
        "--web",
        type=_port,
        default=DEFAULT_PORT,
        metavar="PORT",
        help=f"serve the page there (default {DEFAULT_PORT}, 0: any free one)",
    )
    _add_more(parser)


def _add_more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--web-host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="address of the page (default: this machine only; others get a token)",
    )
    parser.add_argument(
        "--web-image", type=Path, metavar="F", help="a picture or MBTiles under its map"
    )
    parser.add_argument(
        "--web-image-bounds",
        metavar="S,W,N,E",
        help="where the picture lies, in degrees (default: the world file beside it)",
    )


def web_of(arguments: argparse.Namespace) -> Web | None:
    """Where the page is served; None without `--web`.

    Raises:
        UsageError: the picture under the map is none, lies nowhere, or is for no page.
    """
    image: Path | None = arguments.web_image
    if arguments.web is None:
        if image is not None:
            raise UsageError("--web-image lies under the map of a page; add --web")
        return None
    if image is None and arguments.web_image_bounds is not None:
        raise UsageError("--web-image-bounds belongs to a --web-image; add one")
    backdrop = None if image is None else Backdrop.of(image, arguments.web_image_bounds)
    return Web(arguments.web_host, arguments.web, backdrop)


def page_of(
    web: Web | None, mission: Mission, flight: Shown, gossip: Gossip, mapper: Mapper
) -> Page:
    """The page of a flight.

    Raises:
        UsageError: what serves pages is not installed.
    """
    if web is None:
        return NoPage()
    with _extra():
        from air_router.live.server import LivePage  # noqa: PLC0415 - an extra
    return LivePage(
        mission,
        flight.controller,
        flight.commands,
        gossip.links,
        mapper=mapper,
        host=web.host,
        port=web.port,
        backdrop=web.backdrop,
    )


def show_record(path: Path, web: Web, speed: float, say: Say) -> None:
    """Show a recorded flight until Ctrl-C.

    Raises:
        UsageError: what serves pages is not installed.
        RefusedError, LogError, ServeError: there is nothing to show, or nowhere.
    """
    with _extra():
        from air_router.live.playback import Film, Playback  # noqa: PLC0415 - an extra
    playback = Playback(Film(Log(path)), web, speed=speed)
    asyncio.run(_until_interrupted(playback.run(say)))


def joint_page(names: Iterable[str], web: Web) -> Joined:
    """One page for several flights.

    Raises:
        UsageError: what serves pages is not installed.
    """
    with _extra():
        from air_router.live.joint import JointPage  # noqa: PLC0415 - an extra
    return JointPage(names, host=web.host, port=web.port, backdrop=web.backdrop)


def show_flights(page: Served, say: Say) -> None:
    """Show several flights until Ctrl-C.

    Raises:
        ServeError: the address is taken, or none of this machine's.
    """

    async def show() -> None:
        async with page.serving(say):
            await asyncio.Event().wait()

    asyncio.run(_until_interrupted(show()))


@contextmanager
def shown_beside(page: Served, say: Say) -> Iterator[None]:
    """Show several flights from a thread of its own, while in the context.

    Raises:
        ServeError: the address is taken, or none of this machine's.
    """
    started: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = Future()

    async def show() -> None:
        end = asyncio.Event()
        async with page.serving(say):
            started.set_result((asyncio.get_running_loop(), end))
            await end.wait()

    def work() -> None:
        try:
            asyncio.run(show())
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
        with suppress(RuntimeError):  # it has ended by itself, and said why
            loop.call_soon_threadsafe(end.set)
        thread.join(_END_S)


async def _until_interrupted(showing: Coroutine[Any, Any, None]) -> None:
    """Run it until Ctrl-C; raises what it raises."""
    loop, end = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end.set)
    working, ending = loop.create_task(showing), loop.create_task(end.wait())
    await asyncio.wait((working, ending), return_when=asyncio.FIRST_COMPLETED)
    ending.cancel()
    if working.done():
        working.result()
    working.cancel()
    await asyncio.gather(working, return_exceptions=True)


@contextmanager
def _extra() -> Iterator[None]:
    """Where what serves pages is imported; raises UsageError if it is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != "aiohttp":
            raise
        raise UsageError(_MISSING) from None


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port; choose 1 to 65535, or 0")
    return int(text)
