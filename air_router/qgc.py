"""Reads QGroundControl `.plan` files.

Everything that decides where the vehicle flies is either understood or refused with its place in
the file: nothing is dropped silently. Zones may cross the fence here, as they do on many a map.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from air_router.draft import Area, Draft, Keys
from geo.airspace import FENCE
from geo.frame import FrameError, Geodetic, LocalFrame
from mocha_link.document import MAX_BYTES, Document, DocumentError, Problem

_WAYPOINT, _RETURN, _TAKEOFF, _CHANGE_SPEED = 16, 20, 22, 178
_AMSL_FRAMES = (0, 5)
_RELATIVE_FRAMES = (3, 6)
_GROUND_SPEED = 1

_EXPORT_AGAIN = "save the plan with a current QGroundControl"


def read_plan(path: Path) -> Draft:
    """A draft of the mission in a `.plan` file; `team.yaml` and `world.yaml` beside it are used.

    Raises:
        DocumentError: the file cannot be read or is not JSON.
    """
    draft = Draft(_load_json(path))
    data = draft.document.data
    if not isinstance(data, dict) or data.get("fileType") != "Plan":
        draft.complain(
            (), 'not a QGroundControl plan: "fileType" is not "Plan"; choose another file'
        )
        return draft
    draft.name = path.stem
    _PlanReader(draft).read()
    for name in ("team", "world"):
        beside = path.parent / f"{name}.yaml"
        if beside.is_file():
            setattr(draft, name, beside)
    return draft


def _load_json(path: Path) -> Document:
    """A document from JSON: what JSON allows, YAML reads as well, once tabs are blanks."""
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise _unreadable(path, 1, 1, f"cannot read the file: {reason}; check the path") from None
    if len(raw) > MAX_BYTES:
        raise _unreadable(path, 1, 1, f"larger than {MAX_BYTES} bytes; thin the plan out")
    try:
        text = raw.decode("utf-8-sig")
        json.loads(text)
    except UnicodeDecodeError:
        raise _unreadable(path, 1, 1, f"not UTF-8 text; {_EXPORT_AGAIN}") from None
    except json.JSONDecodeError as error:
        message = f"not valid JSON: {error.msg}; {_EXPORT_AGAIN}"
        raise _unreadable(path, error.lineno, error.colno, message) from None
    except RecursionError:
        raise _unreadable(path, 1, 1, f"nested too deeply; {_EXPORT_AGAIN}") from None
    return Document.from_text(text.replace("\t", " "), path)


def _named(keys: Keys) -> str:
    """A value's key and place in lists, for messages: 'params[4]'."""
    name = ""
    for key in reversed(keys):
        name = f"[{key}]{name}" if isinstance(key, int) else f"{key}{name}"
        if isinstance(key, str):
            break
    return f"'{name}'"


def _unreadable(path: Path, line: int, column: int, message: str) -> DocumentError:
    return DocumentError([Problem(path, line, column, message)])


