"""`mocha-link import`: the configuration of the original MOCHA nodes as a team file."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mocha_link.cli.program import examples
from mocha_link.errors import MochaLinkError
from mocha_link.team import upstream


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.epilog = examples(
        "mocha-link import MOCHA/mocha_core -o team.yaml",
        "mocha-link import robot_configs.yaml topic_configs.yaml --ours titan io -o team.yaml",
    )
    # As argparse would write it, the names of --ours seem to belong before the files.
    parser.usage = (
        "mocha-link import [-h] [-v] PACKAGE | ROBOT_CONFIGS [TOPIC_CONFIGS [RADIO_CONFIGS]]\n"
        "                         [-o TEAM] [--ours NAME [NAME ...]] [--ros {1,2}]"
    )
    parser.add_argument(
        "robot_configs",
        type=Path,
        metavar="ROBOT_CONFIGS",
        help="its robots (YAML), or its package mocha_core, of ROS 1 or ROS 2, with all files",
    )
    for name, what in (("topic_configs", "topics"), ("radio_configs", "radios")):
        parser.add_argument(
            name, type=Path, nargs="?", metavar=name.upper(), help=f"its {what} (YAML)"
        )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="TEAM", help="write the team file there, not to stdout"
    )
    parser.add_argument(
        "--ours", nargs="+", default=[], metavar="NAME", help="robots that run our node (none)"
    )
    parser.add_argument(
        "--ros",
        type=int,
        choices=(1, 2),
        help="the ROS of the robots (that of the package.xml above the files, else 1)",
    )


def run(options: argparse.Namespace) -> int:
    """Do it; returns the exit code."""
    robots, topics, radios, ros = upstream.configuration(options.robot_configs)
    if options.topic_configs:  # without radios beside it they are left out
        topics, radios = options.topic_configs, options.radio_configs
    result = upstream.load(robots, topics, radios, ours=options.ours, ros=options.ros or ros)
    for notice in result.notices:
        print(f"note: {notice}", file=sys.stderr)
    if options.output is None:
        print(result.text, end="")
        return 0
    try:
        with options.output.open("x", encoding="utf-8") as file:
            file.write(result.text)
    except OSError as error:
        raise MochaLinkError(
            f"cannot write {options.output}: {error.strerror}; choose another file"
        ) from None
    print(
        f"{options.output} is made; see it with: mocha-link check {options.output}", file=sys.stderr
    )
    return 0
