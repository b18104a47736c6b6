"""The command line `mocha-link`: run a node, read a node's metrics, check a team file ..."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence

from mocha_link.cli.command_help import (
    Command,
    add_commands,
    add_completion,
    add_verbose,
    add_version,
    drop_output,
    log_level,
    style,
)
from mocha_link.cli.interrupt import INTERRUPTED, leave_when_interrupted, raise_when_interrupted
from mocha_link.errors import MochaLinkError, NotInTeamError
from mocha_link.team.problem import DocumentError

COMMANDS = (
    Command(
        "check", "mocha_link.cli.check_command", "check a team file and show its ids and ports"
    ),
    Command(
        "keys", "mocha_link.cli.keys_command", "make keys for the robots, so that only they connect"
    ),
    Command(
        "import",
        "mocha_link.cli.import_command",
        "make a team file of an original MOCHA's YAML files",
    ),
    Command("node", "mocha_link.cli.node_command", "run the node of a robot"),
    Command("metrics", "mocha_link.cli.metrics_command", "show the links of a running node"),
    Command(
        "top", "mocha_link.cli.top_command", "watch the links of a running node live; q ends it"
    ),
    Command(
        "bridge",
        "mocha_link.cli.bridge_command",
        "connect a running node to ROS 1, ROS 2 or other programs",
    ),
)
DONE, FAILED, USAGE, INVALID_FILE = 0, 1, 2, 3
_ENDPOINT = "tcp://127.0.0.1:24500"  # in examples


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    leave_when_interrupted()  # a command is imported when it is asked for
    try:
        options = parser(whole=False).parse_args(arguments)
    except SystemExit:
        raise_when_interrupted()
        raise
    logging.basicConfig(
        stream=sys.stderr,
        level=log_level(options, logging.INFO),
        format="%(levelname)s %(message)s",
    )
    try:
        raise_when_interrupted()
        code: int = options.run(options)
    except DocumentError as error:
        print(error, file=sys.stderr)
        code = INVALID_FILE
    except MochaLinkError as error:
        print(f"mocha-link: {error}", file=sys.stderr)
        code = USAGE if isinstance(error, NotInTeamError) else FAILED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        code = INTERRUPTED
    except BrokenPipeError:  # e.g. `mocha-link metrics ... --follow | head`
        drop_output()
        code = DONE
    return code


def parser(*, whole: bool = True) -> argparse.ArgumentParser:
    """What the command line can say; if not `whole`, of each command when it is asked for."""
    program = argparse.ArgumentParser(
        prog="mocha-link",
        description="Gossip node that carries data between robots whose links come and go.",
        **style(
            "mocha-link check missions/pennovation/team.yaml",
            f"mocha-link node missions/pennovation/team.yaml --robot io --metrics {_ENDPOINT}",
            f"mocha-link top {_ENDPOINT}",
        ),
    )
    add_verbose(program)
    add_version(program)
    commands = program.add_subparsers(required=True, metavar="COMMAND")
    add_commands(commands, program.prog, COMMANDS, whole=whole)
    add_completion(commands, program.prog, parser)
    return program


if __name__ == "__main__":
    sys.exit(main())
