"""`air-router tiles fetch`: a ground for the map pages, to be had where there is no internet.

Fetches the tiles of a place from a map server that the user names, into an MBTiles file.
"""

import hashlib
import http.client
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
from urllib.parse import urlsplit

import click

from air_router import __version__
from air_router.errors import AirRouterError, ExitCode, UsageError
from air_router.mission import Mission, load_mission
from air_router.web.tile_file import (
    HIGHEST_ZOOM,
    MOST_TILE_BYTES,
    Bounds,
    picture_kind,
    read_bounds,
    tiles_within,
)
from geo.frame import Point
from mocha_link.cli import PATH, Options, command, option
from mocha_link.path_safety import check_links
from mocha_link.sanitize import sanitize

MOST_TILES: Final = 5_000
"""More are fetched only on request: two hours of a server's time."""

MOST_MB: Final = 200.0
"""Nor more bytes, whatever the server answers."""

FINEST: Final = 19
"""The finest zoom level that is fetched by default: 0.3 m a pixel at the equator."""

_COARSEST_TILES: Final = 4
"""Of the coarsest level there are so many, at most: the whole mission in one view."""

_AROUND_M: Final = 200.0
_MOST_AROUND_M: Final = 10_000.0
_FORBIDDEN: Final = {
    "openstreetmap.org": "https://operations.osmfoundation.org/policies/tiles/",
}
"""Servers whose terms forbid copies for use without them, and where the terms are."""

