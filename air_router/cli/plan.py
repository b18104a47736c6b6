"""`air-router plan`: the route between two waypoints, or any places, as it would be flown."""

import contextlib
import math
import sys
from collections.abc import Iterator
from itertools import pairwise, product
from typing import Any

import click

from air_router.cli.arguments import place, print_json, start_option, uav_option
from air_router.errors import ExitCode, UsageError
from air_router.mission import FAR_M, Mission, load_mission
from air_router.preflight import closest_approach, route_time_s
from air_router.routing import Leg, NoRoute, Route, Router, WaypointGraph
from geo.airspace import FENCE
from geo.frame import FrameError, Geodetic, Point
from mocha_link.cli import PATH, Options, Parsed, command, option

_EPILOG = """\
examples:
  air-router plan missions/pennovation/mission.yaml --from 1 --to 34
  air-router plan missions/pennovation/mission.yaml --from 0 --to 39.9412,-75.2001
"""

_STEPS = (0, -1, 1)
"""Around a place, in the last digit that is printed of a degree: a centimetre."""


Stop = int | Geodetic
"""Where a route begins or ends: a waypoint (0: home), or any place."""


def _stop(text: str) -> Stop:
    try:
        return place(text) if "," in text else int(text)
    except ValueError as error:
        advice = str(error).partition(";")[2] if "," in text else " 0 is home"
        message = f"{text} is neither a waypoint's number nor LATITUDE,LONGITUDE"
        message += f";{advice}" * bool(advice)
        raise ValueError(message) from None


@command("Plan the route between two waypoints (0 is home) or positions in degrees.", _EPILOG)
@click.argument("mission", type=PATH, help="mission file (.yaml or .plan)")
@start_option
@uav_option
@option(
    "--from",
    "start",
    type=Parsed(_stop),
    required=True,
    metavar="N|LAT,LON",
    help="start of the route: a waypoint number (0: home), or a position in degrees",
)
@option(
    "--to",
    "end",
    type=Parsed(_stop),
    required=True,
    metavar="N|LAT,LON",
    help="end of the route: a waypoint number (0: home), or a position in degrees",
)
@option("--json", is_flag=True, help="print one JSON object on stdout")
@option("--png", type=PATH, metavar="F", help="draw mission and route into file F")
def run(arguments: Options) -> int:
    """Plan, and print the route's legs."""
    mission = load_mission(arguments.mission, uav=arguments.uav, start=arguments.at)
    graph = WaypointGraph(mission)
    begin = _leg(arguments.start, graph, "--from")
    end = _leg(arguments.end, graph, "--to")
    start = begin.to
    route = Router(graph).route(start, end.to if end.node is None else end.node)
    if isinstance(route, NoRoute):
        sys.stderr.write(
            f"no route from {_place_text(arguments.start)} to {_place_text(arguments.end)}: "
        )
        sys.stderr.write(f"{route.reason}{_instead(graph, start, end.to)}\n")
        return ExitCode.ENDED_OTHERWISE
    for warning in route.warnings:
        sys.stderr.write(f"{warning}\n")
    if arguments.json:
        ends = {"from": arguments.start, "to": arguments.end}
        print_json(ends | _facts(mission, begin, route))
    else:
        sys.stdout.write("\n".join(_lines(mission, begin, route)) + "\n")
    if arguments.png is not None:
        from air_router.report import draw_mission  # noqa: PLC0415 - an extra

        draw_mission(mission, arguments.png, graph=graph, route=(start, route))
        sys.stderr.write(f"drawn: {arguments.png}\n")
    return ExitCode.DONE


def _leg(stop: Stop, graph: WaypointGraph, option: str) -> Leg:
    """A stop as the end of a leg."""
    mission = graph.mission
    if isinstance(stop, Geodetic):
        return Leg(_near_home(stop, mission, option))
    if stop not in graph.positions:
        last = len(mission.waypoints)
        raise UsageError(f"no waypoint {stop}; {mission.name} has 1 to {last}, and 0 is home")
    return Leg(graph.position(stop), stop)


def _near_home(given: Geodetic, mission: Mission, option: str) -> Point:
    """A place in the mission's frame, as near to home as a mission's own places have to be."""

    def point(place: Geodetic) -> tuple[Point, float]:
        found = mission.frame.to_local(*place)
        return found, math.dist(found, mission.home)

    try:
        found, away_m = point(given)
    except FrameError as error:
        raise UsageError(f"{option}: {error}") from None
    if away_m <= FAR_M:
        return found
    swapped = Geodetic(given.longitude_deg, given.latitude_deg)
    advice = "correct it"
    with contextlib.suppress(FrameError):
        if point(swapped)[1] <= FAR_M:
            advice = f"latitude comes first: {_place_text(swapped)}"
    far = f"{option}: {_place_text(given)} is {away_m / 1000:.0f} km from home; {advice}"
    raise UsageError(far)


