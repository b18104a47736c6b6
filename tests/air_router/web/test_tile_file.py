"""What is read of MBTiles files, and of those that are none."""

import contextlib
import os
import sqlite3

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.errors import UsageError
from air_router.web.tile_file import MOST_TILE_BYTES, TileError, TileFile, plain, read_bounds
from tests.air_router.tile_maker import around, picture, tile_at, write_tiles

PLACE = (39.942, -75.2)
NEAR = "-75.21,39.93,-75.19,39.95"
PNG = picture(0, 0)
TILES = around(17, *PLACE)
ENDLESS = (
    "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "
    "SELECT 3 AS zoom_level, x AS tile_column, 1 AS tile_row,"
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "site #1?.mbtiles"


def refused(path):
    with pytest.raises(UsageError) as caught:
        TileFile.read(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_tiles_are_found_by_row_from_the_north_whatever_kind_they_are(path):
    column, row = tile_at(17, *PLACE)
    finer = [(18, 2 * column, 2 * row, picture(0, 1, "JPEG"))]
    finer.append((18, 2 * column + 1, 2 * row, picture(1, 1, "WEBP")))
    finer.append((18, 2 * column, 2 * row + 1, b"\xff\xd8\xff" + bytes(MOST_TILE_BYTES)))
    tiles = TileFile.read(write_tiles(path, TILES + finer, bounds=NEAR, format="png"))
    assert (tiles.lowest, tiles.highest) == (17, 18)
    assert tiles.bounds == (39.93, -75.21, 39.95, -75.19)
    assert tiles.tile(17, column, row - 1) == ("image/png", picture(column, row - 1))
    assert tiles.tile(18, 2 * column, 2 * row).kind == "image/jpeg"
    assert tiles.tile(18, 2 * column + 1, 2 * row).kind == "image/webp"
    with pytest.raises(TileError, match=f"tile 18/{2 * column}/{2 * row + 1} is no picture"):
        tiles.tile(18, 2 * column, 2 * row + 1)
    for nowhere in ((17, column + 2, row), (17, 2**17, 0), (16, 0, 0), (10**9, 10**9, 10**9)):
        assert tiles.tile(*nowhere) is None


def test_a_view_of_other_tables_is_as_good(path):
    write_tiles(path, [])
    with contextlib.closing(sqlite3.connect(path)) as file, file:
        file.executescript(
            "DROP TABLE tiles; CREATE TABLE map (z, x, y, id, PRIMARY KEY (z, x, y));"
            "CREATE TABLE images (id PRIMARY KEY, data);"
            "CREATE VIEW tiles AS SELECT z AS zoom_level, x AS tile_column, y AS tile_row, "
            "data AS tile_data FROM map JOIN images USING (id)"
        )
        file.execute("INSERT INTO images VALUES ('one', ?)", (PNG,))
        file.executemany("INSERT INTO map VALUES (9, ?, 511, 'one')", ((x,) for x in range(512)))
    assert TileFile.read(path).tile(9, 400, 0) == ("image/png", PNG)


def test_nothing_is_written_beside_a_file_with_a_log_and_a_running_log_is_read(path):
    write_tiles(path, [(3, 1, 2, PNG)])
    with contextlib.closing(sqlite3.connect(path)) as file:
        file.execute("PRAGMA journal_mode = WAL")
        assert TileFile.read(path).highest == 3
        file.execute("INSERT INTO tiles VALUES (4, 1, 2, ?)", (PNG,))
        file.commit()
        assert TileFile.read(path).highest == 4
    assert TileFile.read(path).tile(4, 1, 13) == ("image/png", PNG)
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    ("tiles", "facts", "why"),
    [
        ([], {}, "has no tiles"),
        ([(30, 1, 2, PNG)], {}, "no tiles at zoom levels 0 to 24"),
        ([(3, 1, 2, b"\x1f\x8b...")], {"format": "pbf"}, "vector tiles, which this map does not"),
        ([(3, 1, 2, b"\x1f\x8b...")], {}, "vector tiles"),
        ([(3, 1, 2, "text"), (3, 2, 2, b"GIF89a"), (3, 3, 2, None)], {}, "neither PNG nor JPEG"),
        ([(3, 1, 2, b"\x89PNG\r\n\x1a\n" + bytes(MOST_TILE_BYTES))], {}, "at most 1 MiB"),
    ],
)
def test_files_whose_tiles_are_not_pictures_are_refused(path, tiles, facts, why):
    assert why in refused(write_tiles(path, tiles, **facts))


def test_files_that_are_something_else_are_refused(path, tmp_path):
    assert "cannot be read: No such file" in refused(path)
    for content in (b"", b"PK\x03\x04" * 50, b"SQLite format 3\0"):
        path.write_bytes(content)
        assert "no SQLite database" in refused(path)
    path.write_bytes(write_tiles(tmp_path / "whole.mbtiles", TILES).read_bytes()[:9000])
    assert "malformed" in refused(path)
    os.truncate(path, 33 * 1024**3)
    assert "larger than 32 GiB" in refused(path)
    path.unlink()
    with contextlib.closing(sqlite3.connect(path)) as file:
        file.execute("CREATE TABLE gpkg_contents (table_name text)")
        assert "not of MBTiles (no such table" in refused(path)
        file.execute("BEGIN EXCLUSIVE")
        assert "being written by another program" in refused(path)


@pytest.mark.parametrize(
    ("columns", "why"),
    [
        (f"{ENDLESS} X'89504E470D0A1A0A' AS tile_data FROM c", "give it an index: sqlite3 '/"),
        ("SELECT 3 AS zoom_level, load_extension('x') AS tile_data", "unsafe use"),
    ],
)
def test_what_a_file_may_have_done_is_bounded(path, columns, why):
    write_tiles(path, [])
    with contextlib.closing(sqlite3.connect(path)) as file:
        file.executescript(f"DROP TABLE tiles; CREATE VIEW tiles AS {columns}")
    assert why in refused(path)


def test_bounds_that_are_wrong_hide_nothing_and_rows_from_the_north_are_noticed(path):
    for bounds in ("170,-10,171,-9", "nonsense", "-75.19,39.93,-75.21,39.95"):
        path.unlink(missing_ok=True)
        assert TileFile.read(write_tiles(path, TILES, bounds=bounds)).bounds is None
    path.unlink()
    mirrored = [(zoom, column, 2**zoom - 1 - row, data) for zoom, column, row, data in TILES]
    assert "counts rows of tiles from the north" in refused(
        write_tiles(path, mirrored, bounds=NEAR)
    )


@given(text=st.text(st.sampled_from("-+.,0189eEinfa_ \x00"), max_size=40))
def test_bounds_are_turned_round_and_no_text_of_them_is_an_error(text):
    assert read_bounds("-75.3, 39.9,-75.1,40") == (39.9, -75.3, 40.0, -75.1)
    for nowhere in ("1,2,3", "0,0,0,1", "0,1,1,0", "0,0,181,1", "0,0,1,91", "nan,0,1,1"):
        assert read_bounds(nowhere) is None
    bounds = read_bounds(text)
    assert bounds is None or bounds[0] < bounds[2]


def test_whom_to_name_is_plain_text():
    assert plain('&copy; <a href="x">Some\n City</a>, 2024') == "© Some City, 2024"
    assert plain("<script>alert(1)</script>&lt;b&gt; <style>p{}</style>A\u202eB<br>") == ("<b> A B")
    assert len(plain("word " * 10_000)) == 200


@given(html=st.text(st.sampled_from("<>/!-&;#x=\"'ab sctyle\x00\u202e"), max_size=80))
def test_no_text_of_whom_to_name_is_an_error(html):
    text = plain(html)
    assert len(text) <= 200
    assert text.isprintable()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    file = tmp_path_factory.mktemp("tiles") / "whole.mbtiles"
    write_tiles(file, TILES, bounds=NEAR)
    return TileFile.read(file), file.read_bytes()


@given(data=st.data())
def test_damage_is_an_error_of_ours_at_the_start_and_in_flight(whole, data):
    tiles, content = whole
    places = st.one_of(st.integers(0, 200), st.integers(0, len(content) - 1))
    altered = bytearray(content)
    for at in data.draw(st.lists(places, max_size=20)):
        altered[at] ^= 1 << at % 8
    if data.draw(st.booleans()):
        del altered[data.draw(places) :]
    tiles.path.write_bytes(altered)
    for zoom, column, row, _ in TILES:
        with contextlib.suppress(TileError):
            tile = tiles.tile(zoom, column, row)
            assert tile is None or tile.kind == "image/png"
    with contextlib.suppress(UsageError):
        TileFile.read(tiles.path)
