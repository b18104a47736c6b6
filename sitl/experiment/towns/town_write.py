"""Writes towns as `town_file` reads them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

from geo.frame import Point
from sitl.experiment.towns.town import Town

_WIDTH = 98


def town_text(town: Town) -> str:
    """A town as YAML; read again it is the same town."""
    lines = [
        f"name: {json.dumps(town.name)}",
        f"frame: {{origin: {_pair(town.frame.origin)}}}",
        f"home: {_pair(town.home)}",
        "bounds: {" + ", ".join(f"{key}: {v!r}" for key, v in town.bounds._asdict().items()) + "}",
        "outline:",
        _points(town.outline, "  "),
        "roads:",
    ]
    for road in town.roads:
        lines += [f"  - width_m: {road.width_m!r}", _points(road.points, "    points: ")]
    for key in ("vegetation", "buildings", "yards"):
        rings = getattr(town, key)
        lines.append(f"{key}:" if rings else f"{key}: []")
        lines += [_points(ring, "  - ") for ring in rings]
    lines.append("goals:" if town.goals else "goals: {}")
    lines += [f"  {json.dumps(goal.id)}: {_pair(goal.position)}" for goal in town.goals]
    lines += ["starts:", _points(town.starts, "  ")]
    return "\n".join(lines) + "\n"


def _points(points: Iterable[Point], indent: str) -> str:
    """A list of pairs after an indent, in lines that are not too long."""
    lines, line = [], indent + "["
    for number, point in enumerate(points):
        pair = _pair(point)
        if number:
            line += ","
            if len(line) + len(pair) > _WIDTH:
                lines.append(line)
                line = " " * (len(indent) + 1) + pair
                continue
            line += " "
        line += pair
    return "\n".join([*lines, line + "]"])


def _pair(pair: Sequence[float]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in pair) + "]"
