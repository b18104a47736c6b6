"""Command lines of the three programs, read as the programs read them, without running them."""

from collections.abc import Iterator, Sequence

import click

from mocha_link.cli import Command, Options, Program, options_of


def context_of(program: Program, arguments: Sequence[str]) -> click.Context:
    """That of the command of these arguments; a `click.UsageError` if they are wrong."""
    ctx = program.make_context(program.name, list(arguments))
    while isinstance(ctx.command, click.Group):
        rest = [*ctx._protected_args, *ctx.args]  # noqa: SLF001 - click has no public way to get a parsed subcommand without running it
        if not rest:
            ctx.fail("Missing command.")
        name, command, more = ctx.command.resolve_command(ctx, rest)
        ctx = command.make_context(name, more, parent=ctx)
    return ctx


def options_for(command: Command, *arguments: object) -> Options:
    """What a command makes of its arguments."""
    return options_of(command.make_context("command", [str(argument) for argument in arguments]))


def commands_of(group: click.Group) -> Iterator[click.Context]:
    """The context, without arguments, of every command below a group, in the order of the help."""
    above = group.make_context(group.name, [], resilient_parsing=True)
    yield from _below(above)


def _below(above: click.Context) -> Iterator[click.Context]:
    for name in above.command.list_commands(above):
        command = above.command.get_command(above, name)
        ctx = command.make_context(name, [], parent=above, resilient_parsing=True)
        yield ctx
        if isinstance(command, click.Group):
            yield from _below(ctx)
