"""No-fly zones and missions in the formats of map programs and authorities."""

from air_router.files.maps.ardupilot_fences import (
    FENCE_COMMANDS,
    FenceCommand,
    FenceItem,
    fence_areas,
    is_fence_file,
    is_waypoint_file,
    old_fence_items,
)
from air_router.files.maps.feature_set import (
    FeatureSet,
    MapPoint,
    feature_set_of_zones,
    map_area_of,
)
from air_router.files.maps.geojson import geojson_text
from air_router.files.maps.gpx import GpxDocument, GpxPoint, read_gpx
from air_router.files.maps.kml import kml_text
from air_router.files.maps.map_area import MapArea, MapCircle, MapOutline, MapRing
from air_router.files.maps.surroundings import Surroundings
from air_router.files.maps.zone_files import read_zones, zones_near
from air_router.files.maps.zone_format import ZoneFeature, ZoneFeatures, ZoneFormat

__all__ = [
    "FENCE_COMMANDS",
    "FeatureSet",
    "FenceCommand",
    "FenceItem",
    "GpxDocument",
    "GpxPoint",
    "MapArea",
    "MapCircle",
    "MapOutline",
    "MapPoint",
    "MapRing",
    "Surroundings",
    "ZoneFeature",
    "ZoneFeatures",
    "ZoneFormat",
    "feature_set_of_zones",
    "fence_areas",
    "geojson_text",
    "is_fence_file",
    "is_waypoint_file",
    "kml_text",
    "map_area_of",
    "old_fence_items",
    "read_gpx",
    "read_zones",
    "zones_near",
]
