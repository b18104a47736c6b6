"""Reads QGroundControl `.plan` files, and waypoint files: their lines are items of a plan.

Everything that decides where the vehicle flies is understood, told of, or refused with its place in
the file: nothing is dropped silently. Zones may cross the fence here, as they do on many a map.

Waypoint files ("QGC WPL 110") are those of Mission Planner, MAVProxy and QGroundControl, with an
item of twelve columns on each line. The first is home where it is a waypoint above the sea, as
ArduPilot's programs write it. Such a file has no fence, no zones and no rally points.
"""

import math
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from air_router.files.json_document import JsonDocument
from air_router.files.mission_document import Area, Keys, MissionDocument
from air_router.files.missions.qgc_items import (
    EXPORT_AGAIN,
    NOT_FLOWN,
    ItemsReader,
    MavCommand,
    PlanValues,
)
from air_router.files.settings import DEFAULT_SPEED_M_S, HIGHEST_HOME_M, LOWEST_HOME_M
from geo.airspace.airspace import FENCE
from geo.airspace.zone import Shape
from mocha_link.team.problem import DocumentError, Problem, ProblemList

PLAN_TYPE = "Plan"


def plan_draft(document: JsonDocument) -> MissionDocument:
    """A draft of the mission in a `.plan` file; `team.yaml` and `world.yaml` beside it are used.

    The document's data stay as they are.
    """
    draft = MissionDocument(document)
    data = document.data
    if not isinstance(data, dict) or data.get("fileType") != PLAN_TYPE:
        message = 'not a QGroundControl plan: "fileType" is not "Plan"; choose another file'
        draft.report(("fileType",), message, "not-a-plan")
        return draft
    draft.name = document.path.stem
    _PlanReader(draft, data).read()
    for name in ("team", "world"):
        beside = document.path.parent / f"{name}.yaml"
        if beside.is_file():
            setattr(draft, name, beside)
    return draft


