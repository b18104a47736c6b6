"""Whether a mission, as drafted, may be flown: every problem of its geometry and its team."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection

from shapely import Polygon

from air_router.draft import Area, Draft, Keys, Spot
from geo.airspace import FENCE, Airspace
from geo.frame import Point
from geo.regions import Regions
from geo.zone import Zone
from mocha_link.document import DocumentError
from mocha_link.team import Team

UAV_KIND = "aerial_robot"
"""The kind of the team's robots that fly; without `uav` in the mission, the only one is meant."""

_FAR_M = 50_000.0
_SAME_PLACE_M = 0.1
_SLIVER_M2 = 0.01


def airspace_of(draft: Draft, clearance_m: float) -> Airspace:
    """The draft's fence and zones."""
    fence = None if draft.fence is None else draft.fence.ring
    return Airspace(fence, [Zone(area.name, area.ring) for area in draft.zones], clearance_m)


def check_geometry(draft: Draft) -> None:
    """Note everything that is wrong with the places and areas of a draft."""
    if draft.frame is None:
        return
    if not draft.waypoints and "waypoints" not in draft.unread and not draft.problems:
        draft.complain(("waypoints",), "a mission needs at least one waypoint; add one")
    _check_names(draft)
    _check_fence_crossings(draft)
    _check_same_places(draft)
    far = _check_distances(draft)
    if _check_spots(draft, far) and not far and "planner" not in draft.unread:
        _check_ways(draft)


def check_team(draft: Draft) -> None:
    """Note what is wrong with the team file, and robots that it does not have.

    Enters the only flying robot of the team as the draft's `uav`, if the mission names none.
    """
    if draft.world is not None and not draft.world.is_file():
        draft.complain(("world",), f"there is no file {draft.world}; correct the path")
    if len(set(draft.seek)) < len(draft.seek):
        draft.complain(("seek",), "a robot is named twice; each is sought in turn anyway")
    if draft.team is None:
        return
    if not draft.team.is_file():
        draft.complain(("team",), f"there is no file {draft.team}; correct the path")
        return
    try:
        team = Team.load(draft.team)
    except DocumentError as error:
        draft.problems.extend(error.problems)
        return
    if draft.uav is not None:
        _check_robot(draft, draft.uav, team.robots, ("uav",))
    else:
        flying = [name for name, robot in team.robots.items() if robot.kind == UAV_KIND]
        if len(flying) == 1:
            draft.uav = flying[0]
        else:
            draft.complain(
                (),
                f"the team has {len(flying)} robots of kind {UAV_KIND}; "
                "add 'uav' with the name of the robot that flies this mission",
            )
    for index, name in enumerate(draft.seek):
        _check_robot(draft, name, team.robots, ("seek", index))
        if name == draft.uav:
            draft.complain(("seek", index), f"'{name}' flies this mission; take it off the list")


def _check_robot(draft: Draft, name: str, known: Collection[str], keys: Keys) -> None:
    if name in known:
        return
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean '{close[0]}'?" if close else f"use one of {', '.join(sorted(known))}"
    draft.complain(keys, f"the team has no robot '{name}'; {hint}")


def _check_names(draft: Draft) -> None:
    first: dict[str, Area] = {}
    for area in draft.zones:
        if area.name in first or area.name == FENCE:
            draft.complain(area.keys, f"another area is called '{area.name}' too; rename one")
        first.setdefault(area.name, area)


def _check_distances(draft: Draft) -> set[str]:
    """Far places are typing errors: digits, signs, or longitude before latitude.

    Returns the labels of such places: nothing else needs to be said about them.
    """
    far: set[str] = set()
    if draft.home is None:
        return far
    advice = "correct it (latitude comes first)" if not draft.in_metres else "correct it"
    for spot in (*draft.waypoints, *draft.rally_points):
        if (far_m := math.dist(spot.position, draft.home.position)) > _FAR_M:
            draft.complain(spot.keys, f"{spot.label} is {far_m / 1000:.0f} km from home; {advice}")
            far.add(spot.label)
    for area in (*draft.zones, *([draft.fence] if draft.fence else [])):
        far_m = max(math.dist(corner, draft.home.position) for corner in area.ring)
        if far_m > _FAR_M:
            label = "the fence" if area is draft.fence else f"no-fly zone '{area.name}'"
            draft.complain(area.keys, f"{label} reaches {far_m / 1000:.0f} km from home; {advice}")
            far.add(label)
    return far


