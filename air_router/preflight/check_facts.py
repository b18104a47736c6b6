"""What `air-router check` tells of a mission that can be flown, to people and to programs."""

import math
from collections.abc import Iterable
from itertools import groupby
from typing import Any

from air_router.counted import counted
from air_router.mission.fence_plan import FENCE_POINTS
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.found_by import finders
from air_router.mission.mission import Mission
from air_router.preflight.survey import MissionSurvey, SurveyedLeg
from air_router.routing.return_planner import (
    LANDING_MARGIN,
    Pace,
    StraightReturn,
    Way,
    straight_returns,
)

_TIGHTEST = 3
_MOST_LINES = 12
"""So many legs that are flown around, or idle zones, are listed; the rest are counted."""

_MOST_STOPS = 8
_MOST_RUNS = 24


def summary(findings: MissionSurvey) -> list[str]:
    """A person's view of a mission that was found to be in order."""
    mission, planner = findings.mission, findings.mission.planner
    margin = (
        f"clearance {planner.clearance_m:g} m + tracking margin {planner.tracking_margin_m:g} m"
    )
    pieces = "in one piece" if findings.connected else "in pieces"
    on_board = len(FlightPlan.of(mission).fence)
    lines = [
        (
            f"{mission.name}: {counted(len(mission.waypoints), 'waypoints')}, "
            f"{counted(len(mission.zones), 'no-fly zones')}, {_fences(mission)}, "
            f"{counted(len(mission.rally_points), 'rally points')}"
        ),
        f"  flies      {_altitudes(mission)} above home at {mission.speed_m_s:g} m/s",
        f"  keeps      {planner.distance_m:g} m from zones and fence ({margin}){_own(mission)}",
        f"  on board   {counted(on_board, 'fence points')}{_too_many(on_board)}",
        (
            f"  graph      {counted(findings.edges, 'clear connections')} up to "
            f"{planner.max_edge_m:g} m, {counted(findings.detours, 'detours')}, "
            f"{pieces}; routes: {planner.kind}"
        ),
        (
            f"  exploring  {findings.length_m:.0f} m from home through all waypoints and back, "
            f"about {_duration(findings.flight_time_s)}"
        ),
    ]
    lines += [
        f"  tightest   {_way(step)}, {step.closest_m:.1f} m from {step.closest_to}"
        for step in findings.tightest(_TIGHTEST)
    ]
    around = findings.around
    lines += [
        f"  around     {_way(step)}, because of {_names(step.straight_blockers, ' and ')}"
        for step in around[:_MOST_LINES]
    ]
    if len(around) > _MOST_LINES:
        lines.append(f"  around     and {len(around) - _MOST_LINES} more")
    lines += _coming_home(findings)
    lines += [
        f"  idle       {idle.zone.name}: {idle.reason}"
        + ("; kept from below that, climbing and landing" if idle.below else "")
        for idle in mission.idle_zones[:_MOST_LINES]
    ]
    if len(mission.idle_zones) > _MOST_LINES:
        lines.append(f"  idle       and {len(mission.idle_zones) - _MOST_LINES} more zones")
    if mission.team is not None:
        seek = ", ".join(mission.seek) or "every other robot"
        seek += f" ({mission.seek_policy})"
        lines.append(f"  team       {mission.team}: {_flying(mission)} {seek}")
        lines += _finds(mission)
    lines += _layers(mission)
    lines += [f"  note       {note}" for note in mission.notes]
    return lines


def _too_many(fence_points: int) -> str:
    if fence_points <= FENCE_POINTS:
        return f" of {FENCE_POINTS} that a PX4 stores"
    return f": MORE THAN THE {FENCE_POINTS} THAT A PX4 STORES, it will refuse them (see the note)"


def _flying(mission: Mission) -> str:
    names = [layer.uav for layer in mission.layers]
    if len(names) > 1:
        return f"{' and '.join(names)} fly and seek"
    return f"{mission.uav} flies and seeks"


def _finds(mission: Mission) -> list[str]:
    """A line for each topic by which robots are found."""
    robots: dict[str, list[str]] = {}
    for robot, topic in finders(mission).items():
        robots.setdefault(f"{topic.name} ({topic.type})", []).append(robot)
    return [f"  found by   {topic}: {_names(names)}" for topic, names in robots.items()]