_MB: Final = 1_000_000
_CHUNK: Final = 64 * 1024
_FASTEST: Final = 10.0  # tiles per second
_EVERY: Final = 50  # tiles between two reports of progress
_TIMEOUT_S: Final = 20.0  # in which nothing comes
_WHOLE_S: Final = 60.0  # in which a tile has come
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
        per_second: Requests per second, at most.
        contact: Where the server's operator reaches the user; goes along with every request.
        pause: Lets so many seconds pass.
        most_bytes: So many are kept of its replies, in one run.
    """

    template: str
    per_second: float
    contact: str = ""
    pause: Callable[[float], None] = time.sleep
    most_bytes: float = MOST_MB * _MB
    _requested_s: float = field(default=-math.inf, init=False)  # monotonic

    def __post_init__(self) -> None:
        missing = [mark for mark in ("{z}", "{x}", "{y}") if mark not in self.template]
        if missing or not self.template.startswith(("https://", "http://")):
            raise UsageError(
                f"'{self.template}' is not the address of tiles; write it like "
                "https://tiles.example.org/{z}/{x}/{y}.png"
            )
        host = urlsplit(self.template).hostname or ""
        for name, terms in _FORBIDDEN.items():
            if host == name or host.endswith(f".{name}"):
                raise UsageError(
                    f"the terms of {host} forbid copies for use offline ({terms}); "
                    "docs/editing.md names servers that allow them"
                )

    def tile(self, key: TileKey) -> bytes | None:
        """A tile; None if the server has none there.

        Raises:
            FetchError: the server refuses, does not answer, or answers something else.
        """
        where = f"tile {key.zoom}/{key.column}/{key.row}"
        for _ in range(_TRIES):
            self.pause(max(0.0, self._requested_s + 1 / self.per_second - time.monotonic()))
            self._requested_s = time.monotonic()
            try:
                data = self._requested(key)
            except urllib.error.HTTPError as error:
                if error.code in _NOTHING_THERE:
                    return None
                if error.code not in _LATER:
                    raise _stopped(
                        where, f"the server answered {error.code} {error.reason}"
                    ) from None
                self.pause(_wait_s(error.headers.get("Retry-After")))
                continue
            except (OSError, ValueError, http.client.HTTPException) as error:
                raise _stopped(where, _why(error)) from None
            if data and picture_kind(data) is None:
                raise _stopped(where, "the answer is no picture (PNG, JPEG, WebP) up to 1 MiB")
            return data or None
        raise _stopped(where, "the server is busy")

    def _requested(self, key: TileKey) -> bytes:
        marks = {"{z}": key.zoom, "{x}": key.column, "{y}": key.row}
        address = self.template
        for mark, number in marks.items():
            address = address.replace(mark, str(number))
        about = "; ".join(filter(None, ("tiles fetch", self.contact)))
        agent = f"air-router/{__version__} ({about})"
        request = urllib.request.Request(address, headers={"User-Agent": agent})  # noqa: S310 - http
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:  # noqa: S310 - http
            data, until_s = b"", time.monotonic() + _WHOLE_S
            while len(data) <= MOST_TILE_BYTES and (chunk := answer.read1(_CHUNK)):
                data += chunk
                if time.monotonic() > until_s:
                    raise TimeoutError(f"the tile has not come within {_WHOLE_S:.0f} s")
            if answer.length and len(data) <= MOST_TILE_BYTES:
                raise http.client.IncompleteRead(data, answer.length)
        return data


@dataclass(frozen=True, slots=True)
class Fetched:
    """How it went: tiles that are new, that were there before, that the server does not have."""

    new: int
    before: int
    none: int  # the server has no such tile
    bytes: int = 0  # of the new ones


def fetch(
    path: Path,
    area: TileArea,
    fetcher: TileFetcher,
    attribution: str,
    progress: Callable[[int], None] = lambda _: None,
) -> Fetched:
    """Fetch what the file does not have yet; `progress` takes the number of tiles done.

    Raises:
        UsageError: the file is another one, or cannot be written.
        FetchError: what was fetched until then is in the file, and the next call goes on there.
    """
    new = before = none = size = 0
    with _opened(path, fetcher.template) as file:
        facts = _facts(path, area, attribution)
        file.executemany("INSERT OR REPLACE INTO metadata VALUES (?, ?)", facts.items())
        file.commit()
        for count, key in enumerate(area):
            progress(count)
            place = (key.zoom, key.column, (1 << key.zoom) - 1 - key.row)
            if file.execute(_HAS, place).fetchone():
                before += 1
                continue
            data = fetcher.tile(key)
            if data is None:
                none += 1
                continue
            size += len(data)
            if size > fetcher.most_bytes:
                raise _stopped(
                    f"tile {count + 1} of {len(area)}",
                    f"more than {fetcher.most_bytes / _MB:g} MB have come; choose fewer zoom "
                    "levels, or raise --most-mb",
                )
            file.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (*place, data))
            suffix = (picture_kind(data) or "").removeprefix("image/").replace("jpeg", "jpg")
            file.execute("INSERT OR IGNORE INTO metadata VALUES ('format', ?)", (suffix,))
            file.commit()
            new += 1
    return Fetched(new, before, none, size)


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


def bounds_around(mission: Mission, around_m: float) -> Bounds:
    """Where a mission lies, its fences too, and so many metres around."""
    points = [mission.home, *(w.position for w in mission.waypoints), *mission.rally_points]
    boxes = [(*point, *point) for point in points]
    boxes += [shape.polygon.bounds for shape in mission.fences]
    west_m, south_m = (min(box[side] for box in boxes) - around_m for side in (0, 1))
    east_m, north_m = (max(box[side] for box in boxes) + around_m for side in (2, 3))
    corners = [Point(east, north) for east in (west_m, east_m) for north in (south_m, north_m)]
    places = [mission.frame.to_geodetic(corner) for corner in corners]
    latitudes = [place.latitude_deg for place in places]
    longitudes = [place.longitude_deg for place in places]
    bounds = min(latitudes), min(longitudes), max(latitudes), max(longitudes)
    if bounds[3] - bounds[1] > 180:
        raise UsageError("the mission lies across the antimeridian: give --bounds for one side")
    return bounds


def zooms_for(bounds: Bounds) -> range:
    """From the level on which few tiles show everything, to the finest that is usual."""
    fits = (
        z for z in range(FINEST, 0, -1) if len(TileArea(bounds, range(z, z + 1))) <= _COARSEST_TILES
    )
    return range(next(fits, 0), FINEST + 1)


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
        raise UsageError(f"'{text}' is not zoom levels of 0 to {HIGHEST_ZOOM}; write it like 15-19")
    return zooms


def _wait_s(header: str | None) -> float:
    try:
        return min(max(float(header or ""), 1.0), _LONGEST_WAIT_S)
    except ValueError:  # a date, or nothing
        return _LONGEST_WAIT_S / _TRIES


def _why(error: Exception) -> str:
    """The error of a request, for the user."""
    if isinstance(error, http.client.IncompleteRead):
        return f"the answer broke off ({error})"
    if isinstance(error, http.client.HTTPException) and not isinstance(error, OSError):
        return f"the answer is not HTTP ({error})"
    return str(getattr(error, "reason", None) or error)


def _stopped(where: str, why: str) -> FetchError:
    return FetchError(
        f"{where}: {sanitize(why)}; what was fetched is kept: run the command again to go on"
    )


@command(
    "Download the map tiles of an area from a server of your choice into an MBTiles file, for "
    "--image and --web-image. Respect the server's terms of use. Ctrl-C quits; run the command "
    "again to continue.",
    "example:\n  air-router tiles fetch site.mbtiles --mission mission.yaml \\\n"
    "      --url 'https://tiles.example.org/{z}/{x}/{y}.png' --attribution '© Example'",
)
@click.argument("do", type=click.Choice(("fetch",)), help="fetch: download the tiles")
@click.argument(
    "file", type=PATH, help="MBTiles file; tiles already in it are not downloaded again"
)
@option("--mission", type=PATH, metavar="M", help="download the surroundings of this mission")
@option(
    "--bounds",
    metavar="S,W,N,E",
    help="download this box: south, west, north, east in degrees",
    not_with=["mission"],
)
@option(
    "--around",
    type=float,
    metavar="METERS",
    default=_AROUND_M,
    help=f"margin around the mission, in meters (default {_AROUND_M:g})",
)
@option(
    "--zooms",
    metavar="Z-Z",
    help=f"zoom levels, coarsest to finest (default: from an overview of the area to {FINEST})",
)
@option(
    "--url",
    metavar="URL",
    required=True,
    help="URL of a tile, with the placeholders {z}, {x} and {y}",
)
@option(
    "--attribution",
    metavar="TEXT",
    required=True,
    help="copyright notice for the map, as the server's terms require",
)
@option(
    "--contact",
    metavar="TEXT",
    default="",
    help="how the server's operator can reach you (an e-mail address, a URL); sent with every "
    "request",
)
@option(
    "--per-second",
    type=float,
    metavar="N",
    default=2.0,
    help=f"largest rate, in tiles per second (default 2, up to {_FASTEST:g})",
)
@option(
    "--most",
    type=int,
    metavar="N",
    default=MOST_TILES,
    help=f"largest number of tiles; a larger area is refused (default {MOST_TILES})",
)
@option(
    "--most-mb",
    type=float,
    metavar="N",
    default=MOST_MB,
    help=f"stop after this many megabytes (default {MOST_MB:g})",
)
def run(arguments: Options) -> int:
    """Fetch, and print the progress."""
    if not 0 < arguments.per_second <= _FASTEST:
        raise UsageError(f"--per-second is more than 0 and at most {_FASTEST:g}")
    if not 0 <= arguments.around <= _MOST_AROUND_M:
        raise UsageError(f"--around is 0 to {_MOST_AROUND_M:g} metres")
    if not arguments.most_mb > 0:
        raise UsageError("--most-mb is more than 0")
    if not arguments.attribution.strip():
        raise UsageError(
            "give --attribution: whom the map has to name, as the server's terms require"
        )
    if arguments.mission is None and arguments.bounds is None:
        raise UsageError("give the place: --mission M or --bounds S,W,N,E")
    if arguments.mission is None:
        bounds = bounds_of(arguments.bounds)
    else:
        bounds = bounds_around(load_mission(arguments.mission), arguments.around)
    zooms = zooms_for(bounds) if arguments.zooms is None else zooms_of(arguments.zooms)
    area = TileArea(bounds, zooms)
    count = len(area)
    if count > arguments.most:
        raise UsageError(
            f"these are {count} tiles; choose smaller bounds or fewer zoom levels, or pass "
            f"--most {count}"
        )
    fetcher = TileFetcher(
        arguments.url,
        arguments.per_second,
        arguments.contact,
        most_bytes=arguments.most_mb * _MB,
    )

    def progress(done: int) -> None:
        if done % _EVERY == 0:
            print(f"{done} of {count} tiles", file=sys.stderr, flush=True)

    fetched = fetch(arguments.file, area, fetcher, arguments.attribution, progress)
    print(
        f"{arguments.file}: {fetched.new} tiles fetched, {fetched.before} were there, "
        f"{fetched.none} the server does not have ({fetched.bytes / _MB:.1f} MB)"
    )
    return ExitCode.DONE
