"""A picture that lies under the map: an aerial photograph, a site plan, or one in tiles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from air_router.errors import UsageError
from air_router.web.tile_file import Bounds, TileFile

_KINDS = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".webp": "image/webp",
    ".gif": "image/gif",
}
_TILES = ".mbtiles"
_MOST_BYTES = 64 * 1024 * 1024
_WORLD_LINES = 6


@dataclass(frozen=True, slots=True)
class Backdrop:
    """A picture, and where it lies, in degrees.

    Attributes:
        path: The picture, or the file with its tiles.
        kind: Its media type, or that of its tiles.
        bounds: South, west, north and east border; None if a world file says where it lies, or
            tiles do.
        world: Degrees per pixel to the east and to the south (negative), and longitude and
            latitude of the centre of the upper left pixel.
        tiles: What the file has; None if it is one picture.
    """

    path: Path
    kind: str
    bounds: Bounds | None
    world: tuple[float, float, float, float] | None
    tiles: TileFile | None = None

    @classmethod
    def of(cls, path: Path, bounds: str | None) -> Backdrop:
        """A picture with its bounds "S,W,N,E", or with a world file (.pgw, .jgw, .wld) beside it.

        Tiles (.mbtiles) lie where they lie, and take no bounds.

        Raises:
            UsageError: it is no picture, or it is not known where it lies.
        """
        suffix = path.suffix.lower()
        kind = _KINDS.get(suffix)
        if kind is None and suffix != _TILES:
            raise UsageError(
                f"{path} is not a picture that a browser shows; use PNG, JPEG, WebP or MBTiles"
            )
        if not path.is_file():
            raise UsageError(f"there is no picture {path}; correct the path")
        if kind is None:
            return cls._of_tiles(path, bounds)
        if path.stat().st_size > _MOST_BYTES:
            raise UsageError(f"{path} is larger than 64 MiB; make it smaller")
        if bounds is not None:
            return cls(path, kind, bounds_of(bounds), None)
        world = _world_file(path)
        if world is None:
            raise UsageError(
                f"where does {path.name} lie? add its bounds S,W,N,E in degrees (--image-bounds or "
                f"--web-image-bounds), or a world file {path.with_suffix('.wld').name} beside it"
            )
        return cls(path, kind, None, _world(world))

    @classmethod
    def _of_tiles(cls, path: Path, bounds: str | None) -> Backdrop:
        if bounds is not None:
            raise UsageError(
                f"{path} says itself where its tiles lie: leave out its bounds (--image-bounds or "
                "--web-image-bounds)"
            )
        tiles = TileFile.read(path)
        return cls(path, tiles.kind, tiles.bounds, None, tiles)

    def view(self) -> dict[str, Any]:
        """For the page, which knows how many pixels the picture has."""
        tiles = None
        if self.tiles is not None:
            tiles = {
                "address": f"/backdrop/{self.tiles.tag}/{{z}}/{{x}}/{{y}}",
                "lowest": self.tiles.lowest,
                "highest": self.tiles.highest,
                "attribution": self.tiles.attribution,
            }
        return {"bounds": self.bounds, "world": self.world, "tiles": tiles}


def bounds_of(text: str) -> Bounds:
    """Bounds "S,W,N,E" in degrees.

    Raises:
        UsageError: they are none.
    """
    try:
        south, west, north, east = (float(word) for word in text.split(","))
    except ValueError:
        raise UsageError(f"'{text}' is not S,W,N,E: four numbers in degrees") from None
    if not (-90 <= south < north <= 90 and -180 <= west < east <= 180):
        raise UsageError(f"'{text}' is not S,W,N,E in degrees: south < north and west < east")
    return south, west, north, east


def _world_file(path: Path) -> Path | None:
    """The file beside a picture that says where it lies: photo.pgw, photo.pngw or photo.wld."""
    suffix = path.suffix
    names = (f"{suffix[:2]}{suffix[-1]}w", f"{suffix}w", ".wld")
    beside = (path.with_suffix(name) for name in names)
    return next((file for file in beside if file.is_file()), None)


def _world(path: Path) -> tuple[float, float, float, float]:
    try:
        numbers = [float(line) for line in path.read_text(encoding="ascii").split()]
    except (OSError, ValueError):
        numbers = []
    if len(numbers) != _WORLD_LINES:
        raise UsageError(f"{path} is not a world file: six lines with a number each")
    east, turn, turn_too, south, longitude_deg, latitude_deg = numbers
    if turn or turn_too:
        raise UsageError(f"{path}: the picture is turned; save it with north up")
    if not (
        abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180 and 0 < east < 1 and -1 < south < 0
    ):
        raise UsageError(f"{path} is not in degrees; reproject the picture to WGS-84 (EPSG:4326)")
    return east, south, longitude_deg, latitude_deg