class _PlanReader:
    """Fills a draft from the document's data, noting problems as it goes."""

    def __init__(self, draft: Draft) -> None:
        self._draft = draft
        self._data = draft.document.data
        self._home_amsl_m = math.nan

    def read(self) -> None:
        """Read all sections."""
        self._version((), 1)
        for section in ("mission", "geoFence", "rallyPoints"):
            if self._section(section):
                self._version((section,), 2)
        if not self._read_home():
            return
        self._read_items()
        self._read_fence()
        self._read_rally_points()

    def _at(self, *keys: str | int) -> Any:
        """The value at a key path, None if there is none."""
        value = self._data
        for key in keys:
            try:
                value = value[key]
            except (KeyError, IndexError, TypeError):
                return None
        return value

    def _number(self, *keys: str | int) -> float | None:
        """A number of the file; None, with a problem noted, if it is something else."""
        value = self._at(*keys)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        found = "nothing" if value is None else json.dumps(value)[:40]
        self._draft.complain(keys, f"{_named(keys)} must be a number, found {found}; correct it")
        return None

    def _entries(self, *keys: str | int) -> list[Any]:
        """A list of the file; empty, with a problem noted, if it is something else."""
        value = self._at(*keys)
        if isinstance(value, list):
            return value
        self._draft.complain(keys, f"missing list {_named(keys)}; {_EXPORT_AGAIN}")
        return []

    def _pair(self, *keys: str | int) -> tuple[float, float] | None:
        latitude_deg, longitude_deg = self._number(*keys, 0), self._number(*keys, 1)
        if latitude_deg is None or longitude_deg is None:
            return None
        return latitude_deg, longitude_deg

    def _section(self, name: str) -> bool:
        if isinstance(self._data.get(name), dict):
            return True
        self._draft.complain((), f"missing section '{name}'; {_EXPORT_AGAIN}")
        return False

    def _version(self, keys: Keys, known: int) -> None:
        version = self._at(*keys, "version")
        if version != known:
            what = _named(keys) if keys else "the plan"
            self._draft.complain(
                (*keys, "version"),
                f"{what} has version {json.dumps(version)}, read is {known}; {_EXPORT_AGAIN}",
            )

    def _read_home(self) -> bool:
        keys = ("mission", "plannedHomePosition")
        if not isinstance(self._at(*keys), list):
            self._draft.complain(("mission",), f"missing key '{keys[-1]}'; {_EXPORT_AGAIN}")
            return False
        pair = self._pair(*keys)
        if pair is None:
            return False
        try:
            self._draft.frame = LocalFrame(Geodetic(*pair))
        except FrameError as error:
            self._draft.complain(keys, f"home: {error}; correct it")
            return False
        self._draft.home = self._draft.spot("home", pair, keys)
        altitude_amsl_m = self._at(*keys, 2)
        if isinstance(altitude_amsl_m, int | float):
            self._home_amsl_m = float(altitude_amsl_m)
            self._draft.home_altitude_amsl_m = self._home_amsl_m
        return True

    def _read_items(self) -> None:
        draft = self._draft
        items = self._entries("mission", "items")
        takeoff_m: float | None = None
        speeds: list[float] = []
        for index, item in enumerate(items):
            keys: Keys = ("mission", "items", index)
            command = self._at(*keys, "command")
            if not isinstance(item, dict) or item.get("type") != "SimpleItem":
                kind = (
                    item.get("complexItemType", item.get("type"))
                    if isinstance(item, dict)
                    else item
                )
                draft.complain(
                    (*keys, "type"),
                    f"item {index}: {json.dumps(kind)[:40]} is not read yet; "
                    "replace it by waypoints in QGroundControl",
                )
            elif command == _WAYPOINT:
                self._read_waypoint(keys)
            elif command == _TAKEOFF:
                takeoff_m = self._altitude(keys)
            elif command == _CHANGE_SPEED:
                speeds += self._speed(keys)
            elif command != _RETURN or index != len(items) - 1:
                draft.complain(
                    (*keys, "command"),
                    f"item {index}: command {json.dumps(command)[:40]} is not read yet; "
                    "remove the item in QGroundControl",
                )
        self._settle(takeoff_m, speeds)

    def _settle(self, takeoff_m: float | None, speeds: list[float]) -> None:
        draft = self._draft
        altitudes = [spot.altitude_m for spot in draft.waypoints if spot.altitude_m]
        draft.altitude_m = takeoff_m or max(altitudes, default=0.0)
        if len(set(speeds)) > 1:
            draft.complain(
                ("mission", "items"),
                f"speeds change from {speeds[0]:g} to {speeds[-1]:g} m/s; leave one speed item",
            )
        if speeds:
            draft.speed_m_s = speeds[0]
        elif (hover_m_s := self._number("mission", "hoverSpeed")) is not None:
            draft.speed_m_s = hover_m_s
            if hover_m_s <= 0:
                draft.complain(
                    ("mission", "hoverSpeed"), "the speed must be more than 0; correct it"
                )

    def _read_waypoint(self, keys: Keys) -> None:
        draft = self._draft
        number = len(draft.waypoints) + 1
        latitude_deg = self._number(*keys, "params", 4)
        longitude_deg = self._number(*keys, "params", 5)
        altitude_m = self._altitude(keys)
        if latitude_deg is None or longitude_deg is None or altitude_m is None:
            return
        pair = (latitude_deg, longitude_deg)
        spot = draft.spot(f"waypoint {number}", pair, (*keys, "params", 4), altitude_m)
        draft.waypoints += [spot] if spot else []

    def _altitude(self, keys: Keys) -> float | None:
        """Metres above home of an item, whatever its frame counts from."""
        altitude_m = self._number(*keys, "params", 6)
        frame = self._at(*keys, "frame")
        if altitude_m is None:
            return None
        if frame in _AMSL_FRAMES:
            altitude_m -= self._home_amsl_m
        elif frame not in _RELATIVE_FRAMES:
            self._draft.complain(
                (*keys, "frame"),
                f"altitude frame {json.dumps(frame)} is not read yet; "
                "choose altitudes relative to launch in QGroundControl",
            )
            return None
        if not altitude_m > 0:
            self._draft.complain(
                (*keys, "params", 6),
                f"the altitude is {altitude_m:g} m above home; it must be more than 0",
            )
            return None
        return altitude_m

    def _speed(self, keys: Keys) -> list[float]:
        kind, speed_m_s = self._number(*keys, "params", 0), self._number(*keys, "params", 1)
        if kind is None or speed_m_s is None or speed_m_s == -1:  # -1: no change
            return []
        if kind != _GROUND_SPEED or not 0 < speed_m_s <= 50:
            self._draft.complain(
                (*keys, "params", 1),
                f"a speed of {speed_m_s:g} m/s of type {kind:g}; write a ground speed up to 50 m/s",
            )
            return []
        return [speed_m_s]

    def _read_fence(self) -> None:
        fences: list[Area] = []
        for kind in ("polygons", "circles"):
            for index in range(len(self._entries("geoFence", kind))):
                keys: Keys = ("geoFence", kind, index)
                inclusion = self._at(*keys, "inclusion")
                self._version(keys, 1)
                if not isinstance(inclusion, bool):
                    self._draft.complain(
                        keys,
                        f"'inclusion' must be true (a fence) or false (a zone); {_EXPORT_AGAIN}",
                    )
                    continue
                name = FENCE if inclusion else f"zone {len(self._draft.zones) + 1}"
                area = self._area(name, keys, zone=not inclusion)
                if area is None:
                    self._draft.unread.add("fence")
                elif inclusion:
                    fences.append(area)
                else:
                    self._draft.zones.append(area)
        self._draft.fence = fences[0] if fences else None
        for extra in fences[1:]:
            self._draft.complain(
                extra.keys, "a second fence (inclusion area) is not read yet; draw one around both"
            )

    def _area(self, name: str, keys: Keys, *, zone: bool) -> Area | None:
        label = f"no-fly zone '{name}'" if zone else "the fence"
        if keys[1] == "circles":
            pair = self._pair(*keys, "circle", "center")
            radius_m = self._number(*keys, "circle", "radius")
            if pair is None or radius_m is None:
                return None
            ring = self._draft.circle(label, pair, radius_m, (*keys, "circle"), zone=zone)
        else:
            corners_keys: Keys = (*keys, "polygon")
            count = len(self._entries(*corners_keys))
            pairs = [self._pair(*corners_keys, index) for index in range(count)]
            corners = [pair for pair in pairs if pair is not None]
            if not count or len(corners) < count:
                return None
            ring = self._draft.polygon(label, corners, corners_keys)
        return None if ring is None else Area(name, ring, keys, crosses_fence=True)

    def _read_rally_points(self) -> None:
        for index in range(len(self._entries("rallyPoints", "points"))):
            keys: Keys = ("rallyPoints", "points", index)
            pair = self._pair(*keys)
            if pair is not None:
                spot = self._draft.spot(f"rally point {index + 1}", pair, keys)
                self._draft.rally_points += [spot] if spot else []
