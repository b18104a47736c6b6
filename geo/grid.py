"""Semantic grids: what stands on the ground, seen from above, one class per square cell.

A grid belongs to a local frame (its `origin`); rows run north, columns run east, and cell [0, 0]
is the south-west one. On the wire: a small header, then the cells, row by row; little-endian.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from geo.frame import FrameError, Geodetic, LocalFrame, Point

Cells = npt.NDArray[np.uint8]

MAX_CELLS = 4_000_000
"""The most cells that a grid may have: 1 km x 1 km at half a metre."""

_VERSION = 1
_GRID = struct.Struct("<4sB3xdddddII")
_PATCH = struct.Struct("<4sB3xdddII")
_MAGIC = {_GRID: b"SGRD", _PATCH: b"SPAT"}


class GridError(ValueError):
    """A grid or patch with invalid numbers or bytes; the message names them."""


class Terrain(IntEnum):
    """Semantic classes of a cell, as the paper's ground robots use them."""

    UNKNOWN = 0
    ROAD = 1
    VEGETATION = 2
    BUILDING = 3
    GRASS = 4
    VEHICLE = 5
    HUMAN = 6
    GRAVEL = 7


@dataclass(frozen=True, slots=True, eq=False)
class GridPatch:
    """A rectangle of freshly seen cells, its south-west corner in metres of the local frame.

    Raises:
        GridError: a number is not finite, the resolution is not positive, or the cells are not a
            two-dimensional array of known classes within `MAX_CELLS`.
    """

    west_m: float
    south_m: float
    resolution_m: float
    cells: Cells

    def __post_init__(self) -> None:
        _check(self.west_m, self.south_m, self.resolution_m, self.cells)

    def encode(self) -> bytes:
        """Header and cells as bytes."""
        return _encoded(_PATCH, self.cells, self.resolution_m, self.west_m, self.south_m)

    @classmethod
    def decode(cls, data: bytes) -> GridPatch:
        """The patch that `encode` wrote; raises GridError on anything else."""
        (resolution_m, west_m, south_m), cells = _decoded(_PATCH, data)
        return cls(west_m, south_m, resolution_m, cells)


@dataclass(slots=True, eq=False)
class SemanticGrid:
    """The map that grows while a vehicle flies, and that its peers receive.

    Attributes:
        origin: WGS-84 origin of the local frame of `west_m` and `south_m`.
        resolution_m: edge of a cell.
        west_m: east coordinate of the western edge.
        south_m: north coordinate of the southern edge.
        cells: classes (`Terrain`), row = north, column = east; changed by `paint`.

    Raises:
        GridError: as for `GridPatch`, or the origin is not a place on Earth.
    """

    origin: Geodetic
    resolution_m: float
    west_m: float
    south_m: float
    cells: Cells

    def __post_init__(self) -> None:
        _check(self.west_m, self.south_m, self.resolution_m, self.cells)
        try:
            LocalFrame(self.origin)
        except FrameError as error:
            raise GridError(f"the grid's origin: {error}") from error

    @classmethod
    def blank(
        cls, origin: Geodetic, resolution_m: float, south_west: Point, north_east: Point
    ) -> SemanticGrid:
        """An unknown grid that covers the rectangle; edges are moved out to whole cells."""
        corners = (*south_west, *north_east)
        if not all(map(math.isfinite, corners)) or not 0 < resolution_m < math.inf:
            raise GridError(f"no grid over {south_west}..{north_east} at {resolution_m} m per cell")
        west = math.floor(south_west.east_m / resolution_m)
        south = math.floor(south_west.north_m / resolution_m)
        columns = math.ceil(north_east.east_m / resolution_m) - west
        rows = math.ceil(north_east.north_m / resolution_m) - south
        if rows < 1 or columns < 1 or rows * columns > MAX_CELLS:
            raise GridError(f"a grid of {rows} x {columns} cells; allowed are 1..{MAX_CELLS} cells")
        cells = np.zeros((rows, columns), dtype=np.uint8)
        return cls(origin, resolution_m, west * resolution_m, south * resolution_m, cells)

    @property
    def known_cells(self) -> int:
        """How many cells are not `Terrain.UNKNOWN`."""
        return int(np.count_nonzero(self.cells))

    def paint(self, patch: GridPatch) -> int:
        """Enter what the patch knows; returns how many cells became known.

        Unknown cells of the patch change nothing; what lies outside of the grid is cut off.

        Raises:
            GridError: the patch has another resolution, or its cells lie between the grid's.
        """
        row, column = self._offset(patch)
        mine, theirs = _overlap(self.cells, patch.cells, row, column)
        seen = theirs != Terrain.UNKNOWN
        fresh = int(np.count_nonzero(seen & (mine == Terrain.UNKNOWN)))
        mine[seen] = theirs[seen]
        return fresh

    def encode(self) -> bytes:
        """Header and cells as bytes; not compressed (the gossip node does that)."""
        numbers = (*self.origin, self.resolution_m, self.west_m, self.south_m)
        return _encoded(_GRID, self.cells, *numbers)

    @classmethod
    def decode(cls, data: bytes) -> SemanticGrid:
        """The grid that `encode` wrote; raises GridError on anything else."""
        (latitude_deg, longitude_deg, resolution_m, west_m, south_m), cells = _decoded(_GRID, data)
        return cls(Geodetic(latitude_deg, longitude_deg), resolution_m, west_m, south_m, cells)

    def _offset(self, other: GridPatch) -> tuple[int, int]:
        """Row and column of this grid at which cell [0, 0] of the other one lies."""
        if not math.isclose(self.resolution_m, other.resolution_m, rel_tol=1e-6):
            raise GridError(
                f"cells of {other.resolution_m} m do not fit cells of {self.resolution_m} m"
            )
        row = (other.south_m - self.south_m) / self.resolution_m
        column = (other.west_m - self.west_m) / self.resolution_m
        if abs(row - round(row)) > 0.01 or abs(column - round(column)) > 0.01:
            raise GridError("the cells do not align: corners must differ by whole cells")
        return round(row), round(column)


