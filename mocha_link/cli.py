"""The command `mocha-link`: run a node, read a node's metrics, check a team file."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import logging
import os
import queue
import signal
import sys
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from mocha_link.bridge_command import add_parser as add_bridge
from mocha_link.command_help import add_command, add_verbose, endpoint, style, web_address
from mocha_link.display import event_line, links_table, rules_line, team_tables
from mocha_link.document import DocumentError
from mocha_link.errors import MochaLinkError
from mocha_link.import_command import add_parser as add_import
from mocha_link.keys_command import add_parser as add_keys
from mocha_link.keys_command import links, protection_lines
from mocha_link.node import Node
from mocha_link.prometheus import PrometheusServer
from mocha_link.service_server import ServiceServer
from mocha_link.team import Team, UnknownRobotError
from mocha_link.telemetry import MetricsError, MetricsServer, as_fields, watch
from mocha_link.top_command import add_parser as add_top

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

    from mocha_link.metrics import LinkEvent

DONE, FAILED, USAGE, INVALID_FILE, INTERRUPTED = 0, 1, 2, 3, 130
_ENDPOINT = "tcp://127.0.0.1:24500"  # in examples
QUEUE_EVENTS = 10_000  # not yet printed; what comes on top is not shown

LOG = logging.getLogger("mocha_link")


class _Terminated(BaseException):
    """SIGTERM came."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(
        stream=sys.stderr,
        level=logging.DEBUG if options.verbose else logging.INFO,
        format="%(levelname)s %(message)s",
    )
    try:
        code: int = options.run(options)
    except DocumentError as error:
        print(error, file=sys.stderr)
        code = INVALID_FILE
    except UnknownRobotError as error:
        print(f"mocha-link: {error}", file=sys.stderr)
        code = USAGE
    except MochaLinkError as error:
        print(f"mocha-link: {error}", file=sys.stderr)
        code = FAILED
    except KeyboardInterrupt:
        code = INTERRUPTED
    except BrokenPipeError:  # e.g. `mocha-link metrics ... --follow | head`
        _drop_output()
        code = DONE
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mocha-link",
        description="Gossip node that carries data between robots whose links come and go.",
        **style(
            "mocha-link check missions/pennovation/team.yaml",
            f"mocha-link node missions/pennovation/team.yaml --robot io --metrics {_ENDPOINT}",
            f"mocha-link top {_ENDPOINT}",
        ),
    )
    add_verbose(parser)
    parser.add_argument("--version", action="version", version=f"mocha-link {_version()}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_check(commands)
    add_keys(commands)
    add_import(commands)
    _add_node(commands)
    _add_metrics(commands)
    add_top(commands)
    add_bridge(commands)
    return parser


def _version() -> str:
    try:
        return metadata.version("air-router")
    except metadata.PackageNotFoundError:  # run from the sources
        return "of an unknown version"


def _add_check(commands: Any) -> None:
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
    check.set_defaults(run=_check)


def _add_node(commands: Any) -> None:
    node = add_command(
        commands,
        "node",
        "run the node of a robot",
        "mocha-link node team.yaml --robot io",
        f"mocha-link node team.yaml --robot io --metrics {_ENDPOINT} --prometheus :9464",
        "mocha-link node team.yaml --robot io --storage io.db --keys /etc/mocha-link",
        "mocha-link node team.yaml --robot io --serve ipc:///tmp/io.node",
    )
    node.add_argument("team", type=Path, metavar="TEAM", help="team file (YAML)")
    node.add_argument("--robot", required=True, metavar="NAME", help="which robot this is")
    node.add_argument(
        "--metrics",
        type=endpoint,
        metavar="ENDPOINT",
        help=f"serve metrics there, e.g. {_ENDPOINT}",
    )
    node.add_argument(
        "--prometheus",
        type=web_address,
        metavar="HOST:PORT",
        help="serve metrics for Prometheus there, e.g. :9464 (this machine only)",
    )
    node.add_argument(
        "--storage",
        type=Path,
        metavar="FILE",
        help="keep the messages in this file, so that they survive a restart; default: in memory",
    )
    node.add_argument(
        "--keys",
        type=Path,
        metavar="DIR",
        help="the folder with the robot's secret, NAME.key, if the team has a key for it",
    )
    node.add_argument(
        "--serve",
        type=endpoint,
        metavar="ENDPOINT",
        help="serve bridges there, e.g. ipc:///tmp/io.node",
    )
    node.add_argument("--json", action="store_true", help="print events as JSON lines")
    node.set_defaults(run=_node)


def _add_metrics(commands: Any) -> None:
    metrics = add_command(
        commands,
        "metrics",
        "show the links of a running node",
        f"mocha-link metrics {_ENDPOINT}",
        f"mocha-link metrics {_ENDPOINT} --json --follow",
    )
    metrics.add_argument(
        "endpoint", type=endpoint, metavar="ENDPOINT", help="what the node got as --metrics"
    )
    metrics.add_argument("--json", action="store_true", help="print JSON, one object per line")
    metrics.add_argument("--follow", action="store_true", help="go on with events as they happen")
    metrics.add_argument(
        "--timeout", type=_seconds, default=5.0, metavar="S", help="wait so long, in s (5)"
    )
    metrics.set_defaults(run=_metrics)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0
    if not 0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"'{text}' is no time; write seconds, more than 0")
    return value


