"""Writes a mission as a QGroundControl plan, as far as a plan can contain it.

A plan's fence knows polygons and circles that are kept to or kept out of, at every altitude and at
all times. Other zones of a mission become larger, never smaller, and are reported as losses.
"""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from air_router.files import (
    Area,
    JsonDocument,
    MissionForm,
    json_text,
)
from air_router.files.maps import MapCircle, MapRing, map_area_of
from air_router.files.missions.placed_form import PlacedForm
from air_router.files.missions.qgc_items import MavCommand
from geo.airspace import Circle
from geo.frame import Geodetic, LocalFrame

RELATIVE_FRAME: Final = 3
_MISSION_FRAME: Final = 2
_PX4, _MULTIROTOR = 12, 2
_GROUND_SPEED: Final = 1.0

_DEGREE_DIGITS: Final = 10
"""Of degrees that are written: a hundredth of a millimetre."""


@dataclass(frozen=True, slots=True, order=True)
class ConversionWarning:
    """Something that was not carried over.

    Attributes:
        what: The part of the mission, as text.
        message: What became of it.
        code: The same for programs.
    """

    what: str
    message: str
    code: str

    def __str__(self) -> str:
        return f"{self.what}: {self.message} [{self.code}]"


@dataclass(slots=True)
class ConversionWarnings:
    """The losses of one conversion, each reported once."""

    entries: list[ConversionWarning] = field(default_factory=list)  # in the order of their finding

    def add(self, what: str, message: str, code: str) -> None:
        """Note a loss."""
        loss = ConversionWarning(what, message, code)
        if loss not in self.entries:
            self.entries.append(loss)


def plan_of(placed: PlacedForm, warnings: ConversionWarnings) -> dict[str, Any]:
    """A new plan's data. The mission has a frame and a home."""
    if placed.frame is None or placed.home is None:
        raise ValueError("a mission without a home is no plan")
    frame, speed_m_s = placed.frame, placed.form.speed_m_s
    home = frame.to_geodetic(placed.home.position)
    altitude_m = placed.home_altitude_amsl_m
    if altitude_m is None:
        message = "home's height above the sea is not known: written as 0"
        warnings.add("home", message, "home-altitude-unknown")
    fence = _areas(placed.fences, frame, warnings, inclusion=True)
    zones = _areas(placed.zones, frame, warnings, inclusion=False)
    rally_points = [
        [*_rounded(frame.to_geodetic(spot.position)), 0.0] for spot in placed.rally_points
    ]
    report_settings(placed.form, warnings, "a plan")
    return {
        "fileType": "Plan",
        "geoFence": {**{kind: fence[kind] + zones[kind] for kind in sorted(fence)}, "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": speed_m_s,
            "firmwareType": _PX4,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": speed_m_s,
            "items": _items(placed, frame, home),
            "plannedHomePosition": [*_rounded(home), altitude_m or 0.0],
            "vehicleType": _MULTIROTOR,
            "version": 2,
        },
        "rallyPoints": {"points": rally_points, "version": 2},
        "version": 1,
    }


def _areas(
    areas: Iterable[Area], frame: LocalFrame, warnings: ConversionWarnings, *, inclusion: bool
) -> dict[str, list[Any]]:
    """Fences, or zones, as entries of the lists `polygons` and `circles` of a plan's fence."""
    found: dict[str, list[Any]] = {"circles": [], "polygons": []}
    for area in areas:
        shape = map_area_of(area, frame).shape
        if isinstance(shape, MapCircle):
            circle = {"center": _rounded(shape.centre), "radius": shape.radius_m}
            found["circles"].append({"circle": circle, "inclusion": inclusion, "version": 1})
        else:
            found["polygons"].append(_polygon(shape.ring, inclusion=inclusion))
            holes = shape.holes if inclusion else ()
            found["polygons"] += [_polygon(hole, inclusion=False) for hole in holes]
        _warn_of_losses(area, warnings, inclusion=inclusion)
    return found


