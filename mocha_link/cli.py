"""The command `mocha-link`: run a node, read a node's metrics, check a team file."""

from __future__ import annotations

import argparse
import json
import logging
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mocha_link.document import DocumentError
from mocha_link.errors import MochaLinkError
from mocha_link.node import Node
from mocha_link.team import Team, UnknownRobotError
from mocha_link.telemetry import MetricsServer, as_fields, watch

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

    from mocha_link.metrics import LinkEvent

DONE, FAILED, USAGE, INVALID_FILE, INTERRUPTED = 0, 1, 2, 3, 130
EXIT_CODES = (
    "exit codes: 0 done, 1 ended otherwise, 2 usage, 3 invalid file, 130 interrupted (Ctrl-C)"
)


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
        sys.stderr.close()
        code = DONE
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mocha-link",
        description="Gossip node that carries data between robots whose links come and go.",
        epilog=EXIT_CODES,
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="log more, on stderr")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    node = commands.add_parser("node", help="run the node of a robot", epilog=EXIT_CODES)
    node.add_argument("team", type=Path, metavar="TEAM", help="team file (YAML)")
    node.add_argument("--robot", required=True, metavar="NAME", help="which robot this is")
    node.add_argument(
        "--metrics", metavar="ENDPOINT", help="serve metrics there, e.g. tcp://127.0.0.1:24500"
    )
    node.add_argument("--json", action="store_true", help="print events as JSON lines")
    node.set_defaults(run=_node)

    metrics = commands.add_parser(
        "metrics", help="show the links of a running node", epilog=EXIT_CODES
    )
    metrics.add_argument("endpoint", metavar="ENDPOINT", help="what the node got as --metrics")
    metrics.add_argument("--json", action="store_true", help="print JSON, one object per line")
    metrics.add_argument("--follow", action="store_true", help="go on with events as they happen")
    metrics.add_argument(
        "--timeout", type=_positive, default=5.0, metavar="S", help="wait so long, in s (5)"
    )
    metrics.set_defaults(run=_metrics)

    check = commands.add_parser(
        "check", help="check a team file and show its ids and ports", epilog=EXIT_CODES
    )
    check.add_argument("team", type=Path, metavar="TEAM", help="team file (YAML)")
    check.add_argument("--json", action="store_true", help="print the ids and ports as JSON")
    check.set_defaults(run=_check)
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def _node(options: argparse.Namespace) -> int:
    node = Node(Team.load(options.team), options.robot)
    stopped = threading.Event()

    def show(event: LinkEvent) -> None:
        fields = {"event": type(event).__name__, **as_fields(event)}
        print(json.dumps(fields) if options.json else _event_line(fields), flush=True)

    def stop(_number: int, _frame: FrameType | None) -> None:
        stopped.set()

    node.subscribe(show)
    before = signal.signal(signal.SIGTERM, stop)
    try:
        with node:
            server = MetricsServer(node, options.metrics) if options.metrics else None
            try:
                if server:
                    server.start()
                    print(f"metrics on {server.endpoint}", file=sys.stderr)
                robot = node.robot
                for peer in robot.peers:
                    print(
                        f"{robot.name} answers {peer} on {robot.listen}:{robot.port_for(peer)}",
                        file=sys.stderr,
                    )
                print("ready; Ctrl-C ends", file=sys.stderr, flush=True)
                stopped.wait()
            finally:
                if server:
                    server.close()
    finally:
        signal.signal(signal.SIGTERM, before)
    return DONE


def _metrics(options: argparse.Namespace) -> int:
    for kind, fields in watch(options.endpoint, timeout_s=options.timeout):
        if options.json:
            print(json.dumps(fields), flush=True)
        elif kind == "links":
            print(_links_table(fields), flush=True)
        else:
            print(_event_line(fields), flush=True)
        if kind == "links" and not options.follow:
            break
    return DONE


def _check(options: argparse.Namespace) -> int:
    team = Team.load(options.team)
    if options.json:
        print(json.dumps(_ids(team)))
        return DONE
    rows = [("robot", "id", "kind", "address", "ports", "radio")]
    for robot in sorted(team.robots.values(), key=lambda robot: robot.robot_id):
        ports = ", ".join(f"{peer}:{robot.port_for(peer)}" for peer in robot.peers)
        number = str(robot.robot_id)
        radio = robot.radio or f"timer, {team.trigger.interval_s:g} s"
        rows.append((robot.name, number, robot.kind, robot.address, ports, radio))
    print(_table(rows))
    print()
    heads = ("kind", "topic", "id", "type", "dtype", "priority", "at most every")
    kinds: list[tuple[str, ...]] = [heads]
    for kind, topics in team.kinds.items():
        for topic in topics:
            interval = f"{topic.min_interval_s:g} s" if topic.min_interval_s else "-"
            ids = (str(topic.topic_id), topic.type, str(topic.dtype))
            kinds.append((kind, topic.name, *ids, topic.priority.name.lower(), interval))
    print(_table(kinds))
    return DONE


def _ids(team: Team) -> dict[str, Any]:
    return {
        "robots": {
            robot.name: {
                "robot_id": robot.robot_id,
                "kind": robot.kind,
                "address": robot.address,
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
                }
                for topic in topics
            }
            for kind, topics in team.kinds.items()
        },
    }


def _event_line(fields: dict[str, Any]) -> str:
    rest = {key: value for key, value in fields.items() if key not in ("event", "peer", "at_s")}
    words = " ".join(f"{key}={_shown(value)}" for key, value in rest.items())
    return f"{fields.get('event')} {fields.get('peer')} {words}"


def _links_table(fields: dict[str, Any]) -> str:
    now = fields["at_s"]
    rows = [
        ("peer", "state", "RSSI", "in", "ago", "out", "ago", "RTT", "bandwidth", "newest", "broken")
    ]
    for peer, link in fields["links"].items():
        rows.append(
            (
                peer,
                link["state"],
                _with_unit(link["rssi_dbm"], "dBm"),
                str(link["syncs_in"]),
                _ago(now, link["last_sync_in_s"]),
                str(link["syncs_out"]),
                _ago(now, link["last_sync_out_s"]),
                _with_unit(link["rtt_s"], "ms", 1000),
                _with_unit(link["bandwidth_bytes_s"], "kB/s", 0.001),
                _with_unit(link["newest_age_s"], "s"),
                str(link["timeouts"]),
            )
        )
    return f"links of {fields['robot']}\n{_table(rows)}"


def _ago(now_s: float, then_s: float | None) -> str:
    return _with_unit(None if then_s is None else now_s - then_s, "s")


def _with_unit(value: float | None, unit: str, factor: float = 1) -> str:
    return "-" if value is None else f"{value * factor:.1f} {unit}"


def _shown(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
