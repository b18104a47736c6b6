"""`make experiments-remade`: repeats archived runs of experiments with the current sources.

    python -m benchmarks.archives            # ten at random; the exit code is 1 if one differs
    python -m benchmarks.archives --seed 7 --runs 20
    python -m benchmarks.archives --index    # rewrite docs/evidence/archives.csv
    python -m benchmarks.archives --again table1 searches-confirmation
    python -m benchmarks.archives --claims            # all claims in order, into the page
    python -m benchmarks.archives --claims verify     # the exit code is 1 if the page differs

`archives.csv` lists for each archive its command, the time to repeat it, and in `moved` (edited by
hand) the change that has altered its results since. Archives with such a note are not repeated.
`--again` repeats all runs of archives with the same seeds, updates docs/evidence/experiments.md,
and removes the notes.
`--claims` decides every claim again from its archive of confirmation runs, and writes the table
of all claims in experiments.md (`--claims verify`: compares it).
"""

from __future__ import annotations

import argparse
import csv
import random
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from air_router.files import write_whole
from benchmarks.patched import ROOT
from sitl.experiment import Experiment, Record, experiment_names, load_experiment
from sitl.experiment.analysis import Report
from sitl.experiment.campaign import (
    ARCHIVE_ENDING,
    Remade,
    program,
    read_archive,
    remade,
    remakeable,
)

EVIDENCE: Final = ROOT / "docs" / "evidence"
INDEX: Final = EVIDENCE / "archives.csv"
PAGE: Final = EVIDENCE / "experiments.md"
ENDING: Final = f"-runs{ARCHIVE_ENDING}"

LONGEST_CPU_S: Final = 20.0
"""A longer run is not tried: with ten runs the check takes a minute."""

HEADS: Final = ("archive", "runs", "cpu_h", "program", "commit", "constraints", "moved")

HOW: Final = """\

If a change is meant to move results, state it: write the commit and what it changed into the column
'moved' of docs/evidence/archives.csv, or make the archives again from a committed state:
    .venv/bin/python -m benchmarks.archives --again {names}
"""


def archives() -> list[str]:
    """The names of all archives."""
    return sorted(path.name.removesuffix(ENDING) for path in EVIDENCE.glob(f"*{ENDING}"))


def path_of(name: str) -> Path:
    """Where an archive is."""
    return EVIDENCE / f"{name}{ENDING}"


def moved() -> dict[str, str]:
    """Which change has moved the results of an archive, by its name; only of those that have."""
    if not INDEX.is_file():
        return {}
    with INDEX.open(encoding="utf-8", newline="") as file:
        return {row["archive"]: row["moved"] for row in csv.DictReader(file) if row["moved"]}


def index(notes: Mapping[str, str]) -> str:
    """The text of `archives.csv`."""
    lines = [",".join(HEADS)]
    for name in archives():
        _, records = read_archive(path_of(name))
        cpu_h = sum(record["measures"]["cpu_s"] for record in records) / 3600
        origin = [_all(record["program"].split()[-1] for record in records)]
        origin.append(_all(record.get("commit", "") for record in records))
        locks = (record.get("dependencies", {}).get("constraints", "") for record in records)
        note = notes.get(name, "").replace('"', '""')
        cells = [name, str(len(records)), f"{cpu_h:.2f}", *origin, _all(locks)]
        lines.append(",".join([*cells, f'"{note}"' if note else ""]))
    return "\n".join(lines) + "\n"


def _all(values: Iterable[str]) -> str:
    return " ".join(sorted(set(values)))


def chosen(count: int, rng: random.Random) -> list[tuple[Experiment, Record]]:
    """Runs at random: an archive first, then one of its runs, so that small archives count."""
    pool: dict[str, list[tuple[Experiment, Record]]] = {}
    for name in archives():
        if name in moved():
            continue
        experiment, records = read_archive(path_of(name))
        if runs := [
            (experiment, record)
            for record in records
            if remakeable(experiment, record) and record["measures"]["cpu_s"] <= LONGEST_CPU_S
        ]:
            pool[name] = rng.sample(runs, min(count, len(runs)))
    found: list[tuple[Experiment, Record]] = []
    while len(found) < count and any(pool.values()):
        found.append(pool[rng.choice([name for name, runs in pool.items() if runs])].pop())
    return found


def check(count: int, seed: int) -> int:
    """Make runs again; the exit code."""
    notes = moved()
    for name, note in notes.items():
        print(f"{name}: not tried, results have moved: {note}")
    runs = chosen(count, random.Random(seed))
    differing = set()
    for experiment, record in runs:
        result: Remade = remade(experiment, record)
        print(result.text, flush=True)
        if not result.same or result.differing:
            differing.add(experiment.called(record["phase"]))
    print(f"{len(runs)} runs of {len(archives()) - len(notes)} archives, --seed {seed}")
    if differing:
        sys.stderr.write(HOW.format(names=" ".join(sorted(differing))))
    return 1 if differing else 0


