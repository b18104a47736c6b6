import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo.frame import Geodetic, Point
from geo.grid import MAX_CELLS, GridError, GridPatch, SemanticGrid, Terrain

ORIGIN = Geodetic(39.94, -75.2)


def blank(resolution_m=0.5, south_west=(-3.2, -1), north_east=(3.1, 2)):
    return SemanticGrid.blank(ORIGIN, resolution_m, Point(*south_west), Point(*north_east))


def cells(*rows):
    return np.array(rows, dtype=np.uint8)


def test_blank_grid_covers_the_rectangle_with_whole_cells():
    grid = blank()
    assert (grid.west_m, grid.south_m) == (-3.5, -1)
    assert grid.cells.shape == (6, 14)
    assert grid.known_cells == 0


def test_painting_enters_what_is_known_and_counts_what_is_new():
    grid = blank(1, (0, 0), (4, 3))
    assert grid.paint(GridPatch(1, 1, 1, cells([1, 0], [2, 3]))) == 3
    assert grid.paint(GridPatch(1, 1, 1, cells([4, 0], [0, 0]))) == 0
    assert grid.cells.tolist() == [[0, 0, 0, 0], [0, 4, 0, 0], [0, 2, 3, 0]]
    assert grid.known_cells == 3


@pytest.mark.parametrize(
    ("corner", "painted"),
    [((-1, -1), 1), ((3, 2), 1), ((-1, 2), 1), ((9, 9), 0), ((-9, 0), 0), ((1, 1), 4)],
)
def test_a_patch_is_cut_off_at_the_edges(corner, painted):
    grid = blank(1, (0, 0), (4, 3))
    assert grid.paint(GridPatch(*corner, 1, cells([1, 1], [1, 1]))) == painted


def test_patches_that_do_not_fit_are_refused():
    grid = blank(1, (0, 0), (4, 3))
    with pytest.raises(GridError, match=r"cells of 2 m do not fit cells of 1 m"):
        grid.paint(GridPatch(0, 0, 2, cells([1])))
    with pytest.raises(GridError, match="do not align"):
        grid.paint(GridPatch(0.5, 0, 1, cells([1])))


@given(
    st.integers(1, 30),
    st.integers(1, 30),
    st.floats(-1e4, 1e4),
    st.floats(0.01, 10),
    st.integers(0, 2**32 - 1),
)
def test_grids_and_patches_survive_the_wire(rows, columns, west_m, resolution_m, seed):
    painted = np.random.default_rng(seed).integers(0, len(Terrain), (rows, columns), np.uint8)
    grid = SemanticGrid(ORIGIN, resolution_m, west_m, -7.25, painted)
    back = SemanticGrid.decode(grid.encode())
    assert (back.origin, back.resolution_m, back.west_m, back.south_m) == (
        grid.origin,
        grid.resolution_m,
        grid.west_m,
        grid.south_m,
    )
    assert np.array_equal(back.cells, painted)
    patch = GridPatch.decode(GridPatch(west_m, 3, resolution_m, painted).encode())
    assert np.array_equal(patch.cells, painted)
    assert patch.west_m == west_m


def test_a_decoded_grid_can_be_painted():
    grid = SemanticGrid.decode(blank(1, (0, 0), (2, 2)).encode())
    assert grid.paint(GridPatch(0, 0, 1, cells([1, 1]))) == 2


@given(st.binary(max_size=200))
def test_any_bytes_give_a_grid_or_a_grid_error(data):
    for prefix in (b"", b"SGRD\x01\0\0\0", b"SPAT\x01\0\0\0"):
        for kind in (SemanticGrid, GridPatch):
            with contextlib.suppress(GridError):
                kind.decode(prefix + data)


def header(**changes):
    fields = {"version": 1, "latitude": 1.0, "longitude": 2.0, "resolution": 1.0}
    fields |= {"west": 0.0, "south": 0.0, "rows": 1, "columns": 1}
    return struct.pack("<4sB3xdddddII", b"SGRD", *(fields | changes).values())


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"SGRD", "too few"),
        (b"WHAT" + header()[4:] + b"\1", "starts with"),
        (header(version=2) + b"\1", "version 2"),
        (header() + b"\1\1", "holds 2 bytes"),
        (header(rows=2**31, columns=2**31) + b"\1", "announces"),
        (header(rows=0) + b"", "announces"),
        (header(rows=1, columns=MAX_CELLS + 1), "announces"),
        (header(latitude=float("nan")) + b"\1", "latitude"),
        (header(resolution=0.0) + b"\1", "resolution"),
        (header(resolution=float("nan")) + b"\1", "resolution"),
        (header(west=float("inf")) + b"\1", "corner"),
        (header() + b"\x63", "class 99"),
    ],
)
def test_wrong_bytes_are_named(data, reason):
    with pytest.raises(GridError, match=reason):
        SemanticGrid.decode(data)


def test_impossible_grids_are_refused():
    with pytest.raises(GridError, match="allowed are"):
        blank(0.001, (0, 0), (1e4, 1e4))
    with pytest.raises(GridError, match="no grid over"):
        blank(1, (float("nan"), 0), (1, 1))
    with pytest.raises(GridError, match="2-D array of uint8"):
        GridPatch(0, 0, 1, np.zeros(3))
