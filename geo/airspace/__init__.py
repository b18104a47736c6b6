"""Where a vehicle may be: fences, zones, and the distance kept from them."""

from geo.airspace.airspace import FENCE, Airspace
from geo.airspace.zone import (
    ARC_EXCESS,
    ARC_STEPS,
    Band,
    Circle,
    Outline,
    Ring,
    Shape,
    Zone,
    ZoneError,
    arc_excess,
    checked_ring,
    circle_ring,
    polygons_of,
)
from geo.airspace.zone_repair import repaired

__all__ = [
    "ARC_EXCESS",
    "ARC_STEPS",
    "FENCE",
    "Airspace",
    "Band",
    "Circle",
    "Outline",
    "Ring",
    "Shape",
    "Zone",
    "ZoneError",
    "arc_excess",
    "checked_ring",
    "circle_ring",
    "polygons_of",
    "repaired",
]