def again(names: Iterable[str], jobs: int) -> int:
    """Make all runs of archives anew; the exit code."""
    notes = moved()
    for name in names:
        experiment, records = read_archive(path_of(name))
        numbers = [record["number"] for record in records]
        shipped = experiment.name in experiment_names()
        if not shipped:
            sys.stderr.write(f"{name}: no experiment '{experiment.name}' is shipped any more\n")
            return 1
        arguments = [experiment.name, "--jobs", str(jobs), "--out", str(ROOT / "build" / name)]
        arguments += ["--first-seed", str(min(numbers))]
        arguments += ["--seeds", str(max(numbers) - min(numbers) + 1)]
        arguments += ["--archive", str(path_of(name)), "--docs", str(PAGE)]
        done = subprocess.run([sys.executable, "-m", "sitl", "experiment", *arguments], check=False)  # noqa: S603 - ours
        if done.returncode:
            return done.returncode
        _, new = read_archive(path_of(name))
        if len(new) != len(records) or {run["program"] for run in new} != {program()}:
            sys.stderr.write(f"{name}: not all of its runs were made anew\n")
            return 1
        notes.pop(name, None)
        write_whole(INDEX, index(notes), replace=True)
    return 0


CONFIRMED: Final = "-confirmation"


def claims_text(names: Iterable[str], page: str) -> str:
    """The table of all declared claims, in order, as archives of confirmation runs decide them.

    Args:
        names: Of the archives.
        page: The text that has their sections.
    """
    rows: dict[int, tuple[str, str, str, str]] = {}

    def add(experiment: Experiment, number: int, text: str, brief: str, because: str) -> None:
        where = f"[`{experiment.name}`](#{anchor(page, experiment.called('confirmation'))})"
        rows[number] = text, f"**{brief}**", because, where

    for experiment, _ in map(load_experiment, experiment_names()):
        for rule in experiment.claims:
            add(experiment, rule.number, rule.text, "not run yet", "")
    for name in names:
        experiment, records = read_archive(path_of(name))
        for claim in Report(experiment, records).claims if experiment.claims else ():
            first, *others = claim.parts
            more = f"; first of {len(others) + 1} parts" if others else ""
            add(experiment, claim.number, claim.text, claim.brief, first.because + more)
    heads = "| claim | what it says | verdict | effect [95 % interval] | experiment |"
    cells = (f"| {number} | {' | '.join(rows[number])} |" for number in sorted(rows))
    return "\n".join([heads, "|---:|---|---|---|---|", *cells])


def anchor(page: str, name: str) -> str:
    """The anchor of the section that has an archive's claims."""
    before = page.partition(f"<!-- begin {name} claims -->")[0]
    heading = re.findall(r"^#+ (.+)$", before, re.MULTILINE)[-1:] or [name]
    return re.sub(r"[^a-z0-9 _-]", "", heading[0].lower()).replace(" ", "-")


def with_claims(page: str, table: str) -> str:
    """The page with another table of all claims."""
    begin, end = "<!-- begin all claims -->", "<!-- end -->"
    before, found, rest = page.partition(begin)
    if not found:
        raise ValueError(f"{PAGE} has no '{begin}'")
    return f"{before}{begin}\n{table}\n{end}{rest.partition(end)[2]}"


def claims(*, write: bool) -> int:
    """Decide all claims anew; the exit code is 1 if the page differs and is not written."""
    page = PAGE.read_text(encoding="utf-8")
    confirmed = [name for name in archives() if name.endswith(CONFIRMED)]
    new = with_claims(page, claims_text(confirmed, page))
    if write:
        write_whole(PAGE, new, replace=True)
    elif new != page:
        sys.stderr.write(f"{PAGE}: the table of all claims differs from the archives\n")
        return 1
    return 0


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.archives", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--runs", type=int, default=10, help="number of runs to repeat (10)")
    parser.add_argument("--seed", type=int, default=None, help="seed of the choice of runs")
    parser.add_argument("--index", action="store_true", help="rewrite docs/evidence/archives.csv")
    parser.add_argument(
        "--claims",
        nargs="?",
        const="write",
        choices=("write", "verify"),
        help="write, or compare, the table of all claims",
    )
    parser.add_argument(
        "--again",
        nargs="+",
        choices=archives(),
        metavar="ARCHIVE",
        help="repeat all runs of these archives, and update the docs",
    )
    parser.add_argument("--jobs", type=int, default=2, help="number of processes (2)")
    arguments = parser.parse_args()
    if arguments.index:
        write_whole(INDEX, index(moved()), replace=True)
        return 0
    if arguments.claims:
        return claims(write=arguments.claims == "write")
    if arguments.again:
        return again(arguments.again, arguments.jobs)
    seed = random.SystemRandom().randrange(10**6) if arguments.seed is None else arguments.seed
    return check(arguments.runs, seed)


if __name__ == "__main__":
    sys.exit(main())
