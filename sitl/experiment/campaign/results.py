"""The finished runs as a tidy table: a line per run, a column per number, units in the names."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from sitl.experiment.campaign.plan import Record
from sitl.experiment.settings import value_of

_ALWAYS: Final = ("town", "radius_m", "uavs", "ugvs", "channel", "protocol", "policy", "passive")
"""Settings that have a column even where all rows agree."""

_NOT_SHOWN: Final = {"sources"}


def tidy(records: Sequence[Record]) -> list[dict[str, Any]]:
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
            "peak_memory_MB": record["peak_memory_MB"],
            "digest": record["digest"],
            "program": record["program"],
            "machine": record["machine"],
        }
        for record, row in zip(records, settings, strict=True)
    ]


def pair_ages(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Ages of information: a line per run, topic, robot that makes it and robot that uses it."""
    names = ("topic", "maker", "user", "age_mean_s", "age_peak_s")
    return [
        {
            "row": record["row"],
            "seed_number": record["number"],
            **dict(zip(names, pair, strict=True)),
        }
        for record in records
        for pair in record["curves"].get("pairs", ())  # archives have none
    ]


def flat(settings: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Settings without mappings in them: `timers.init_s`."""
    result: dict[str, Any] = {}
    for key, value in settings.items():
        if key in _NOT_SHOWN:
            continue
        if isinstance(value, Mapping):
            result.update(flat(value, f"{before}{key}."))
        else:
            result[before + key] = value
    return result


def write_csv(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write tidy runs; an empty cell is a number that a run does not have."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else [])
        writer.writeheader()
        writer.writerows(rows)


def write_json(value: Any, path: Path) -> None:
    """Write plain values for other programs; nan becomes null."""
    path.write_text(json.dumps(without_nan(value), indent=1) + "\n", encoding="utf-8")


def without_nan(value: Any) -> Any:
    """Plain values with null for what is no number."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: without_nan(inner) for key, inner in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [without_nan(inner) for inner in value]
    return value
