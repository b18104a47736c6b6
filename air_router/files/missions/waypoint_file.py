"""Reads waypoint files: the lines of these are items of a plan.

Waypoint files ("QGC WPL 110") are those of Mission Planner, MAVProxy and QGroundControl, with an
item of twelve columns on each line. The first is home where it is a waypoint above the sea, as
ArduPilot's programs write it. Fences and rally points are files of that form, too.
"""

import math
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from air_router.files import (
    DEFAULT_SPEED_M_S,
    CircleForm,
    Findings,
    Keys,
    MissionForm,
    PlacedSource,
    SpotForm,
    ZoneForm,
)
from air_router.files.maps import (
    FENCE_COMMANDS,
    FenceCommand,
    FenceItem,
    MapCircle,
    fence_areas,
    old_fence_items,
)
from air_router.files.missions.form_builder import FormBuilder, note_form
from air_router.files.missions.placed_form import Placer
from air_router.files.missions.qgc_items import NOT_FLOWN, ItemsReader, MavCommand
from mocha_link.team import DocumentError, Problem, ProblemList

_FENCE: Final = "fence"
"""The begin of keys that count all of the file's items, not only those that are flown."""

_VERSION: Final = "QGC WPL 110"
_COLUMNS: Final = 12
_FRAME, _COMMAND, _PARAMS = 2, 3, 4
_AMSL_FRAME: Final = 0


class _WaypointFile:
    """The file's lines, which know where a value stands. Keys are those of a plan's items.

    Attributes:
        path: The file.
        flown: Which of the file's items are the plan's: without home, fences and rally points.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.flown: list[int] = []
        lines = enumerate(text.splitlines(), start=1)
        rows = [(number, list(re.finditer(r"\S+", line))) for number, line in lines]
        self._rows = [(number, columns) for number, columns in rows if columns][1:]  # line, columns

    def problem(self, keys: Sequence[str | int], message: str, code: str) -> Problem:
        """A problem with the value at `("mission", "items", row, "params", number)`, or alike."""
        if len(keys) < 3 or not isinstance(keys[2], int):
            return Problem(self.path, 1, 1, message, code)
        index = keys[2] if keys[0] == _FENCE else self.flown[keys[2]]
        number, columns = self._rows[index]
        column = {"frame": _FRAME, "command": _COMMAND, "params": _PARAMS}.get(str(keys[-1]), 0)
        if len(keys) == 5 and isinstance(keys[4], int):
            column = _PARAMS + keys[4]
        return Problem(self.path, number, columns[column].start() + 1, message, code)

    def items(self) -> list[dict[str, Any]]:
        """The lines as items of a plan.

        Raises:
            DocumentError: with every line that is not twelve numbers.
        """
        problems, items = ProblemList(), []
        for number, columns in self._rows:
            numbers = [_number(column[0], whole=i < _PARAMS) for i, column in enumerate(columns)]
            if len(columns) != _COLUMNS:
                message = f"an item has {_COLUMNS} columns, found {len(columns)}; export again"
                wrong = partial(Problem, self.path, number, 1, message, "wrong-length")
                problems.add(self.path, "wrong-length", wrong)
            elif None in numbers:
                column = columns[numbers.index(None)]
                message = f"'{column[0][:20]}' is not such a number; correct it"
                wrong = partial(
                    Problem, self.path, number, column.start() + 1, message, "wrong-type"
                )
                problems.add(self.path, "wrong-type", wrong)
            else:
                frame, command, *params = numbers[_FRAME:-1]
                items.append(
                    {"type": "SimpleItem", "frame": frame, "command": command, "params": params}
                )
        if found := list(problems):
            raise DocumentError(found)
        return items


def read_waypoints(text: str, path: Path) -> tuple[MissionForm, Findings]:
    """The mission in a waypoint file, and what was found.

    Raises:
        DocumentError: it is none, of another version, or a line is not an item.
    """
    first = text.partition("\n")[0].strip()
    if first != _VERSION:
        message = f"the first line is '{first[:40]}', read is '{_VERSION}'; export the file again"
        raise DocumentError.at(path, message, "plan-version")
    document = _WaypointFile(path, text)
    findings, form = Findings(document), FormBuilder({"name": path.stem})
    items = document.items()
    places = [row for row, item in enumerate(items) if item["params"][4] or item["params"][5]]
    if not places:
        findings.report((), "no waypoints in it; export the file again", "no-waypoints")
        return form.form(path), findings
    start = places[0]
    home = items[start]
    *place, altitude_m = home["params"][4:]
    keys: Keys = (_FENCE, "items", start, "params", 4)
    placer = Placer.around("home", place, keys, findings)
    if placer is None:
        return form.form(path), findings
    document.flown = [n for n, item in enumerate(items) if item["command"] not in FENCE_COMMANDS]
    if start == 0 and (home["command"], home["frame"]) == (MavCommand.WAYPOINT, _AMSL_FRAME):
        document.flown.remove(0)
    else:
        altitude_m = None
        message = "the file has no home: the first place in it is taken; move it"
        findings.note(keys, message, "home-assumed")
    form.set_home(place, keys, altitude_m)
    flown = [items[number] for number in document.flown]
    data = {"mission": {"items": flown, "hoverSpeed": DEFAULT_SPEED_M_S}}
    ItemsReader(placer, data, form).read()
    fence = [
        FenceItem(FenceCommand(item["command"]), *_of_fence(item), (_FENCE, "items", number))
        for number, item in enumerate(items)
        if item["command"] in FENCE_COMMANDS
    ]
    _add_fences(findings, form, fence)
    made = form.form(path)
    note_form(made, findings)
    return made, findings


def read_old_fence(text: str, path: Path) -> tuple[MissionForm, Findings]:
    """A mission with the fence of an old `.fen` file, and with its return point as home."""
    findings, form = Findings(PlacedSource(path)), FormBuilder({"name": path.stem})
    items = old_fence_items(text)
    if len(items) < 2:
        findings.report((), "no corners in it; draw the fence again", "zone-too-few-corners")
        return form.form(path), findings
    point, *corners = items
    home = (point.latitude_deg, point.longitude_deg)
    if Placer.around("the fence", home, point.keys, findings):
        form.set_home(home, point.keys)
        message = "a fence has no home: its return point is taken; move it"
        findings.note(point.keys, message, "home-assumed")
        _add_fences(findings, form, corners)
    return form.form(path), findings


def _of_fence(item: dict[str, Any]) -> tuple[float, float, float]:
    """An item's first parameter, latitude and longitude."""
    return item["params"][0], item["params"][4], item["params"][5]


