"""Runs the bridge to ROS 1 or ROS 2 until a signal ends it, in whatever Python has that ROS."""

from __future__ import annotations

import importlib.util
import json
import logging
import os
import re
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mocha_link.bridges.bridge import Bridge
from mocha_link.bridges.progress import Progress
from mocha_link.bridges.ros_clients import Rcl, Ros1
from mocha_link.errors import MISSING_EXTRA, MissingExtraError, MochaLinkError
from mocha_link.lifetime import INTERRUPTED, until_terminated
from mocha_link.service import EndpointKeyError, ServiceClient, ServiceUnreachableError, folder

DONE, FAILED = 0, 1

LOG = logging.getLogger("mocha_link")


class BridgeError(MochaLinkError):
    """A bridge cannot run here; the message has the requirement."""


def run(kind: str, options: SimpleNamespace) -> int:
    """Run a bridge until a signal comes; returns the exit code. Raises MochaLinkError."""
    with until_terminated():
        _run(kind, options)
    return DONE


def _run(kind: str, options: SimpleNamespace) -> None:
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
    """The node's team, as soon as the node runs."""
    logged = False
    while True:
        try:
            return client.team()
        except ServiceUnreachableError as error:
            if not logged:
                LOG.warning("waiting for the node: %s", error)
            logged = True


def _state_file(name: str) -> Path | None:
    """In the folder of the endpoints' keys, which only its user may enter; None: there is none."""
    try:
        return folder() / name
    except EndpointKeyError as error:
        LOG.warning("no state is kept, so a restart will repeat messages: %s", error)
        return None


def _middleware(kind: str, options: SimpleNamespace, team: dict[str, Any]) -> Any:
    name = "mocha_bridge_" + re.sub(r"[^A-Za-z0-9_]", "_", team["robot"])
    if kind == "ros1":
        return Ros1(name, team["types"])
    if has("rclpy") and not options.dds:
        if options.domain is not None:
            os.environ["ROS_DOMAIN_ID"] = str(options.domain)
        return Rcl(name, best_effort=options.best_effort)
    from mocha_link.bridges.dds import Dds  # noqa: PLC0415 - an extra that may be missing

    return Dds(team["definitions"], domain=options.domain, best_effort=options.best_effort)


def need(kind: str, options: SimpleNamespace) -> None:
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
    """What ``__main__`` runs in a foreign Python: one argument, the options as JSON."""
    settings = json.loads(arguments[0])
    settings["state"] = settings["state"] and Path(settings["state"])
    options = SimpleNamespace(**settings)
    form = "%(levelname)s %(message)s"
    logging.basicConfig(stream=sys.stderr, level=options.log_level, format=form)
    try:
        return run(options.kind, options)
    except MochaLinkError as error:
        sys.stderr.write(f"mocha-link: {error}\n")
        return MISSING_EXTRA if isinstance(error, MissingExtraError) else FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
