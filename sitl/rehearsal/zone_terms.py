"""Terms of their own for the zones of every rehearsed mission: limits, hours, clearances, holes.

Home is put high above the sea. The zones of the mission get limits within which it flies, in every
reference, and hours that are always; beside them are drawn zones that it flies below, above, inside
or long after. A flight that reads all of that right goes as it would without. One that misreads a
term flies elsewhere, has another fence on board, or does not begin.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import shapely
import yaml

from sitl.rehearsal.judge import Pair, RawMission, leads_home, read_mission

_HOME_AMSL_M: Final = 550.0
_OVER_M, _BELOW_M = 18.0, 0.5
"""Zones begin so far above the highest cruise altitude, or end at this share of the lowest one."""

_OFF_GROUND_M: Final = 1.0
"""Drawn zones begin there: what stands on the ground would be a building to robots."""

_LONG_AGO, _FAR_OFF = "2001-01-01T00:00:00Z", "2100-01-01T00:00:00Z"
_EXPIRED: Final = [{"until": _LONG_AGO}]
_SITE_M, _WIDE_M, _AROUND_M = 15.0, 1000.0, 40.0
_FIRST: Final = 4
"""So many waypoints surely are flown to."""

WIDER_M: Final = 0.5
"""So much more than zones by their own clearance is kept from what has none: from the fence."""

_KEPT_M: Final = 1.7
"""What routes keep on top of a clearance, at least, by what the vehicle may be off them."""

OVER_RALLY: Final = "over a rally point"
_MAST_M: Final = 1.0
_HOLE: Final = 4
"""Number of the zone that becomes a hole of the fence."""

_SPARE_M, _WORTH_M = 0.3, 3.0
"""What is left of a clearance that is as wide as it can be; one that is so much wider shows."""


def with_terms(
    document: dict[str, Any], *, wide: bool = False, hours: bool = True
) -> dict[str, Any]:
    """A mission among zones with terms; its own limits stay.

    Args:
        document: The mission.
        wide: One zone gets a wide clearance, where that shows: ways lead around it.
        hours: Zones have hours. Before a flight the companion's clock must be the vehicle's then.
    """
    return _with_terms(yaml.safe_dump(document), wide, hours)


@functools.lru_cache(maxsize=4)
def _with_terms(text: str, wide: bool, hours: bool) -> dict[str, Any]:
    document = yaml.safe_load(text)
    planner = {"terrain_relief_m": 20.0, "tracking_margin_m": 1.5} | (document.get("planner") or {})
    home = document["home"]
    place = home["position"] if isinstance(home, dict) else home
    document["home"] = {"position": place, "altitude_amsl_m": _HOME_AMSL_M}
    mission = read_mission(Path(), yaml.safe_dump(document))
    document["planner"] = {**planner, "clearance_m": mission.clearance_m + WIDER_M}
    own = {"clearance_m": mission.clearance_m}
    terms = [*_limits(mission, planner["terrain_relief_m"])]
    zones = [{**own, **terms[n % len(terms)], **z} for n, z in enumerate(document["no_fly_zones"])]
    if zones and wide:
        margin_m = max(planner["tracking_margin_m"], _KEPT_M)
        zones[-1] |= _widest(mission, len(zones) - 1, margin_m)
    fence, hole = document.get("fence"), zones[_HOLE] if len(zones) > _HOLE else {}
    if isinstance(fence, list) and "polygon" in hole and not hole.get("crosses_fence"):
        zones.remove(hole)
        document["fence"] = {"polygon": fence, "holes": [hole["polygon"]]}
    zones += _drawn(mission)
    if not hours:
        zones = [zone for zone in zones if zone.get("active") != _EXPIRED]
        zones = [{key: zone[key] for key in zone if key != "active"} for zone in zones]
    return {**document, "no_fly_zones": zones}


def _limits(mission: RawMission, relief_m: float) -> Iterator[dict[str, Any]]:
    """Terms of zones that count at every cruise altitude, always."""
    low_m, high_m = mission.altitudes_m[0], mission.altitudes_m[-1]
    margin_m = mission.vertical_margin_m
    yield {}
    amsl = {"lower_m": _HOME_AMSL_M + 2.0, "upper_m": _HOME_AMSL_M + high_m + 60.0}
    always = [{"from": _LONG_AGO, "until": _FAR_OFF}]
    yield {"altitude": {**amsl, "reference": "amsl"}, "active": always}
    # These two only by the terrain, or by how far off its altitude a vehicle may be.
    yield {"altitude": {"lower_m": low_m + relief_m - margin_m, "reference": "ground"}}
    yield {"altitude": {"upper_m": low_m - 0.6 * margin_m}}
    yield {"altitude": {"lower_m": 2.0, "upper_m": high_m + 50.0}}


def _drawn(mission: RawMission) -> Iterator[dict[str, Any]]:
    """Zones that the flight passes: under it, over it, around it, expired."""
    low_m, high_m = mission.altitudes_m[0], mission.altitudes_m[-1]
    landings = [(0.0, 0.0), *mission.rally]
    first = sorted(
        mission.waypoints[:_FIRST], key=lambda place: -min(math.dist(place, at) for at in landings)
    )
    yield _circle(mission, "under it", first[0], _SITE_M) | {
        "altitude": {"lower_m": _OFF_GROUND_M, "upper_m": low_m * _BELOW_M}
    }
    yield _circle(mission, "expired", first[-1], _SITE_M) | {"active": _EXPIRED}
    yield _circle(mission, "over it", (0.0, 0.0), _WIDE_M) | {
        "altitude": {"lower_m": _HOME_AMSL_M + high_m + _OVER_M, "reference": "amsl"}
    }
    places = [*mission.waypoints, *landings]
    for fence in mission.fences:
        west, south, east, north = fence.polygon.bounds
        places += [(west, south), (east, north)]
    sides = [(min(axis), max(axis)) for axis in zip(*places, strict=True)]
    yield {
        "name": "around it",
        "altitude": {"lower_m": _OFF_GROUND_M},
        "polygon": _box(mission, sides, _WIDE_M),
        "holes": [_box(mission, sides, _AROUND_M)],
    }


def over_a_rally_point(mission: RawMission) -> list[dict[str, Any]]:
    """A mast on the rally point that is farthest from all waypoints; none without rally points."""

    def from_waypoints_m(place: Pair) -> float:
        return min(math.dist(place, waypoint) for waypoint in mission.waypoints)

    places = sorted(mission.rally, key=from_waypoints_m)[-1:]
    small = {"clearance_m": _MAST_M}
    return [_circle(mission, OVER_RALLY, place, _MAST_M) | small for place in places]


def _widest(mission: RawMission, number: int, margin_m: float) -> dict[str, float]:
    """The widest clearance that a zone can have, where that shows; climb corridors come last."""
    last = mission.zones[number]
    zones = [zone for zone in mission.zones if zone is not last]
    places = [(0.0, 0.0), *mission.waypoints, *mission.rally]
    near_m = min(last.polygon.distance(place) for place in map(shapely.Point, places))
    wide_m = float(math.floor(near_m - margin_m - _SPARE_M))
    kept = [replace(zone, clearance_m=zone.clearance_m + margin_m) for zone in zones]
    kept.append(replace(last, clearance_m=wide_m + margin_m))
    ways = all(leads_home(replace(mission, zones=tuple(kept)), place) for place in places)
    shows = wide_m >= mission.clearance_m + _WORTH_M
    return {"clearance_m": wide_m} if shows and ways else {}


def _circle(mission: RawMission, name: str, centre: Pair, radius_m: float) -> dict[str, Any]:
    circle = {"centre": _degrees(mission, centre), "radius_m": radius_m}
    return {"name": name, "circle": circle, "crosses_fence": True}


def _box(mission: RawMission, sides: list[tuple[float, float]], beyond_m: float) -> list[Any]:
    """A box so far around others, in degrees."""
    (west, east), (south, north) = ((low - beyond_m, high + beyond_m) for low, high in sides)
    corners = ((west, south), (east, south), (east, north), (west, north))
    return [_degrees(mission, corner) for corner in corners]


def _degrees(mission: RawMission, place: Pair) -> list[float]:
    return [round(float(degrees), 8) for degrees in mission.frame.degrees(*place)]
