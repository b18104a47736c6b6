"""MBTiles 1.3: the tiles of a map, pictures of 2^z by 2^z squares of the world, in a SQLite file.

Files come from anywhere: reads are bounded, in bytes and in steps of the database,
and nothing in them is run. They are opened for every tile anew: that costs less than the tile, and
neither threads nor a replaced file need care.
"""

from __future__ import annotations

import hashlib
import math
import re
import shlex
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from html import unescape
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from air_router.errors import AirRouterError, UsageError

MOST_TILE_BYTES = 1024 * 1024  # 512 by 512 pixels that nothing can compress
HIGHEST_ZOOM = 24
_MERCATOR_DEG = 85.0511
_MOST_BYTES = 32 * 1024**3
_MOST_ROW_BYTES = MOST_TILE_BYTES + 64 * 1024
_STEPS = 1000
_MOST_STEPS = 2_000_000 // _STEPS  # of the database: a tile takes some twenty, with an index
_BUSY_S = 0.2
_SAMPLES = 16
_MOST_LETTERS = 200
_MAGIC = b"SQLite format 3\0"
_MODE_AT = 18  # in the file's head: 2 where a write-ahead log belongs to it
_WITH_LOG = 2
_NOT_SHOWN = re.compile(r"<(script|style)\b.*?(</\1\s*>|$)", re.DOTALL | re.IGNORECASE)
_MARKUP = re.compile(r"<!--.*?(-->|$)|</?[a-z!][^>]*(>|$)", re.DOTALL | re.IGNORECASE)
_VECTORS = ("pbf", "mvt")
_COMPRESSED = (b"\x1f\x8b", b"\x78\x9c", b"\x78\xda", b"\x78\x01")
_INDEX = "CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row)"
_HOW = "docs/editing.md shows how to make one"

Bounds = tuple[float, float, float, float]
"""South, west, north and east border in degrees."""


class TileError(AirRouterError):
    """A tile cannot be shown: its row is damaged, or the file was removed."""


class Tile(NamedTuple):
    """A picture and its media type."""

    kind: str  # media type
    data: bytes


@dataclass(frozen=True, slots=True)
class TileFile:
    """A file with tiles that are pictures, as it was found.

    Attributes:
        path: The file.
        lowest: The coarsest zoom level that has tiles.
        highest: The finest one.
        bounds: Where there are tiles; None where the file does not say so, or wrongly.
        attribution: Whom to name, in plain text.
        tag: Changes with the file.
    """

    path: Path
    lowest: int
    highest: int
    bounds: Bounds | None
    attribution: str
    tag: str
    _uri: str

    @classmethod
    def read(cls, path: Path) -> TileFile:
        """The contents of a file.

        Raises:
            UsageError: it is no MBTiles file, is damaged, or its tiles are no pictures.
        """
        try:
            uri, tag = _address(path)
            with _opened(uri) as file:
                facts = _metadata(file)
                _check_pictures(path, file, facts)
                lowest, highest = _zooms(path, file)
                bounds = _checked(path, file, highest, read_bounds(facts.get("bounds", "")))
        except OSError as error:
            raise UsageError(f"{path} cannot be read: {error.strerror or error}") from None
        except sqlite3.Error as error:
            raise UsageError(_why(path, error)) from None
        attribution = plain(facts.get("attribution", ""))
        return cls(path, lowest, highest, bounds, attribution, tag, uri)

    def view(self) -> dict[str, Any]:
        """For the page: where it finds a tile, which there are, and whom to name."""
        return {
            "address": f"/backdrop/{self.tag}/{{z}}/{{x}}/{{y}}",
            "bounds": self.bounds,
            "lowest": self.lowest,
            "highest": self.highest,
            "attribution": self.attribution,
        }

    def tile(self, zoom: int, column: int, row: int) -> Tile | None:
        """A tile, or None; its row is counted from the north, as browsers do.

        Raises:
            TileError: it cannot be read, or is no picture.
        """
        if zoom > HIGHEST_ZOOM or max(column, row) >= (side := 1 << zoom):
            return None
        try:
            with _opened(self._uri) as file:
                data = _tile(file, zoom, column, side - 1 - row)
        except sqlite3.Error as error:
            raise TileError(_why(self.path, error)) from None
        if data is None:
            return None
        kind = picture_kind(data)
        if kind is None:
            raise TileError(
                f"{self.path}: tile {zoom}/{column}/{row} is no picture of at most 1 MiB"
            )
        return Tile(kind, data)


