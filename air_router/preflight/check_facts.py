"""The summary that `air-router check` prints of a valid mission, for people and for programs."""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

from air_router.mission import FENCE_POINTS, FlightPlan, Mission, finders
from air_router.preflight.expected_clearance import expected_clearances
from air_router.preflight.survey import MissionSurvey, SurveyedLeg
from air_router.routing import LANDING_MARGIN, Pace, Way, straight_returns
from air_router.words import counted

_TIGHTEST = 3
_MOST_LINES = 12
"""Most detours or idle zones listed; the rest are counted."""

_MOST_STOPS = 8
_MOST_RUNS = 24

_Row = tuple[str, str]
"""The subject of a line of the summary, and its text."""


def summary(findings: MissionSurvey) -> list[str]:
    """The summary of a valid mission, for people."""
    mission = findings.mission
    first = (
        f"{mission.name}: {counted(len(mission.waypoints), 'waypoints')}, "
        f"{counted(len(mission.zones), 'no-fly zones')}, {_fences(mission)}, "
        f"{counted(len(mission.rally_points), 'rally points')}"
    )
    parts = (_flight, _legs, _coming_home, _idle, _team)
    rows = [row for part in parts for row in part(findings)]
    return [first, *(f"  {about:<10} {text}" for about, text in rows)]


def _flight(findings: MissionSurvey) -> Iterator[_Row]:
    mission, planner = findings.mission, findings.mission.planner
    flown = (mission.altitude_above_home_m, *(w.altitude_above_home_m for w in mission.waypoints))
    flies, allowed = _altitudes(flown), _altitudes(mission.altitudes_m)
    on_request = f"; {allowed} on request" if allowed != flies else ""
    yield "flies", f"{flies} above home at {mission.speed_m_s:g} m/s{on_request}"
    kept_m, margin_m = mission.planning_distance_m, mission.tracking.planned_m
    margin = f"clearance {planner.clearance_m:g} m + tracking margin {margin_m:.2f} m"
    yield "keeps", f"{kept_m:.2f} m from zones and fence ({margin}){_own(mission)}"
    yield from _expected(mission)
    points = len(FlightPlan.of(mission).fence)
    limit = f"; PX4 stores {FENCE_POINTS}"
    if points > FENCE_POINTS:
        limit = (
            f": MORE THAN THE {FENCE_POINTS} THAT PX4 STORES, it will refuse them (see the note)"
        )
    yield "on board", f"{counted(points, 'fence points')}{limit}"
    graph = findings.graph
    pieces = "in one piece" if graph.connected else "in pieces"
    edges, detours = (
        counted(len(list(graph.edges)), "clear connections"),
        counted(len(list(graph.detours)), "detours"),
    )
    yield (
        "graph",
        f"{edges} up to {planner.max_edge_m:g} m, {detours}, {pieces}; planner: {planner.kind}",
    )


def _expected(mission: Mission) -> Iterator[_Row]:
    """The least expected clearance of the true vehicle, by kind of leg, with warnings."""
    planner, kinds = mission.planner, expected_clearances(mission)
    conditions = (
        f"wind {planner.wind_m_s:g} m/s, GPS accuracy {planner.position_accuracy_m:g} m (h_acc)"
    )
    margin = mission.tracking
    off = f"{margin.error_m:.2f} m off a leg at {mission.speed_m_s:g} m/s, {margin.turn_m:.2f} m"
    yield "plans for", f"{conditions}: up to {off} in turns"
    near = [kind for kind in kinds if math.isfinite(kind.kept_m)]
    text = ", ".join(f"{kind.name} {kind.kept_m:.1f} m" for kind in near)
    if mission.zones or mission.fences:
        yield "expected", f"least true distance to zones and fence: {text}"
    for kind in kinds:
        if kind.short_m > 0:
            short = f"{kind.kept_m:.2f} m of {kind.to}, {kind.promised_m:g} m are promised"
            yield "WARNING", f"{kind.name}: {short}; {kind.advice}"


def _legs(findings: MissionSurvey) -> Iterator[_Row]:
    through = f"{findings.length_m:.0f} m from home through all waypoints and back"
    yield "exploring", f"{through}, about {_duration(findings.flight_time_s)}"
    for step in findings.tightest(_TIGHTEST):
        yield "tightest", f"{_way(step)}, {step.closest_m:.1f} m from {step.closest_to}"
    around = [
        f"{_way(step)}, because of {_names(step.straight_blockers, ' and ')}"
        for step in findings.around
    ]
    yield from _first_of("around", around, "")


def _idle(findings: MissionSurvey) -> Iterator[_Row]:
    below = "; kept from below that, climbing and landing"
    zones = [
        f"{idle.zone.name}: {idle.reason}{below if idle.below else ''}"
        for idle in findings.mission.idle_zones
    ]
    yield from _first_of("idle", zones, " zones")


def _first_of(about: str, texts: list[str], things: str) -> Iterator[_Row]:
    yield from ((about, text) for text in texts[:_MOST_LINES])
    if len(texts) > _MOST_LINES:
        yield about, f"and {len(texts) - _MOST_LINES} more{things}"


