"""`sitl experiment`: many simulated runs of many teams, a table with intervals, and figures."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import random
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import click

from air_router.cli import print_json
from air_router.errors import AirRouterError, ExitCode, UsageError
from air_router.flight import StatusLine
from air_router.words import counted
from mocha_link.cli import PATH, Options, Parsed, command, option
from sitl.experiment import Experiment, Record, Task, experiment_names, load_experiment
from sitl.experiment.campaign import (
    ARCHIVE_ENDING,
    Campaign,
    Journal,
    RunLog,
    StopClock,
    Work,
    cluster_at,
    make_runs,
    program,
    read_archive,
    run_log,
    write_archive,
)

_EPILOG = """\
Every finished run is stored in DIR/runs.jsonl. The same command continues an interrupted
experiment; with more --seeds or other --rows it adds the missing runs.
See docs/evidence/experiments.md.

examples:
  sitl experiment table1 --seeds 30
  sitl experiment table1 --rows radius_m=30 ugvs=3,5 --seeds 5
  sitl experiment table1 --cluster tcp://10.0.0.5:8786
"""


def count(text: str, least: int = 1) -> int:
    """A whole number of a command line."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < least:
        raise ValueError(f"{text} is not a whole number of at least {least}")
    return number


jobs_option = option(
    "--jobs", type=Parsed(count), metavar="N", help="number of processes (default: number of CPUs)"
)
cluster_option = option(
    "--cluster",
    metavar="ADDRESS",
    help="distribute the runs by a dask.distributed scheduler (tcp://HOST:8786)",
)


def _archive(text: str) -> Path:
    if not text.endswith(ARCHIVE_ENDING):
        raise ValueError(f"{text} does not end with {ARCHIVE_ENDING}")
    return Path(text)


@command(
    "Run an experiment: every row of its file with several seeds. A run simulates half an hour of "
    "a team in a town in about a second. Prints a table with confidence intervals; writes "
    "results.csv, figures, and tests of the paper's claims.",
    _EPILOG,
)
@click.argument(
    "experiment",
    required=False,
    metavar="[NAME|FILE]",
    help=f"one of {', '.join(experiment_names())}; an experiment's file; or an archive of "
    f"runs (*{ARCHIVE_ENDING}), to recompute table and claims",
)
@option(
    "--seeds", type=Parsed(count), metavar="N", help="number of runs per row (default: the file's)"
)
@option(
    "--first-seed",
    type=Parsed(partial(count, least=0)),
    metavar="N",
    help="number of the first run of each row (default: the file's); numbers from the file's "
    "confirmation_seed on are confirmation runs",
)
@option(
    "--rows",
    many=True,
    metavar="WHICH ...",
    help="run only these rows: key=value[,value], or a label pattern",
)
@jobs_option
@cluster_option
@option(
    "--out",
    type=PATH,
    metavar="DIR",
    help="folder for runs and results (default: experiments/NAME or experiments/NAME-confirmation)",
)
@option("--fresh", is_flag=True, help="delete the finished runs in DIR first")
@option(
    "--docs",
    type=PATH,
    metavar="FILE",
    help="write table, claims and figures into a Markdown file, between its marker comments",
)
@option(
    "--archive",
    type=Parsed(_archive),
    metavar="FILE",
    help=f"write the data behind tables and claims into a file *{ARCHIVE_ENDING}; the seed numbers "
    "that it has already count as begun, whatever the declared time is",
)
@option(
    "--verify",
    type=PATH,
    metavar="FILE",
    help="with an archive: list differences to a Markdown file and its evidence; change nothing",
)
@option(
    "--remake",
    type=Parsed(count),
    metavar="N",
    help="with an archive: repeat N of its runs, chosen at random by --first-seed, and list "
    "those with a different digest",
)
@option("--no-figures", is_flag=True, help="do not draw figures")
@option("--json", is_flag=True, help="print one JSON object on stdout")
@option("--list", is_flag=True, help="list the experiments and their rows")
def run(arguments: Options) -> int:
    """Run the experiment, and print its results."""
    if arguments.list:
        _print_list(arguments.json)
        return ExitCode.DONE
    from sitl.experiment.campaign import make_run, put_together  # noqa: PLC0415 - only with SciPy

    return run_with(arguments, make_run, put_together)


