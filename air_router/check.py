"""`air-router check`: whether a mission can be flown as it is written, and what to expect."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from air_router.errors import ExitCode, MissionFileError
from air_router.graph import WaypointGraph
from air_router.mission import Mission, load_mission
from air_router.survey import Step, Survey, survey


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `check` to the command line."""
    parser = commands.add_parser(
        "check",
        help="check a mission file and say what to expect",
        description="Check a mission: prints every error as file:line:column, or a summary.",
        epilog="example: air-router check missions/pennovation/mission.yaml --png mission.png",
    )
    parser.add_argument("mission", type=Path, metavar="MISSION", help="mission YAML or .plan")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument("--png", type=Path, metavar="F", help="draw the mission into F")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Check, and print the summary."""
    try:
        mission = load_mission(arguments.mission)
    except MissionFileError as error:
        if arguments.json:
            _print_json({"valid": False, "problems": _problems(error)})
        raise
    graph = WaypointGraph(mission)
    findings = survey(graph)
    if arguments.json:
        _print_json({"valid": not findings.stranded, "problems": [], **_facts(mission, findings)})
    else:
        sys.stdout.write("\n".join(summary(mission, findings)) + "\n")
    if arguments.png is not None:
        from air_router.picture import draw_mission  # noqa: PLC0415 - an extra

        draw_mission(mission, arguments.png, graph=graph)
    for number, reason in findings.stranded:
        sys.stderr.write(f"{mission.path}: no way home from waypoint {number}: {reason}\n")
    return ExitCode.INVALID_FILE if findings.stranded else ExitCode.DONE


def summary(mission: Mission, findings: Survey) -> list[str]:
    """A person's view of a mission that was found to be in order."""
    planner = mission.planner
    margin = (
        f"clearance {planner.clearance_m:g} m + tracking margin {planner.tracking_margin_m:g} m"
    )
    fence = ("no fence", "a fence")[min(len(mission.fences), 1)]
    if len(mission.fences) > 1:
        fence = f"{len(mission.fences)} fences"
    pieces = "in one piece" if findings.connected else "in pieces"
    minutes, seconds = divmod(round(findings.flight_time_s(mission.speed_m_s)), 60)
    lines = [
        (
            f"{mission.name}: {len(mission.waypoints)} waypoints, "
            f"{len(mission.zones)} no-fly zones, {fence}, {len(mission.rally_points)} rally points"
        ),
        f"  flies      {mission.altitude_above_home_m:g} m above home at {mission.speed_m_s:g} m/s",
        f"  keeps      {planner.distance_m:g} m from zones and fence ({margin})",
        (
            f"  graph      {findings.edges} clear connections up to {planner.max_edge_m:g} m, "
            f"{findings.detours} detours, {pieces}"
        ),
        (
            f"  exploring  {findings.length_m:.0f} m from home through all waypoints and back, "
            f"about {minutes} min {seconds} s"
        ),
    ]
    tightest = findings.tightest
    if tightest is not None and tightest.closest_to:
        lines.append(
            f"  tightest   {_way(tightest)}, {tightest.closest_m:.1f} m from {tightest.closest_to}"
        )
    lines += [
        f"  around     {_way(step)}, because of {' and '.join(step.straight_blockers)}"
        for step in findings.steps
        if step.straight_blockers
    ]
    if mission.team is not None:
        seek = ", ".join(mission.seek) or "every other robot"
        lines.append(f"  team       {mission.team}: {mission.uav} flies and seeks {seek}")
    return lines


def _way(step: Step) -> str:
    via = [str(leg.node) if leg.node is not None else "a corner" for leg in step.route.legs[:-1]]
    through = f" by way of {', '.join(via)}" if via else ""
    return f"{_node(step.start)} to {_node(step.end)}{through}"


def _node(node: int) -> str:
    return str(node) if node else "home"


def _facts(mission: Mission, findings: Survey) -> dict[str, Any]:
    tightest = findings.tightest
    return {
        "mission": mission.name,
        "path": str(mission.path),
        "waypoints": len(mission.waypoints),
        "zones": len(mission.zones),
        "fence": bool(mission.fences),
        "rally_points": len(mission.rally_points),
        "clearance_m": mission.planner.clearance_m,
        "planning_distance_m": mission.planner.distance_m,
        "edges": findings.edges,
        "detours": findings.detours,
        "connected": findings.connected,
        "stranded": [number for number, _ in findings.stranded],
        "path_length_m": round(findings.length_m, 2),
        "flight_time_s": round(findings.flight_time_s(mission.speed_m_s), 1),
        "tightest_leg": None
        if tightest is None or not tightest.closest_to
        else {
            "from": tightest.start,
            "to": tightest.end,
            "distance_m": round(tightest.closest_m, 3),
            "closest_to": tightest.closest_to,
        },
    }


def _problems(error: MissionFileError) -> list[dict[str, Any]]:
    return [problem.as_json() for problem in error.problems]


def _print_json(answer: dict[str, Any]) -> None:
    json.dump(answer, sys.stdout)
    sys.stdout.write("\n")