def _layers(mission: Mission) -> list[str]:
    """A line for each UAV of a mission for several: the other lines are of the first one."""
    return [
        f"  layer      {layer.uav}: {layer.altitude_m:g} m above its home, "
        + ("explores and searches" if layer.explore else "only searches")
        + (" (its mission is shown here)" if layer.uav == mission.uav else "")
        for layer in mission.layers
    ]


def _coming_home(findings: MissionSurvey) -> list[str]:
    mission, ways = findings.mission, findings.return_planner
    lines = []
    worst = ways.worst_waypoint
    if worst is not None:
        number, way = worst
        charge = _charge(mission, ways.pace, way)
        lines.append(
            f"  home       farthest is waypoint {number}: {way.length_m:.0f} m, "
            f"{_duration(ways.pace.home_s(way))} to the ground{charge}"
        )
    place = ways.worst_place
    if place is not None and worst is not None and place[1].length_m > worst[1].length_m + 0.5:
        (a, b), way = place
        charge = "" if mission.endurance_s is None else _charge(mission, ways.pace, way)
        lines.append(
            f"  home       from between {_node(a)} and {_node(b)}: {way.length_m:.0f} m, "
            f"{_duration(ways.pace.home_s(way))}{charge}"
        )
    if mission.rally_points:
        if ways.rally:
            farthest = max(ways.rally, key=lambda node: ways.rally[node].length_m)
            lines.append(
                f"  rally      a rally point is at most {ways.rally[farthest].length_m:.0f} m "
                f"away, from {_node(farthest)}"
            )
        else:
            lines.append("  rally      no clear way leads to a rally point")
    for to, returns in _by_aim(straight_returns(mission)):
        numbers = [r.waypoint for r in returns]
        zones = dict.fromkeys(name for r in returns for name in r.cuts)
        lines.append(
            f"  PX4 return straight to {to} would cut {_names(zones)}: from {_ranges(numbers)}"
        )
    return lines


def _charge(mission: Mission, pace: Pace, way: Way) -> str:
    need = pace.need(way)
    if need is None:
        return "; with endurance_s its share of the battery would be known"
    whole = need + LANDING_MARGIN
    verdict = "covers" if mission.battery_reserve >= whole else "does not cover"
    early = "" if mission.battery_reserve >= whole else ": the vehicle turns at that charge"
    return (
        f", {need:.0%} of a full battery; battery_reserve {mission.battery_reserve:.0%} {verdict} "
        f"it and {LANDING_MARGIN:.0%} left on the ground{early}"
    )


def facts_of(findings: MissionSurvey) -> dict[str, Any]:
    """The same as one JSON object; docs/commands.md lists its keys."""
    mission = findings.mission
    tightest = findings.tightest(_TIGHTEST)
    return {
        "valid": not findings.stranded,
        "problems": [],
        "notes": [note.as_json() for note in mission.notes],
        "mission": mission.name,
        "path": str(mission.path),
        "waypoints": len(mission.waypoints),
        "zones": len(mission.zones),
        "idle_zones": [
            {"name": idle.zone.name, "reason": idle.reason, "heeded_below": idle.below}
            for idle in mission.idle_zones
        ],
        "fence": bool(mission.fences),
        "fences": len(mission.fences),
        "fence_points_on_board": len(FlightPlan.of(mission).fence),
        "rally_points": len(mission.rally_points),
        "layers": [
            {"uav": layer.uav, "altitude_m": layer.altitude_m, "explore": layer.explore}
            for layer in mission.layers
        ],
        "cruise_m": [mission.cruise.lower_m, mission.cruise.upper_m],
        "window": str(mission.window),
        "clearance_m": mission.planner.clearance_m,
        "planning_distance_m": mission.planner.distance_m,
        "planner": mission.planner.kind,
        "seek": list(mission.seek),
        "seek_policy": mission.seek_policy,
        "found_by": {
            robot: {"topic": topic.name, "type": topic.type}
            for robot, topic in finders(mission).items()
        },
        "edges": findings.edges,
        "detours": findings.detours,
        "connected": findings.connected,
        "stranded": [number for number, _ in findings.stranded],
        "path_length_m": round(findings.length_m, 2),
        "flight_time_s": round(findings.flight_time_s, 1),
        "tightest_leg": _tight(tightest[0]) if tightest else None,
        "tightest_legs": [_tight(step) for step in tightest],
        "around": [
            {"from": s.start, "to": s.end, "because": list(s.straight_blockers)}
            for s in findings.around
        ],
        "home": _home_facts(findings),
    }