def _instead(graph: WaypointGraph, start: Point, goal: Point) -> str:
    """The place to hover that a flight would choose for a goal that is not clear, as text.

    In the digits that are printed it is clear too: they can be copied into `--to`.
    """
    mission, airspace = graph.mission, graph.mission.planning_airspace
    place = None if airspace.point_clear(goal) else graph.paths.nearest(goal, reachable_from=start)
    if place is None:
        return ""
    latitude_deg, longitude_deg = mission.frame.to_geodetic(place)
    printed = [
        Geodetic(round(latitude_deg + north / 1e7, 7), round(longitude_deg + east / 1e7, 7))
        for north, east in product(_STEPS, _STEPS)
    ]
    away_m = {at: math.dist(mission.frame.to_local(*at), goal) for at in printed}
    clear = [at for at in printed if airspace.point_clear(mission.frame.to_local(*at))]
    best = min(clear or printed[:1], key=lambda at: away_m[at])
    return (
        f"; the nearest place to hover is {best.latitude_deg:.7f},{best.longitude_deg:.7f}, "
        f"{away_m[best]:.1f} m away"
    )


def _place_text(stop: Stop) -> str:
    return str(stop) if isinstance(stop, int) else f"{stop[0]:.9g},{stop[1]:.9g}"


def _lines(mission: Mission, begin: Leg, route: Route) -> list[str]:
    names = ["start" if begin.node is None else _name(begin), *map(_name, route.legs)]
    if route.legs and route.legs[-1].node is None:
        names[-1] = "goal"
    lines = [f"{'from':>10}  {'to':>10}  {'length':>8}  {'east':>8}  {'north':>8}  closest"]
    legs = zip(pairwise(names), _legs(mission, begin, route), strict=True)
    for (here, there), (before, leg, near_m, what) in legs:
        lines.append(
            f"{here:>10}  {there:>10}  {math.dist(before.to, leg.to):6.1f} m  "
            f"{leg.to.east_m:6.1f} m  {leg.to.north_m:6.1f} m  {_near(near_m, what, 'from')}"
        )
    closest_m, closest_to = closest_approach(mission, begin.to, route)
    lines.append(
        f"{route.length_m:.1f} m, about {route_time_s(route, mission.speed_m_s):.0f} s; "
        f"closest approach {_near(closest_m, closest_to, 'to')}"
    )
    return lines


def _near(distance_m: float, what: str, preposition: str) -> str:
    if not what:
        return "nothing near"
    if distance_m < 0:
        return "outside the fence" if what == FENCE else f"inside {what}"
    return f"{distance_m:.1f} m {preposition} {what}"


def _name(leg: Leg) -> str:
    if leg.node is None:
        return "corner"
    return str(leg.node) if leg.node else "home"


def _legs(mission: Mission, begin: Leg, route: Route) -> Iterator[tuple[Leg, Leg, float, str]]:
    """The legs: where from and where to, how near they come (metres), and to what."""
    for before, leg in pairwise([begin, *route.legs]):
        yield before, leg, *mission.airspace.track_distance_m([before.to, leg.to])


def _facts(mission: Mission, begin: Leg, route: Route) -> dict[str, Any]:
    closest_m, closest_to = closest_approach(mission, begin.to, route)
    legs = []
    for before, leg, near_m, what in _legs(mission, begin, route):
        latitude_deg, longitude_deg = mission.frame.to_geodetic(leg.to)
        legs.append(
            {
                "node": leg.node,
                "latitude_deg": round(latitude_deg, 7),
                "longitude_deg": round(longitude_deg, 7),
                "east_m": round(leg.to.east_m, 3),
                "north_m": round(leg.to.north_m, 3),
                "length_m": round(math.dist(before.to, leg.to), 3),
                "closest_m": _finite(near_m),
                "closest_to": what or None,
            }
        )
    return {
        "length_m": round(route.length_m, 3),
        "flight_time_s": round(route_time_s(route, mission.speed_m_s), 1),
        "clearance_m": mission.planner.clearance_m,
        "closest_approach_m": _finite(closest_m),
        "closest_approach_to": closest_to or None,
        "legs": legs,
    }


def _finite(distance_m: float) -> float | None:
    return round(distance_m, 3) if math.isfinite(distance_m) else None
