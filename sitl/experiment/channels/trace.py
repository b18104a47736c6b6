"""Links as they were recorded: replayed line by line, whatever the robots of the run do.

A trace is a CSV file with a line of names, or JSON lines (an object per line); times rise:

    t_s,a,b,up,rssi_dbm,rate_bytes_s
    0,uav01,ugv01,1,,250000
    31.5,uav01,ugv01,0,,

t_s            seconds from the start of the run
a, b           two robots of the run, in any order
up             1 or true: they are in contact from then on; 0 or false: not any more
rssi_dbm       instead of `up`: in contact at the model's trigger and above
rate_bytes_s   what the link carries from then on; the model's rate where it is left out

Only `t_s`, `a`, `b`, and one of `up` and `rssi_dbm` must be there. What is not said stays as it
was; before the first line no robot hears another.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from air_router.errors import AirRouterError, ExitCode
from sitl.experiment.channels.channel import Change, Link, Load, Places, SpatialReuse
from sitl.experiment.settings import TraceModel

MOST_LINES: Final = 2_000_000
MOST_TOLD: Final = 20


class TraceError(AirRouterError):
    """A trace that cannot be used; every problem with its line."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a trace: from a time on a link is so."""

    time_s: float
    a: int
    b: int
    up: bool
    rate_bytes_s: float | None  # None: as before


class TraceChannel(SpatialReuse):
    """A recorded channel.

    Args:
        model: The file, and what it leaves out.
        names: Of the robots, in the order of their numbers.

    Raises:
        TraceError: with every problem of the file.
    """

    def __init__(self, model: TraceModel, names: Sequence[str]) -> None:
        super().__init__(model.pull_every_s, len(names))
        self._model = model
        self._entries = read_trace(model, names)  # in order of time
        self._next = 0  # entry that has not happened yet
        self._rates: dict[tuple[int, int], float] = {}  # bytes/s as recorded last; a < b
        self._up: set[tuple[int, int]] = set()  # in contact, a < b

    def look(self, now_s: float, places: Places) -> list[Change]:  # noqa: ARG002 - a port's
        """What has changed since the last look."""
        before = set(self._up)
        while self._next < len(self._entries) and self._entries[self._next].time_s <= now_s:
            entry = self._entries[self._next]
            self._next += 1
            pair = entry.a, entry.b
            if entry.rate_bytes_s is not None:
                self._rates[pair] = entry.rate_bytes_s
            if entry.up:
                self._up.add(pair)
            else:
                self._up.discard(pair)
        for a, b in before ^ self._up:
            self._hears[a] ^= {b}
            self._hears[b] ^= {a}
        return [Change(*pair, pair in self._up) for pair in sorted(before ^ self._up)]

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002 - a port's
        """Round trips, and the bytes at the recorded rate."""
        rate_bytes_s = self._rates.get((min(link), max(link)), self._model.rate_bytes_s)
        return load.round_trips * self._model.round_trip_s + load.size / rate_bytes_s


class _Line(BaseModel):
    """What a line of a trace may say."""

    model_config = ConfigDict(extra="forbid")

    t_s: Annotated[FiniteFloat, Field(ge=0)]
    a: str
    b: str
    up: bool | None = None
    rssi_dbm: FiniteFloat | None = None
    rate_bytes_s: FiniteFloat | None = None


def read_trace(model: TraceModel, names: Sequence[str]) -> list[Entry]:
    """The lines of a trace, in the order of time.

    Raises:
        TraceError: with every problem of the file.
    """
    path = model.path
    problems: list[str] = []
    entries: list[Entry] = []
    try:
        with path.open(encoding="utf-8", newline="") as file:
            for number, row in _rows(path, file):
                try:
                    entries.append(_entry(row, model, names, entries))
                except ValidationError as error:
                    wrong = error.errors()[0]
                    where = ".".join(map(str, wrong["loc"]))
                    problems.append(
                        f"{path}:{number}: {where}: {str(wrong['input'])[:40]!r}: {wrong['msg']}"
                    )
                except ValueError as error:
                    problems.append(f"{path}:{number}: {error}")
                if len(entries) + len(problems) > MOST_LINES:
                    problems.append(f"{path}: more than {MOST_LINES} lines; cut it into parts")
                    break
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        problems.append(f"{path}: cannot be read: {error}")
    if problems:
        more = [f"and {len(problems) - MOST_TOLD} more"] if len(problems) > MOST_TOLD else []
        raise TraceError("\n".join([*problems[:MOST_TOLD], *more]))
    return entries


def _rows(path: Path, file: Iterable[str]) -> Iterator[tuple[int, dict[str, Any] | str]]:
    """Every line's number, and its fields or its JSON."""
    if path.suffix.lower() == ".csv":
        table = csv.DictReader(file)
        for row in table:
            yield table.line_num, {key: value for key, value in row.items() if value != ""}
        return
    yield from ((number, text) for number, text in enumerate(file, start=1) if text.strip())


def _entry(
    row: dict[str, Any] | str, model: TraceModel, names: Sequence[str], before: Sequence[Entry]
) -> Entry:
    """The entry of a line. Raises ValueError with what is wrong, and what to do."""
    said = _Line.model_validate_json(row) if isinstance(row, str) else _Line.model_validate(row)
    last_s = before[-1].time_s if before else 0.0
    if said.t_s < last_s:
        raise ValueError(f"t_s must rise; it is {said.t_s:g}, after {last_s:g}")
    for key, name in (("a", said.a), ("b", said.b)):
        if name not in names:
            raise ValueError(f"{key}: no robot {name!r}; use {', '.join(names)}")
    a, b = sorted(map(names.index, (said.a, said.b)))
    if a == b:
        raise ValueError("a and b are the same robot")
    if said.up is None and said.rssi_dbm is None:
        raise ValueError("neither up nor rssi_dbm; say one of them")
    if said.rate_bytes_s is not None and said.rate_bytes_s <= 0:
        raise ValueError(f"rate_bytes_s of {said.rate_bytes_s:g}; say up: 0 of a link that is down")
    up = (said.rssi_dbm or 0.0) >= model.trigger_dbm if said.up is None else said.up
    return Entry(said.t_s, a, b, up, said.rate_bytes_s)
