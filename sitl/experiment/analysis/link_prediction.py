"""How well models of links predicted links of many runs: a table, and curves of calibration.

The runs of the first row count, so that every scenario counts once: what is flown there does not
depend on the models.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from sitl.experiment import Experiment, Record
from sitl.experiment.analysis.statistics import Interval, Numbers, interval

MODELS_SHOWN: Final = {
    "semantic map": "with the map",
    "path loss": "path loss",
    "distance": "distance",
    "constant": "share of links so far",
}
"""Names of models in records, and how they are called."""

_LEAST_LINKS: Final = 20  # of a bin of a curve


def of_links(experiment: Experiment, records: Sequence[Record]) -> list[Record]:
    """The runs of the first row in which links were predicted."""
    label = experiment.rows[0].label
    return [
        record
        for record in records
        if record["row"] == label and record["measures"].get("brier_semantic_map") is not None
    ]


def calibration(runs: Sequence[Record], model: str) -> tuple[Numbers, Numbers]:
    """Of all runs, by bins: the mean predicted probability, and the share that was there."""
    bins = np.sum([run["curves"]["links"][model] for run in runs], axis=0)
    count, expected, seen = bins[bins[:, 0] >= _LEAST_LINKS].T
    return expected / count, seen / count


def links_text(experiment: Experiment, records: Sequence[Record]) -> str:
    """The table for a document; empty: no links were predicted."""
    runs = of_links(experiment, records)
    if not runs:
        return ""
    text = [
        "| model | Brier score | log loss, nats |",
        "|---|---:|---:|",
    ]
    for name, label in MODELS_SHOWN.items():
        key = name.replace(" ", "_")
        cells = [_cell(runs, f"{score}_{key}") for score in ("brier", "log_loss")]
        text.append(f"| {label} | {cells[0]} | {cells[1]} |")
    return "\n".join(text)


def _cell(runs: Sequence[Record], measure: str) -> str:
    found = interval(_column(runs, measure))
    return f"{found.value:.3f}" + _bounds(found)


def _bounds(found: Interval) -> str:
    return "" if np.isnan(found.low) else f" [{found.low:.3f}, {found.high:.3f}]"


def _column(runs: Sequence[Record], measure: str) -> Numbers:
    return np.array([run["measures"][measure] for run in runs], dtype=np.float64)
