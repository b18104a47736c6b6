"""`mocha-link import`: the configuration of the original MOCHA nodes as a team file."""

from __future__ import annotations

import sys

import click

from mocha_link.cli.program import PATH, Options, command, examples, option
from mocha_link.errors import MochaLinkError
from mocha_link.team import upstream


@command(
    "Make a team file from the YAML files of original MOCHA nodes.",
    examples(
        "mocha-link import MOCHA/mocha_core -o team.yaml",
        "mocha-link import robot_configs.yaml topic_configs.yaml --ours titan io -o team.yaml",
    ),
    usage="[OPTIONS] PACKAGE | ROBOT_CONFIGS [TOPIC_CONFIGS [RADIO_CONFIGS]]",
)
@click.argument(
    "robot_configs",
    type=PATH,
    help="MOCHA's robot_configs.yaml, or the folder of its package mocha_core with all files",
)
@click.argument("topic_configs", type=PATH, required=False, help="MOCHA's topic_configs.yaml")
@click.argument("radio_configs", type=PATH, required=False, help="MOCHA's radio_configs.yaml")
@option("-o", "--output", type=PATH, metavar="TEAM", help="team file to write (default: stdout)")
@option("--ours", many=True, metavar="NAME ...", help="robots that run our node (default: none)")
@option(
    "--ros",
    type=click.Choice([1, 2]),
    help="ROS version of the robots (default: from the package.xml above the files, else 1)",
)
def run(options: Options) -> int:
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
