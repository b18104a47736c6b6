"""What is other between a mission and the same with changed zones; among which a router plans."""

from __future__ import annotations

from dataclasses import replace

from air_router.mission import Mission
from air_router.routing import Router, WaypointGraph
from geo.airspace import FENCE, Airspace


def among(router: Router, mission: Mission) -> bool:
    """Whether a router plans among the fences and zones of a mission."""
    made = router.graph.mission
    return (made.fences, made.zones) == (mission.fences, mission.zones)


def names_of_new(before: Mission, now: Mission) -> frozenset[str]:
    """The zones, and perhaps the fence, that are other than before."""
    fence = {FENCE} if before.fences != now.fences else set()
    return frozenset({zone.name for zone in set(now.zones) - set(before.zones)} | fence)


def difference(before: Mission, now: Mission) -> str:
    """What has changed, in words; perhaps nothing since an upload that failed."""
    old, new = set(before.zones), set(now.zones)
    names = {"new": new - old, "gone": old - new}
    changed = {zone.name for zone in new - old} & {zone.name for zone in old - new}
    words = [f"'{name}' is another" for name in sorted(changed)]
    for word, zones in names.items():
        words += [f"'{name}' is {word}" for name in sorted({z.name for z in zones} - changed)]
    if before.fences != now.fences:
        words.append("the fence is another")
    return ", ".join(words) or "to those that are not on board yet"


def among_both(router: Router, mission: Mission, off_m: float) -> bool:
    """Whether a router plans also among what applies so far above, or below, the cruise."""
    kept = _names(router.graph.mission.planning_airspace)
    return _names(_at_both(mission, off_m)) <= kept


def widened_router(mission: Mission, off_m: float) -> Router:
    """Plans among what applies from the cruise altitudes to so far above or below them."""
    planning = _at_both(mission, off_m).with_margin(mission.tracking.planned_m)
    return Router(WaypointGraph(replace(mission, planning_airspace=planning)))


def _at_both(mission: Mission, off_m: float) -> Airspace:
    edge_m = mission.cruise.upper_m if off_m > 0 else mission.cruise.lower_m
    return mission.airspace_at(edge_m + off_m)


def _names(airspace: Airspace) -> frozenset[str]:
    """Its zones: as many may be others."""
    return frozenset(zone.name for zone in airspace.zones)
