"""The mission file of a rehearsal: hurried, and drawn into by an operator while it is flown."""

from __future__ import annotations

import copy
import functools
import math
from pathlib import Path
from typing import Any, Final

import yaml

from geo.frame import LocalFrame, Point

HOME_CLEAR_M: Final = 8.0
"""Nearer to home than this the file would be refused."""

_WALL_M, _THICK_M = 22.0, 6.0
"""How far from where the vehicle was first walls are drawn, and how thick."""

_SIDES: Final = ((0, 1), (0, -1), (1, 0), (-1, 0))
_TIMERS: Final = {"init_s": 40, "explore_s": 25, "search_s": 10, "communicate_s": 10}
_FILES: Final = ("team", "world")


class RehearsalFileError(Exception):
    """A mission that cannot be rehearsed."""


@functools.cache
def hurried(path: Path) -> dict[str, Any]:
    """A mission in a hurry: the paper's times divided, a few minutes in all.

    Raises:
        RehearsalFileError: it is no mission in YAML.
    """
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not isinstance(document, dict) or "home" not in document:
        raise RehearsalFileError(f"{path}: only missions in YAML are rehearsed")
    folder = path.absolute().parent
    for key in _FILES:
        if key in document:
            document[key] = str(folder / document[key])
    if "no_fly_files" in document:
        document["no_fly_files"] = [str(folder / name) for name in document["no_fly_files"]]
    return {**document, "timers": _TIMERS, "speed_m_s": 5, "duration_s": 170}


def with_room(document: dict[str, Any], points: int = 44) -> dict[str, Any]:
    """A mission with so few zones that more can be drawn: PX4 stores 64 points of a fence."""
    zones = list(document["no_fly_zones"])
    corners = len(document["fence"] or ()) if isinstance(document["fence"], list) else 1
    while zones and corners + sum(len(zone.get("polygon", "1")) for zone in zones) > points:
        zones.pop()
    return {**document, "no_fly_zones": zones}


class MissionFile:
    """A mission file that an operator draws zones into.

    Args:
        path: Where it is written.
        document: What is in it.

    Attributes:
        text: What is in it now.
        frame: The mission's local frame, once it is known.
    """

    def __init__(self, path: Path, document: dict[str, Any]) -> None:
        self.path = path
        self._document = document
        self._before = document
        self._middle: Point | None = None  # of the four walls; None: none was drawn yet
        self._walls: list[str] = []  # names of those that stand, the last one opens first
        self.frame: LocalFrame
        self.text = ""
        self._write(document)

    def circle(self, place: Point, radius_m: float, home: Point) -> str | None:
        """Draw a circle; its name, None where it would be refused."""
        if math.dist(place, home) - radius_m < HOME_CLEAR_M:
            return None
        shape = {"circle": {"centre": self._degrees(place), "radius_m": radius_m}}
        return self._draw({f"added {len(self._document['no_fly_zones'])}": shape})

    def wall(self, vehicle: Point, side: int, home: Point) -> str | None:
        """Draw one of four walls around where the vehicle was at the first of them."""
        self._middle = vehicle if self._middle is None else self._middle
        shape = self._wall(self._middle, side, home)
        if shape is None:
            return None
        self._walls.append(f"wall {side}")
        return self._draw({self._walls[-1]: shape})

    def enclose(self, vehicle: Point, home: Point) -> str | None:
        """Draw all four walls at once: nothing leads out, home least of all."""
        shapes = [self._wall(vehicle, side, home) for side in range(len(_SIDES))]
        named = {f"wall {side}": shape for side, shape in enumerate(shapes) if shape is not None}
        inside = max(abs(home[axis] - vehicle[axis]) for axis in (0, 1)) <= _WALL_M
        if inside or len(named) < len(_SIDES):
            return None
        self._walls = list(named)
        return self._draw(named)

    def _wall(self, around: Point, side: int, home: Point) -> dict[str, Any] | None:
        """One wall around a place; None where it would be refused."""
        east, north = _SIDES[side]
        out_m, along_m = _WALL_M + _THICK_M / 2, _WALL_M + _THICK_M
        middle = around[0] + east * out_m, around[1] + north * out_m
        half = (_THICK_M / 2, along_m) if east else (along_m, _THICK_M / 2)
        away = [max(abs(home[axis] - middle[axis]) - half[axis], 0.0) for axis in (0, 1)]
        if math.hypot(*away) < HOME_CLEAR_M:
            return None
        corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ring = [Point(middle[0] + e * half[0], middle[1] + n * half[1]) for e, n in corners]
        return {"polygon": [self._degrees(corner) for corner in ring]}

    def open(self) -> bool:
        """Take away the wall that was drawn last."""
        if not self._walls:
            return False
        name = self._walls.pop()
        changed = copy.deepcopy(self._document)
        changed["no_fly_zones"] = [z for z in changed["no_fly_zones"] if z.get("name") != name]
        self._write(changed)
        return True

    def undo(self) -> None:
        """The last change was not taken: the file is again as it is flown."""
        self._write(self._before)

    def _draw(self, shapes: dict[str, dict[str, Any]]) -> str:
        changed = copy.deepcopy(self._document)
        changed["no_fly_zones"] += [
            {"name": name, "crosses_fence": True, **shape} for name, shape in shapes.items()
        ]
        self._write(changed)
        return next(iter(shapes))

    def _write(self, document: dict[str, Any]) -> None:
        self._before, self._document = self._document, document
        self.text = yaml.safe_dump(document, sort_keys=False)
        self.path.write_text(self.text, encoding="utf-8")

    def _degrees(self, place: Point) -> list[float]:
        return [round(degrees, 8) for degrees in self.frame.to_geodetic(place)]