def _check_fence_crossings(draft: Draft) -> None:
    if draft.fence is None:
        return
    inside = Polygon(draft.fence.ring)
    for area in draft.zones:
        zone = Polygon(area.ring)
        beyond = zone.difference(inside).area > _SLIVER_M2
        within = zone.intersection(inside).area > _SLIVER_M2
        if beyond and within and not area.crosses_fence:
            draft.complain(
                area.keys,
                f"no-fly zone '{area.name}' crosses the fence; move its corners inside, "
                "or confirm that it is meant with 'crosses_fence: true'",
            )


def _check_same_places(draft: Draft) -> None:
    for index, spot in enumerate(draft.waypoints):
        for other in draft.waypoints[:index]:
            if math.dist(spot.position, other.position) < _SAME_PLACE_M:
                draft.complain(spot.keys, f"{spot.label} lies on {other.label}; remove one of them")
                break


def _check_spots(draft: Draft, far: Collection[str]) -> bool:
    """Whether home, waypoints and rally points all keep their distance."""
    planner = draft.planner
    readable = "planner" not in draft.unread
    airspace = airspace_of(draft, planner.distance_m if readable else 0.0)
    spots = [*([draft.home] if draft.home else []), *draft.waypoints, *draft.rally_points]
    near = [spot for spot in spots if spot.label not in far]
    wrong = [spot for spot in near if not airspace.point_clear(spot.position)]
    for spot in wrong:
        draft.complain(spot.keys, _complaint(spot, airspace, _needs(draft)))
    return not wrong


def _complaint(spot: Spot, airspace: Airspace, needs: str) -> str:
    holders = airspace.holders(spot.position)
    if FENCE in holders:
        return f"{spot.label} lies outside of the fence; move it inside"
    if holders:
        zones = " and ".join(f"'{name}'" for name in holders)
        return f"{spot.label} lies inside no-fly zone {zones}; move it out, to {needs}"
    distance_m, name = airspace.nearest(spot.position)
    what = "the fence" if name == FENCE else f"no-fly zone '{name}'"
    return (
        f"{spot.label} is {_metres(distance_m)} from {what}, it needs {needs}; "
        f"move it by {_metres(airspace.clearance_m - distance_m)} or lower planner.clearance_m"
    )


def _needs(draft: Draft) -> str:
    planner = draft.planner
    return (
        f"{planner.distance_m:g} m (clearance {planner.clearance_m:g} m + "
        f"tracking margin {planner.tracking_margin_m:g} m)"
    )


def _metres(distance_m: float) -> str:
    return f"{distance_m:.2f} m" if distance_m < 1 else f"{distance_m:.1f} m"


def _check_ways(draft: Draft) -> None:
    """A clear way must lead from home to every waypoint (and so from each to every other)."""
    if draft.home is None:
        return
    regions = Regions(airspace_of(draft, draft.planner.distance_m))
    answers: dict[int | None, str] = {}
    for spot in draft.waypoints:
        region = regions.of(spot.position)
        if regions.connected(draft.home.position, spot.position):
            continue
        if region not in answers:
            answers[region] = _walls(regions, draft.home.position, spot.position)
        draft.complain(
            spot.keys,
            f"no clear way leads from home to {spot.label}: {answers[region]} at "
            f"{_needs(draft)}; open a gap, or move or remove the waypoint",
        )


def _walls(regions: Regions, home: Point, place: Point) -> str:
    names = regions.separators(home, place)
    words = ["the fence" if name == FENCE else f"'{name}'" for name in names]
    if not words:
        return "what lies between leaves no room"
    return f"{' and '.join(words)} {'leaves' if len(words) == 1 else 'leave'} no room"
