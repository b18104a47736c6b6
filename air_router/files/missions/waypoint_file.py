"""Waypoint files of Mission Planner, MAVProxy and QGroundControl ("QGC WPL 110"), read.

A line is an item of a plan, in twelve columns. The first is home where it is a waypoint above the
sea, as ArduPilot's programs write it. Such a file has no fence, no zones and no rally points.
"""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from air_router.files.mission_document import MissionDocument
from air_router.files.missions.qgc_items import ItemsReader, MavCommand
from air_router.files.settings import DEFAULT_SPEED_M_S
from mocha_link.team.problem import DocumentError, Problem

HEADER: Final = "QGC WPL"
_VERSION: Final = f"{HEADER} 110"
_COLUMNS: Final = 12
_FRAME, _COMMAND, _PARAMS = 2, 3, 4
_AMSL_FRAME: Final = 0


class WaypointFile:
    """The file's lines, which know where a value stands. Keys are those of a plan's items.

    Attributes:
        path: The file.
        first: Which line is the plan's first item; 1 where home stands before it.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path, self.first = path, 0
        lines = enumerate(text.splitlines(), start=1)
        rows = [(number, list(re.finditer(r"\S+", line))) for number, line in lines]
        self._rows = [(number, words) for number, words in rows if words][1:]  # line, words

    def problem(self, keys: Sequence[str | int], message: str, code: str) -> Problem:
        """A problem with the value at `("mission", "items", row, "params", number)`, or alike."""
        if len(keys) < 3 or not isinstance(keys[2], int):
            return Problem(self.path, 1, 1, message, code)
        number, words = self._rows[self.first + keys[2]]
        column = {"frame": _FRAME, "command": _COMMAND, "params": _PARAMS}.get(str(keys[-1]), 0)
        if len(keys) == 5 and isinstance(keys[4], int):
            column = _PARAMS + keys[4]
        return Problem(self.path, number, words[column].start() + 1, message, code)

    def items(self) -> list[dict[str, Any]]:
        """The lines as items of a plan.

        Raises:
            DocumentError: with every line that is not twelve numbers.
        """
        problems, items = [], []
        for number, words in self._rows:
            numbers = [_number(word[0], whole=i < _PARAMS) for i, word in enumerate(words)]
            if len(words) != _COLUMNS:
                message = f"an item has {_COLUMNS} columns, found {len(words)}; export again"
                problems.append(Problem(self.path, number, 1, message, "wrong-length"))
            elif None in numbers:
                wrong = words[numbers.index(None)]
                message = f"'{wrong[0][:20]}' is not such a number; correct it"
                problems.append(
                    Problem(self.path, number, wrong.start() + 1, message, "wrong-type")
                )
            else:
                frame, command, *params = numbers[_FRAME:-1]
                items.append(
                    {"type": "SimpleItem", "frame": frame, "command": command, "params": params}
                )
        if problems:
            raise DocumentError(problems)
        return items


def read_waypoints(text: str, path: Path) -> MissionDocument:
    """A draft of the mission in a waypoint file.

    Raises:
        DocumentError: it is none, of another version, or a line is not an item.
    """
    first = text.partition("\n")[0].strip()
    if first != _VERSION:
        message = f"the first line is '{first[:40]}', read is '{_VERSION}'; export the file again"
        raise DocumentError.at(path, message, "plan-version")
    document = WaypointFile(path, text)
    draft = MissionDocument(document, path.stem)
    items = document.items()
    places = [row for row, item in enumerate(items) if item["params"][4] or item["params"][5]]
    if not places:
        draft.report((), "no waypoints in it; export the file again", "no-waypoints")
        return draft
    home = items[places[0]]
    keys = ("mission", "items", places[0], "params", 4)
    latitude_deg, longitude_deg, altitude_m = home["params"][4:]
    if not draft.find_frame("home", (latitude_deg, longitude_deg), keys):
        return draft
    draft.home = draft.spot("home", (latitude_deg, longitude_deg), keys)
    if home is items[0] and (home["command"], home["frame"]) == (MavCommand.WAYPOINT, _AMSL_FRAME):
        draft.home_altitude_amsl_m = altitude_m
        document.first = 1
    else:
        message = "the file has no home: the first place in it is taken; move it"
        draft.note(keys, message, "home-assumed")
    plan = {"items": items[document.first :], "hoverSpeed": DEFAULT_SPEED_M_S}
    ItemsReader(draft, {"mission": plan}).read()
    return draft


def _number(word: str, *, whole: bool) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    if whole:
        return int(value) if value.is_integer() else None
    return value if math.isfinite(value) else None
