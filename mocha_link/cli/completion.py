"""`PROGRAM completion SHELL`: the script that lets a shell complete what is typed."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mocha_link.cli.command_help import add_command
from mocha_link.errors import MochaLinkError

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
