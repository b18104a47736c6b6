"""The command line `mocha-link`: run a node, read a node's metrics, check a team file ..."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence

from mocha_link.cli.program import EXAMPLE, USAGE, Program, drop_output, examples
from mocha_link.errors import (
    MISSING_EXTRA,
    MissingExtraError,
    MochaLinkError,
    NotInTeamError,
    error_text,
)
from mocha_link.team import DocumentError

COMMANDS = {
    name: (f"mocha_link.cli.{name}_command", about)
    for name, about in {
        "check": "check a team file and show its ids and ports",
        "keys": "make keys, so that only robots of the team can connect",
        "import": "make a team file from the YAML files of original MOCHA nodes",
        "node": "run the gossip node of a robot",
        "metrics": "show the links of a running node",
        "monitor": "watch the links of a running node live; q ends it",
        "doctor": "test the links of a robot and find the causes of faults",
        "bridge": "connect a running node to ROS 1 or ROS 2",
    }.items()
}
DONE, FAILED, INVALID_FILE = 0, 1, 3


def _ended(error: Exception) -> tuple[int, str]:
    if isinstance(error, BrokenPipeError):  # e.g. `mocha-link metrics ... --follow | head`
        drop_output()
        return DONE, ""
    if isinstance(error, DocumentError):
        return INVALID_FILE, str(error)
    if isinstance(error, MissingExtraError):
        return MISSING_EXTRA, f"mocha-link: {error}"
    return USAGE if isinstance(
        error, NotInTeamError
    ) else FAILED, f"mocha-link: {error_text(error)}"


PROGRAM = Program(
    "mocha-link",
    "Gossip node that carries data between robots with intermittent links.",
    examples(
        "mocha-link check missions/pennovation/team.yaml",
        f"mocha-link node missions/pennovation/team.yaml --robot io --metrics {EXAMPLE}",
        f"mocha-link monitor {EXAMPLE}",
    ),
    COMMANDS,
    expected=(DocumentError, MochaLinkError, OSError),
    ended=_ended,
    log_level=logging.INFO,
    log_format="%(levelname)s %(message)s",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    return PROGRAM.run(argv)


if __name__ == "__main__":
    sys.exit(main())