def with_zones(
    plan: JsonDocument, zones: Sequence[Area], frame: LocalFrame, warnings: ConversionWarnings
) -> str:
    """The text of a plan, which stays what it is and gets more zones."""
    if not zones:
        return plan.text
    data = copy.deepcopy(plan.data)
    fence = data["geoFence"] = data.get("geoFence") or {"version": 2}
    for kind, entries in _areas(zones, frame, warnings, inclusion=False).items():
        if entries:
            fence[kind] = [*(fence.get(kind) or []), *entries]
    return json_text(data, like=plan.text)


def _polygon(ring: MapRing, *, inclusion: bool) -> dict[str, Any]:
    return {"inclusion": inclusion, "polygon": [*map(_rounded, ring)], "version": 1}


def _warn_of_losses(area: Area, warnings: ConversionWarnings, *, inclusion: bool) -> None:
    what = "a fence" if inclusion else f"no-fly zone '{area.name}'"
    if not inclusion and not isinstance(area.shape, Circle) and area.shape.holes:
        warnings.add(what, "its holes are closed: a plan's zones have none", "holes-closed")
    if area.terms.altitudes is not None:
        warnings.add(what, "it reaches over all altitudes: a plan's zones do", "altitudes-lost")
    if area.terms.validity is not None:
        warnings.add(what, "it applies always: a plan's zones do", "schedule-lost")
    if area.terms.clearance_m is not None:
        warnings.add(what, "its own clearance is not in the plan", "clearance-lost")
    if not inclusion and not area.name.removeprefix("zone ").isdigit():
        warnings.add("names of zones", "a plan's zones have none", "names-lost")


def _items(placed: PlacedForm, frame: LocalFrame, home: Geodetic) -> list[dict[str, Any]]:
    form = placed.form
    speed = [_GROUND_SPEED, form.speed_m_s, -1.0, 0.0, 0.0, 0.0, 0.0]
    steps: list[tuple[MavCommand, list[Any], int]] = [
        (MavCommand.CHANGE_SPEED, speed, _MISSION_FRAME),
        (MavCommand.TAKEOFF, [0, 0, 0, None, *_rounded(home), form.altitude_m], RELATIVE_FRAME),
    ]
    for spot in placed.waypoints:
        place = _rounded(frame.to_geodetic(spot.position))
        params = [0, form.planner.acceptance_radius_m, 0, None, *place]
        params.append(spot.altitude_m or form.altitude_m)
        steps.append((MavCommand.WAYPOINT, params, RELATIVE_FRAME))
    steps.append((MavCommand.RETURN_TO_LAUNCH, [0.0] * 7, _MISSION_FRAME))
    return [
        simple_item(command, params, number=number, frame=altitude_frame)
        for number, (command, params, altitude_frame) in enumerate(steps, start=1)
    ]


def simple_item(
    command: MavCommand, params: list[Any], *, number: int, frame: int = RELATIVE_FRAME
) -> dict[str, Any]:
    """A simple item as QGroundControl writes it; `number` counts the plan's items from 1."""
    altitude = {"AMSLAltAboveTerrain": None, "Altitude": params[6] or 0.0, "AltitudeMode": 1}
    return {
        **(altitude if frame == RELATIVE_FRAME else {}),
        "autoContinue": True,
        "command": int(command),
        "doJumpId": number,
        "frame": frame,
        "params": params,
        "type": "SimpleItem",
    }


def _rounded(place: Geodetic) -> list[float]:
    return [round(degrees, _DEGREE_DIGITS) for degrees in place]


_ONLY_OURS: Final = (
    *("altitudes_m", "timers", "planner", "team", "world", "uav", "uavs", "seek"),
    *("when_explored", "goals_from", "duration_s", "endurance_s", "battery_reserve", "accepts"),
)


def report_settings(form: MissionForm, warnings: ConversionWarnings, where: str) -> None:
    """Note the settings of a mission that only a mission file has."""
    for what in _ONLY_OURS:
        if getattr(form, what) != MissionForm.model_fields[what].get_default():
            warnings.add(what, f"{where} has none; keep the mission file", "settings-lost")
