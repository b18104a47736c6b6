"""`mocha-link bridge`: a process beside the node that connects it to the robot's ROS 1 or ROS 2."""

from __future__ import annotations

import argparse
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

from mocha_link import bridges
from mocha_link.bridges import run as ros_bridge
from mocha_link.cli.program import add_command, endpoint, examples, log_level

WHAT = {
    "ros1": "publish and subscribe ROS 1 topics",
    "ros2": "publish and subscribe ROS 2 topics",
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.epilog = examples(*(lines[0] for lines in EXAMPLES.values()))
    kinds = parser.add_subparsers(required=True, dest="kind", metavar="BRIDGE")
    for kind, what in WHAT.items():
        ros = add_command(kinds, kind, what, *EXAMPLES[kind])
        ros_bridge.add_options(ros, kind, endpoint)
        ros.add_argument(
            "--python",
            metavar="PATH",
            help=f"the Python that has ROS, if this one has not ({DEFAULT_PYTHON})",
        )


def run(options: argparse.Namespace) -> int:
    """Run here if this Python can, else become one that can; returns the exit code."""
    here = any(map(ros_bridge.has, NEEDS[options.kind]))
    python = options.python or (None if here else DEFAULT_PYTHON)
    if python is not None:
        found = shutil.which(python)
        if not options.python and not (found and _has_ros(found, options.kind)):
            ros_bridge.need(options.kind, options)
        if found is None:
            advice = ros_bridge.ADVICE[options.kind]
            raise ros_bridge.BridgeError(f"no program {python}; {advice}")
        _become(found, options)
    return ros_bridge.run(options.kind, options)


def _has_ros(python: str, kind: str) -> bool:
    """Whether the Python of the system can run a bridge."""
    modules = f"import zmq, {NEEDS[kind][0]}"
    return not subprocess.run([python, "-c", modules], capture_output=True, check=False).returncode  # noqa: S603


def _become(python: str, options: argparse.Namespace) -> NoReturn:
    folder = str(Path(bridges.__file__).parent)
    level = ["--log-level", logging.getLevelName(log_level(options, logging.INFO))]
    sys.stderr.flush()
    os.execv(python, [python, folder, *level, options.kind, *_arguments(options)])  # noqa: S606


def _arguments(options: argparse.Namespace) -> list[str]:
    given = ["--node", options.node]
    if options.state:
        given += ["--state", str(options.state)]
    if options.kind == "ros2":
        given += [] if options.domain is None else ["--domain", str(options.domain)]
        given += ["--best-effort", *options.best_effort] if options.best_effort else []
        given += ["--dds"] if options.dds else []
    return given
