"""`air-router tiles fetch`: a ground for the map pages, to be had where there is no internet.

Fetches the tiles of a place from a map server that the user names, into an MBTiles file.
"""

import argparse
import hashlib
import math
import sqlite3
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final, NamedTuple

from air_router import __version__
from air_router.errors import AirRouterError, ExitCode, UsageError
from air_router.web.tile_file import (
    HIGHEST_ZOOM,
    MOST_TILE_BYTES,
    Bounds,
    picture_kind,
    read_bounds,
    tiles_within,
)
from mocha_link.path_safety import check_links

MOST_TILES: Final = 5_000
"""More are fetched only where the user says so: two hours of a server's time."""

_FASTEST: Final = 10.0  # tiles per second
_EVERY: Final = 50  # tiles, so often it is told how far it is
_TIMEOUT_S: Final = 20.0
_TRIES: Final = 3
_LONGEST_WAIT_S: Final = 60.0
_NOTHING_THERE: Final = (HTTPStatus.NO_CONTENT, HTTPStatus.NOT_FOUND, HTTPStatus.GONE)
_LATER: Final = (HTTPStatus.TOO_MANY_REQUESTS, HTTPStatus.SERVICE_UNAVAILABLE)
_TABLES: Final = """
CREATE TABLE IF NOT EXISTS metadata (name text PRIMARY KEY, value text);
CREATE TABLE IF NOT EXISTS tiles (zoom_level integer, tile_column integer, tile_row integer,
  tile_data blob, UNIQUE (zoom_level, tile_column, tile_row));
"""


class FetchError(AirRouterError):
    """The server refuses, does not answer, or answers no tile."""


class TileKey(NamedTuple):
    """A tile; its row is counted from the north, as map servers do."""

    zoom: int
    column: int
    row: int  # 0: the northernmost


@dataclass(frozen=True, slots=True)
class TileArea:
    """A part of the world, and how finely.

    Attributes:
        bounds: South, west, north, east in degrees.
        zooms: From the coarsest to the finest.
    """

    bounds: Bounds
    zooms: range

    def __len__(self) -> int:
        return sum(len(columns) * len(rows) for _, columns, rows in self._levels())

    def __iter__(self) -> Iterator[TileKey]:
        for zoom, columns, rows in self._levels():
            yield from (TileKey(zoom, column, row) for column in columns for row in rows)

    def _levels(self) -> Iterator[tuple[int, range, range]]:
        for zoom in self.zooms:
            yield zoom, *tiles_within(zoom, self.bounds)


@dataclass(slots=True)
class TileFetcher:
    """Asks a server for one tile after the other.

    Attributes:
        template: The address of a tile, with {z}, {x} and {y} where its numbers stand.
        per_second: So many are asked for, at most.
        contact: Where the server's operator reaches the user; goes along with every request.
        pause: Lets so many seconds pass.
    """

    template: str
    per_second: float
    contact: str = ""
    pause: Callable[[float], None] = time.sleep
    _asked_s: float = field(default=-math.inf, init=False)  # monotonic

    def __post_init__(self) -> None:
        missing = [mark for mark in ("{z}", "{x}", "{y}") if mark not in self.template]
        if missing or not self.template.startswith(("https://", "http://")):
            raise UsageError(
                f"'{self.template}' is not the address of tiles; write it like "
                "https://tiles.example.org/{z}/{x}/{y}.png"
            )

    def tile(self, key: TileKey) -> bytes | None:
        """A tile; None if the server has none there.

        Raises:
            FetchError: the server refuses, does not answer, or answers something else.
        """
        where = f"tile {key.zoom}/{key.column}/{key.row}"
        for _ in range(_TRIES):
            self.pause(max(0.0, self._asked_s + 1 / self.per_second - time.monotonic()))
            self._asked_s = time.monotonic()
            try:
                data = self._asked(key)
            except urllib.error.HTTPError as error:
                if error.code in _NOTHING_THERE:
                    return None
                if error.code not in _LATER:
                    raise _stopped(where, f"the server says {error.code} {error.reason}") from None
                self.pause(_wait_s(error.headers.get("Retry-After")))
                continue
            except (OSError, ValueError) as error:
                raise _stopped(where, f"{getattr(error, 'reason', None) or error}") from None
            if data and picture_kind(data) is None:
                raise _stopped(where, "the answer is no picture (PNG, JPEG, WebP) up to 1 MiB")
            return data or None
        raise _stopped(where, "the server is busy")

    def _asked(self, key: TileKey) -> bytes:
        marks = {"{z}": key.zoom, "{x}": key.column, "{y}": key.row}
        address = self.template
        for mark, number in marks.items():
            address = address.replace(mark, str(number))
        about = "; ".join(filter(None, ("tiles fetch", self.contact)))
        agent = f"air-router/{__version__} ({about})"
        request = urllib.request.Request(address, headers={"User-Agent": agent})  # noqa: S310 - http
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:  # noqa: S310 - http
            data: bytes = answer.read(MOST_TILE_BYTES + 1)
        return data