def _node(options: argparse.Namespace) -> int:
    node = Node(Team.load(options.team), options.robot, storage=options.storage, keys=options.keys)
    events: queue.Queue[LinkEvent] = queue.Queue(QUEUE_EVENTS)

    def keep(event: LinkEvent) -> None:  # the node must not wait for whoever reads our output
        with contextlib.suppress(queue.Full):
            events.put_nowait(event)

    def terminate(_number: int, _frame: FrameType | None) -> None:
        raise _Terminated

    node.subscribe(keep)
    before = signal.signal(signal.SIGTERM, terminate)
    try:
        with node, contextlib.ExitStack() as stack:
            if options.metrics:
                server = stack.enter_context(MetricsServer(node, options.metrics))
                _say(f"metrics on {server.endpoint}")
            if options.prometheus:
                web = stack.enter_context(PrometheusServer(node, options.prometheus))
                _say(f"metrics on {web.url}")
            if options.serve:
                service = stack.enter_context(ServiceServer(node, options.serve))
                _say(f"serves bridges on {service.endpoint}")
            robot = node.robot
            if robot.original:
                LOG.warning(
                    "%s says that %s runs the original node: the others speak the old protocol "
                    "with it; if this node is to stay, take 'original' away in every team file",
                    options.team,
                    robot.name,
                )
            if options.storage and not node.storage_fault:
                count = len(node.messages())
                _say(f"{options.storage} has {count} message{'s' * (count != 1)}")
            for peer in robot.peers:
                _say(f"{robot.name} answers {peer} on {robot.listen}:{robot.port_for(peer)}")
            _say("ready; Ctrl-C ends")
            _show(events, as_json=options.json)
    except _Terminated:
        return DONE
    finally:
        signal.signal(signal.SIGTERM, before)
    return DONE


def _show(events: queue.Queue[LinkEvent], *, as_json: bool) -> NoReturn:
    while True:
        event = events.get()
        fields = {"event": type(event).__name__, **as_fields(event)}
        try:
            print(json.dumps(fields) if as_json else event_line(fields), flush=True)
        except BrokenPipeError:
            _drop_output()
            LOG.warning("nobody reads the events any more; the node goes on without")


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _drop_output() -> None:
    """Let what is still printed, also at exit, go nowhere instead of into a broken pipe."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def _metrics(options: argparse.Namespace) -> int:
    shown = False
    for kind, fields in watch(options.endpoint, timeout_s=options.timeout):
        try:
            text = links_table(fields) if kind == "links" else event_line(fields)
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError, OSError):
            raise MetricsError(f"what {options.endpoint} sends is not a node's metrics") from None
        if options.json:
            print(json.dumps(fields), flush=True)
        elif kind != "links" or not shown:  # the table once, then the news
            print(text, flush=True)
        shown = shown or kind == "links"
        if shown and not options.follow:
            break
    return DONE


def _check(options: argparse.Namespace) -> int:
    try:
        team = Team.load(options.team)
    except DocumentError as error:
        if options.json:
            print(json.dumps({"problems": [problem.as_json() for problem in error.problems]}))
        raise
    if options.json:
        print(json.dumps(_ids(team)))
        return DONE
    print("\n".join([team_tables(team), "", rules_line(team), *protection_lines(team)]))
    return DONE


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


if __name__ == "__main__":
    sys.exit(main())
