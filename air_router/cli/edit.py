"""`air-router edit`: a mission on a map page, to drag, check and save."""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path

from air_router.editor.mission_text import MissionText
from air_router.editor.session import Session
from air_router.editor.starter import write_starter
from air_router.errors import ExitCode, UsageError
from air_router.web.backdrop import Backdrop

_DEFAULT_PORT = 8424


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `edit` to the command line."""
    parser = commands.add_parser(
        "edit",
        help="edit a mission on a map",
        description="Open a map page to drag waypoints and zone corners, see the route graph and "
        "all problems change at once, and save the same file with its comments intact. "
        "Ctrl-C ends.",
        epilog="example: air-router edit missions/pennovation/mission.yaml",
    )
    parser.add_argument("mission", type=Path, metavar="MISSION", help="mission YAML or .plan")
    parser.add_argument(
        "--port",
        type=int,
        default=_DEFAULT_PORT,
        metavar="P",
        help=f"where the page is served (default {_DEFAULT_PORT}, 0: any free port)",
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="address to serve on (default: this machine only; others get a token)",
    )
    parser.add_argument(
        "--new", metavar="LAT,LON", help="begin a new mission there; MISSION must not exist yet"
    )
    parser.add_argument("--no-open", action="store_true", help="do not open a browser")
    parser.add_argument(
        "--image", type=Path, metavar="F", help="a picture or MBTiles under the map"
    )
    parser.add_argument(
        "--image-bounds",
        metavar="S,W,N,E",
        help="where the picture lies, in degrees (default: the world file beside it)",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C; its address goes to stdout."""
    if not 0 <= arguments.port <= 65535:
        raise UsageError(f"{arguments.port} is not a port; choose one from 1 to 65535, or 0")
    if arguments.image is None and arguments.image_bounds is not None:
        raise UsageError("--image-bounds belongs to an --image; add one")
    image: Path | None = arguments.image
    backdrop = None if image is None else Backdrop.of(image, arguments.image_bounds)
    if arguments.new is not None:
        write_starter(arguments.mission, arguments.new)
    file = MissionText(arguments.mission)
    session = Session(file)

    def ready(address: str) -> None:
        print(address, flush=True)
        _say(f"editing {arguments.mission}; Ctrl-C ends")
        if not arguments.no_open and _has_screen():
            webbrowser.open(address)

    asyncio.run(_serve(session, backdrop, arguments.host, arguments.port, ready))
    if session.dirty:
        kept = file.keep_aside(session.manuscript.text)
        _say(f"what was not saved is in {kept}")
    return ExitCode.DONE


async def _serve(
    session: Session,
    backdrop: Backdrop | None,
    host: str,
    port: int,
    ready: Callable[[str], None],
) -> None:
    try:
        from air_router.editor.server import EditorServer, serve_until  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        if error.name != "aiohttp":
            raise
        raise UsageError(
            "the edit page needs aiohttp, which is not installed; pip install 'air-router[web]'"
        ) from None
    end = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end.set)
    server = EditorServer(session, token=None, backdrop=backdrop)
    await serve_until(server, host, port, ready, end)


def _has_screen() -> bool:
    """Whether a browser would open in a window, not in this terminal."""
    return sys.platform == "darwin" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
