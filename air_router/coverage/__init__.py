"""Survey lines over an area, from files and for cameras."""

from air_router.coverage.camera import CAMERAS, SurveyCamera, camera_of
from air_router.coverage.cover_area import CoverOptions, Field, read_field
from air_router.coverage.cover_output import (
    facts_of,
    lines_of,
    place_of,
    place_text,
    waypoints_of,
    written,
)

__all__ = [
    "CAMERAS",
    "CoverOptions",
    "Field",
    "SurveyCamera",
    "camera_of",
    "facts_of",
    "lines_of",
    "place_of",
    "place_text",
    "read_field",
    "waypoints_of",
    "written",
]
