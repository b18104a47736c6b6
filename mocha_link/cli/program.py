"""A program of several commands on click: its help, options, log, errors, end, and completion.

A command's module is imported when the command runs or its own help is shown: a program of many
commands starts as quickly as the one that is run.
"""

from __future__ import annotations

import importlib
import io
import logging
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, TextIO

import click
from click.core import ParameterSource

from mocha_link import __version__
from mocha_link.errors import MissingExtraError
from mocha_link.lifetime import INTERRUPTED, leave_when_interrupted, raise_when_interrupted

USAGE: Final = 2
EXIT_CODES: Final = (
    "exit codes: 0 done, 1 ended abnormally, 2 wrong usage, 3 invalid file, 7 a package is\n"
    "missing, 130 interrupted (Ctrl-C)"
)
HELP_COLUMNS: Final = 100  # at most, where the terminal has them; examples need them
LEVELS: Final = ("debug", "info", "warning", "error")
EXAMPLE: Final = "tcp://127.0.0.1:24500"  # an endpoint
_ENDPOINT = re.compile(r"(tcp://.+:([0-9]+|\*)|ipc://.+)", re.ASCII)
_NEGATIVE = re.compile(r"-[\d.]+(,|$)")
"""A number below zero, or a place in the southern hemisphere: a value, never an option."""

SHELLS: Final = {
    "bash": "source <({} completion bash)    # a line for ~/.bashrc",
    "zsh": "{} completion zsh > ~/.zfunc/_{}    # a folder of fpath",
    "fish": "{} completion fish > ~/.config/fish/completions/{}.fish",
}
"""The completion script of each shell."""

PATH: Final = click.Path(path_type=Path, readable=False)
"""The type of a file or folder; the shell completes it.

The command that opens it reports errors.
"""

Decorator = Callable[[Any], Any]
"""Adds options to a function that `command` makes a command."""


class Options(SimpleNamespace):
    """The values of a command line, by option name."""


class _Alone(str):
    """The value of an option given without one; differs from every typed text."""

    __slots__ = ()


class Parsed(click.ParamType[Any]):
    """The type of a value that a function parses; its ValueError becomes the usage error.

    The text of an option given without a value is parsed too. Other such values, and defaults, are
    used unchanged.
    """

    name = "text"

    def __init__(self, read: Callable[[str], Any]) -> None:
        self.read = read

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read a text of the command line."""
        if not isinstance(value, str):
            return value
        try:
            return self.read(str(value))
        except ValueError as error:
            self.fail(str(error), param, ctx)


class Option(click.Option):
    """An option that can exclude others, or take several values.

    Args:
        names: As the user writes it; the last may be its name in `Options`.
        not_with: Names in `Options` that contradict it.
        many: Whether it takes several values: ``--rows A B``.
        more: Arguments of click's option.
    """

    def __init__(
        self,
        names: Sequence[str],
        *,
        not_with: Sequence[str] = (),
        many: bool = False,
        **more: Any,
    ) -> None:
        super().__init__(names, multiple=many or more.pop("multiple", False), **more)
        self.not_with, self.many = not_with, many
        self.needs_value = not (self.is_flag or self.count or "flag_value" in more)


def option(*names: str, **attributes: Any) -> Decorator:
    """Add an `Option` to a command."""
    return click.option(*names, cls=Option, **attributes)


def optional(value: Any) -> dict[str, Any]:
    """Make an option's value optional; without one the option has `value`."""
    alone = _Alone(value) if isinstance(value, str) else value
    return {"is_flag": False, "flag_value": alone}


def together(*options: Decorator) -> Decorator:
    """Several options as one decorator, in the order of the help."""

    def add(function: Any) -> Any:
        for one in reversed(options):
            function = one(function)
        return function

    return add


class _WithEpilog(click.Command):
    """A command whose help ends with preformatted text: examples, tables, exit codes."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002 - click's
        """Write the preformatted text."""
        if self.epilog:
            formatter.write(f"\n{self.epilog.strip()}\n")


class Command(_WithEpilog):
    """A command: a function of `Options` that returns the exit code."""

    def __init__(self, *arguments: Any, usage: str = "", **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.usage = usage  # replaces click's usage line where that would mislead
        self.params += _log_options()

    def collect_usage_pieces(self, ctx: click.Context) -> list[str]:
        """The usage line after the name, in the help."""
        return [self.usage] if self.usage else super().collect_usage_pieces(ctx)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments, and refuse options that contradict each other."""
        rest = super().parse_args(ctx, self._spread(ctx, args))
        if ctx.resilient_parsing:
            return rest
        for param in self.params:
            for other in self.params:
                if other.name in getattr(param, "not_with", ()) and _given(ctx, param, other):
                    names = (each.get_error_hint(ctx).strip("'[]") for each in (param, other))
                    raise click.UsageError(f"{' and '.join(names)} contradict each other", ctx)
        return rest

    def _spread(self, ctx: click.Context, args: Sequence[str]) -> list[str]:
        """The arguments with `--rows A B` as `--rows A --rows B`, the form that click accepts.

        Raises:
            click.BadOptionUsage: another option follows an option that needs a value.
        """
        options = [each for each in self.params if isinstance(each, Option)]
        known = {name for each in options for name in each.opts}
        many = {name for each in options if each.many for name in each.opts}
        needy = {name for each in options if each.needs_value for name in each.opts}
        spread: list[str] = []
        current = ""
        for argument in args:
            if argument in known and spread and spread[-1] in needy and not ctx.resilient_parsing:
                message = f"Option '{spread[-1]}' requires an argument, not '{argument}'."
                raise click.BadOptionUsage(spread[-1], message, ctx)
            if argument.startswith("-"):
                current = argument if argument in many else ""
            elif current and spread[-1] != current:
                spread.append(current)
            spread.append(argument)
        return spread

    def invoke(self, ctx: click.Context) -> int:
        """Run the command at the requested log level; from here on an interrupt raises."""
        raise_when_interrupted()
        program = ctx.find_root().command
        if isinstance(program, Program):
            level = log_level(ctx, program.log_level)
            logging.basicConfig(level=level, format=program.log_format, stream=sys.stderr)
        assert self.callback is not None  # noqa: S101 - `command` sees to that
        return int(self.callback(options_of(ctx)))


