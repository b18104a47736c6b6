"""`mocha-link bridge`: a process beside the node that connects it to what else the robot runs."""

from __future__ import annotations

import argparse
import logging
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import NoReturn

from mocha_link import bridges
from mocha_link.bridges import run as ros_bridge
from mocha_link.bridges.zeromq import ZeroMqBridge
from mocha_link.cli.command_help import add_command, endpoint, examples, log_level
from mocha_link.node.lifetime import until_terminated

WHAT = {
    "zmq": "serve programs in any language, with JSON or bytes",
    "ros1": "publish and subscribe ROS 1 topics",
    "ros2": "publish and subscribe ROS 2 topics",
}
EXAMPLES = {
    "zmq": (
        "mocha-link bridge zmq --node ipc:///tmp/io.node --serve tcp://127.0.0.1:24600",
        "mocha-link bridge zmq --node ipc:///tmp/io.node --serve ipc:///tmp/io --stream ipc:///tmp/s",
    ),
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
    parser.epilog = examples(*(example for kind in EXAMPLES for example in EXAMPLES[kind][:1]))
    kinds = parser.add_subparsers(required=True, dest="kind", metavar="BRIDGE")
    served = add_command(kinds, "zmq", WHAT["zmq"], *EXAMPLES["zmq"])
    served.add_argument(
        "--node",
        type=endpoint,
        required=True,
        metavar="ENDPOINT",
        help="what the node got as --serve",
    )
    served.add_argument(
        "--serve",
        type=endpoint,
        required=True,
        metavar="ENDPOINT",
        help="where programs ask, e.g. ipc:///tmp/io",
    )
    served.add_argument(
        "--stream", type=endpoint, metavar="ENDPOINT", help="publish all messages there"
    )
    served.add_argument("--json", action="store_true", help="stream values, not data")
    for kind in ("ros1", "ros2"):
        ros = add_command(kinds, kind, WHAT[kind], *EXAMPLES[kind])
        ros_bridge.add_options(ros, kind)
        ros.add_argument(
            "--python",
            metavar="PATH",
            help=f"the Python that has ROS, if this one has not ({DEFAULT_PYTHON})",
        )


def run(options: argparse.Namespace) -> int:
    """Do it; returns the exit code."""
    return _serve(options) if options.kind == "zmq" else _run_ros(options)


def _serve(options: argparse.Namespace) -> int:
    with (
        until_terminated(),
        ZeroMqBridge(
            options.node, options.serve, stream=options.stream, as_json=options.json
        ) as bridge,
    ):
        print(f"answers on {bridge.endpoint}", file=sys.stderr)
        if bridge.stream:
            print(f"streams on {bridge.stream}", file=sys.stderr)
        print("ready; Ctrl-C ends", file=sys.stderr, flush=True)
        threading.Event().wait()
    return 0


def _run_ros(options: argparse.Namespace) -> int:
    """Run here if this Python can, else become one that can."""
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
    verbose = ["-v"] if log_level(options, logging.INFO) <= logging.DEBUG else []
    sys.stderr.flush()
    os.execv(python, [python, folder, *verbose, options.kind, *_arguments(options)])  # noqa: S606


def _arguments(options: argparse.Namespace) -> list[str]:
    given = ["--node", options.node]
    if options.state:
        given += ["--state", str(options.state)]
    if options.kind == "ros2":
        given += [] if options.domain is None else ["--domain", str(options.domain)]
        given += ["--best-effort", *options.best_effort] if options.best_effort else []
        given += ["--dds"] if options.dds else []
    return given
