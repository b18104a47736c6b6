"""A program of several commands, each a module: its parser, help, log, end, and completion.

A command's module is imported when the command is asked for: a program of many commands starts as
quickly as the one that is run.
"""

from __future__ import annotations

import argparse
import importlib
import io
import logging
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TextIO

from mocha_link import __version__
from mocha_link.errors import MissingExtraError, needs_extra
from mocha_link.lifetime import INTERRUPTED, leave_when_interrupted, raise_when_interrupted

USAGE = 2
EXIT_CODES = (
    "exit codes: 0 done, 1 ended otherwise, 2 usage, 3 invalid file, 7 a package is missing, "
    "130 interrupted (Ctrl-C)"
)
LEVELS = {
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warning": logging.WARNING,
    "error": logging.ERROR,
}
EXAMPLE = "tcp://127.0.0.1:24500"  # an endpoint
_ENDPOINT = re.compile(r"(tcp://.+:([0-9]+|\*)|ipc://.+)", re.ASCII)

SHELLS = {
    "bash": "source <({prog} completion bash)    # a line for ~/.bashrc",
    "zsh": "{prog} completion zsh > ~/.zfunc/_{prog}    # a folder of fpath",
    "fish": "{prog} completion fish > ~/.config/fish/completions/{prog}.fish",
}
"""How each is told, in words of its own."""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are two lines: what is wrong, and where to read on."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the command line, and end."""
        self.exit(
            USAGE, f"{self.prog}: error: {message}\n`{self.prog} --help` says what it takes\n"
        )


@dataclass(frozen=True, slots=True)
class Command:
    """A command of a program.

    Attributes:
        module: Its `add_arguments(parser)` says what the command does and takes, its
            `run(arguments)` does it and returns the exit code.
        about: What it is for, in a line without a capital and a full stop.
    """

    name: str
    module: str
    about: str

    def parser(self, program: str) -> Parser:
        """The parser of its arguments, as a command of `program`."""
        module = importlib.import_module(self.module)
        parser = Parser(
            prog=f"{program} {self.name}",
            description=sentence(self.about),
            formatter_class=Help,
        )
        module.add_arguments(parser)
        add_verbose(parser, default=argparse.SUPPRESS)  # what stands before the command counts, too
        parser.set_defaults(run=module.run)
        return parser


@dataclass(frozen=True, slots=True)
class Program:
    """A program of several commands.

    Attributes:
        expected: What ends a command with one message; anything else is a fault of ours.
        ended: The exit code and the message, "" for none, of one of those.
        prepared: What is made of the words of the command line before they are parsed.
    """

    name: str
    description: str
    epilog: str  # below the options of `--help`
    commands: tuple[Command, ...]
    expected: tuple[type[Exception], ...]
    ended: Callable[[Exception], tuple[int, str]]
    prepared: Callable[[Sequence[str]], Sequence[str]] = list
    log_level: int = logging.WARNING  # without `--verbose`
    log_format: str = "%(levelname)s %(name)s: %(message)s"

    def parser(
        self, *, whole: bool = True, lacking: list[str] | None = None
    ) -> argparse.ArgumentParser:
        """What its command line can say.

        If `whole`, the modules of all commands are imported now: for code that looks into their
        parsers, to write documentation or to complete words. Otherwise each when it is asked for.
        Why a module cannot be imported, an extra being absent, is put into `lacking`, and the
        command then has a name only; without that it is an error.
        """
        parser = Parser(
            prog=self.name, description=self.description, epilog=self.epilog, formatter_class=Help
        )
        add_verbose(parser)
        parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
        commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
        for command in self.commands:
            commands.add_parser(command.name, help=command.about)
            commands.choices[command.name] = _StandIn(command, self.name)
            if whole:
                try:
                    commands.choices[command.name] = command.parser(self.name)
                except MissingExtraError as error:
                    if lacking is None:
                        raise
                    lacking.append(str(error))
        completion = add_command(
            commands,
            "completion",
            "print a script that has a shell complete commands and options",
            *(line.format(prog=self.name) for line in SHELLS.values()),
        )
        completion.add_argument("shell", choices=tuple(SHELLS), help="for which shell")
        completion.set_defaults(run=self._complete)
        return parser

    def _complete(self, arguments: argparse.Namespace) -> int:
        lacking: list[str] = []
        sys.stdout.write(script(self.parser(lacking=lacking), arguments.shell) + "\n")
        for why in dict.fromkeys(lacking):
            sys.stderr.write(f"options of some commands are not completed: {why}\n")
        return 0

    def run(self, argv: Sequence[str] | None) -> int:
        """Run one command; returns its exit code. Results go to stdout, all else to stderr."""
        leave_when_interrupted()  # a command is imported when it is asked for
        prepare_output()
        words = self.prepared(sys.argv[1:] if argv is None else argv)
        if not words:
            self.parser(whole=False).print_help(sys.stderr)
            return USAGE
        try:
            arguments = self.parser(whole=False).parse_args(words)
            raise_when_interrupted()
            level = log_level(arguments, self.log_level)
            logging.basicConfig(level=level, format=self.log_format, stream=sys.stderr)
            return int(arguments.run(arguments))
        except SystemExit as end:  # argparse has said why
            raise_when_interrupted()
            return end.code if isinstance(end.code, int) else USAGE
        except KeyboardInterrupt:
            code, message = INTERRUPTED, "interrupted"
        except self.expected as error:
            code, message = self.ended(error)
        if message:
            print(message, file=sys.stderr)
        return code


class _StandIn(Parser):
    """Stands where a command's parser belongs, until there is something for it to parse."""

    def __init__(self, command: Command, program: str) -> None:
        super().__init__(add_help=False)
        self._command, self._program = command, program  # that makes the parser

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        return self._command.parser(self._program).parse_known_args(args, namespace)


def script(program: argparse.ArgumentParser, shell: str) -> str:
    """The script for one of `SHELLS`; arguments that are paths are completed as files.

    Raises:
        MissingExtraError: what writes it is not installed.
    """
    with needs_extra("completion", "completion"):
        import shtab  # noqa: PLC0415 - an extra
    waiting = [program]
    while waiting:
        for action in waiting.pop()._actions:  # noqa: SLF001 - no public way to walk a parser
            if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
                waiting += action.choices.values()
            elif action.type is Path:
                action.complete = shtab.FILE  # type: ignore[attr-defined] # shtab looks there
    return str(shtab.complete(program, shell=shell))


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


def prepare_output() -> None:
    """Have a command's results go somewhere, whatever stdout is and whichever letters it takes.

    What its encoding lacks is escaped, as on stderr. A closed one swallows what is printed.
    """
    if sys.stdout is None:
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - until the end
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def drop_output() -> None:
    """Let what is still printed, also at exit, go nowhere instead of into a broken pipe."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def seconds(text: str) -> float:
    """A time, for `argparse`."""
    try:
        value = float(text)
    except ValueError:
        value = 0
    if not 0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"'{text}' is no time; write seconds, more than 0")
    return value


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
            f"'{text}' is no endpoint; write {EXAMPLE} (address and port) or "
            "ipc:///tmp/name (a path)"
        )
    return text
