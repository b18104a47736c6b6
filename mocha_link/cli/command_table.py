"""The commands of a program: what its help says of each, and which module makes it.

A module is imported when its command is asked for: a program of many commands starts as quickly as
the one that is run.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

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
