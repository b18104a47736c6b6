"""Values and items of a QGroundControl plan: which are waypoints, and which others to report.

Surveys and corridor scans carry the items that they fly in themselves. What a mission of ours does
not do (cameras, loitering, splines, landing elsewhere) is reported, and stays in the plan's file.
"""

import math
from enum import IntEnum
from typing import Any, Final

from air_router.files import (
    SLOWEST_M_S,
    Findings,
    JsonValues,
    Keys,
    WaypointForm,
    named,
    shown,
)
from air_router.files.missions.form_builder import FormBuilder
from air_router.files.missions.placed_form import MissionPoint, Placer

SAME_PLACE_M: Final = 0.1
_AT_HOME_M: Final = 20.0
NOT_FLOWN: Final = "not-flown"
"""The code of notes about items that only the plan's file keeps."""
_AMSL_FRAMES, RELATIVE_FRAMES, _TERRAIN_FRAMES = (0, 5), (3, 6), (10, 11)
_GROUND_SPEED = 1
_FASTEST_M_S: Final = 50.0
_HIGHEST_M: Final = 10_000.0


class MavCommand(IntEnum):
    """MAV_CMD values with a meaning of their own for a mission."""

    WAYPOINT = 16
    LOITER_UNLIMITED = 17
    LOITER_TURNS = 18
    LOITER_TIME = 19
    RETURN_TO_LAUNCH = 20
    LAND = 21
    TAKEOFF = 22
    LOITER_TO_ALTITUDE = 31
    SPLINE_WAYPOINT = 82
    VTOL_TAKEOFF = 84
    VTOL_LAND = 85
    DELAY = 93
    CHANGE_SPEED = 178


_AS_WAYPOINTS: Final = {
    MavCommand.LOITER_UNLIMITED: "without loitering",
    MavCommand.LOITER_TURNS: "without circling",
    MavCommand.LOITER_TIME: "without loitering",
    MavCommand.LOITER_TO_ALTITUDE: "without loitering",
    MavCommand.SPLINE_WAYPOINT: "on straight legs, not on a spline",
}
_TAKEOFFS: Final = (MavCommand.TAKEOFF, MavCommand.VTOL_TAKEOFF)
_ENDS: Final = (MavCommand.RETURN_TO_LAUNCH, MavCommand.LAND, MavCommand.VTOL_LAND)
_FIRST_NAV, _LAST_NAV = 16, 95
_FENCE_AND_RALLY: Final = range(5000, 5101)
_USER_WAYPOINTS: Final = range(31000, 31005)


EXPORT_AGAIN: Final = "save the plan with a current QGroundControl"
_DROPPED: Final = "QGroundControl itself silently drops the whole section; it is read here"


class PlanValues(JsonValues):
    """Reads values of a plan; what is wrong with them is reported."""

    def __init__(self, findings: Findings, data: Any) -> None:
        super().__init__(data, findings.report)
        self.findings = findings

    def pair(self, *keys: str | int, first: int = 0) -> tuple[float, float] | None:
        """Latitude and longitude in a list, mostly at its begin."""
        latitude_deg, longitude_deg = self.number((*keys, first)), self.number((*keys, first + 1))
        if latitude_deg is None or longitude_deg is None:
            return None
        return latitude_deg, longitude_deg

    def has_version(self, keys: Keys, known: int) -> bool:
        """Whether the part of the plan at `keys` has this version."""
        version = self.at(*keys, "version")
        return bool(version == known) and not isinstance(version, bool)

    def version(self, keys: Keys, known: int, *, dropped: bool = False) -> None:
        """Report unless the part of the plan at `keys` has this version.

        QGroundControl drops some parts of another version: those are read, and it is noted.
        """
        if self.has_version(keys, known):
            return
        found, what = shown(self.at(*keys, "version")), named(keys) if keys else "the plan"
        advice = _DROPPED if dropped else EXPORT_AGAIN
        message = f"{what} has version {found}, read is {known}; {advice}"
        note = self.findings.note if dropped else self.findings.report
        note((*keys, "version"), message, "plan-version")


