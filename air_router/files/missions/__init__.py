"""Mission files: YAML, QGroundControl plans, waypoint files; read and written."""

from air_router.files.missions.gpx_mission import read_gpx_mission
from air_router.files.missions.mission_file import other_kind, read_mission
from air_router.files.missions.mission_write import feature_set_of, first_mission_text, mission_text
from air_router.files.missions.placed_form import MissionPoint, PlacedForm, place
from air_router.files.missions.qgc_items import NOT_FLOWN, RELATIVE_FRAMES, MavCommand
from air_router.files.missions.qgc_read import read_plan
from air_router.files.missions.qgc_write import (
    ConversionWarnings,
    plan_of,
    report_settings,
    simple_item,
    with_zones,
)
from air_router.files.missions.waypoint_file import read_old_fence, read_waypoints

__all__ = [
    "NOT_FLOWN",
    "RELATIVE_FRAMES",
    "ConversionWarnings",
    "MavCommand",
    "MissionPoint",
    "PlacedForm",
    "feature_set_of",
    "first_mission_text",
    "mission_text",
    "other_kind",
    "place",
    "plan_of",
    "read_gpx_mission",
    "read_mission",
    "read_old_fence",
    "read_plan",
    "read_waypoints",
    "report_settings",
    "simple_item",
    "with_zones",
]
