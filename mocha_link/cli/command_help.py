"""What every command of `mocha-link` says of itself with ``--help``, and how arguments are read."""

from __future__ import annotations

import argparse
import logging
import os
import re
import sys
from collections.abc import Sequence
from typing import Any, TextIO

EXIT_CODES = (
    "exit codes: 0 done, 1 ended otherwise, 2 usage, 3 invalid file, 130 interrupted (Ctrl-C)"
)
LEVELS = {
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warning": logging.WARNING,
    "error": logging.ERROR,
}
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


def add_verbose(parser: argparse.ArgumentParser, *, default: Any = None) -> None:
    """Add ``-v`` and ``--log-level``; `default` is `argparse.SUPPRESS` for a subcommand."""
    parser.add_argument(
        "-v",
        "--verbose",
        action="count",
        default=0 if default is None else default,
        help="log more, on stderr (-vv: still more)",
    )
    parser.add_argument(
        "--log-level",
        choices=tuple(LEVELS),
        default=default,
        help="log from this on, whatever -v says",
    )


def log_level(options: argparse.Namespace, usual: int) -> int:
    """The level of `logging` that the arguments ask for; every ``-v`` is one more than usual."""
    if options.log_level:
        return LEVELS[options.log_level]
    return max(logging.DEBUG, usual - 10 * int(options.verbose))


def coloured(out: TextIO) -> bool:
    """Whether colours may be written there: to a terminal that has them, unless NO_COLOR is set."""
    dumb = os.environ.get("TERM", "dumb") == "dumb"
    return out.isatty() and not dumb and not os.environ.get("NO_COLOR")


def drop_output() -> None:
    """Let what is still printed, also at exit, go nowhere instead of into a broken pipe."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def add_version(parser: argparse.ArgumentParser) -> None:
    """Add ``--version``."""
    parser.add_argument("--version", action=_Version)


class _Version(argparse.Action):
    """Prints the version; unlike argparse's own, it looks it up only when it is asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        told = "show program's version number and exit"
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help=told)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        sys.stdout.write(version(parser.prog) + "\n")
        parser.exit()


def version(program: str) -> str:
    """What ``--version`` prints."""
    from importlib import metadata  # noqa: PLC0415 - half of what a command's start would take

    try:
        return f"{program} {metadata.version('air-router')}"
    except metadata.PackageNotFoundError:  # run from the sources
        return f"{program} of an unknown version"


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
