"""What the runs of an experiment amount to, and the files and documents with it.

results.csv     a line per run, a column per number, units in the names
results.parquet the same with types, if pyarrow is there
ages.csv        ages of information: a line per run, topic, robot that makes it, robot that uses it
table.txt       the table with intervals
summary.json    the table and the verdicts on the claims, for programs

A document gets it between marks: `<!-- begin NAME WHAT -->` and `<!-- end -->`; NAME is the
experiment (NAME-confirmation: its runs for confirmation), WHAT one of facts, archive, paper,
readings, claims, fidelity, fit, blind, outcome, links. So the document can be made again from any
runs. Figures go beside it, into `images`; tables, rows compared by seeds, the numbers behind
claims, settings that were fitted, what they predict, and policies compared over scenarios into
`NAME-table.csv`, `-pairs.csv`, `-claims.csv`, `-draws.csv`, `-cells.csv`, `-policies.csv` and
`-strata.csv`, where these exist.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import hashlib
import io
import json
import math
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from air_router.errors import UsageError
from air_router.files import write_whole
from air_router.words import counted, duration_text
from mocha_link.errors import MissingExtraError
from sitl.experiment import Experiment, Record, flat, seeds_of, value_of
from sitl.experiment.analysis import tables
from sitl.experiment.analysis.calibration import Calibration, Prediction
from sitl.experiment.analysis.claims import Claim, claims_of, comparisons, likeness
from sitl.experiment.analysis.link_prediction import links_text
from sitl.experiment.analysis.outcome import (
    Scenarios,
    is_of_scenarios,
    outcome_text,
    standings,
    strata,
)
from sitl.experiment.analysis.parquet import write_parquet
from sitl.experiment.analysis.statistics import Runs

_ALWAYS: Final = ("town", "radius_m", "uavs", "ugvs", "channel", "protocol", "policy", "passive")
"""Settings that have a column even where all rows agree."""

_IDS: Final = ("experiment", "row", "phase", "number", "seed")
_ORIGIN: Final = ("peak_memory_MB", "digest", "program", "commit", "machine")
_AGE_HEADS: Final = ("row", "seed_number", "topic", "maker", "user", "age_mean_s", "age_peak_s")
_IMAGES: Final = Path("images")
_END: Final = "<!-- end -->"


class NoMarksError(UsageError):
    """The document has no place for this experiment."""


class Report:
    """An experiment's runs, and what follows from them; each part is worked out once.

    Args:
        experiment: Whose runs they are.
        records: The runs, all of one phase; at least one.
    """

    def __init__(self, experiment: Experiment, records: Sequence[Record]) -> None:
        self.experiment = experiment  # whose runs they are
        self.records = records  # all of one phase

    @property
    def name(self) -> str:
        """What the runs are called, in documents and folders."""
        return self.experiment.called(self.records[0]["phase"])

    @cached_property
    def lines(self) -> list[tables.Line]:
        """The rows of the table."""
        return tables.lines(self.experiment, self.records)

    @cached_property
    def claims(self) -> list[Claim]:
        """The claims with our answers. Raises UsageError."""
        return claims_of(self.experiment, self.records)

    @cached_property
    def calibration(self) -> Calibration | None:
        """What was drawn and fitted, if anything was."""
        fits = "message_wait" in self.experiment.space
        return Calibration(self.experiment, self.records) if fits else None

    @cached_property
    def scenarios(self) -> Scenarios | None:
        """Rows compared over scenarios, if seed numbers are scenarios that all rows have met."""
        if not is_of_scenarios(self.experiment):
            return None
        found = Scenarios(self.experiment, self.records)
        return found if len(found.numbers) > 1 else None

    @cached_property
    def prediction(self) -> Prediction | None:
        """What fitted settings predict of the paper's rows, if every row has some."""
        fitted = all("message_wait" in row.settings for row in self.experiment.rows)
        return Prediction(self.records) if fitted else None

    @cached_property
    def text(self) -> str:
        """The table for a terminal, and the rows whose policies failed."""
        table = tables.as_text(self.experiment, self.lines, seeds_of(self.records))
        return "\n".join([table, *(f"{row}: {text}" for row, text in self.faults.items())])

    @cached_property
    def faults(self) -> dict[str, str]:
        """Of rows whose policy failed in some runs: in how many, and the first fault."""
        runs = [(record["row"], fault_of(record)) for record in self.records]
        counts = Counter(row for row, fault in runs if fault)
        first = {row: fault for row, fault in reversed(runs) if fault}
        return {
            row: f"policies failed in {counted(counts[row], 'runs')}, and defaults decided: {fault}"
            for row, fault in first.items()
        }

    @property
    def summary(self) -> dict[str, Any]:
        """All of it in plain values; None for what is no number."""
        plain: dict[str, Any] = without_nan(
            {
                "experiment": self.experiment.name,
                "phase": self.records[0]["phase"],
                "seeds": sorted({record["number"] for record in self.records}),
                "runs": len(self.records),
                "rows": tables.as_plain(self.lines),
                "faults": self.faults,
                "claims": [
                    {**dataclasses.asdict(claim), "verdict": claim.verdict} for claim in self.claims
                ],
            }
        )
        return plain

    def write(self, folder: Path) -> None:
        """Write the files into a folder, which is there."""
        ages = [  # archives have none
            (record["row"], record["number"], *pair)
            for record in self.records
            for pair in record["curves"].get("pairs", ())
        ]
        files = {
            "results.csv": _csv(_tidy(self.records)),
            "ages.csv": _csv([_AGE_HEADS, *ages]),
            "table.txt": self.text + "\n",
            "summary.json": json.dumps(self.summary, indent=1) + "\n",
        }
        for name, text in files.items():
            write_whole(folder / name, text, replace=True)
        with contextlib.suppress(MissingExtraError):
            write_parquet(folder / "results.parquet", _tidy(self.records))


