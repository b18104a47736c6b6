"""Writes a mission as a QGroundControl plan, as far as a plan can say it.

A plan's fence knows polygons and circles that are kept to or kept out of, at every altitude and at
all times. What a mission knows beyond that becomes larger, never smaller, and is told as a loss.
"""

from __future__ import annotations

from typing import Any, Final

from air_router.files.conversion_warnings import ConversionWarnings
from air_router.files.maps.feature_set import corners_of
from air_router.files.mission_document import Area, MissionDocument
from air_router.files.qgc.qgc_edit import MISSION_FRAME, PlanEdit, simple_item
from air_router.files.qgc.qgc_items import MavCommand
from air_router.files.settings import DEFAULT_SEEK_POLICY, PlannerSettings, Timers
from geo.airspace.zone import Circle
from geo.frame import Geodetic, LocalFrame

_PX4, _MULTIROTOR = 12, 2
_GROUND_SPEED: Final = 1.0


def plan_of(draft: MissionDocument, warnings: ConversionWarnings) -> dict[str, Any]:
    """A new plan's data. The draft has a frame and a home."""
    if draft.frame is None or draft.home is None:
        raise ValueError("a mission without a home is no plan")
    frame = draft.frame
    home = frame.to_geodetic(draft.home.position)
    edit = PlanEdit(_empty(draft, home, warnings))
    _add_items(edit, draft, frame, home)
    for area in draft.fences:
        add_area(edit, area, frame, warnings, inclusion=True)
    for area in draft.zones:
        add_area(edit, area, frame, warnings, inclusion=False)
    for spot in draft.rally_points:
        edit.add_rally_point(frame.to_geodetic(spot.position))
    tell_settings(draft, warnings, "a plan")
    return edit.data


def add_area(
    edit: PlanEdit, area: Area, frame: LocalFrame, warnings: ConversionWarnings, *, inclusion: bool
) -> None:
    """Add a fence or a zone to a plan."""
    what = "a fence" if inclusion else f"no-fly zone '{area.name}'"
    shape = area.shape
    if isinstance(shape, Circle):
        edit.add_circle(frame.to_geodetic(shape.centre), shape.radius_m, inclusion=inclusion)
    else:
        edit.add_polygon(corners_of(shape.ring, frame), inclusion=inclusion)
        for hole in shape.holes if inclusion else ():
            edit.add_polygon(corners_of(hole, frame), inclusion=False)
        if shape.holes and not inclusion:
            warnings.add(what, "its holes are closed: a plan's zones have none", "holes-closed")
    if area.altitudes is not None:
        warnings.add(what, "it reaches over all altitudes: a plan's zones do", "altitudes-lost")
    if area.validity is not None:
        warnings.add(what, "it applies always: a plan's zones do", "schedule-lost")
    if area.clearance_m is not None:
        warnings.add(what, "its own clearance is not in the plan", "clearance-lost")
    if not inclusion and not _is_number_name(area.name):
        warnings.add("names of zones", "a plan's zones have none", "names-lost")


def _empty(draft: MissionDocument, home: Geodetic, warnings: ConversionWarnings) -> dict[str, Any]:
    altitude_m = draft.home_altitude_amsl_m
    if altitude_m is None:
        message = "home's height above the sea is not known: written as 0"
        warnings.add("home", message, "home-altitude-unknown")
    return {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": draft.speed_m_s,
            "firmwareType": _PX4,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": draft.speed_m_s,
            "items": [],
            "plannedHomePosition": [
                round(home.latitude_deg, 10),
                round(home.longitude_deg, 10),
                altitude_m or 0.0,
            ],
            "vehicleType": _MULTIROTOR,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }


def _add_items(edit: PlanEdit, draft: MissionDocument, frame: LocalFrame, home: Geodetic) -> None:
    items: list[dict[str, Any]] = edit.data["mission"]["items"]
    speed = [_GROUND_SPEED, draft.speed_m_s, -1.0, 0.0, 0.0, 0.0, 0.0]
    items.append(simple_item(MavCommand.CHANGE_SPEED, [*speed], number=1, frame=MISSION_FRAME))
    at_home = [round(home.latitude_deg, 10), round(home.longitude_deg, 10), draft.altitude_m]
    items.append(simple_item(MavCommand.TAKEOFF, [0, 0, 0, None, *at_home], number=2))
    for spot in draft.waypoints:
        edit.add_waypoint(
            frame.to_geodetic(spot.position),
            spot.altitude_m or draft.altitude_m,
            acceptance_radius_m=draft.planner.acceptance_radius_m,
        )
    end = simple_item(
        MavCommand.RETURN_TO_LAUNCH, [0.0] * 7, number=len(items) + 1, frame=MISSION_FRAME
    )
    items.append(end)


def tell_settings(draft: MissionDocument, warnings: ConversionWarnings, where: str) -> None:
    """Note the settings of a mission that only a mission file has."""
    for what, given in (
        ("timers", draft.timers != Timers()),
        ("planner", draft.planner != PlannerSettings()),
        ("team", draft.team is not None),
        ("world", draft.world is not None),
        ("seek", bool(draft.seek) or draft.seek_policy != DEFAULT_SEEK_POLICY),
        ("goals_from", bool(draft.goals_from)),
        ("uavs", bool(draft.uavs)),
        ("duration_s", draft.duration_s is not None),
        ("accepts", bool(draft.accepts)),
    ):
        if given:
            warnings.add(what, f"{where} has none; keep the mission file", "settings-lost")


def _is_number_name(name: str) -> bool:
    return name.removeprefix("zone ").isdigit()