def command(about: str, epilog: str = "", *, usage: str = "") -> Callable[..., Command]:
    """Turn a function of `Options` into a command; the outermost decorator.

    Args:
        about: What it does, in whole sentences.
        epilog: Preformatted end of its help.
        usage: The usage line, if the generated one would mislead.
    """
    return click.command(cls=Command, help=about, epilog=epilog, usage=usage)


def options_of(ctx: click.Context) -> Options:
    """The values of a command line, without the options of the log."""
    return Options(**{k: v for k, v in ctx.params.items() if k not in {"verbose", "log_level"}})


class Group(_WithEpilog, click.Group):
    """A group of commands."""

    def __init__(self, name: str, **more: Any) -> None:
        settings = {"help_option_names": ["-h", "--help"], "max_content_width": HELP_COLUMNS}
        super().__init__(name, no_args_is_help=False, context_settings=settings, **more)
        self.params += _log_options()


class Program(Group):
    """A program of several commands.

    Args:
        name: Its name on the command line.
        about: Its purpose.
        epilog: Preformatted end of its help.
        table: By command name: the module that has the command as `run`, and its purpose, in lower
            case and without a full stop.
        expected: Errors that end a command with one message; any other is a bug of ours.
        ended: Returns the exit code and the message ("": none) of such an error.
        log_level: Level without `--verbose`.
        log_format: Format for `logging`.
    """

    def __init__(  # noqa: PLR0913 - all that differs among three programs
        self,
        name: str,
        about: str,
        epilog: str,
        table: Mapping[str, tuple[str, str]],
        *,
        expected: tuple[type[Exception], ...],
        ended: Callable[[Exception], tuple[int, str]],
        log_level: int = logging.WARNING,
        log_format: str = "%(levelname)s %(name)s: %(message)s",
    ) -> None:
        super().__init__(name, help=about, epilog=epilog)
        self.table = {**table, "completion": ("", _COMPLETION)}
        self.expected, self.ended = expected, ended
        self.log_level, self.log_format = log_level, log_format
        click.version_option(__version__, prog_name=name, message="%(prog)s %(version)s")(self)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **x: Any
    ) -> click.Context:
        """Parse the arguments before the command."""
        return super().make_context(info_name, _with_values(args), parent, **x)

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's
        """The names of the commands, in the order of the help."""
        return list(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in self.table:
            if ctx.resilient_parsing:
                return None
            raise click.NoSuchCommand(cmd_name, possibilities=self.table, ctx=ctx)
        module, _ = self.table[cmd_name]
        if not module:
            return _completion_of(self)
        found: click.Command = importlib.import_module(module).run
        found.name = cmd_name
        return found

    def shell_complete(
        self, ctx: click.Context, incomplete: str
    ) -> list[click.shell_completion.CompletionItem]:
        """Complete the name of a command, without importing any."""
        from click.shell_completion import CompletionItem  # noqa: PLC0415 - slow to load

        found = [
            CompletionItem(name, help=about)
            for name, (_, about) in self.table.items()
            if name.startswith(incomplete)
        ]
        return found + click.Command.shell_complete(self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002 - click's
        """List the commands, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in self.table.items()])

    def run(self, argv: Sequence[str] | None) -> int:
        """Run one command; return its exit code. Results go to stdout, all else to stderr."""
        leave_when_interrupted()  # a command is imported on use
        prepare_output()
        arguments = list(sys.argv[1:] if argv is None else argv)
        name = str(self.name)
        try:
            if instruction := os.environ.get(_variable(name)):
                return _complete(self, instruction)
            if not arguments:
                with self.make_context(name, [], resilient_parsing=True) as ctx:
                    click.echo(self.get_help(ctx), err=True)
                return USAGE
            with self.make_context(name, arguments) as ctx:
                return int(self.invoke(ctx))
        except click.exceptions.Exit as end:  # --help, --version
            return end.exit_code
        except click.UsageError as error:
            path = error.ctx.command_path if error.ctx else name
            code = USAGE
            message = f"{path}: error: {error.format_message()}\n`{path} --help` shows its usage"
        except KeyboardInterrupt:
            code, message = INTERRUPTED, "interrupted"
        except self.expected as error:
            code, message = self.ended(error)
        finally:
            raise_when_interrupted()
        if message:
            print(message, file=sys.stderr)
        return code


def _with_values(arguments: Sequence[str]) -> list[str]:
    """The arguments; a negative number that follows no option gets a blank before it.

    Else ``ask goto -33.9,151.2`` would be an option.
    """
    made: list[str] = []
    for argument in arguments:
        value = _NEGATIVE.match(argument) and not (made and made[-1].startswith("-"))
        made.append(f" {argument}" if value else argument)
    return made


def _given(ctx: click.Context, *params: click.Parameter) -> bool:
    """Whether the user gave all of them."""
    sources = [ctx.get_parameter_source(each.name) for each in params if each.name]
    return all(source is ParameterSource.COMMANDLINE for source in sources)


def _log_options() -> list[click.Parameter]:
    return [
        Option(["-v", "--verbose"], count=True, help="log more to stderr (-vv: even more)"),
        Option(
            ["--log-level"],
            type=click.Choice(LEVELS),
            help="lowest level to log; overrides -v",
        ),
    ]


def log_level(ctx: click.Context, usual: int) -> int:
    """The log level requested before and after the command; each ``-v`` lowers it by one."""
    verbose = 0
    while True:
        if level := ctx.params.get("log_level"):
            return logging.getLevelNamesMapping()[str(level).upper()]
        verbose += int(ctx.params.get("verbose", 0))
        if ctx.parent is None:
            return max(logging.DEBUG, usual - 10 * verbose)
        ctx = ctx.parent


_COMPLETION: Final = "print the completion script of a shell"


def _completion_of(program: Program) -> Command:
    def run(options: Options) -> int:
        from click.shell_completion import get_completion_class  # noqa: PLC0415 - slow to load

        kind = get_completion_class(options.shell)
        assert kind is not None  # noqa: S101 - the shells are click's
        name = str(program.name)
        click.echo(kind(program, {}, name, _variable(name)).source())
        return 0

    lines = (line.format(program.name, program.name) for line in SHELLS.values())
    shell = click.Argument(
        ["shell"], type=click.Choice([*SHELLS]), help="shell that runs the script"
    )
    return Command(
        "completion",
        params=[shell],
        callback=run,
        help=sentence(_COMPLETION),
        epilog=examples(*lines),
    )


def _variable(program: str) -> str:
    """The environment variable of a completion request."""
    return f"_{program.upper().replace('-', '_')}_COMPLETE"


def _complete(program: Program, instruction: str) -> int:
    from click.shell_completion import shell_complete  # noqa: PLC0415 - slow to load

    name = str(program.name)
    try:
        code: int = shell_complete(program, {}, name, _variable(name), instruction)
    except MissingExtraError:  # the command reports it when it runs
        return 0
    return code


def examples(*lines: str) -> str:
    """The end of a help: these examples and the exit codes."""
    head = "examples:" if len(lines) > 1 else "example:"
    return "\n  ".join([head, *lines]) + f"\n\n{EXIT_CODES}"


def sentence(about: str) -> str:
    """Make a sentence of a purpose: a capital and a full stop."""
    return f"{about[0].upper()}{about[1:]}."


def coloured(out: TextIO) -> bool:
    """Whether `out` is a terminal that shows colours, and NO_COLOR is not set."""
    dumb = os.environ.get("TERM", "dumb") == "dumb"
    return out.isatty() and not dumb and not os.environ.get("NO_COLOR")


def prepare_output() -> None:
    """Make stdout accept every result.

    Characters that its encoding lacks are escaped, as on stderr. A closed stream discards output.
    """
    if sys.stdout is None:
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - until the end
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def drop_output() -> None:
    """Discard further output, also at exit, instead of writing to a broken pipe."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def seconds(text: str) -> float:
    """Parse a duration in seconds.

    Raises:
        ValueError: The text is not a positive number.
    """
    try:
        value = float(text)
    except ValueError:
        value = 0
    if not 0 < value < 1e6:
        raise ValueError(f"'{text}' is no time; write seconds, more than 0")
    return value


def web_address(text: str) -> str:
    """Parse HOST:PORT, :PORT or PORT.

    Raises:
        ValueError: The text has none of these forms.
    """
    port = text.rpartition(":")[2]
    if not (port.isdecimal() and int(port) < 1 << 16):
        raise ValueError(f"'{text}' is no address; write host:port, or :port")
    return text


def endpoint(text: str) -> str:
    """Parse a ZeroMQ endpoint.

    Raises:
        ValueError: The text is not an endpoint.
    """
    if not _ENDPOINT.fullmatch(text):
        raise ValueError(
            f"'{text}' is no endpoint; write {EXAMPLE} (address and port) or "
            "ipc:///tmp/name (a path)"
        )
    return text
