"""The command line `mocha-link`: run a node, read a node's metrics, check a team file ..."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence

from mocha_link.cli.program import EXAMPLE, USAGE, Command, Program, drop_output, examples
from mocha_link.errors import (
    MISSING_EXTRA,
    MissingExtraError,
    MochaLinkError,
    NotInTeamError,
    told,
)
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
        "monitor",
        "mocha_link.cli.monitor_command",
        "watch the links of a running node live; q ends it",
    ),
    Command("doctor", "mocha_link.cli.doctor_command", "say why robots do not talk, by trying it"),
    Command(
        "bridge",
        "mocha_link.cli.bridge_command",
        "connect a running node to ROS 1 or ROS 2",
    ),
)
DONE, FAILED, INVALID_FILE = 0, 1, 3


def _ended(error: Exception) -> tuple[int, str]:
    if isinstance(error, BrokenPipeError):  # e.g. `mocha-link metrics ... --follow | head`
        drop_output()
        return DONE, ""
    if isinstance(error, DocumentError):
        return INVALID_FILE, str(error)
    if isinstance(error, MissingExtraError):
        return MISSING_EXTRA, f"mocha-link: {error}"
    return USAGE if isinstance(error, NotInTeamError) else FAILED, f"mocha-link: {told(error)}"


PROGRAM = Program(
    "mocha-link",
    "Gossip node that carries data between robots whose links come and go.",
    examples(
        "mocha-link check missions/pennovation/team.yaml",
        f"mocha-link node missions/pennovation/team.yaml --robot io --metrics {EXAMPLE}",
        f"mocha-link monitor {EXAMPLE}",
    ),
    COMMANDS,
    (DocumentError, MochaLinkError, OSError),
    _ended,
    log_level=logging.INFO,
    log_format="%(levelname)s %(message)s",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    return PROGRAM.run(argv)


if __name__ == "__main__":
    sys.exit(main())
