"""`sitl leaderboard`: seek policies on the frozen test set, one line each."""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import click

from air_router.cli import print_json
from air_router.errors import ExitCode
from air_router.files import known_policy
from air_router.flight import StatusLine
from mocha_link.cli import PATH, Options, Parsed, command, option
from sitl.cli.experiment_command import cluster_option, jobs_option, terminated
from sitl.experiment import OFF_BOARD, Experiment, Task
from sitl.experiment.campaign import Campaign, RunLog, Work, cluster_at, make_runs, run_log

_EPILOG = """\
Each policy flies the twelve scenarios of the test set, which takes half a minute of processor time.
Finished runs are stored in --out; the same command continues after an interruption. round_robin is
always the baseline. To write a policy, see docs/seeking.md.

examples:
  sitl leaderboard my_policy:Nearest
  sitl leaderboard never freshest rendezvous tour --table leaderboard.csv
"""


def _policy(text: str) -> str:
    from sitl.experiment.board import NEVER  # noqa: PLC0415 - only when it runs

    if text in {NEVER, *OFF_BOARD}:
        return text
    try:
        return known_policy(text)
    except ValueError as error:
        raise ValueError(f"'{text}': {error}") from None


@command("Compare seek policies on a fixed test set.", _EPILOG)
@click.argument(
    "policies",
    nargs=-1,
    type=Parsed(_policy),
    metavar="[POLICY ...]",
    help="policies: names, package.module:Class, or `never` to seek no robot",
)
@option(
    "--table",
    type=PATH,
    metavar="FILE",
    help="CSV file of standings: lines of these policies are replaced, others kept",
)
@jobs_option
@cluster_option
@option(
    "--out",
    type=PATH,
    default="experiments/leaderboard",
    metavar="DIR",
    help="folder for finished runs (default: experiments/leaderboard)",
)
@option("--fresh", is_flag=True, help="delete the finished runs in DIR first")
@option("--json", is_flag=True, help="print one JSON object on stdout")
def run(arguments: Options) -> int:
    """Fly the test set, and print the table."""
    from sitl.experiment.campaign import make_run, put_together  # noqa: PLC0415 - only with SciPy

    return run_with(arguments, make_run, put_together)


def run_with(
    arguments: Options, work: Work, try_out: Callable[[Task], object] | None = None
) -> int:
    """The command, with the function that makes one run, and the one that checks for it."""
    from sitl.experiment.board import BASELINE, entries, frozen_set  # noqa: PLC0415 - with SciPy

    test_set = frozen_set()
    policies = tuple(dict.fromkeys([BASELINE, *arguments.policies]))
    experiment = entries(test_set, policies)
    numbers = range(test_set.first_seed, test_set.first_seed + test_set.seeds)
    folder = Path(arguments.out)
    with run_log(folder, fresh=arguments.fresh) as log:
        campaign = Campaign(experiment, experiment.rows, numbers, log.records, folder)
        if try_out is not None:
            campaign.try_out(try_out, StatusLine())
        if arguments.fresh:
            log.clear()
        try:
            _fly(campaign, log, arguments, work)
        except KeyboardInterrupt:
            sys.stderr.write("stopped; the same command goes on\n")
            return ExitCode.INTERRUPTED
    for failure in campaign.failed:
        sys.stderr.write(f"{failure.task.name}:\n{failure.why}\n")
    if campaign.failed:
        return ExitCode.ENDED_OTHERWISE
    return _show(test_set, policies, campaign, arguments)


def _fly(campaign: Campaign, log: RunLog, arguments: Options, work: Work) -> None:
    """Make the runs that are missing. Raises KeyboardInterrupt: the user stopped it."""
    status = StatusLine()
    with terminated():
        if arguments.cluster is not None:
            with cluster_at(arguments.cluster) as many:
                campaign.run(many.make_runs(work, campaign.missing), log.add, status)
        else:
            jobs = arguments.jobs or os.cpu_count() or 1
            campaign.run(make_runs(work, campaign.missing, jobs), log.add, status)


def _show(
    test_set: Experiment, policies: Sequence[str], campaign: Campaign, arguments: Options
) -> int:
    """Print the standings, and put them into the table; the exit code."""
    from sitl.experiment.board import (  # noqa: PLC0415 - only with SciPy
        BASELINE,
        FINGERPRINT,
        read_board,
        standing,
        table_text,
        write_board,
    )

    scenarios = [row.label for row in test_set.rows]
    runs = {record["row"]: record for record in campaign.records}
    name = f"{test_set.name} {FINGERPRINT}"
    of = {own: [runs[f"{scenario}, {own}"] for scenario in scenarios] for own in policies}
    made = {(own, name): standing(own, name, of[own], of[BASELINE]) for own in policies}
    table = None if arguments.table is None else Path(arguments.table)
    before = [] if table is None else read_board(table)
    whole = {(own.policy, own.test_set): own for own in before} | made
    for old in before:
        if whole[old.policy, old.test_set].digest != old.digest:
            sys.stderr.write(f"note: results of {old.policy} have moved since {old.commit}\n")
    if table is not None:
        write_board(table, [*whole.values()])
    if arguments.json:
        print_json([dataclasses.asdict(own) for own in made.values()])
    else:
        shown = [own for own in whole.values() if own.test_set == name]
        sys.stdout.write(f"{test_set.title} ({FINGERPRINT})\n\n{table_text(shown)}\n")
    failed = any(own.failed != "0" for own in made.values())
    return ExitCode.ENDED_OTHERWISE if failed else ExitCode.DONE