class ItemsReader(PlanValues):
    """Fills a form's waypoints, altitude and speed from the plan's items.

    Args:
        placer: Its frame lies around home.
        data: The plan's.
        form: Has its home.
    """

    def __init__(self, placer: Placer, data: Any, form: FormBuilder) -> None:
        super().__init__(placer.findings, data)
        self._placer, self._form = placer, form
        self._waypoints = list[MissionPoint]()  # to compare them
        self._takeoff_m: float | None = None  # altitude of the take-off item
        self._speeds: list[tuple[float, Keys]] = []  # in m/s, and the item's keys
        self._others: dict[int, list[Keys]] = {}  # places of items that are not flown, by command
        self._end: Keys | None = None  # item after which nothing is flown
        self._places: dict[tuple[int, int], list[MissionPoint]] = {}  # waypoints by cell

    def read(self) -> None:
        """Read all items."""
        for keys in self.entries(("mission", "items"), advice=EXPORT_AGAIN):
            self._read_item(keys)
        for command, places in self._others.items():
            times = "" if len(places) == 1 else f" ({len(places)} times)"
            message = f"command {command}{times} stays in the plan's file and is not flown"
            self.findings.note((*places[0], "command"), message, NOT_FLOWN)
        self._settle()

    def _read_item(self, keys: Keys) -> None:
        item = self.at(*keys)
        kind = item.get("type") if isinstance(item, dict) else None
        if kind == "SimpleItem":
            self._read_simple(keys)
        elif kind == "ComplexItem":
            self._read_complex(keys)
        else:
            found = shown(item if kind is None else kind)
            message = f"an item must be a SimpleItem or a ComplexItem, found {found}; remove it"
            self.findings.report((*keys, "type"), message, "unknown-item")

    def _read_complex(self, keys: Keys) -> None:
        kind = self.at(*keys, "complexItemType")
        inner: Keys = (*keys, "TransectStyleComplexItem", "Items")
        if not isinstance(self.at(*inner), list):
            message = (
                f"{shown(kind)} stays in the plan's file and is not flown: the file does not "
                "contain its path"
            )
            self.findings.note((*keys, "complexItemType"), message, NOT_FLOWN)
            return
        before = len(self._waypoints)
        for item in self.entries(inner):
            self._read_item(item)
        count = len(self._waypoints) - before
        message = f"{shown(kind)}: flown by way of its {count} waypoints"
        self.findings.note((*keys, "complexItemType"), message, "survey-waypoints")

    def _read_simple(self, keys: Keys) -> None:
        command = self.at(*keys, "command")
        if not isinstance(command, int) or isinstance(command, bool):
            message = f"an item's command must be a whole number, found {shown(command)}; remove it"
            self.findings.report((*keys, "command"), message, "wrong-type")
        elif command == MavCommand.WAYPOINT or command in _AS_WAYPOINTS:
            self._read_waypoint(keys, command)
        elif command in _TAKEOFFS:
            self._takeoff_m = self._altitude(keys)
        elif command == MavCommand.CHANGE_SPEED:
            self._read_speed(keys)
        elif command in _ENDS:
            self._read_end(keys, command)
        elif command == MavCommand.DELAY or not _decides_where(command):
            self._others.setdefault(command, []).append(keys)
        else:
            message = f"command {command} is not read yet; remove the item in QGroundControl"
            self.findings.report((*keys, "command"), message, "unknown-command")

    def _read_waypoint(self, keys: Keys, command: int) -> None:
        findings = self.findings
        pair = self.pair(*keys, "params", first=4)
        altitude_m = self._altitude(keys)
        if self._end is not None:
            message = "the plan returns or lands before this waypoint; put that item last"
            findings.report((*self._end, "command"), message, "end-before-waypoint")
            self._end = None
        if pair is None or altitude_m is None:
            return
        label = f"waypoint {len(self._waypoints) + 1}"
        spot = self._placer.spot(label, pair, (*keys, "params", 4), altitude_m)
        if spot is None:
            return
        other = self._same_place(spot)
        if other is not None:
            message = f"this waypoint lies on {other.label}: visited once"
            findings.note(spot.keys, message, "waypoint-twice")
            return
        self._waypoints.append(spot)
        entry = WaypointForm.model_construct(position=list(pair), altitude_m=altitude_m)
        self._form.append("waypoints", entry, position=spot.keys)
        if command in _AS_WAYPOINTS:
            how = _AS_WAYPOINTS[MavCommand(command)]
            message = f"{label} is command {command}: flown as a waypoint, {how}"
            findings.note((*keys, "command"), message, "flown-as-waypoint")

    def _same_place(self, spot: MissionPoint) -> MissionPoint | None:
        """An earlier waypoint at this place; the grid's cells are as wide as that."""
        east, north = (math.floor(metres / SAME_PLACE_M) for metres in spot.position)
        around = [(east + i, north + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        for cell in around:
            for other in self._places.get(cell, ()):
                if math.dist(other.position, spot.position) < SAME_PLACE_M:
                    return other
        self._places.setdefault((east, north), []).append(spot)
        return None

    def _altitude(self, keys: Keys) -> float | None:
        """Metres above home of an item, whatever its frame counts from."""
        altitude_m = self.number((*keys, "params", 6))
        frame = self.at(*keys, "frame")
        if altitude_m is None:
            return None
        if frame in _TERRAIN_FRAMES and self.at(*keys, "AMSLAltAboveTerrain") is not None:
            altitude_m = self.number((*keys, "AMSLAltAboveTerrain"))
            frame = _AMSL_FRAMES[0]
        if frame in _AMSL_FRAMES and altitude_m is not None:
            altitude_m = self._above_home(altitude_m, keys)
        elif frame in _TERRAIN_FRAMES:
            self._refuse_frame(
                keys, "an altitude above the terrain, whose height here is not in the plan"
            )
            return None
        elif frame not in RELATIVE_FRAMES:
            self._refuse_frame(keys, f"altitude frame {shown(frame)} is not read")
            return None
        if altitude_m is not None and not 0 < altitude_m <= _HIGHEST_M:
            message = f"the altitude is {altitude_m:g} m above home; it must be more than 0 and at "
            message += f"most {_HIGHEST_M:g} m"
            self.findings.report((*keys, "params", 6), message, "out-of-range")
            return None
        return altitude_m

    def _refuse_frame(self, keys: Keys, why: str) -> None:
        message = (
            f"{why}; in QGroundControl set the item's altitude to 'Relative To Launch', or to "
            "'Calc Above Terrain', which stores the terrain's height; in Mission Planner to "
            "'Relative'"
        )
        self.findings.report((*keys, "frame"), message, "altitude-frame")

    def _above_home(self, altitude_amsl_m: float, keys: Keys) -> float | None:
        home_amsl_m: float | None = self._form.values["home"].altitude_amsl_m
        if home_amsl_m is None:
            message = "an altitude above the sea, and home has none; give 'plannedHomePosition' one"
            self.findings.report((*keys, "params", 6), message, "home-altitude-unknown")
            return None
        return altitude_amsl_m - home_amsl_m

    def _read_speed(self, keys: Keys) -> None:
        kind, speed_m_s = self.number((*keys, "params", 0)), self.number((*keys, "params", 1))
        if kind is None or speed_m_s is None or speed_m_s in (-1, -2):  # no change, the default
            return
        if kind != _GROUND_SPEED or not SLOWEST_M_S <= speed_m_s <= _FASTEST_M_S:
            message = f"a speed of {speed_m_s:g} m/s of type {kind:g}; write a ground speed of "
            message += f"{SLOWEST_M_S:g} to {_FASTEST_M_S:g} m/s"
            self.findings.report((*keys, "params", 1), message, "out-of-range")
            return
        self._speeds.append((speed_m_s, (*keys, "params", 1)))

    def _read_end(self, keys: Keys, command: int) -> None:
        self._end = keys
        if command == MavCommand.RETURN_TO_LAUNCH:
            return
        latitude_deg, longitude_deg = self.at(*keys, "params", 4), self.at(*keys, "params", 5)
        if not latitude_deg and not longitude_deg:  # where the vehicle is by then
            latitude_deg = longitude_deg = None
        far_m = self._from_home_m(latitude_deg, longitude_deg)
        if far_m > _AT_HOME_M:
            where = f"{far_m:.0f} m from home" if math.isfinite(far_m) else "wherever it is by then"
            message = f"command {command} lands {where}; a mission of ours lands at home"
            self.findings.note((*keys, "command"), message, "lands-at-home")

    def _from_home_m(self, latitude_deg: Any, longitude_deg: Any) -> float:
        """How far a place is from home; infinite if it is none."""
        try:
            place = self._placer.frame.to_local(float(latitude_deg), float(longitude_deg))
        except (TypeError, ValueError, OverflowError):
            return math.inf
        return math.hypot(*place)

    def _settle(self) -> None:
        findings, form = self.findings, self._form
        altitudes = [spot.altitude_m for spot in self._waypoints if spot.altitude_m]
        form.put("altitude_m", self._takeoff_m or max(altitudes, default=0.0))
        if self._speeds:
            slowest_m_s = min(speed_m_s for speed_m_s, _ in self._speeds)
            form.put("speed_m_s", slowest_m_s)
            first_m_s = self._speeds[0][0]
            differing = [keys for speed_m_s, keys in self._speeds if speed_m_s != first_m_s]
            if differing:
                message = f"the speed changes; flown is the slowest, {slowest_m_s:g} m/s"
                findings.note(differing[0], message, "speeds-differ")
        elif (hover_m_s := self.number(("mission", "hoverSpeed"))) is not None:
            form.put("speed_m_s", hover_m_s)
            if not SLOWEST_M_S <= hover_m_s <= _FASTEST_M_S:
                message = f"the speed must be {SLOWEST_M_S:g} to {_FASTEST_M_S:g} m/s"
                findings.report(("mission", "hoverSpeed"), f"{message}; correct it", "out-of-range")


def _decides_where(command: int) -> bool:
    """Whether an unknown command has a place to fly to, or to avoid."""
    return (
        _FIRST_NAV <= command <= _LAST_NAV
        or command in _FENCE_AND_RALLY
        or command in _USER_WAYPOINTS
    )
