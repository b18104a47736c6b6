"""What the command lines share: help, options, the table of commands, completion by the shell.

A command's module is imported when the command is asked for: a program of many commands starts as
quickly as the one that is run.
"""

from __future__ import annotations

import argparse
import importlib
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from mocha_link.errors import MochaLinkError

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


Adjust = Callable[[argparse.ArgumentParser], None]


@dataclass(frozen=True, slots=True)
class Command:
    """A command of a program.

    Attributes:
        module: Its `register(commands)` adds the command, with the same name and line of help.
        about: That line.
    """

    name: str
    module: str
    about: str

    def parser(self, program: str, adjust: Adjust | None = None) -> argparse.ArgumentParser:
        """The parser that the module makes; its default `run` takes the arguments.

        Args:
            program: Whose command it is.
            adjust: What the program does to the parsers of all its commands.
        """
        commands = argparse.ArgumentParser().add_subparsers(prog=program)
        importlib.import_module(self.module).register(commands)
        parser = commands.choices[self.name]
        if adjust:
            adjust(parser)
        return parser


class _StandIn(argparse.ArgumentParser):
    """Stands where a command's parser belongs, until there is something for it to parse."""

    def __init__(self, make: Callable[[], argparse.ArgumentParser]) -> None:
        super().__init__(add_help=False)
        self._make = make

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        return self._make().parse_known_args(args, namespace)


def add_commands(
    commands: Any,
    program: str,
    table: Iterable[Command],
    adjust: Adjust | None = None,
    *,
    whole: bool,
) -> None:
    """Add the commands of a table to the subcommands of a parser.

    If `whole`, all their modules are imported now: for code that looks into the parsers, to write
    documentation or to complete words. Otherwise each is imported when it is asked for.
    """
    for command in table:
        commands.add_parser(command.name, help=command.about)
        make = partial(command.parser, program, adjust)
        commands.choices[command.name] = make() if whole else _StandIn(make)


SHELLS = {
    "bash": "source <({prog} completion bash)    # a line for ~/.bashrc",
    "zsh": "{prog} completion zsh > ~/.zfunc/_{prog}    # a folder of fpath",
    "fish": "{prog} completion fish > ~/.config/fish/completions/{prog}.fish",
}
"""How each is told, in words of its own."""


class CompletionError(MochaLinkError):
    """The script cannot be made."""


def add_completion(
    commands: Any, program: str, whole: Callable[[], argparse.ArgumentParser]
) -> None:
    """Add the command to the subcommands of `program`; `whole` has all that is completed."""
    parser = add_command(
        commands,
        "completion",
        "print a script that has a shell complete commands and options",
        *(line.format(prog=program) for line in SHELLS.values()),
    )
    parser.add_argument("shell", choices=tuple(SHELLS), help="for which shell")
    parser.set_defaults(run=lambda options: _print(whole(), options.shell))


def script(program: argparse.ArgumentParser, shell: str) -> str:
    """The script for one of `SHELLS`; arguments that are paths are completed as files.

    Raises:
        CompletionError: what writes it is not installed.
    """
    try:
        import shtab  # noqa: PLC0415 - an extra
    except ModuleNotFoundError:
        raise CompletionError(
            "completion needs shtab, which is not installed; "
            "run: pip install 'air-router[completion]'"
        ) from None
    waiting = [program]
    while waiting:
        for action in waiting.pop()._actions:  # noqa: SLF001 - no public way to walk a parser
            if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
                waiting += action.choices.values()
            elif action.type is Path:
                action.complete = shtab.FILE  # type: ignore[attr-defined] # shtab looks there
    return str(shtab.complete(program, shell=shell))


def _print(program: argparse.ArgumentParser, shell: str) -> int:
    sys.stdout.write(script(program, shell) + "\n")
    return 0