def fault_of(record: Record) -> str:
    """What went wrong in policies of other packages in a run; empty: nothing."""
    faults: Mapping[str, str] = record.get("faults", {})
    return "; ".join(f"{name}: {fault}" for name, fault in faults.items())


def _tidy(records: Sequence[Record]) -> list[Sequence[Any]]:
    """The heads, and a row for every run; None is a number that a run does not have."""
    settings = [flat(record["settings"]) for record in records]
    keys = dict.fromkeys((*_ALWAYS, *(key for row in settings for key in row)))
    measures = dict.fromkeys(key for record in records for key in record["measures"])
    heads = (*_IDS, *keys, *measures, "policy_fault", *_ORIGIN)
    rows: list[Sequence[Any]] = [
        [
            *(record[key] for key in _IDS),
            *(value_of(row, key) for key in keys),
            *(record["measures"].get(key) for key in measures),
            fault_of(record),
            *(record.get(key) for key in _ORIGIN),
        ]
        for record, row in zip(records, settings, strict=True)
    ]
    return [["seed_number" if head == "number" else head for head in heads], *rows]


def _csv(rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def without_nan(value: Any) -> Any:
    """Plain values with None for what is no number."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: without_nan(inner) for key, inner in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [without_nan(inner) for inner in value]
    return value


# Documents.


def text_of(document: Path, name: str) -> str:
    """The text of a document that has a block of an experiment.

    Raises:
        NoMarksError: it has none.
        OSError: it cannot be read.
    """
    text = document.read_text(encoding="utf-8")
    if f"<!-- begin {name} " not in text:
        raise NoMarksError(
            f"{document} has no place for '{name}'; put '<!-- begin {name} facts -->' and "
            f"'{_END}' on lines of their own"
        )
    return text


def fill(document: Path, report: Report, archive: Path | None, figures: Sequence[Path]) -> None:
    """Replace an experiment's blocks in a document, and put those figures beside it that it shows.

    Files of evidence that are there are written anew. What has no content stays as it is.

    Raises:
        NoMarksError: the document has no block of the experiment.
    """
    text = _filled(text_of(document, report.name), report.name, _blocks(document, report, archive))
    write_whole(document, text, replace=True)
    into = document.parent / _IMAGES
    for figure in figures:
        copy = into / f"{report.name}-{figure.name}"
        if (_IMAGES / copy.name).as_posix() in text:
            into.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(figure, copy)
    for file, content in _evidence(document, report).items():
        write_whole(file, content, replace=True)


def differences(document: Path, report: Report, archive: Path) -> list[str]:
    """Blocks and files of evidence that differ from the archived runs.

    Raises:
        NoMarksError: the document has no block of the experiment.
    """
    text = text_of(document, report.name)
    found = [
        f"{document}: {report.name} {what}"
        for what, content in _blocks(document, report, archive).items()
        if _filled(text, report.name, {what: content}) != text
    ]
    files = _evidence(document, report)
    return found + [str(f) for f, own in files.items() if f.read_text(encoding="utf-8") != own]


def _filled(text: str, name: str, contents: Mapping[str, str]) -> str:
    """A document with other content in an experiment's blocks; where there is none, it stays."""
    for what, content in contents.items():
        begin = f"<!-- begin {name} {what} -->"
        pattern = re.escape(begin) + r"\n.*?" + re.escape(_END)
        new = f"{begin}\n{content}\n{_END}"
        if content:
            text = re.sub(pattern, new.replace("\\", r"\\"), text, flags=re.DOTALL)
    return text


def _blocks(document: Path, report: Report, archive: Path | None) -> dict[str, str]:
    """The text for each kind of block; empty where there is none."""
    experiment = report.experiment
    whole = tables.of_the_paper(experiment) and len(experiment.rows) == len(tables.PAPER_TABLE)
    return {
        "readings": tables.readings_text(experiment, report.records),
        "fidelity": likeness(Runs(experiment, report.records)),
        "claims": _claims(document, report),
        "facts": _facts(report),
        "paper": tables.nearness(report.lines) if whole else "",
        "fit": report.calibration.text() if report.calibration else "",
        "outcome": outcome_text(report.scenarios, experiment.relevant) if report.scenarios else "",
        "links": links_text(experiment, report.records),
        "blind": report.prediction.text() if report.prediction else "",
        "archive": "" if archive is None else _archive(archive, document, report),
    }


def _claims(document: Path, report: Report) -> str:
    """The verdicts with what they rest on; those on exploration seeds decide nothing: in a line."""
    if report.claims and report.records[0]["phase"] == "exploration":
        path = f"{report.name}-claims.csv"
        verdicts = "; ".join(f"claim {claim.number} {claim.brief}" for claim in report.claims)
        numbers = f" [Numbers]({path})." if (document.parent / path).exists() else ""
        return f"{verdicts[:1].upper()}{verdicts[1:]}.{numbers}"
    text = ["| claim | what it says | verdict | effect [95 % interval] |", "|---|---|---|---|"]
    for claim in report.claims:
        text.append(f"| **{claim.number}** | **{claim.text}** | **{claim.brief}** | |")
        text += [f"| | {part.what} | {part.verdict} | {part.because} |" for part in claim.parts]
    return "\n".join(text)


def _archive(archive: Path, document: Path, report: Report) -> str:
    """Where the runs are, and what distinguishes them from others."""
    path = archive.absolute().relative_to(document.absolute().parent).as_posix()
    programs, rules, commits = (
        ", ".join(sorted({record[key] for record in report.records if key in record}))
        for key in ("program", "rules", "commit")
    )
    locks = sorted(
        {record.get("dependencies", {}).get("constraints", "") for record in report.records}
    )
    made_by = f"commit {commits}, constraints {', '.join(locks)}, " if commits else ""
    content = archive.read_bytes()
    return (
        f"Remade from [{path}]({path}): {len(content) / 1e6:.2f} MB, SHA-256 "
        f"`{hashlib.sha256(content).hexdigest()}`, {made_by}program {programs}, claims {rules}."
    )


def _facts(report: Report) -> str:
    """What was run, and how long it took."""
    cpu_s = sum(record["measures"]["cpu_s"] for record in report.records)
    rows = len({record["row"] for record in report.records})
    return (
        f"{counted(len(report.records), 'runs')} ({counted(rows, 'rows')}, "
        f"{seeds_of(report.records)}), {duration_text(cpu_s)} of processor time."
    )


def _evidence(document: Path, report: Report) -> dict[Path, str]:
    """What belongs into the files of evidence that a document has beside it."""
    tabled: dict[str, Callable[[], list[list[str]]]] = {
        "table": lambda: tables.as_rows(report.experiment, report.lines),
        "pairs": lambda: comparisons(Runs(report.experiment, report.records)),
        "claims": lambda: [
            ["claim", "part", "verdict", "because"],
            *(
                [str(claim.number), part.what, part.verdict, part.because]
                for claim in report.claims
                for part in claim.parts
            ),
        ],
        "draws": lambda: report.calibration.settings() if report.calibration else [],
        "policies": lambda: standings(report.scenarios) if report.scenarios else [],
        "strata": lambda: (
            strata(report.scenarios, tuple(report.experiment.space)) if report.scenarios else []
        ),
        "cells": lambda: report.prediction.cells() if report.prediction else [],
    }
    found = {}
    for what, made in tabled.items():
        file = document.parent / f"{report.name}-{what}.csv"
        if file.exists() and len(rows := made()) > 1:
            found[file] = _csv(rows)
    return found
