"""Compares a mission with the same mission with changed zones, and a router with a mission."""

from __future__ import annotations

from air_router.controller.limits import ALL_ZONES_ABOVE_M
from air_router.mission import Mission
from air_router.routing import Router
from geo.airspace import FENCE


def counted(mission: Mission, *, all_zones: bool) -> Mission:
    """The mission with the zones that apply: as drawn, or all if the altitude is in doubt."""
    return mission.with_all_zones(ALL_ZONES_ABOVE_M) if all_zones else mission.as_drawn()


def plans_for(router: Router, mission: Mission) -> bool:
    """Whether a router was made for the fences and zones of a mission."""
    made = router.graph.mission
    return (made.fences, made.zones, made.drawn) == (mission.fences, mission.zones, mission.drawn)


def names_of_new(before: Mission, now: Mission) -> frozenset[str]:
    """The names of zones that are new or changed, and the fence if it is."""
    fence = {FENCE} if before.fences != now.fences else set()
    return frozenset({zone.name for zone in set(now.zones) - set(before.zones)} | fence)


def difference(before: Mission, now: Mission) -> str:
    """What has changed, as text; after a failed upload perhaps nothing."""
    old, new = set(before.drawn), set(now.drawn)
    names = {"new": new - old, "gone": old - new}
    changed = {zone.name for zone in new - old} & {zone.name for zone in old - new}
    words = [f"'{name}' is another" for name in sorted(changed)]
    for word, zones in names.items():
        words += [f"'{name}' is {word}" for name in sorted({z.name for z in zones} - changed)]
    if before.fences != now.fences:
        words.append("the fence is another")
    if now.all_zones and not before.all_zones:
        words.append("all apply at every altitude")
    elif before.all_zones and not now.all_zones:
        words.append("each applies at its altitudes again")
    return ", ".join(words) or "to those that are not on board yet"