@dataclass(frozen=True, slots=True)
class Fetched:
    """How it went: tiles that are new, that were there before, that the server does not have."""

    new: int
    before: int
    none: int  # the server has no such tile


def fetch(
    path: Path,
    area: TileArea,
    fetcher: TileFetcher,
    attribution: str,
    tell: Callable[[int], None] = lambda _: None,
) -> Fetched:
    """Fetch what the file does not have yet; `tell` is told how many tiles were looked at.

    Raises:
        UsageError: the file is another one, or cannot be written.
        FetchError: what was fetched until then is in the file, and the next call goes on there.
    """
    new = before = none = 0
    with _opened(path, fetcher.template) as file:
        facts = _facts(path, area, attribution)
        file.executemany("INSERT OR REPLACE INTO metadata VALUES (?, ?)", facts.items())
        file.commit()
        for count, key in enumerate(area):
            tell(count)
            place = (key.zoom, key.column, (1 << key.zoom) - 1 - key.row)
            if file.execute(_HAS, place).fetchone():
                before += 1
                continue
            data = fetcher.tile(key)
            if data is None:
                none += 1
                continue
            file.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (*place, data))
            suffix = (picture_kind(data) or "").removeprefix("image/").replace("jpeg", "jpg")
            file.execute("INSERT OR IGNORE INTO metadata VALUES ('format', ?)", (suffix,))
            file.commit()
            new += 1
    return Fetched(new, before, none)


_HAS: Final = "SELECT 1 FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"


@contextmanager
def _opened(path: Path, template: str) -> Iterator[sqlite3.Connection]:
    source = hashlib.sha256(template.encode()).hexdigest()[:16]  # an address may hold a key
    try:
        check_links(path)
        with closing(sqlite3.connect(path)) as file:
            file.executescript(_TABLES)
            known = file.execute("SELECT value FROM metadata WHERE name = 'source'").fetchone()
            if file.execute("SELECT 1 FROM tiles LIMIT 1").fetchone() and known != (source,):
                raise UsageError(
                    f"{path} has tiles of another server; give another file, or remove it"
                )
            file.execute("INSERT OR REPLACE INTO metadata VALUES ('source', ?)", (source,))
            yield file
    except (sqlite3.Error, OSError) as error:
        raise UsageError(f"{path} cannot be written as MBTiles: {error}") from None


def _facts(path: Path, area: TileArea, attribution: str) -> dict[str, Any]:
    south, west, north, east = area.bounds
    return {
        "name": path.stem,
        "attribution": attribution,
        "bounds": f"{west},{south},{east},{north}",
        "minzoom": area.zooms[0],
        "maxzoom": area.zooms[-1],
        "type": "baselayer",
        "version": "1.3",
    }


def bounds_of(text: str) -> Bounds:
    """Bounds "S,W,N,E" in degrees.

    Raises:
        UsageError: they are none.
    """
    south, west, north, east = (*text.split(","), *4 * [""])[:4]
    bounds = read_bounds(f"{west},{south},{east},{north}") if text.count(",") == 3 else None
    if bounds is None:
        raise UsageError(f"'{text}' is not S,W,N,E in degrees: south < north and west < east")
    return bounds


def zooms_of(text: str) -> range:
    """Zoom levels "15-19", or one.

    Raises:
        UsageError: they are none.
    """
    first, _, last = text.partition("-")
    try:
        zooms = range(int(first), int(last or first) + 1)
    except ValueError:
        zooms = range(0)
    if not zooms or zooms[-1] > HIGHEST_ZOOM:
        raise UsageError(f"'{text}' is not zoom levels of 0 to {HIGHEST_ZOOM}; write 15-19, say")
    return zooms


def _wait_s(told: str | None) -> float:
    try:
        return min(max(float(told or ""), 1.0), _LONGEST_WAIT_S)
    except ValueError:  # a date, or nothing
        return _LONGEST_WAIT_S / _TRIES


def _stopped(where: str, why: str) -> FetchError:
    return FetchError(f"{where}: {why}; what was fetched is kept: run the command again to go on")


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