def run_with(
    arguments: Options, work: Work, try_out: Callable[[Task], object] | None = None
) -> int:
    """The command, with the function that makes one run, and the one that checks for it."""
    if arguments.experiment is None:
        raise UsageError(f"which experiment? a file, or one of {', '.join(experiment_names())}")
    archived = arguments.verify or arguments.remake
    if archived or arguments.experiment.endswith(ARCHIVE_ENDING):
        return _from_archive(Path(arguments.experiment), arguments, work)
    experiment, plan = load_experiment(arguments.experiment)
    rows = experiment.chosen(arguments.rows)
    first = experiment.first_seed if arguments.first_seed is None else arguments.first_seed
    numbers = range(first, first + (arguments.seeds or experiment.seeds))
    name = experiment.called(experiment.phase(first))
    folder = arguments.out or Path("experiments") / name
    if arguments.docs is not None:  # before the runs: whether there is something to fill after them
        from sitl.experiment.analysis import text_of  # noqa: PLC0415 - only with SciPy

        text_of(arguments.docs, name)
    status = StatusLine()
    with run_log(folder, fresh=arguments.fresh) as log:
        campaign = Campaign(experiment, rows, numbers, log.records, folder)
        if try_out is not None:
            campaign.try_out(try_out, status)
        if arguments.fresh:
            log.clear()
        journal = Journal(folder)
        seeds = {"seeds": [numbers[0], numbers[-1]], "kept": len(campaign.records)}
        declared = {"declaration": experiment.declaration, "rules": experiment.rules}
        journal.note("begun", **declared, program=program(), **seeds)
        interrupted = _run_campaign(campaign, arguments, work, log, journal)
    _note_other_programs(campaign, status)
    records = campaign.records
    if records:
        if arguments.archive is not None and not interrupted:
            write_archive(arguments.archive, plan, records)
        journal.note("evaluated", runs=len(records))
        docs = None if interrupted else arguments.docs
        _evaluate(experiment, records, folder, arguments, (docs, arguments.archive))
    if interrupted:
        return ExitCode.INTERRUPTED
    failed = campaign.failed or any(record.get("faults") for record in records)
    return ExitCode.ENDED_OTHERWISE if failed else ExitCode.DONE


def _from_archive(archive: Path, arguments: Options, work: Work) -> int:
    """Table and claims of archived runs; whether a document, or the program, agrees with them."""
    if not archive.name.endswith(ARCHIVE_ENDING):
        which = "--verify" if arguments.verify else "--remake"
        raise UsageError(f"{which} is about an archive of runs; give a file *{ARCHIVE_ENDING}")
    experiment, records = read_archive(archive)
    if experiment.name in experiment_names():
        now, _ = load_experiment(experiment.name)
        # Claims that are declared after exploration runs were read do not count against these.
        claims_differ = experiment.claims and now.rules != experiment.rules
        if claims_differ or now.rows != experiment.rows:
            sys.stderr.write(f"note: {experiment.name} has other rows or claims since {archive}\n")
    if arguments.remake is not None:
        return _remake(experiment, records, arguments, work)
    if arguments.verify is None:
        folder = arguments.out or Path("experiments") / experiment.called(records[0]["phase"])
        folder.mkdir(parents=True, exist_ok=True)
        _evaluate(experiment, records, folder, arguments, (arguments.docs, archive))
        return ExitCode.DONE
    from sitl.experiment.analysis import Report, differences  # noqa: PLC0415 - only with SciPy

    found = differences(arguments.verify, Report(experiment, records), archive)
    for what in found:
        sys.stderr.write(f"{what}: differs from the archived runs\n")
    if not found:
        sys.stderr.write(f"{experiment.name}: {counted(len(records), 'runs')} agree\n")
    return ExitCode.ENDED_OTHERWISE if found else ExitCode.DONE


def _remake(
    experiment: Experiment, records: Sequence[Record], arguments: Options, work: Work
) -> int:
    """Make some archived runs again; those that differ are on stdout."""
    from sitl.experiment.campaign import remade, remakeable  # noqa: PLC0415 - only with SciPy

    runs = [record for record in records if remakeable(experiment, record)]
    if not runs:
        raise UsageError("no run of this archive is in simulated time; none can come out the same")
    rng = random.Random(arguments.first_seed or 0)  # noqa: S311 - repeatable on purpose
    results = [
        remade(experiment, record, work)
        for record in rng.sample(runs, min(arguments.remake, len(runs)))
    ]
    if arguments.json:
        print_json([dataclasses.asdict(result) for result in results])
    else:
        sys.stdout.writelines(f"{result.text}\n" for result in results)
    same = all(result.same and not result.differing for result in results)
    return ExitCode.DONE if same else ExitCode.ENDED_OTHERWISE


