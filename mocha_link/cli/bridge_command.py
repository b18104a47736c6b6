"""`mocha-link bridge`: a process beside the node that connects it to the robot's ROS 1 or ROS 2."""

from __future__ import annotations

import json
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

import click

from mocha_link import bridges
from mocha_link.bridges import run as ros_bridge
from mocha_link.cli.program import (
    PATH,
    Command,
    Decorator,
    Group,
    Options,
    Parsed,
    command,
    endpoint,
    examples,
    log_level,
    option,
    sentence,
    together,
)

WHAT = {
    "ros1": "publish and subscribe to ROS 1 topics",
    "ros2": "publish and subscribe to ROS 2 topics",
}
EXAMPLES = {
    "ros1": ("mocha-link bridge ros1 --node ipc:///tmp/io.node",),
    "ros2": (
        "mocha-link bridge ros2 --node ipc:///tmp/io.node --domain 7",
        "mocha-link bridge ros2 --node ipc:///tmp/io.node --best-effort /scan",
    ),
}
NEEDS = {"ros1": ("rospy",), "ros2": ("rclpy", "cyclonedds")}
DEFAULT_PYTHON = "/usr/bin/python3"  # what Debian's and Ubuntu's ROS packages are installed for


def _bridge(kind: str, *more: Decorator) -> Command:
    """The command of the bridge to one ROS version."""

    def run(options: Options) -> int:
        return _run(kind, options)

    ros = together(
        option(
            "--node",
            required=True,
            type=Parsed(endpoint),
            metavar="ENDPOINT",
            help="endpoint of the node's --serve",
        ),
        option(
            "--state",
            type=PATH,
            metavar="FILE",
            help="file that stores which messages were forwarded (default: "
            "~/.local/state/mocha-link/<robot>-<bridge>)",
        ),
        *more,
        option(
            "--python",
            metavar="PATH",
            help=f"Python interpreter with ROS, if this one has no ROS (default {DEFAULT_PYTHON})",
        ),
    )
    found = command(sentence(WHAT[kind]), examples(*EXAMPLES[kind]))(ros(run))
    found.name = kind
    found.short_help = WHAT[kind]
    return found


run = Group(
    "bridge",
    commands=[
        _bridge("ros1"),
        _bridge(
            "ros2",
            option("--domain", type=int, metavar="N", help="DDS domain (default: ROS_DOMAIN_ID)"),
            option(
                "--best-effort",
                many=True,
                type=Parsed(bridges.channel),
                metavar="TOPIC ...",
                help="topics of this robot with best-effort publishers",
            ),
            option("--dds", is_flag=True, help="use CycloneDDS even where rclpy is installed"),
        ),
    ],
    help="Connect a running node to ROS 1 or ROS 2.",
    epilog=examples(*(lines[0] for lines in EXAMPLES.values())),
)


def _run(kind: str, options: Options) -> int:
    """Run here if this Python can, else become one that can; returns the exit code."""
    here = any(map(ros_bridge.has, NEEDS[kind]))
    python = options.python or (None if here else DEFAULT_PYTHON)
    if python is not None:
        found = shutil.which(python)
        if not options.python and not (found and _has_ros(found, kind)):
            ros_bridge.need(kind, options)
        if found is None:
            raise ros_bridge.BridgeError(f"no program {python}; {ros_bridge.ADVICE[kind]}")
        _become(found, kind, options)
    return ros_bridge.run(kind, options)


def _has_ros(python: str, kind: str) -> bool:
    """Whether the Python of the system can run a bridge."""
    modules = f"import zmq, {NEEDS[kind][0]}"
    return not subprocess.run([python, "-c", modules], capture_output=True, check=False).returncode  # noqa: S603


def _become(python: str, kind: str, options: Options) -> NoReturn:
    folder = str(Path(bridges.__file__).parent)
    settings = {
        "kind": kind,
        "log_level": log_level(click.get_current_context(), logging.INFO),
        **vars(options),
    }
    sys.stderr.flush()
    os.execv(python, [python, folder, json.dumps(settings, default=str)])  # noqa: S606
