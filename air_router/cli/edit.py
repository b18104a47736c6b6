"""`air-router edit`: a mission on a map page, to drag, check and save."""

import gc
import os
import sys
import webbrowser

import click

from air_router.cli.arguments import home, say
from air_router.editor import EditSession, MissionFile, write_starter
from air_router.errors import ExitCode
from air_router.web import page_options, page_port, show, web_of
from mocha_link.cli import PATH, Options, Parsed, command, option
from mocha_link.errors import needs_extra

_DEFAULT_PORT = 8424


@command(
    "Edit a mission on a map page: drag waypoints and zone corners, with the route graph and all "
    "problems updated live, and save to the same file with comments preserved. Ctrl-C quits.",
    "example: air-router edit missions/pennovation/mission.yaml",
)
@click.argument("mission", type=PATH, help="mission file (.yaml or .plan)")
@option(
    "--port",
    "web",
    type=Parsed(page_port),
    metavar="P",
    default=_DEFAULT_PORT,
    help=f"port that the page is served on (default {_DEFAULT_PORT}; 0: any free port)",
)
@page_options()
@option(
    "--new",
    type=Parsed(home),
    metavar="LAT,LON",
    help="create MISSION with home at this position, in degrees; the file must not exist yet",
)
@option("--no-open", is_flag=True, help="do not open a browser")
def run(arguments: Options) -> int:
    """Serve the page until Ctrl-C; its address goes to stdout."""
    web = web_of(arguments)
    assert web is not None  # noqa: S101 - there always is a port
    with needs_extra("the page", "web", "air-router"):
        from air_router.editor import EditorServer  # noqa: PLC0415 - an extra
    if arguments.new is not None:
        write_starter(arguments.mission, arguments.new)
    file = MissionFile(arguments.mission)
    session = EditSession(file)
    # An edit leaves no garbage in circles, a page that comes and goes a few kilobytes. A search for
    # it, among the objects of this edit and of earlier ones, holds up a key by 50 ms.
    gc.disable()

    def ready(address: str) -> None:
        print(address, flush=True)
        say(f"editing {arguments.mission}; Ctrl-C ends")
        if not arguments.no_open and _has_screen():
            webbrowser.open(address)

    try:
        show(EditorServer(session, web), ready)
    finally:
        if session.dirty:
            kept = file.keep_aside(session.editable.text)
            say(f"what was not saved is in {kept}")
    return ExitCode.DONE


def _has_screen() -> bool:
    """Whether a browser would open in a window, not in this terminal."""
    return sys.platform == "darwin" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