def _add_fences(findings: Findings, form: FormBuilder, items: Sequence[FenceItem]) -> None:
    """Add fences, zones and rally points."""
    for area in fence_areas(items):
        if area.shape is None:
            number = len(form.values.get("no_fly_zones", ())) + 1
            label = "the fence" if area.inclusion else f"no-fly zone 'zone {number}'"
            findings.report(area.keys, f"{label}: {area.error}", "wrong-form")
            continue
        shape: dict[str, Any]
        if isinstance(area.shape, MapCircle):
            centre, radius_m = list(area.shape.centre), area.shape.radius_m
            shape = {"circle": CircleForm.model_construct(centre=centre, radius_m=radius_m)}
        else:
            shape = {"polygon": [list(corner) for corner in area.shape.ring]}
        section = "fences" if area.inclusion else "no_fly_zones"
        entry = ZoneForm.model_construct(**shape, crosses_fence=True)
        form.append(section, entry, entry=area.keys, polygon=area.keys, circle=area.keys)
    for item in items:
        place = [item.latitude_deg, item.longitude_deg]
        if item.command is FenceCommand.RALLY_POINT:
            spot = SpotForm.model_construct(position=place)
            form.append("rally_points", spot, position=item.keys)
        elif item.command is FenceCommand.RETURN_POINT:
            findings.note(item.keys, "the fence's return point is not flown", NOT_FLOWN)


def _number(column: str, *, whole: bool) -> float | None:
    try:
        value = float(column)
    except ValueError:
        return None
    if whole:
        return int(value) if value.is_integer() else None
    return value if math.isfinite(value) else None
