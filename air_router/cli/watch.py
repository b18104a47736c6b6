"""`air-router watch`: several flights on one map page."""

import click

from air_router.cli.arguments import say
from air_router.errors import ExitCode, UsageError
from air_router.web import PageAddress, show, web_of, web_options
from mocha_link.cli import Options, command
from mocha_link.errors import needs_extra


@command(
    "Serve one map page for several flights that run with --web on other machines. The page "
    "connects to a flight as soon as it starts, and reconnects after a lost link. Ctrl-C ends the "
    "page, not the flights.",
    "examples:\n"
    "  air-router watch 'http://192.168.1.11:8425/?token=aTbZ' 192.168.1.12:8425\n"
    "  air-router watch titan.local atlas.local --web 0    (any free port)",
)
@click.argument(
    "addresses",
    nargs=-1,
    required=True,
    metavar="ADDRESS ...",
    help="address that `fly --web` prints; HOST or HOST:PORT for a page without a token",
)
@web_options(always=True)
def run(arguments: Options) -> int:
    """Serve the page until Ctrl-C."""
    web = web_of(arguments)
    assert web is not None  # noqa: S101 - there always is a port
    flights = [PageAddress.of(text) for text in arguments.addresses]
    places = [flight.place for flight in flights]
    twice = next((place for place in places if places.count(place) > 1), None)
    if twice is not None:
        raise UsageError(f"{twice} is given twice; leave one out")
    with needs_extra("the page", "web", "air-router"):
        from air_router.live import JointPage  # noqa: PLC0415 - an extra
    page = JointPage(places, web)
    for flight in flights:
        page.found(flight.place, flight)
    show(page, lambda where: say(f"{where}; Ctrl-C ends"))
    return ExitCode.DONE
