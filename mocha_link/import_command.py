"""`mocha-link import`: the configuration of the original MOCHA nodes as a team file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mocha_link import upstream
from mocha_link.errors import MochaLinkError

if TYPE_CHECKING:
    import argparse


def add_parser(commands: Any, style: dict[str, Any]) -> None:
    """Add the command to the subcommands of a parser."""
    command = commands.add_parser(
        "import", help="make a team file of an original MOCHA's YAML files", **style
    )
    for name, what in (("robot_configs", "robots"), ("topic_configs", "topics")):
        command.add_argument(name, type=Path, metavar=name.upper(), help=f"its {what} (YAML)")
    command.add_argument(
        "radio_configs", type=Path, nargs="?", metavar="RADIO_CONFIGS", help="its radios (YAML)"
    )
    command.add_argument(
        "-o", "--output", type=Path, metavar="TEAM", help="write the team file there, not to stdout"
    )
    command.add_argument(
        "--ours", nargs="+", default=[], metavar="NAME", help="robots that run our node (none)"
    )
    command.add_argument(
        "--ros", type=int, choices=(1, 2), default=1, help="the ROS of the robots (1)"
    )
    command.set_defaults(run=run)


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
    return 0