class _PlanReader(PlanValues):
    """Fills a draft from the document's data, noting problems as it goes."""

    def read(self) -> None:
        """Read all sections."""
        self.version((), 1)
        if not self._section("mission"):
            return
        self.version(("mission",), 2)
        if not self._read_home():
            return
        ItemsReader(self.draft, self._data).read()
        self._read_fence()
        self._read_rally_points()

    def _section(self, name: str) -> bool:
        if isinstance(self.at(name), dict):
            return True
        message = f"missing section '{name}'; {EXPORT_AGAIN}"
        self.draft.report((name,), message, "missing-key")
        return False

    def _optional_section(self, name: str, without: str) -> bool:
        """A section that other programs leave out, with a note of what that means."""
        if self.at(name) is not None:
            if found := self._section(name):
                self.version((name,), 2, dropped=True)
            return found
        message = f"the plan has no section '{name}': {without}; QGroundControl writes one"
        self.draft.note((), message, "no-section")
        return False

    def _read_home(self) -> bool:
        keys = ("mission", "plannedHomePosition")
        if not isinstance(self.at(*keys), list):
            message = f"missing key '{keys[-1]}'; {EXPORT_AGAIN}"
            self.draft.report(keys, message, "missing-key")
            return False
        pair = self.pair(*keys)
        if pair is None or not self.draft.find_frame("home", pair, keys):
            return False
        self.draft.home = self.draft.spot("home", pair, keys)
        if self.at(*keys, 2) is not None:
            self._read_home_altitude((*keys, 2))
        return True

    def _read_home_altitude(self, keys: Keys) -> None:
        altitude_m = self.number(keys)
        if altitude_m is not None and not LOWEST_HOME_M <= altitude_m <= HIGHEST_HOME_M:
            message = (
                f"home is {altitude_m:g} m above the sea; it must be {LOWEST_HOME_M:g} to "
                f"{HIGHEST_HOME_M:g} m"
            )
            self.draft.report(keys, f"{message}; correct it", "out-of-range")
            altitude_m = None
        self.draft.home_altitude_amsl_m = altitude_m

    def _read_fence(self) -> None:
        if not self._optional_section("geoFence", "there is no fence"):
            return
        current = self.has_version(("geoFence",), 2)
        if not current and self.at("geoFence", "polygon"):
            message = f"a fence as QGroundControl drew it years ago is not read; {EXPORT_AGAIN}"
            self.draft.report(("geoFence", "polygon"), message, "plan-version")
            self.draft.unread.add("fence")
        for kind in ("polygons", "circles"):
            if not current and self.at("geoFence", kind) is None:
                continue
            for keys in self.entries(("geoFence", kind), advice=EXPORT_AGAIN):
                self._read_area(keys)
        if self.at("geoFence", "breachReturn") is not None:
            message = "the breach return point stays in the plan's file and is not flown"
            self.draft.note(("geoFence", "breachReturn"), message, NOT_FLOWN)

    def _read_area(self, keys: Keys) -> None:
        draft = self.draft
        inclusion = self.at(*keys, "inclusion")
        self.version(keys, 1)
        if not isinstance(inclusion, bool):
            message = f"'inclusion' must be true (a fence) or false (a zone); {EXPORT_AGAIN}"
            code = "missing-key" if inclusion is None else "wrong-type"
            draft.report((*keys, "inclusion"), message, code)
            return
        name = FENCE if inclusion else f"zone {len(draft.zones) + 1}"
        shape = self._shape("the fence" if inclusion else f"no-fly zone '{name}'", keys)
        if shape is None:
            draft.unread.add("fence")
        else:
            areas = draft.fences if inclusion else draft.zones
            areas.append(Area(name, shape, keys, crosses_fence=not inclusion))

    def _shape(self, label: str, keys: Keys) -> Shape | None:
        if keys[1] == "circles":
            centre = self.pair(*keys, "circle", "center")
            radius_m = self.number((*keys, "circle", "radius"))
            if centre is None or radius_m is None:
                return None
            return self.draft.circle(label, centre, radius_m, (*keys, "circle"))
        corners: Keys = (*keys, "polygon")
        pairs = [self.pair(*corner) for corner in self.entries(corners)]
        known = [pair for pair in pairs if pair is not None]
        if len(known) < len(pairs) or not isinstance(self.at(*corners), list):
            return None
        return self.draft.polygon(label, known, corners)

    def _read_rally_points(self) -> None:
        if not self._optional_section("rallyPoints", "there are no rally points"):
            return
        points = self.entries(("rallyPoints", "points"), advice=EXPORT_AGAIN)
        for number, keys in enumerate(points, start=1):
            pair = self.pair(*keys)
            if pair is not None:
                spot = self.draft.spot(f"rally point {number}", pair, keys)
                self.draft.rally_points += [spot] if spot else []


# Waypoint files


_VERSION: Final = "QGC WPL 110"
_COLUMNS: Final = 12
_FRAME, _COMMAND, _PARAMS = 2, 3, 4
_AMSL_FRAME: Final = 0


class _WaypointFile:
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
        problems, items = ProblemList(), []
        for number, words in self._rows:
            numbers = [_number(word[0], whole=i < _PARAMS) for i, word in enumerate(words)]
            if len(words) != _COLUMNS:
                message = f"an item has {_COLUMNS} columns, found {len(words)}; export again"
                wrong = partial(Problem, self.path, number, 1, message, "wrong-length")
                problems.add(self.path, "wrong-length", wrong)
            elif None in numbers:
                word = words[numbers.index(None)]
                message = f"'{word[0][:20]}' is not such a number; correct it"
                wrong = partial(Problem, self.path, number, word.start() + 1, message, "wrong-type")
                problems.add(self.path, "wrong-type", wrong)
            else:
                frame, command, *params = numbers[_FRAME:-1]
                items.append(
                    {"type": "SimpleItem", "frame": frame, "command": command, "params": params}
                )
        if found := list(problems):
            raise DocumentError(found)
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
    document = _WaypointFile(path, text)
    draft = MissionDocument(document, path.stem)
    items = document.items()
    places = [row for row, item in enumerate(items) if item["params"][4] or item["params"][5]]
    if not places:
        draft.report((), "no waypoints in it; export the file again", "no-waypoints")
        return draft
    home = items[places[0]]
    keys = ("mission", "items", places[0], "params", 4)
    *place, altitude_m = home["params"][4:]
    if not draft.find_frame("home", place, keys):
        return draft
    draft.home = draft.spot("home", place, keys)
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
