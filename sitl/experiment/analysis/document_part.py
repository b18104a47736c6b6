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
import io
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Final

from air_router.counted import counted
from air_router.errors import UsageError
from sitl.experiment.analysis import fidelity, tables
from sitl.experiment.analysis.claims import Claim, claims_of
from sitl.experiment.analysis.comparison import as_rows, compared
from sitl.experiment.analysis.effects import Runs
from sitl.experiment.analysis.paper import TABLE
from sitl.experiment.analysis.tables import Line
from sitl.experiment.campaign.archive import checksum
from sitl.experiment.campaign.campaign import in_words
from sitl.experiment.campaign.links import comparison, halves
from sitl.experiment.campaign.plan import Experiment, Record, seeds_of

IMAGES: Final = Path("images") / "experiments"
_END: Final = "<!-- end -->"


class NoMarksError(UsageError):
    """The document has no place for this experiment."""


def claims_text(claims: Sequence[Claim]) -> str:
    """Claims and their answers, for a document."""
    text = ["| claim | what it says | verdict | effect [95 % interval] |", "|---|---|---|---|"]
    for claim in claims:
        text.append(f"| **{claim.number}** | **{claim.text}** | **{claim.brief}** | |")
        text += [f"| | {part.what} | {part.verdict} | {part.because} |" for part in claim.parts]
    return "\n".join(text)


def evidence_of(experiment: Experiment, records: Sequence[Record]) -> dict[str, list[list[str]]]:
    """Table, pairs and claims with all numbers, as rows of cells under their heads."""
    runs = Runs(experiment, records)
    return {
        "table": tables.as_rows(experiment, tables.lines(experiment, records)),
        "pairs": as_rows(runs, compared(runs)),
        "claims": [
            ["claim", "part", "verdict", "because"],
            *(
                [str(claim.number), part.what, part.verdict, part.because]
                for claim in claims_of(experiment, records)
                for part in claim.parts
            ),
        ],
    }


def facts_text(experiment: Experiment, found: Sequence[Line], records: Sequence[Record]) -> str:
    """What was run, how long it took, and how near the paper's goals and waits it came."""
    measures = [record["measures"] for record in records]
    cpu_s = sum(run["cpu_s"] for run in measures)
    text = (
        f"{counted(len(records), 'runs')} ({counted(len(found), 'rows')}, {seeds_of(records)}), "
        f"{in_words(cpu_s)} of processor time."
    )
    ratios = near_paper(found, "wait_mean_s") if tables.of_the_paper(experiment) else []
    if len(ratios) == len(TABLE):
        goals = [ratio for _, ratio in near_paper(found, "goals_percent")]
        text += (
            f" More goals are found than in the paper in {sum(ratio > 1 for ratio in goals)} of "
            f"{len(goals)} rows, {median(goals):.2f} times as many (median)."
        )
        low, high = (pick(ratios, key=lambda entry: entry[1]) for pick in (min, max))
        text += (
            " The mean wait is within a factor of two of the paper's in "
            f"{within_factor(ratios)} of {len(ratios)} rows; it is {low[1]:.2f} times the paper's "
            f"at the least ({low[0]}) and {high[1]:.2f} times at the most ({high[0]})."
        )
    return text


def near_paper(found: Sequence[Line], column: str) -> list[tuple[str, float]]:
    """For each row of the paper's table: a number of ours as a multiple of the paper's."""
    return [
        (line.label, line.values[column].value / getattr(line.paper, column))
        for line in found
        if line.paper
    ]


def within_factor(ratios: Sequence[tuple[str, float]]) -> int:
    """How many of the rows lie within a factor of two of the paper's."""
    return sum(0.5 <= ratio <= 2.0 for _, ratio in ratios)


def links_text(records: Sequence[Record]) -> str:
    """How well links were predicted, for a document."""
    text = ["| predicted from | Brier score | AUC |", "|---|---:|---:|"]
    for name, found in comparison(records).items():
        text.append(f"| {name} | {found.brier:.4f} | {found.area:.3f} |")
    return "\n".join(text)