def read_bounds(text: str) -> Bounds | None:
    """West, south, east and north border, as MBTiles writes it; None if the text is none."""
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        return None
    good = -90 <= south < north <= 90 and -180 <= west < east <= 180
    return (south, west, north, east) if good else None


def plain(html: str) -> str:
    """The plain text of what may be HTML, in one line that is not too long."""
    text = _NOT_SHOWN.sub(" ", html[: 10 * _MOST_LETTERS])
    text = unescape(_MARKUP.sub("", text))
    text = "".join(letter if letter.isprintable() else " " for letter in text)
    text = " ".join(text.split())
    return text if len(text) <= _MOST_LETTERS else f"{text[: _MOST_LETTERS - 1]}…"


def _address(path: Path) -> tuple[str, str]:
    """How SQLite opens a file without ever writing, and a tag that changes with the file."""
    with path.open("rb") as file:
        head = file.read(_MODE_AT + 1)
    if not head.startswith(_MAGIC) or len(head) <= _MODE_AT:
        raise UsageError(f"{path} is not an MBTiles file: no SQLite database; {_HOW}")
    state = path.stat()
    if state.st_size > _MOST_BYTES:
        raise UsageError(f"{path} is larger than 32 GiB; cut out the mission's surroundings")
    path = path.resolve()
    # Only who may write beside the file could read its write-ahead log. Without a log there is
    # nothing in it, and the file is read as what does not change.
    asleep = head[_MODE_AT] == _WITH_LOG and not path.with_name(f"{path.name}-wal").exists()
    tag = hashlib.sha256(b"%b %d %d" % (bytes(path), state.st_size, state.st_mtime_ns))
    return f"{path.as_uri()}?mode=ro" + ("&immutable=1" if asleep else ""), tag.hexdigest()[:12]


@contextmanager
def _opened(uri: str) -> Iterator[sqlite3.Connection]:
    """The file, for as much work as a tile should take."""
    steps = count(1)
    with closing(sqlite3.connect(uri, uri=True, timeout=_BUSY_S)) as file:
        file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MOST_ROW_BYTES)
        file.set_progress_handler(lambda: next(steps) > _MOST_STEPS, _STEPS)
        file.text_factory = lambda text: text.decode(errors="replace")
        file.execute("PRAGMA trusted_schema = OFF")
        file.execute("PRAGMA mmap_size = 0")  # a file that is cut short must not end the program
        yield file


def _metadata(file: sqlite3.Connection) -> dict[str, str]:
    found = file.execute(
        "SELECT name, value FROM metadata WHERE name IN ('format', 'bounds', 'attribution') "
        "AND length(value) <= 10000 LIMIT 10"
    )
    return {name: str(value) for name, value in found}


def _tile(file: sqlite3.Connection, zoom: int, column: int, tms_row: int) -> Any:
    """What stands for a tile, whatever it is; None if nothing. MBTiles counts from the south."""
    found = file.execute(
        "SELECT CASE WHEN length(tile_data) <= ? THEN tile_data ELSE length(tile_data) END "
        "FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?",
        (MOST_TILE_BYTES, zoom, column, tms_row),
    ).fetchone()
    return found and found[0]


def picture_kind(data: Any) -> str | None:
    """The media type of a picture by its first bytes; files mix them, whatever their metadata."""
    if not isinstance(data, bytes):
        return None
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    if data.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    return "image/webp" if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else None


