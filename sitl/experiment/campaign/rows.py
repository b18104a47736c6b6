"""Rows in words for legends and tables; and which are wanted, by settings or label patterns."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping
from typing import Any, Final

from air_router.counted import counted
from air_router.errors import UsageError
from sitl.experiment.campaign.plan import Experiment, Row, Settings
from sitl.experiment.campaign.results import flat
from sitl.experiment.settings import value_of

_UNITS: Final = {"radius_m": "radius {} m"}
_COUNTS: Final = {"uavs": "UAVs", "ugvs": "UGVs"}
_FLAGS: Final = {"passive": ("passive", "seeking")}


def words(settings: Settings, keys: Iterable[str]) -> str:
    """Some settings in words."""
    parts = []
    for key in keys:
        value = settings.get(key)
        if value is None:
            continue
        if key in _FLAGS:
            parts.append(_FLAGS[key][0 if value else 1])
            continue
        parts.append(_UNITS.get(key, "{}").format(phrase(key, value)))
    return ", ".join(parts)


def phrase(key: str, value: Any) -> str:
    """One setting's value, without a name or a unit unless it counts something."""
    if key in _COUNTS:
        return counted(value, _COUNTS[key])
    inner = flat(value).values() if isinstance(value, Mapping) else [value]
    shown = " ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in inner)
    return shown.replace("_", " ")


def rows_with(rows: Iterable[Row], settings: Settings) -> list[Row]:
    """The rows that have these settings; a list names several values."""
    wanted = {key: own if isinstance(own, list) else [own] for key, own in settings.items()}
    return [
        row
        for row in rows
        if all(value_of(flat(row.settings), key) in own for key, own in wanted.items())
    ]


class NoSuchRowError(UsageError):
    """No row of the experiment is meant."""


def _said(row: Row, key: str) -> str:
    """What a row has of a setting, as people write it; `timers.init_s` is one within another."""
    value = value_of(flat(row.settings), key)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def chosen_rows(experiment: Experiment, choices: Iterable[str]) -> tuple[Row, ...]:
    """The rows for which all `key=value[,value]` hold, and whose label fits one of the patterns.

    Raises:
        NoSuchRowError: a choice fits no row.
    """
    rows = experiment.rows
    patterns = []
    for choice in choices:
        key, equals, values = choice.partition("=")
        if not equals:
            patterns.append(choice)
            continue
        wanted = set(values.split(","))
        among = dict.fromkeys(_said(row, key) for row in experiment.rows)
        if set(among) == {str(None)}:
            raise NoSuchRowError(f"no row has {choice}; '{key}' is no setting of these rows")
        kept = tuple(row for row in rows if _said(row, key) in wanted)
        if not kept:
            raise NoSuchRowError(f"no row has {choice}; '{key}' is one of {', '.join(among)}")
        rows = kept
    if patterns:
        rows = tuple(
            row for row in rows if any(fnmatch.fnmatchcase(row.label, p) for p in patterns)
        )
        if not rows:
            labels = "', '".join(row.label for row in experiment.rows)
            raise NoSuchRowError(f"no row fits {' or '.join(patterns)}; there are '{labels}'")
    return rows