def _home_facts(findings: MissionSurvey) -> dict[str, Any]:
    mission, ways = findings.mission, findings.return_planner
    worst = ways.worst_waypoint
    need = None if worst is None else ways.pace.need(worst[1])
    rally = max((way.length_m for way in ways.rally.values()), default=None)
    return {
        "farthest_waypoint": None if worst is None else worst[0],
        "length_m": None if worst is None else round(worst[1].length_m, 2),
        "time_s": None if worst is None else round(ways.pace.home_s(worst[1]), 1),
        "endurance_s": mission.endurance_s,
        "need": None if need is None else round(need, 4),
        "landing_margin": LANDING_MARGIN,
        "battery_reserve": mission.battery_reserve,
        "reserve_covers": None
        if need is None
        else mission.battery_reserve >= need + LANDING_MARGIN,
        "rally_length_m": None if rally is None else round(rally, 2),
        "straight_returns": [
            {"waypoint": r.waypoint, "to": r.to, "cuts": list(r.cuts)}
            for r in straight_returns(mission)
        ],
    }


def _tight(step: SurveyedLeg) -> dict[str, Any]:
    return {
        "from": step.start,
        "to": step.end,
        "distance_m": round(step.closest_m, 3),
        "closest_to": step.closest_to,
    }


def _by_aim(returns: Iterable[StraightReturn]) -> list[tuple[str, list[StraightReturn]]]:
    ordered = sorted(returns, key=lambda r: (r.to != "home", r.to, r.waypoint))
    return [(to, list(group)) for to, group in groupby(ordered, key=lambda r: r.to)]


def _ranges(numbers: list[int]) -> str:
    """Numbers in few words: 1, 4-6, 9."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    words = [str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    if len(words) <= _MOST_RUNS:
        return ", ".join(words)
    return f"{', '.join(words[:_MOST_RUNS])} ... ({sum(map(len, runs))} waypoints)"


def _names(zones: Iterable[str], comma: str = ", ") -> str:
    names = list(zones)
    if len(names) > 5:
        return f"{', '.join(names[:4])} and {len(names) - 4} more"
    return comma.join(names)


def _way(step: SurveyedLeg) -> str:
    via = [leg.node for leg in step.route.legs[:-1]]
    stops: list[str] = []
    for corner, nodes in groupby(via, key=lambda node: node is None):
        named = [str(node) for node in nodes]
        corners = "a corner" if len(named) == 1 else f"{len(named)} corners"
        stops += [corners] if corner else named
    if len(stops) > _MOST_STOPS:
        stops[_MOST_STOPS - 1 :] = [f"{len(stops) - _MOST_STOPS + 1} more"]
    through = f" by way of {', '.join(stops)}" if stops else ""
    return f"{_node(step.start)} to {_node(step.end)}{through}"


def _node(node: int) -> str:
    return str(node) if node else "home"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def _fences(mission: Mission) -> str:
    count = len(mission.fences)
    return {0: "no fence", 1: "a fence"}.get(count, f"{count} fences")


def _altitudes(mission: Mission) -> str:
    flown = {mission.altitude_above_home_m, *(w.altitude_above_home_m for w in mission.waypoints)}
    low, high = min(flown), max(flown)
    return f"{low:g} m" if math.isclose(low, high) else f"{low:g} to {high:g} m"


def _own(mission: Mission) -> str:
    own = [zone for zone in mission.airspace.zones if zone.clearance_m is not None]
    if not own:
        return ""
    margin_m = mission.planner.tracking_margin_m
    kept = ", ".join(
        f"{(zone.clearance_m or 0.0) + margin_m:g} m from {zone.name}" for zone in own[:4]
    )
    more = f" and {len(own) - 4} more" if len(own) > 4 else ""
    return f"; {kept}{more}"
