"""`mocha-link check`: what a team file says, and every problem in it."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path
from typing import Any

from mocha_link.command_help import add_command
from mocha_link.display import rules_line, team_tables
from mocha_link.document import DocumentError
from mocha_link.keys_command import links, protection_lines
from mocha_link.team import Team


def register(commands: Any) -> None:
    """Add `check` to the commands of `mocha-link`."""
    check = add_command(
        commands,
        "check",
        "check a team file and show its ids and ports",
        "mocha-link check missions/pennovation/team.yaml",
    )
    check.add_argument("team", type=Path, metavar="TEAM", help="team file (YAML)")
    check.add_argument(
        "--json", action="store_true", help="print the ids and ports, or the problems, as JSON"
    )
    check.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    try:
        team = Team.load(options.team)
    except DocumentError as error:
        if options.json:
            print(json.dumps({"problems": [problem.as_json() for problem in error.problems]}))
        raise
    if options.json:
        print(json.dumps(_ids(team)))
        return 0
    print("\n".join([team_tables(team), "", rules_line(team), *protection_lines(team)]))
    return 0


def _ids(team: Team) -> dict[str, Any]:
    return {
        "robots": {
            robot.name: {
                "robot_id": robot.robot_id,
                "kind": robot.kind,
                "address": robot.address,
                "radio": robot.radio,
                "original": robot.original,
                "ports": {peer: robot.port_for(peer) for peer in robot.peers},
            }
            for robot in team.robots.values()
        },
        "kinds": {
            kind: {
                topic.name: {
                    "topic_id": topic.topic_id,
                    "type": topic.type,
                    "dtype": topic.dtype,
                    "priority": topic.priority.name.lower(),
                    "min_interval_s": topic.min_interval_s,
                    "history": topic.history,
                    "aggregate": topic.aggregate,
                }
                for topic in topics
            }
            for kind, topics in team.kinds.items()
        },
        "trigger": dataclasses.asdict(team.trigger),
        "trust": team.trust.value,
        "links": [
            {"robots": link.robots, "open_because": link.open_because} for link in links(team)
        ],
    }