def _check_pictures(path: Path, file: sqlite3.Connection, facts: dict[str, str]) -> None:
    """Raises UsageError: the tiles are no pictures."""
    heads = [
        head
        for (head,) in file.execute(
            "SELECT CASE WHEN length(tile_data) <= ? THEN substr(tile_data, 1, 16) END "
            "FROM tiles LIMIT ?",
            (MOST_TILE_BYTES, _SAMPLES),
        )
    ]
    found = facts.get("format", "").lower()
    vectors = [isinstance(head, bytes) and head.startswith(_COMPRESSED) for head in heads]
    if found in _VECTORS or "vector" in found or (vectors and all(vectors)):
        raise UsageError(
            f"{path} holds vector tiles, which this map does not draw; take one with PNG, JPEG or "
            f"WebP tiles; {_HOW}"
        )
    if not heads:
        raise UsageError(f"{path} has no tiles; {_HOW}")
    if not any(map(picture_kind, heads)):
        raise UsageError(
            f"the tiles of {path} are neither PNG nor JPEG nor WebP of at most 1 MiB; {_HOW}"
        )


def _zooms(path: Path, file: sqlite3.Connection) -> tuple[int, int]:
    """The coarsest and the finest zoom level, as the tiles have them: not all files state them."""
    found = "SELECT zoom_level FROM tiles WHERE zoom_level BETWEEN 0 AND ? ORDER BY zoom_level"
    levels = [
        file.execute(f"{found} {order} LIMIT 1", (HIGHEST_ZOOM,)).fetchone()
        for order in ("ASC", "DESC")
    ]
    if None in levels:
        raise UsageError(f"{path} has no tiles at zoom levels 0 to {HIGHEST_ZOOM}; {_HOW}")
    lowest, highest = sorted(int(level) for (level,) in levels)
    return lowest, highest


def _checked(
    path: Path, file: sqlite3.Connection, zoom: int, bounds: Bounds | None
) -> Bounds | None:
    """The bounds, if there is a tile within them: wrong ones would hide the whole map."""
    found = file.execute(
        "SELECT tile_row, tile_column FROM tiles WHERE zoom_level = ? LIMIT 1", (zoom,)
    ).fetchone()
    if bounds is None or not found or not all(isinstance(number, int) for number in found):
        return None
    row, column = found
    columns, rows = tiles_within(zoom, bounds)
    if column in columns and (1 << zoom) - 1 - row in rows:
        return bounds
    if column in columns and row in rows:
        raise UsageError(
            f"{path} counts rows of tiles from the north, MBTiles counts them from the south; "
            "make it anew with another tool"
        )
    return None


def tiles_within(zoom: int, bounds: Bounds) -> tuple[range, range]:
    """Columns and rows, from the north, of the tiles that touch an area, in Web Mercator."""
    south, west, north, east = bounds
    columns, rows = zip(_tile_at(zoom, north, west), _tile_at(zoom, south, east), strict=True)
    return range(columns[0], columns[1] + 1), range(rows[0], rows[1] + 1)


def _tile_at(zoom: int, latitude_deg: float, longitude_deg: float) -> tuple[int, int]:
    side = 1 << zoom
    latitude = math.radians(min(max(latitude_deg, -_MERCATOR_DEG), _MERCATOR_DEG))
    x = (longitude_deg + 180) / 360
    y = (1 - math.asinh(math.tan(latitude)) / math.pi) / 2
    return min(int(x * side), side - 1), min(max(int(y * side), 0), side - 1)


def _why(path: Path, error: sqlite3.Error) -> str:
    """Why SQLite does not read a file, and what to do."""
    found = str(error)
    if found == "interrupted":
        name = shlex.quote(str(path))
        return f"{path} takes too long to search; give it an index: sqlite3 {name} '{_INDEX}'"
    if "locked" in found or "busy" in found:
        return f"{path} is being written by another program; wait until that has ended"
    if "readonly" in found:
        return f"{path} was left half written by another program; make it anew"
    if "no such" in found:
        return f"{path} is a database, but not of MBTiles ({found}); {_HOW}"
    return f"{path} cannot be read as MBTiles ({found}); copy it again, or make it anew"
