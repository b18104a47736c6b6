"""`mocha-link check`: the content of a team file, and every problem in it."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from typing import Any

import click

from mocha_link.cli.keys_command import links, protection_lines
from mocha_link.cli.links_view import aligned
from mocha_link.cli.program import PATH, Options, command, examples, option
from mocha_link.cli.rollout import changes
from mocha_link.team import DocumentError, Team, keys

LOG = logging.getLogger("mocha_link")


@command(
    "Check a team file and show its ids and ports. With NEW, compare two team files: list what "
    "nodes with OLD and nodes with NEW do not exchange while both files are in use. Exit code 1: "
    "NEW interrupts an exchange.",
    examples(
        "mocha-link check missions/pennovation/team.yaml",
        "mocha-link check team.yaml team.new.yaml     # before a roll-out",
    ),
)
@click.argument("team", type=PATH, metavar="TEAM|OLD", help="team file (YAML)")
@click.argument("new", type=PATH, required=False, help="team file that will replace OLD")
@option("--json", is_flag=True, help="print one JSON object on stdout")
def run(options: Options) -> int:
    """Do it; returns the exit code."""
    try:
        team = Team.load(options.team)
        new = Team.load(options.new) if options.new else None
    except DocumentError as error:
        if options.json:
            print(json.dumps({"problems": [problem.as_json() for problem in error.problems]}))
        raise
    if new:
        return _compare(team, new, as_json=options.json)
    exposure = keys.exposure(team, team.robots.values())
    if exposure:
        LOG.warning("%s", exposure)
    if options.json:
        print(json.dumps(_ids(team)))
        return 0
    print("\n".join([_team_tables(team), "", _rules_line(team), *protection_lines(team)]))
    return 0


def _compare(old: Team, new: Team, *, as_json: bool) -> int:
    """Print what a roll-out changes; returns the exit code."""
    found = changes(old, new)
    cuts = sum(change.cuts for change in found)
    if as_json:
        listed = [change.as_json() for change in found]
        print(json.dumps({"cuts": bool(cuts), "changes": listed}))
        return 1 if cuts else 0
    for change in found:
        print(f"{'CUTS' if change.cuts else 'ok  '}  {change}")
    if not found:
        print("both files mean the same")
    elif cuts:
        print(
            f"\n{cuts} of {len(found)} changes cut the exchange until all nodes have the new file"
        )
    else:
        print(f"\nnone of {len(found)} changes cuts the exchange: restart the nodes in any order")
    return 1 if cuts else 0


def _ids(team: Team) -> dict[str, Any]:
    return {
        "robots": {
            robot.name: {
                **robot.model_dump(include={"robot_id", "kind", "address", "radio", "original"}),
                "ports": {peer: robot.port_for(peer) for peer in robot.peers},
            }
            for robot in team.robots.values()
        },
        "kinds": {
            kind: {topic.name: topic.model_dump(exclude={"name"}) for topic in topics}
            for kind, topics in team.kinds.items()
        },
        "trigger": team.trigger.model_dump(),
        "trust": team.trust.value,
        "exposed": [r.name for r in team.robots.values() if keys.exposed(team, r)],
        "links": [{"robots": robots, "open_because": why} for robots, why in links(team).items()],
    }


def _team_tables(team: Team) -> str:
    """The robots and topics of a team with the ids and ports that follow from the file.

    What no robot or topic of the team has is not shown.
    """
    rows = [("robot", "id", "kind", "address", "ports", "radio", "node")]
    for robot in sorted(team.robots.values(), key=lambda robot: robot.robot_id):
        ports = ", ".join(f"{peer}:{robot.port_for(peer)}" for peer in robot.peers) or "-"
        radio = robot.radio or f"timer, {team.trigger.interval_s:g} s"
        node = "original" if robot.original else ""
        rows.append(
            (robot.name, str(robot.robot_id), robot.kind, robot.shown_address, ports, radio, node)
        )
    heads = ("kind", "topic", "id", "type", "dtype", "priority", "at most every", "keeps", "sends")
    kinds: list[tuple[str, ...]] = [heads]
    for kind, topics in team.kinds.items():
        for topic in topics:
            interval = f"{topic.min_interval_s:g} s" if topic.min_interval_s else "-"
            ids = (str(topic.topic_id), topic.type, str(topic.dtype))
            keeps = f"{topic.history}" if topic.history > 1 else ""
            sends = "all together" if topic.aggregate else ""
            kinds.append(
                (kind, topic.name, *ids, topic.priority.name.lower(), interval, keeps, sends)
            )
    return "\n".join([*aligned(_used(rows)), "", *aligned(_used(kinds))])


def _rules_line(team: Team) -> str:
    """When nodes pull, and whose messages they take."""
    trigger = team.trigger
    pulls = f"pulls every {trigger.interval_s:g} s"
    if any(robot.radio for robot in team.robots.values()):
        pulls += (
            f"; with a radio from a signal of {trigger.rssi_threshold_dbm:g} dBm, "
            f"{trigger.snr_threshold_db:g} dB SNR or {trigger.device_threshold:g} device units on "
            f"(hysteresis {trigger.hysteresis_db:g})"
        )
    if trigger.budget_bytes:
        pulls += f"; at most {trigger.budget_bytes} bytes in a contact"
    return f"{pulls}; trust: {team.trust.value}"


def _used(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """The table without columns that are empty below their head."""
    used = [index for index in range(len(rows[0])) if any(row[index] for row in rows[1:])]
    return [[row[index] for index in used] for row in rows]
