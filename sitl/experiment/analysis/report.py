"""What the runs of an experiment amount to, and the files that say it.

results.csv     a line per run, a column per number, units in the names
ages.csv        ages of information: a line per run, topic, robot that makes it, robot that uses it
table.txt, .md  the table with intervals, for a terminal and for a document
summary.json    the table and the verdicts on the claims, for programs
"""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from sitl.experiment.analysis import tables
from sitl.experiment.analysis.claims import Claim, claims_of
from sitl.experiment.plan import Experiment, Record, flat, seeds_of
from sitl.experiment.settings import value_of

_ALWAYS: Final = ("town", "radius_m", "uavs", "ugvs", "channel", "protocol", "policy", "passive")
"""Settings that have a column even where all rows agree."""

_PAIR: Final = ("topic", "maker", "user", "age_mean_s", "age_peak_s")


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
    def text(self) -> str:
        """The table for a terminal."""
        return tables.as_text(self.experiment, self.lines, seeds_of(self.records))

    @cached_property
    def table(self) -> str:
        """The table for a document."""
        return tables.as_markdown(self.experiment, self.lines)

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
                "claims": [
                    {**dataclasses.asdict(claim), "verdict": claim.verdict} for claim in self.claims
                ],
            }
        )
        return plain

    def write(self, folder: Path) -> None:
        """Write the files into a folder, which is there."""
        _write_csv(_tidy(self.records), folder / "results.csv")
        _write_csv(_pair_ages(self.records), folder / "ages.csv")
        summary = json.dumps(self.summary, indent=1)
        for name, text in (("table.txt", self.text), ("table.md", self.table)):
            (folder / name).write_text(text + "\n", encoding="utf-8")
        (folder / "summary.json").write_text(summary + "\n", encoding="utf-8")


def _tidy(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Runs as mappings with the same keys in the same order."""
    settings = [flat(record["settings"]) for record in records]
    keys = dict.fromkeys((*_ALWAYS, *(key for row in settings for key in row)))
    measures = dict.fromkeys(key for record in records for key in record["measures"])
    return [
        {
            "experiment": record["experiment"],
            "row": record["row"],
            "phase": record["phase"],
            "seed_number": record["number"],
            "seed": record["seed"],
            **{key: value_of(row, key) for key in keys},
            **{key: record["measures"].get(key) for key in measures},
            **{key: record[key] for key in ("peak_memory_MB", "digest", "program", "machine")},
        }
        for record, row in zip(records, settings, strict=True)
    ]


def _pair_ages(records: Sequence[Record]) -> list[dict[str, Any]]:
    return [
        {"row": r["row"], "seed_number": r["number"], **dict(zip(_PAIR, pair, strict=True))}
        for r in records
        for pair in r["curves"].get("pairs", ())  # archives have none
    ]


def _write_csv(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """An empty cell is a number that a run does not have."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else [])
        writer.writeheader()
        writer.writerows(rows)


def without_nan(value: Any) -> Any:
    """Plain values with None for what is no number."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: without_nan(inner) for key, inner in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [without_nan(inner) for inner in value]
    return value