def _overlap(mine: Cells, theirs: Cells, row: int, column: int) -> tuple[Cells, Cells]:
    """Views of the cells that both arrays cover, theirs[0, 0] lying at mine[row, column]."""
    top = min(mine.shape[0], row + theirs.shape[0])
    right = min(mine.shape[1], column + theirs.shape[1])
    bottom, left = max(row, 0), max(column, 0)
    if top <= bottom or right <= left:
        return mine[:0, :0], theirs[:0, :0]
    return (
        mine[bottom:top, left:right],
        theirs[bottom - row : top - row, left - column : right - column],
    )


def _check(west_m: float, south_m: float, resolution_m: float, cells: Cells) -> None:
    if not all(map(math.isfinite, (west_m, south_m))) or abs(west_m) + abs(south_m) > 1e7:
        raise GridError(f"the corner {west_m}, {south_m} is not within 10 000 km of the origin")
    if not 1e-3 <= resolution_m <= 1e4:
        raise GridError(f"a resolution of {resolution_m} m; allowed are 0.001..10000 m per cell")
    if cells.dtype != np.uint8 or cells.ndim != 2:
        raise GridError(f"cells must be a 2-D array of uint8, not {cells.ndim}-D {cells.dtype}")
    if not 0 < cells.size <= MAX_CELLS:
        raise GridError(f"{cells.size} cells; allowed are 1..{MAX_CELLS}")
    if int(cells.max()) > max(Terrain):
        raise GridError(f"cell class {int(cells.max())} is unknown; the last one is {max(Terrain)}")


def _encoded(layout: struct.Struct, cells: Cells, *numbers: float) -> bytes:
    """A header with these numbers, and the cells behind it."""
    header = layout.pack(_MAGIC[layout], _VERSION, *numbers, *cells.shape)
    return header + cells.tobytes()


def _decoded(layout: struct.Struct, data: bytes) -> tuple[list[float], Cells]:
    """The numbers of a header, and the cells behind it; raises GridError."""
    if len(data) < layout.size:
        raise GridError(f"{len(data)} bytes are too few for a header of {layout.size}")
    magic, version, *numbers, rows, columns = layout.unpack_from(data)
    if magic != _MAGIC[layout]:
        raise GridError(f"starts with {magic!r}, expected {_MAGIC[layout]!r}")
    if version != _VERSION:
        raise GridError(f"format version {version}; this program reads version {_VERSION}")
    if not 0 < rows * columns <= MAX_CELLS:
        raise GridError(f"announces {rows} x {columns} cells; allowed are 1..{MAX_CELLS}")
    body = data[layout.size :]
    if len(body) != rows * columns:
        raise GridError(f"holds {len(body)} bytes of cells, announces {rows} x {columns}")
    return numbers, np.frombuffer(body, np.uint8).reshape(rows, columns).copy()
