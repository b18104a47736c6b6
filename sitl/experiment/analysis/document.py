"""Puts an experiment's table, claims and figures into a document, between marks that stand there.

A block of the document begins with `<!-- begin NAME WHAT -->` and ends with `<!-- end -->`; NAME is
the experiment (NAME-confirmation: its runs for confirmation), WHAT one of facts, archive, table,
claims, links, fidelity. What is between is replaced, so the document can be made again from any
runs. Figures go beside it, into `images/experiments`; tables, rows compared by seeds, and the
numbers behind claims into `evidence/NAME-table.csv`, `-pairs.csv` and `-claims.csv`, where these
exist.
"""

from __future__ import annotations

import csv
import hashlib
import io
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Final

from air_router.counted import counted
from air_router.errors import UsageError
from sitl.experiment.analysis import tables
from sitl.experiment.analysis.comparison import as_rows, compared, likeness, likeness_table
from sitl.experiment.analysis.links import comparison, halves
from sitl.experiment.analysis.report import Report
from sitl.experiment.analysis.statistics import Runs
from sitl.experiment.analysis.tables import PAPER_TABLE, Line
from sitl.experiment.campaign.campaign import in_words
from sitl.experiment.plan import seeds_of

_IMAGES: Final = Path("images") / "experiments"
_END: Final = "<!-- end -->"


class NoMarksError(UsageError):
    """The document has no place for this experiment."""


def text_of(document: Path, name: str) -> str:
    """The text of a document that has a block of an experiment.

    Raises:
        NoMarksError: it has none.
        OSError: it cannot be read.
    """
    text = document.read_text(encoding="utf-8")
    if f"<!-- begin {name} " not in text:
        raise NoMarksError(
            f"{document} has no place for '{name}'; put '<!-- begin {name} table -->' and "
            f"'{_END}' on lines of their own"
        )
    return text


def fill(document: Path, report: Report, archive: Path | None, figures: Sequence[Path]) -> None:
    """Replace an experiment's blocks in a document, and put those figures beside it that it shows.

    Files of evidence that are there are written anew. What has no content stays as it is.

    Raises:
        NoMarksError: the document has no block of the experiment.
    """
    text = _filled(text_of(document, report.name), report.name, blocks(document, report, archive))
    document.write_text(text, encoding="utf-8")
    into = document.parent / _IMAGES
    for figure in figures:
        copy = into / f"{report.name}-{figure.name}"
        if (_IMAGES / copy.name).as_posix() in text:
            into.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(figure, copy)
    for file, content in _evidence(document, report).items():
        file.write_text(content, encoding="utf-8")


def differences(document: Path, report: Report, archive: Path) -> list[str]:
    """Blocks and files of evidence that say something else than the archived runs.

    Raises:
        NoMarksError: the document has no block of the experiment.
    """
    text = text_of(document, report.name)
    found = [
        f"{document}: {report.name} {what}"
        for what, content in blocks(document, report, archive).items()
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


def blocks(document: Path, report: Report, archive: Path | None) -> dict[str, str]:
    """The text for each kind of block; empty where there is nothing to say."""
    return {
        "fidelity": likeness_table(likeness(report.experiment, report.records)),
        "links": _links(report),
        "table": report.table,
        "claims": _claims(report),
        "facts": _facts(report),
        "archive": "" if archive is None else _archive(archive, document, report),
    }


def _claims(report: Report) -> str:
    text = ["| claim | what it says | verdict | effect [95 % interval] |", "|---|---|---|---|"]
    for claim in report.claims:
        text.append(f"| **{claim.number}** | **{claim.text}** | **{claim.brief}** | |")
        text += [f"| | {part.what} | {part.verdict} | {part.because} |" for part in claim.parts]
    return "\n".join(text)


def _links(report: Report) -> str:
    """How well links were predicted."""
    records = [record for record in report.records if "links" in record["curves"]]
    if not all(halves(records)):
        return ""
    text = ["| predicted from | Brier score | AUC |", "|---|---:|---:|"]
    for name, found in comparison(records).items():
        text.append(f"| {name} | {found.brier:.4f} | {found.area:.3f} |")
    return "\n".join(text)


def _archive(archive: Path, document: Path, report: Report) -> str:
    """Where the runs are, and what tells them from others."""
    path = archive.absolute().relative_to(document.absolute().parent).as_posix()
    programs = ", ".join(sorted({record["program"] for record in report.records}))
    rules = ", ".join(sorted({record["rules"] for record in report.records}))
    checksum = hashlib.sha256(archive.read_bytes()).hexdigest()
    return (
        f"Remade from [{path}]({path}): {archive.stat().st_size / 1e6:.2f} MB, SHA-256 "
        f"`{checksum}`, program {programs}, claims {rules}."
    )


def _facts(report: Report) -> str:
    """What was run, how long it took, and how near the paper's goals and waits it came."""
    cpu_s = sum(record["measures"]["cpu_s"] for record in report.records)
    text = (
        f"{counted(len(report.records), 'runs')} ({counted(len(report.lines), 'rows')}, "
        f"{seeds_of(report.records)}), {in_words(cpu_s)} of processor time."
    )
    of_paper = tables.of_the_paper(report.experiment)
    ratios = near_paper(report.lines, "wait_mean_s") if of_paper else []
    if len(ratios) == len(PAPER_TABLE):
        goals = [ratio for _, ratio in near_paper(report.lines, "goals_percent")]
        near = sum(0.5 <= ratio <= 2.0 for _, ratio in ratios)
        low, high = (pick(ratios, key=lambda entry: entry[1]) for pick in (min, max))
        text += (
            f" More goals are found than in the paper in {sum(ratio > 1 for ratio in goals)} of "
            f"{len(goals)} rows, {median(goals):.2f} times as many (median)."
            f" The mean wait is within a factor of two of the paper's in {near} of {len(ratios)} "
            f"rows; it is {low[1]:.2f} times the paper's at the least ({low[0]}) and "
            f"{high[1]:.2f} times at the most ({high[0]})."
        )
    return text


def near_paper(found: Sequence[Line], column: str) -> list[tuple[str, float]]:
    """For each row of the paper's table: a number of ours as a multiple of the paper's."""
    return [
        (line.label, line.values[column].value / getattr(line.paper, column))
        for line in found
        if line.paper
    ]


def _evidence(document: Path, report: Report) -> dict[Path, str]:
    """What belongs into the files of evidence that a document has beside it."""
    runs = Runs(report.experiment, report.records)
    tabled = {
        "table": tables.as_rows(report.experiment, report.lines),
        "pairs": as_rows(runs, compared(runs)),
        "claims": [
            ["claim", "part", "verdict", "because"],
            *(
                [str(claim.number), part.what, part.verdict, part.because]
                for claim in report.claims
                for part in claim.parts
            ),
        ],
    }
    found = {}
    for what, rows in tabled.items():
        file = document.parent / "evidence" / f"{report.name}-{what}.csv"
        if file.exists() and len(rows) > 1:
            out = io.StringIO()
            csv.writer(out, lineterminator="\n").writerows(rows)
            found[file] = out.getvalue()
    return found
