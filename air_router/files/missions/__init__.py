"""Mission files: YAML, QGroundControl plans, waypoint files; read and written."""

from air_router.files.missions.gpx_mission import gpx_draft
from air_router.files.missions.mission_file import read_mission
from air_router.files.missions.mission_mistakes import other_kind
from air_router.files.missions.mission_write import first_mission_text, mission_text
from air_router.files.missions.qgc_items import NOT_FLOWN, RELATIVE_FRAMES, MavCommand
from air_router.files.missions.qgc_read import plan_draft
from air_router.files.missions.qgc_write import (
    ConversionWarnings,
    areas_of,
    plan_of,
    simple_item,
    tell_settings,
    with_zones,
)
from air_router.files.missions.waypoint_file import read_old_fence_draft, read_waypoints

__all__ = [
    "NOT_FLOWN",
    "RELATIVE_FRAMES",
    "ConversionWarnings",
    "MavCommand",
    "areas_of",
    "first_mission_text",
    "gpx_draft",
    "mission_text",
    "other_kind",
    "plan_draft",
    "plan_of",
    "read_mission",
    "read_old_fence_draft",
    "read_waypoints",
    "simple_item",
    "tell_settings",
    "with_zones",
]
