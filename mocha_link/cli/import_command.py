"""`mocha-link import`: the configuration of the original MOCHA nodes as a team file."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mocha_link.cli.command_help import examples
from mocha_link.errors import MochaLinkError
from mocha_link.team import upstream


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.epilog = examples(
        "mocha-link import robot_configs.yaml topic_configs.yaml radio_configs.yaml -o team.yaml",
        "mocha-link import robot_configs.yaml topic_configs.yaml --ours titan io -o team.yaml",
    )
    # As argparse would write it, the names of --ours seem to belong before the files.
    parser.usage = (
        "mocha-link import [-h] [-v] ROBOT_CONFIGS TOPIC_CONFIGS [RADIO_CONFIGS]\n"
        "                         [-o TEAM] [--ours NAME [NAME ...]] [--ros {1,2}]"
    )
    for name, what in (("robot_configs", "robots"), ("topic_configs", "topics")):
        parser.add_argument(name, type=Path, metavar=name.upper(), help=f"its {what} (YAML)")
    parser.add_argument(
        "radio_configs", type=Path, nargs="?", metavar="RADIO_CONFIGS", help="its radios (YAML)"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="TEAM", help="write the team file there, not to stdout"
    )
    parser.add_argument(
        "--ours", nargs="+", default=[], metavar="NAME", help="robots that run our node (none)"
    )
    parser.add_argument(
        "--ros", type=int, choices=(1, 2), default=1, help="the ROS of the robots (1)"
    )


def run(options: argparse.Namespace) -> int:
    """Do it; returns the exit code."""
    result = upstream.load(
        options.robot_configs,
        options.topic_configs,
        options.radio_configs,
        ours=options.ours,
        ros=options.ros,
    )
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
