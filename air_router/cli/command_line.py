"""What our programs have in common: how expected errors end them, places as arguments, JSON."""

import json
import re
import sys
from collections.abc import Sequence
from typing import Any

from air_router.errors import EXPECTED, exit_code
from mocha_link.cli.program import Command, Program
from mocha_link.errors import told

_SOUTHERN = re.compile(r"-[\d.]+,")
"""How a place, or bounds, with a negative latitude begin."""


def program_of(name: str, description: str, epilog: str, commands: tuple[Command, ...]) -> Program:
    """A program whose commands end with our exit codes."""
    return Program(name, description, epilog, commands, EXPECTED, _ended, _with_places)


def _ended(error: Exception) -> tuple[int, str]:
    return exit_code(error), told(error)


def print_json(facts: Any) -> None:
    """What `--json` prints: one object on a line of its own, at once."""
    json.dump(facts, sys.stdout)
    sys.stdout.write("\n")
    sys.stdout.flush()


def _with_places(argv: Sequence[str]) -> list[str]:
    """The arguments with places in the southern hemisphere joined to their options.

    `--home -33.9,151.2` is taken for two options by argparse, `--home=-33.9,151.2` is not; and a
    place by itself for one, but for a blank before it.
    """
    joined: list[str] = []
    for word in argv:
        option = joined[-1] if joined else ""
        if option.startswith("--") and "=" not in option and _SOUTHERN.match(word):
            joined[-1] += f"={word}"
        elif _SOUTHERN.match(word):
            joined.append(f" {word}")
        else:
            joined.append(word)
    return joined