def archive_text(archive: Path, document: Path, records: Sequence[Record]) -> str:
    """Where the runs are, for a document, and what tells them from others."""
    path = archive.absolute().relative_to(document.absolute().parent).as_posix()
    programs = ", ".join(sorted({record["program"] for record in records}))
    rules = ", ".join(sorted({record["rules"] for record in records}))
    return (
        f"Remade from [{path}]({path}): {archive.stat().st_size / 1e6:.2f} MB, SHA-256 "
        f"`{checksum(archive)}`, program {programs}, claims {rules}."
    )


def blocks_of(experiment: Experiment, records: Sequence[Record]) -> dict[str, str]:
    """The text for each kind of block but the archive's."""
    found = tables.lines(experiment, records)
    links = [record for record in records if "links" in record["curves"]]
    return {
        "fidelity": fidelity.as_markdown(fidelity.likeness(experiment, records)),
        "links": links_text(links) if all(halves(links)) else "",
        "table": tables.as_markdown(experiment, found),
        "claims": claims_text(claims_of(experiment, records)),
        "facts": facts_text(experiment, found, records),
    }


def blocks_in(document: Path, name: str) -> str:
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


def filled(text: str, name: str, blocks: Mapping[str, str]) -> str:
    """A document with other content in an experiment's blocks; where there is none, it stays."""
    for what, content in blocks.items():
        begin = f"<!-- begin {name} {what} -->"
        pattern = re.escape(begin) + r"\n.*?" + re.escape(_END)
        new = f"{begin}\n{content}\n{_END}"
        if content:
            text = re.sub(pattern, new.replace("\\", r"\\"), text, flags=re.DOTALL)
    return text


def evidence_files(
    document: Path, name: str, evidence: Mapping[str, Sequence[Sequence[str]]]
) -> dict[Path, str]:
    """What belongs into the files of evidence that a document has beside it."""
    found = {}
    for what, rows in evidence.items():
        file = document.parent / "evidence" / f"{name}-{what}.csv"
        if file.exists() and len(rows) > 1:
            out = io.StringIO()
            csv.writer(out, lineterminator="\n").writerows(rows)
            found[file] = out.getvalue()
    return found


def differences(
    document: Path, experiment: Experiment, records: Sequence[Record], archive: Path
) -> list[str]:
    """Blocks and files of evidence that say something else than the archived runs.

    Raises:
        NoMarksError: the document has no block of the experiment.
    """
    name = experiment.called(records[0]["phase"])
    text = blocks_in(document, name)
    blocks = blocks_of(experiment, records)
    blocks["archive"] = archive_text(archive, document, records)
    found = [
        f"{document}: {name} {what}"
        for what, content in blocks.items()
        if filled(text, name, {what: content}) != text
    ]
    files = evidence_files(document, name, evidence_of(experiment, records))
    return found + [str(f) for f, own in files.items() if f.read_text(encoding="utf-8") != own]


def fill(
    document: Path,
    name: str,
    blocks: Mapping[str, str],
    figures: Sequence[Path],
    evidence: Mapping[str, Sequence[Sequence[str]]],
) -> None:
    """Replace an experiment's blocks in a document, and put those figures beside it that it shows.

    Files of evidence that are there are written anew. What has no content stays as it is.

    Raises:
        NoMarksError: the document has no block of the experiment.
    """
    text = filled(blocks_in(document, name), name, blocks)
    document.write_text(text, encoding="utf-8")
    into = document.parent / IMAGES
    for figure in figures:
        copy = into / f"{name}-{figure.name}"
        if (IMAGES / copy.name).as_posix() in text:
            into.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(figure, copy)
    for file, content in evidence_files(document, name, evidence).items():
        file.write_text(content, encoding="utf-8")
