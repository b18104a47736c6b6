"""What commands share: how their help ends, how much they log, addresses as arguments."""

from __future__ import annotations

import argparse
import logging
import os
import re
import sys
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


def examples(*lines: str) -> str:
    """How the help of a program or a command ends: with these examples and the exit codes."""
    head = "examples:" if len(lines) > 1 else "example:"
    return "\n  ".join([head, *lines]) + f"\n\n{EXIT_CODES}"


class Help(argparse.HelpFormatter):
    """Fills paragraphs, but leaves alone those with indented lines: examples, tables."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n\n".join(
            paragraph
            if re.search(r"^( |examples?:)", paragraph, re.MULTILINE)
            else super(Help, self)._fill_text(paragraph, width, indent)
            for paragraph in text.split("\n\n")
        )


def add_command(commands: Any, name: str, about: str, *lines: str) -> argparse.ArgumentParser:
    """Add a command; `about` says what it is for, without a capital and a full stop."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=about, description=sentence(about), epilog=examples(*lines), formatter_class=Help
    )
    add_verbose(parser, default=argparse.SUPPRESS)  # what stands before the command counts, too
    return parser


def sentence(about: str) -> str:
    """With a capital and a full stop."""
    return f"{about[0].upper()}{about[1:]}."


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