def _run_campaign(
    campaign: Campaign,
    arguments: Options,
    work: Work,
    log: RunLog,
    journal: Journal,
) -> bool:
    """Make the missing runs, as long as the declared clock lets them begin.

    Returns whether the user stopped it.
    """
    begun = campaign.begun | _begun_in(arguments.archive, campaign.declaration)
    status, clock = StatusLine(), StopClock(campaign.stop, begun)
    missing, wanted = len(campaign.missing), len(campaign.wanted)
    if not missing:
        status.print_line(f"all {counted(wanted, 'runs')} are there")
        return False
    if missing < wanted:
        status.print_line(f"{wanted - missing} of {counted(wanted, 'runs')} are there")
    try:
        with terminated():
            if arguments.cluster is not None:
                with cluster_at(arguments.cluster) as many:
                    outcomes = many.make_runs(work, campaign.missing, clock.may_begin)
                    campaign.run(outcomes, log.add, status)
            else:
                jobs = arguments.jobs or os.cpu_count() or 1
                outcomes = make_runs(work, campaign.missing, jobs, clock.may_begin)
                campaign.run(outcomes, log.add, status)
    except KeyboardInterrupt:
        kept = wanted - len(campaign.missing)
        status.print_line(f"stopped; {kept} of {wanted} runs are kept, the same command goes on")
        journal.note("stopped", by="user", runs=kept)
        return True
    for failure in campaign.failed:
        sys.stderr.write(f"{failure.task.name}:\n{failure.why}\n")
    if clock.stopped:
        status.print_line("the declared time is over: no further seed number is begun")
    by = "clock" if clock.stopped else "end"
    journal.note("stopped", by=by, runs=len(campaign.records), failed=len(campaign.failed))
    return False


def _begun_in(archive: Path | None, declaration: str) -> set[int]:
    """The seed numbers of an archive, if runs of the same declaration are to be made again."""
    if archive is None or not archive.is_file():
        return set()
    _, records = read_archive(archive)
    return {each["number"] for each in records if each.get("declaration") == declaration}


@contextlib.contextmanager
def terminated() -> Iterator[None]:
    """SIGTERM is Ctrl-C here: the processes end, and finished runs are kept."""

    def stop(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _note_other_programs(campaign: Campaign, status: StatusLine) -> None:
    others = sorted({record["program"] for record in campaign.records} - {program()})
    if others:
        status.print_line(
            f"note: some of the runs are from other versions of the program ({', '.join(others)}; "
            f"this is {program()}); --fresh makes them again"
        )


def _evaluate(
    experiment: Experiment,
    records: Sequence[Record],
    folder: Path,
    arguments: Options,
    into: tuple[Path | None, Path | None],
) -> None:
    """Write and print the results of runs.

    `into`: a document to put them into, if any, and the archive of these runs that it names.
    """
    from sitl.experiment.analysis import Report, fill  # noqa: PLC0415 - only with SciPy

    found = Report(experiment, records)
    found.write(folder)
    figures = [] if arguments.no_figures else _figures(experiment, records, folder)
    if arguments.json:
        more = {"figures": [str(path) for path in figures], "folder": str(folder)}
        print_json(found.summary | more)
    else:
        sys.stdout.write(found.text + "\n")
        for claim in found.claims:
            sys.stdout.write(f"\nclaim {claim.number}: {claim.text}\n  {claim.verdict}\n")
    docs, archive = into
    if docs is not None:
        fill(docs, found, archive, figures)
    sys.stderr.write(f"results and {counted(len(figures), 'figures')} are in {folder}\n")


def _figures(experiment: Experiment, records: Sequence[Record], folder: Path) -> list[Path]:
    try:
        from sitl.experiment.analysis import draw_all  # noqa: PLC0415 - only with matplotlib
    except AirRouterError as error:
        sys.stderr.write(f"no figures: {error}\n")
        return []
    return draw_all(experiment, records, folder)


def _print_list(as_json: bool) -> None:
    found = [load_experiment(name) for name in experiment_names()]
    if as_json:
        print_json(
            [
                {
                    "name": experiment.name,
                    "title": experiment.title,
                    "question": " ".join(experiment.question.split()),
                    "rows": [row.label for row in experiment.rows],
                    "seeds": experiment.seeds,
                    "path": str(path),
                }
                for experiment, path in found
            ]
        )
        return
    for experiment, _ in found:
        size = f"{counted(len(experiment.rows), 'rows')}, {counted(experiment.seeds, 'seeds')}"
        sys.stdout.write(f"{experiment.name:12} {experiment.title} ({size})\n")
