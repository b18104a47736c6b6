"""`air-router tiles fetch`: a ground for the map pages, to be had where there is no internet."""

import argparse
import sys
from pathlib import Path

from air_router.errors import ExitCode, UsageError
from air_router.web.backdrop import bounds_of
from air_router.web.tile_fetch import MOST_TILES, TileArea, TileFetcher, fetch, zooms_of

_FASTEST = 10.0
_EVERY = 50


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = (
        "Fetch the map tiles of a place from a server of your choice into an MBTiles file, for "
        "--image and --web-image. Ask for what its terms allow. Ctrl-C ends; run again to go on."
    )
    parser.epilog = (
        "example: air-router tiles fetch site.mbtiles --bounds 39.939,-75.204,39.945,-75.196 "
        "--zooms 15-19 --url 'https://tiles.example.org/{z}/{x}/{y}.png' --attribution '© Example'"
    )
    parser.add_argument("do", choices=("fetch",), help="what to do")
    parser.add_argument("file", type=Path, metavar="FILE", help="MBTiles file; it is gone on with")
    parser.add_argument("--bounds", required=True, metavar="S,W,N,E", help="in degrees")
    parser.add_argument("--zooms", required=True, metavar="Z-Z", help="zoom levels (15-19, say)")
    parser.add_argument("--url", required=True, metavar="URL", help="with {z}, {x} and {y}")
    parser.add_argument(
        "--attribution", required=True, metavar="TEXT", help="whom the map has to name"
    )
    parser.add_argument("--contact", default="", metavar="TEXT", help="told to the server")
    parser.add_argument(
        "--per-second",
        type=float,
        default=2.0,
        metavar="N",
        help=f"tiles per second, at most (default 2, up to {_FASTEST:g})",
    )
    parser.add_argument(
        "--most",
        type=int,
        default=MOST_TILES,
        metavar="N",
        help=f"refuse to fetch more tiles than these (default {MOST_TILES})",
    )


def run(arguments: argparse.Namespace) -> int:
    """Fetch, and say how far it is."""
    if not 0 < arguments.per_second <= _FASTEST:
        raise UsageError(f"--per-second is more than 0 and at most {_FASTEST:g}")
    area = TileArea(bounds_of(arguments.bounds), zooms_of(arguments.zooms))
    count = len(area)
    if count > arguments.most:
        raise UsageError(
            f"these are {count} tiles; choose smaller bounds or fewer zoom levels, or say "
            f"--most {count}"
        )
    fetcher = TileFetcher(arguments.url, arguments.per_second, arguments.contact)

    def tell(done: int) -> None:
        if done % _EVERY == 0:
            print(f"{done} of {count} tiles", file=sys.stderr, flush=True)

    fetched = fetch(arguments.file, area, fetcher, arguments.attribution, tell)
    print(
        f"{arguments.file}: {fetched.new} tiles fetched, {fetched.before} were there, "
        f"{fetched.none} the server does not have"
    )
    return ExitCode.DONE
