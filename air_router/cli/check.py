"""`air-router check`: whether a mission can be flown as written, and what to expect."""

import importlib.util
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from air_router.cli.arguments import print_json, start_option, uav_option
from air_router.errors import ExitCode
from air_router.files import SEEK_POLICIES, Findings
from air_router.files.missions import PlacedForm
from air_router.mission import Mission, chosen, read_placed, unusual, validate
from air_router.preflight import (
    MissionSurvey,
    WorldUncheckedError,
    check_world,
    facts_of,
    summary,
    world_notes,
)
from air_router.routing import WaypointGraph
from mocha_link.cli import PATH, Options, command, option
from mocha_link.team import DocumentError, Problem

_EPILOG = """\
examples:
  air-router check missions/pennovation/mission.yaml
  air-router check broken.yaml --png broken.png       (problems are drawn in red)
  air-router check site.yaml --at 2026-11-21T06:30Z   (with the zones that apply at that time)

exit codes: 0 the mission can be flown, 3 it cannot: every problem is listed with line and code
"""


@command(
    "Check a mission: print every problem as file:line:column, or a summary of the flight.", _EPILOG
)
@click.argument("mission", type=PATH, help="mission file (.yaml or .plan)")
@option("--json", is_flag=True, help="print one JSON object on stdout")
@option("--png", type=PATH, metavar="F", help="draw the mission into file F, even if it has errors")
@start_option
@uav_option
def run(arguments: Options) -> int:
    """Check, and print the summary."""
    try:
        placed, findings = read_placed(arguments.mission)
    except DocumentError as error:
        raise _refusal(error.problems, (), arguments) from None
    if arguments.uav is not None:
        placed = chosen(placed, arguments.uav)
    mission = validate(placed, findings, arguments.at)
    if findings.problems or mission is None:
        refusal = _refusal(findings.problems, findings.notes, arguments)
        if arguments.png is not None and mission is not None:
            _draw_wrong(placed, findings, mission, arguments.png)
        raise refusal
    mission = replace(mission, notes=(*mission.notes, *world_notes(mission.world)))
    survey = MissionSurvey(WaypointGraph(mission))
    _check_policy(mission)
    try:
        _check_world(mission)
    except DocumentError as error:
        raise _refusal(error.problems, findings.notes, arguments) from None
    if arguments.json:
        print_json(facts_of(survey))
    else:
        sys.stdout.write("\n".join(summary(survey)) + "\n")
    if arguments.png is not None:
        from air_router.report import draw_mission  # noqa: PLC0415 - an extra

        legs = [
            (survey.graph.position(step.start), survey.graph.position(step.end))
            for step in survey.around
        ]
        draw_mission(mission, arguments.png, graph=survey.graph, around=legs)
        sys.stderr.write(f"drawn: {arguments.png}\n")
    for number, reason in survey.stranded:
        sys.stderr.write(f"{mission.path}: no way home from waypoint {number}: {reason}\n")
    return ExitCode.INVALID_FILE if survey.stranded else ExitCode.DONE


def _check_policy(mission: Mission) -> None:
    """Load the seek policy of another package. Raises SeekPolicyError."""
    if mission.seek_policy not in SEEK_POLICIES:
        from air_router.seek_policies import policy_of  # noqa: PLC0415 - few missions need it

        policy_of(mission.seek_policy)


def _check_world(mission: Mission) -> None:
    """Check the world file, where there is one and it can be simulated.

    Raises DocumentError or WorldRefusedError: it is wrong.
    """
    if mission.world is None or importlib.util.find_spec("sitl") is None:
        return
    try:
        check_world(mission.path)
    except WorldUncheckedError as error:  # the mission can be flown outside all the same
        sys.stderr.write(f"the world file is not checked: {error}\n")


def _draw_wrong(placed: PlacedForm, findings: Findings, mission: Mission, path: Path) -> None:
    from air_router.mission import faults_of  # noqa: PLC0415 - only for pictures
    from air_router.report import draw_mission  # noqa: PLC0415 - an extra

    graph = None if "planner" in placed.form.unread else WaypointGraph(mission)
    draw_mission(mission, path, graph=graph, faults=faults_of(placed, findings, mission))
    sys.stderr.write(f"drawn: {path}\n")


def _refusal(
    problems: Sequence[Problem], notes: Sequence[Problem], arguments: Options
) -> DocumentError:
    """Why it cannot be flown, as scripts read it."""
    if arguments.json:
        listed = {"problems": DocumentError(problems).problems, "notes": notes}
        facts = {key: [each.as_json() for each in of] for key, of in listed.items()}
        print_json({"valid": False, **facts})
    return DocumentError([*problems, *unusual(notes)])
