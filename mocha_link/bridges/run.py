"""Runs the bridge to ROS 1 or ROS 2 until a signal ends it, in whatever Python has that ROS."""

from __future__ import annotations

import argparse
import importlib.util
import logging
import os
import re
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mocha_link.bridges.bridge import Bridge, channel
from mocha_link.bridges.progress import Progress
from mocha_link.bridges.ros_clients import Rcl, Ros1
from mocha_link.errors import MISSING_EXTRA, MissingExtraError, MochaLinkError
from mocha_link.lifetime import INTERRUPTED, until_terminated
from mocha_link.service import EndpointKeyError, ServiceClient, ServiceUnreachableError, folder

DONE, FAILED = 0, 1

LOG = logging.getLogger("mocha_link")


class BridgeError(MochaLinkError):
    """A bridge cannot run here; the message says what it needs."""


def add_options(
    parser: argparse.ArgumentParser, kind: str, endpoint: Callable[[str], str] = str
) -> None:
    """The options of the bridge to ``ros1`` or ``ros2``; `endpoint` reads one, for `argparse`."""
    parser.add_argument(
        "--node",
        required=True,
        type=endpoint,
        metavar="ENDPOINT",
        help="what the node got as --serve",
    )
    parser.add_argument(
        "--state",
        type=Path,
        metavar="FILE",
        help="remember there what was handed on (~/.local/state/mocha-link/<robot>-<bridge>)",
    )
    if kind == "ros2":
        parser.add_argument("--domain", type=int, metavar="N", help="DDS domain (ROS_DOMAIN_ID)")
        parser.add_argument(
            "--best-effort",
            nargs="+",
            type=channel,
            default=[],
            metavar="TOPIC",
            help="topics of this robot whose publishers are not reliable",
        )
        parser.add_argument(
            "--dds", action="store_true", help="use CycloneDDS also where rclpy is installed"
        )


def run(kind: str, options: argparse.Namespace) -> int:
    """Run a bridge until a signal comes; returns the exit code. Raises MochaLinkError."""
    with until_terminated():
        _run(kind, options)
    return DONE


def _run(kind: str, options: argparse.Namespace) -> None:
    need(kind, options)  # before a node is waited for
    with ServiceClient(options.node) as client:
        team = _team(client)
    progress = Progress(options.state or _state_file(f"{team['robot']}-{kind}"))
    middleware = _middleware(kind, options, team)
    bridge = Bridge(options.node, middleware, progress)
    ending = threading.Event()
    reasons: list[str] = []

    def watch() -> None:
        reason = middleware.watch(ending.wait)
        if reason:
            reasons.append(reason)
            bridge.stop()

    threading.Thread(target=watch, name="watch", daemon=True).start()
    try:
        bridge.run()
    finally:
        ending.set()
        middleware.close()
        progress.close()
    if reasons:
        raise BridgeError(reasons[0])


def _team(client: ServiceClient) -> dict[str, Any]:
    """What the node says of its team, as soon as it runs."""
    told = False
    while True:
        try:
            return client.team()
        except ServiceUnreachableError as error:
            if not told:
                LOG.warning("waiting for the node: %s", error)
            told = True


def _state_file(name: str) -> Path | None:
    """In the folder of the endpoints' keys, which only its user may enter; None: there is none."""
    try:
        return folder() / name
    except EndpointKeyError as error:
        LOG.warning("no state is kept, so a restart will repeat messages: %s", error)
        return None


def _middleware(kind: str, options: argparse.Namespace, team: dict[str, Any]) -> Any:
    name = "mocha_bridge_" + re.sub(r"[^A-Za-z0-9_]", "_", team["robot"])
    if kind == "ros1":
        return Ros1(name, team["types"])
    if has("rclpy") and not options.dds:
        if options.domain is not None:
            os.environ["ROS_DOMAIN_ID"] = str(options.domain)
        return Rcl(name, best_effort=options.best_effort)
    from mocha_link.bridges.dds import Dds  # noqa: PLC0415 - an extra that may be missing

    return Dds(team["definitions"], domain=options.domain, best_effort=options.best_effort)


def need(kind: str, options: argparse.Namespace) -> None:
    """Raises BridgeError or MissingExtraError if a bridge cannot run in this Python."""
    if kind == "ros1":
        if not has("rospy"):
            raise BridgeError(f"{sys.executable} has no rospy; {ADVICE['ros1']}")
    elif (options.dds or not has("rclpy")) and not (has("cyclonedds") and has("rosbags")):
        raise MissingExtraError(
            f"the bridge to ROS 2, as {sys.executable} has no rclpy (--python PATH names another),",
            "cyclonedds",
            "ros2",
        )


def has(module: str) -> bool:
    """Whether this Python has a module."""
    return importlib.util.find_spec(module) is not None


ADVICE = {
    "ros1": "name one that has it: --python /usr/bin/python3 (Debian: python3-rospy, python3-zmq)",
    "ros2": "name one that has rclpy",
}


def main(arguments: Sequence[str]) -> int:
    """The command line of ``__main__``, in a foreign Python."""
    parser = argparse.ArgumentParser(prog="mocha-link bridge", description=run.__doc__)
    parser.add_argument("--log-level", default="INFO", help="log from this on, on stderr")
    kinds = parser.add_subparsers(required=True, dest="kind", metavar="BRIDGE")
    for kind in ("ros1", "ros2"):
        add_options(kinds.add_parser(kind), kind)
    options = parser.parse_args(arguments)
    form = "%(levelname)s %(message)s"
    logging.basicConfig(stream=sys.stderr, level=options.log_level, format=form)
    try:
        return run(options.kind, options)
    except MochaLinkError as error:
        sys.stderr.write(f"mocha-link: {error}\n")
        return MISSING_EXTRA if isinstance(error, MissingExtraError) else FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
