"""MBTiles files for tests: every tile has one colour, which encodes where it lies."""

import contextlib
import io
import math
import sqlite3

from PIL import Image

TABLE = "CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, {}"
TABLE = TABLE.format("tile_data blob, UNIQUE (zoom_level, tile_column, tile_row))")


def colour_of(column, row):
    """The colour of a tile; neighbours differ much."""
    return (60 + 120 * (column % 2), 60 + 120 * (row % 2), 30)


def picture(column, row, kind="PNG"):
    """A real picture of 256 by 256 pixels."""
    written = io.BytesIO()
    Image.new("RGB", (256, 256), colour_of(column, row)).save(written, kind)
    return written.getvalue()


def tile_at(zoom, latitude_deg, longitude_deg):
    """Column and row, from the north, of the tile with a place: the usual Web Mercator formula."""
    latitude = math.radians(latitude_deg)
    x = (longitude_deg + 180) / 360
    y = (1 - math.asinh(math.tan(latitude)) / math.pi) / 2
    return int(x * 2**zoom), int(y * 2**zoom)


def around(zoom, latitude_deg, longitude_deg, reach=1):
    """Zoom level, column, row and picture of the tiles around a place."""
    column, row = tile_at(zoom, latitude_deg, longitude_deg)
    return [
        (zoom, x, y, picture(x, y))
        for x in range(column - reach, column + reach + 1)
        for y in range(row - reach, row + reach + 1)
    ]


def write_tiles(path, tiles, *, schema=TABLE, **facts):
    """A file with tiles, whose rows are counted from the north, and with metadata."""
    with contextlib.closing(sqlite3.connect(path)) as file, file:
        file.execute("CREATE TABLE metadata (name text, value text)")
        file.executemany("INSERT INTO metadata VALUES (?, ?)", facts.items())
        file.execute(schema)
        file.executemany(
            "INSERT INTO tiles VALUES (?, ?, ?, ?)",
            ((zoom, column, 2**zoom - 1 - row, data) for zoom, column, row, data in tiles),
        )
    return path
