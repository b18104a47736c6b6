"""`air-router plan`: the route between two waypoints, as the vehicle would fly it."""

from __future__ import annotations

import argparse
import json
import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

from air_router.command_line import add_start
from air_router.errors import ExitCode, UsageError
from air_router.graph import WaypointGraph
from air_router.mission import Mission, load_mission
from air_router.router import Leg, NoRoute, Route, Router
from air_router.survey import closest_approach, route_time_s
from geo.frame import Point


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `plan` to the command line."""
    parser = commands.add_parser(
        "plan",
        help="plan a route between two waypoints",
        description="Plan the route between two waypoints; 0 is home.",
        epilog="example: air-router plan missions/pennovation/mission.yaml --from 1 --to 34",
    )
    parser.add_argument("mission", type=Path, metavar="MISSION", help="mission YAML or .plan")
    add_start(parser)
    parser.add_argument("--from", type=int, required=True, metavar="N", dest="start", help="start")
    parser.add_argument("--to", type=int, required=True, metavar="N", dest="end", help="goal")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument("--png", type=Path, metavar="F", help="draw mission and route into F")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Plan, and print the route's legs."""
    mission = load_mission(arguments.mission, start=arguments.at)
    graph = WaypointGraph(mission)
    for node in (arguments.start, arguments.end):
        if node not in graph.positions:
            last = len(mission.waypoints)
            raise UsageError(f"no waypoint {node}; {mission.name} has 1 to {last}, and 0 is home")
    start = graph.position(arguments.start)
    route = Router(graph).route(start, arguments.end)
    if isinstance(route, NoRoute):
        sys.stderr.write(f"no route from {arguments.start} to {arguments.end}: {route.reason}\n")
        return ExitCode.ENDED_OTHERWISE
    if arguments.json:
        json.dump(_facts(mission, arguments.start, arguments.end, route, start), sys.stdout)
        sys.stdout.write("\n")
    else:
        sys.stdout.write("\n".join(_lines(mission, arguments.start, start, route)) + "\n")
    if arguments.png is not None:
        from air_router.picture import draw_mission  # noqa: PLC0415 - an extra

        draw_mission(mission, arguments.png, graph=graph, route=(start, route))
    return ExitCode.DONE


def _lines(mission: Mission, node: int, start: Point, route: Route) -> list[str]:
    lines = [f"{'from':>10}  {'to':>10}  {'length':>8}  {'east':>8}  {'north':>8}  closest"]
    name = _name(Leg(start, node))
    for (before, leg), (near_m, what) in zip(
        pairwise([Leg(start, node), *route.legs]), _approaches(mission, start, route), strict=True
    ):
        lines.append(
            f"{name:>10}  {_name(leg):>10}  {math.dist(before.to, leg.to):6.1f} m  "
            f"{leg.to.east_m:6.1f} m  {leg.to.north_m:6.1f} m  {_near(near_m, what, 'from')}"
        )
        name = _name(leg)
    closest_m, closest_to = closest_approach(mission, start, route)
    lines.append(
        f"{route.length_m:.1f} m, about {route_time_s(route, mission.speed_m_s):.0f} s; "
        f"closest approach {_near(closest_m, closest_to, 'to')}"
    )
    return lines


def _near(distance_m: float, what: str, word: str) -> str:
    return f"{distance_m:.1f} m {word} {what}" if what else "nothing near"


def _name(leg: Leg) -> str:
    if leg.node is None:
        return "corner"
    return str(leg.node) if leg.node else "home"


def _approaches(mission: Mission, start: Point, route: Route) -> list[tuple[float, str]]:
    points = [start, *(leg.to for leg in route.legs)]
    return [mission.airspace.track_distance_m(pair) for pair in pairwise(points)]


def _facts(mission: Mission, node: int, end: int, route: Route, start: Point) -> dict[str, Any]:
    closest_m, closest_to = closest_approach(mission, start, route)
    legs = []
    before = start
    for leg, (near_m, what) in zip(route.legs, _approaches(mission, start, route), strict=True):
        latitude_deg, longitude_deg = mission.frame.to_geodetic(leg.to)
        legs.append(
            {
                "node": leg.node,
                "latitude_deg": round(latitude_deg, 7),
                "longitude_deg": round(longitude_deg, 7),
                "east_m": round(leg.to.east_m, 3),
                "north_m": round(leg.to.north_m, 3),
                "length_m": round(math.dist(before, leg.to), 3),
                "closest_m": _finite(near_m),
                "closest_to": what or None,
            }
        )
        before = leg.to
    return {
        "from": node,
        "to": end,
        "length_m": round(route.length_m, 3),
        "flight_time_s": round(route_time_s(route, mission.speed_m_s), 1),
        "clearance_m": mission.planner.clearance_m,
        "closest_approach_m": _finite(closest_m),
        "closest_approach_to": closest_to or None,
        "legs": legs,
    }


def _finite(distance_m: float) -> float | None:
    return round(distance_m, 3) if math.isfinite(distance_m) else None
