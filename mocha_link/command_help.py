"""What every command of `mocha-link` says of itself with ``--help``, and how arguments are read."""

from __future__ import annotations

import argparse
import re
from typing import Any

EXIT_CODES = (
    "exit codes: 0 done, 1 ended otherwise, 2 usage, 3 invalid file, 130 interrupted (Ctrl-C)"
)
_ENDPOINT = re.compile(r"(tcp://.+:([0-9]+|\*)|ipc://.+)", re.ASCII)


def style(*examples: str) -> dict[str, Any]:
    """Arguments for a parser whose help ends with examples and the exit codes."""
    head = "examples:" if len(examples) > 1 else "example:"
    return {
        "epilog": "\n  ".join([head, *examples]) + f"\n\n{EXIT_CODES}",
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }


def add_command(
    commands: Any, name: str, about: str, *examples: str, **options: Any
) -> argparse.ArgumentParser:
    """Add a command; `about` says what it is for, without a capital and a full stop."""
    description = f"{about[0].upper()}{about[1:]}."
    options = {"help": about, "description": description, **style(*examples), **options}
    parser: argparse.ArgumentParser = commands.add_parser(name, **options)
    add_verbose(parser, default=argparse.SUPPRESS)  # what stands before the command counts, too
    return parser


def add_verbose(parser: argparse.ArgumentParser, *, default: Any = False) -> None:
    """Add ``-v``."""
    parser.add_argument(
        "-v", "--verbose", action="store_true", default=default, help="log more, on stderr"
    )


def web_address(text: str) -> str:
    """HOST:PORT, :PORT or PORT, for `argparse`."""
    port = text.rpartition(":")[2]
    if not (port.isdecimal() and int(port) < 1 << 16):
        raise argparse.ArgumentTypeError(f"'{text}' is no address; write host:port, or :port")
    return text


def endpoint(text: str) -> str:
    """A ZeroMQ endpoint, for `argparse`."""
    if not _ENDPOINT.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"'{text}' is no endpoint; write tcp://127.0.0.1:24500 (address and port) or "
            "ipc:///tmp/name (a path)"
        )
    return text