def _team(findings: MissionSurvey) -> Iterator[_Row]:
    """The team, the topics by which its robots are found, layers of several UAVs, and notes."""
    mission = findings.mission
    if mission.team is not None:
        uavs = [layer.uav for layer in mission.layers]
        flying = f"{mission.uav} flies and seeks"
        if len(uavs) > 1:
            flying = f"{' and '.join(uavs)} fly and seek"
        seek = ", ".join(mission.seek) or "every other robot"
        yield "team", f"{mission.team}: {flying} {seek} ({mission.seek_policy})"
        found: dict[str, list[str]] = {}
        for robot, topic in finders(mission).items():
            found.setdefault(f"{topic.name} ({topic.type})", []).append(robot)
        for topic_text, robots in found.items():
            yield "found by", f"{topic_text}: {_names(robots)}"
    for layer in mission.layers:
        does = "explores and searches" if layer.explore else "only searches"
        shown = " (its mission is shown here)" if layer.uav == mission.uav else ""
        yield "layer", f"{layer.uav}: {layer.altitude_m:g} m above its home, {does}{shown}"
    for note in mission.notes:
        yield "note", str(note)


def _coming_home(findings: MissionSurvey) -> Iterator[_Row]:
    mission, ways = findings.mission, findings.return_planner
    worst, place = ways.worst_waypoint, ways.worst_place
    if worst is not None:
        number, way = worst
        where = f"farthest is waypoint {number}: {way.length_m:.0f} m, "
        time = f"{_duration(ways.pace.home_s(way))} to the ground"
        yield "home", f"{where}{time}{_charge(mission, ways.pace, way)}"
    if place is not None and worst is not None and place[1].length_m > worst[1].length_m + 0.5:
        (a, b), way = place
        charge = "" if mission.endurance_s is None else _charge(mission, ways.pace, way)
        where = f"from between {_node(a)} and {_node(b)}: {way.length_m:.0f} m, "
        yield "home", f"{where}{_duration(ways.pace.home_s(way))}{charge}"
    if mission.rally_points and not ways.rally:
        yield "rally", "no clear way leads to a rally point"
    elif mission.rally_points:
        farthest = max(ways.rally, key=lambda node: ways.rally[node].length_m)
        length_m = ways.rally[farthest].length_m
        yield "rally", f"a rally point is at most {length_m:.0f} m away, from {_node(farthest)}"
    ordered = sorted(straight_returns(mission), key=lambda r: (r.to != "home", r.to, r.waypoint))
    for to, group in groupby(ordered, key=lambda r: r.to):
        returns = list(group)
        zones = dict.fromkeys(name for r in returns for name in r.cuts)
        numbers = _ranges([r.waypoint for r in returns])
        yield "PX4 return", f"straight to {to} would cross {_names(zones)}: from {numbers}"


def _charge(mission: Mission, pace: Pace, way: Way) -> str:
    need = pace.need(way)
    if need is None:
        return "; set endurance_s to see its share of the battery"
    whole = need + LANDING_MARGIN
    verdict = "covers" if mission.battery_reserve >= whole else "does not cover"
    early = "" if mission.battery_reserve >= whole else ": the vehicle turns at that charge"
    return (
        f", {need:.0%} of a full battery; battery_reserve {mission.battery_reserve:.0%} {verdict} "
        f"it and {LANDING_MARGIN:.0%} left on the ground{early}"
    )


def facts_of(findings: MissionSurvey) -> dict[str, Any]:
    """The summary as one JSON object; docs/commands.md lists its keys."""
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
        "planning_distance_m": mission.planning_distance_m,
        "planner": mission.planner.kind,
        "tracking": {
            "error_m": mission.tracking.error_m,
            "turn_m": mission.tracking.turn_m,
            "planned_m": mission.tracking.planned_m,
            "flown_m": mission.tracking.flown_m,
            "turned_m": mission.tracking.turned_m,
            "wind_m_s": mission.planner.wind_m_s,
            "position_accuracy_m": mission.planner.position_accuracy_m,
        },
        "expected_clearance_m": {
            kind.name: round(kind.kept_m, 3) for kind in expected_clearances(mission)
        },
        "seek": list(mission.seek),
        "seek_policy": mission.seek_policy,
        "found_by": {
            robot: {"topic": topic.name, "type": topic.type}
            for robot, topic in finders(mission).items()
        },
        "edges": len(list(findings.graph.edges)),
        "detours": len(list(findings.graph.detours)),
        "connected": findings.graph.connected,
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


def _ranges(numbers: list[int]) -> str:
    """Numbers as short ranges: 1, 4-6, 9."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    ranges = [str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    if len(ranges) <= _MOST_RUNS:
        return ", ".join(ranges)
    return f"{', '.join(ranges[:_MOST_RUNS])} ... ({sum(map(len, runs))} waypoints)"


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


def _altitudes(given_m: Sequence[float]) -> str:
    low, high = min(given_m), max(given_m)
    return f"{low:g} m" if math.isclose(low, high) else f"{low:g} to {high:g} m"


def _own(mission: Mission) -> str:
    own = [zone for zone in mission.airspace.zones if zone.clearance_m is not None]
    if not own:
        return ""
    margin_m = mission.tracking.planned_m
    kept = ", ".join(
        f"{(zone.clearance_m or 0.0) + margin_m:.2f} m from {zone.name}" for zone in own[:4]
    )
    more = f" and {len(own) - 4} more" if len(own) > 4 else ""
    return f"; {kept}{more}"
