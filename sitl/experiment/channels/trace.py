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
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode
from mocha_link.node.gossip import TIMEOUT_S
from sitl.experiment.channels.channel import Change, Link, Load, Places
from sitl.experiment.settings import TraceModel

MOST_LINES: Final = 2_000_000
MOST_TOLD: Final = 20
_FIELDS: Final = ("t_s", "a", "b", "up", "rssi_dbm", "rate_bytes_s")
_YES_NO: Final = {"1": True, "true": True, "0": False, "false": False}


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
    rate_bytes_s: float


class TraceChannel:
    """A recorded channel.

    Args:
        model: The file, and what it leaves out.
        names: Of the robots, in the order of their numbers.

    Raises:
        TraceError: with every problem of the file.
    """

    patience_s = TIMEOUT_S
    frame_by_frame = True

    def __init__(self, model: TraceModel, names: Sequence[str]) -> None:
        self.pull_every_s = model.pull_every_s  # None: only when a contact begins
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
            self._rates[pair] = entry.rate_bytes_s
            if entry.up:
                self._up.add(pair)
            else:
                self._up.discard(pair)
        return [Change(*pair, pair in self._up) for pair in sorted(before ^ self._up)]

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002 - a port's
        """Round trips, and the bytes at the recorded rate."""
        rate_bytes_s = self._rates[min(link), max(link)]
        return load.round_trips * self._model.round_trip_s + load.size / rate_bytes_s

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """Who has waited longest."""
        return (ready_s, *link)

    def pick(self, waiting: Iterable[Link], busy: Sequence[Link]) -> int | None:
        """The first none of whose robots is, or hears, one of those that are under way."""
        sending = {number for link in busy for number in link}
        deaf = sending | {b for a, b in self._up if a in sending}
        deaf |= {a for a, b in self._up if b in sending}
        for place, (asking, answering) in enumerate(waiting):
            if asking not in deaf and answering not in deaf:
                return place
        return None


def read_trace(model: TraceModel, names: Sequence[str]) -> list[Entry]:
    """The lines of a trace, in the order of time.

    Raises:
        TraceError: with every problem of the file.
    """
    path = model.path
    numbers = {name: number for number, name in enumerate(names)}
    problems: list[str] = []
    entries: list[Entry] = []
    reader = _Reader(model, numbers)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            for line, row in _rows(path, file):
                try:
                    entries.append(reader.entry(row))
                except ValueError as error:
                    problems.append(f"{path}:{line}: {error}")
                if len(entries) + len(problems) > MOST_LINES:
                    problems.append(f"{path}: more than {MOST_LINES} lines; cut it into parts")
                    break
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        problems.append(f"{path}: cannot be read: {error}")
    if problems:
        more = [f"and {len(problems) - MOST_TOLD} more"] if len(problems) > MOST_TOLD else []
        raise TraceError("\n".join([*problems[:MOST_TOLD], *more]))
    return entries


def _rows(path: Path, file: Iterable[str]) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Every line's number and fields."""
    if path.suffix.lower() == ".csv":
        table = csv.DictReader(file)
        for row in table:
            yield table.line_num, row
        return
    for number, text in enumerate(file, start=1):
        if text.strip():
            yield number, _Json(text)


class _Json(dict[str, Any]):
    """The object of a line; one that is none has the field that says so."""

    def __init__(self, text: str) -> None:
        try:
            data = json.loads(text)
        except ValueError as error:
            data = {"": f"no JSON: {error}"}
        super().__init__(data if isinstance(data, dict) else {"": "not a JSON object"})


class _Reader:
    """Makes entries of rows. Raises ValueError with what is wrong, and what to do."""

    def __init__(self, model: TraceModel, numbers: Mapping[str, int]) -> None:
        self._model = model
        self._numbers = numbers
        self._rates: dict[tuple[int, int], float] = {}  # bytes/s, for rows without a rate
        self._last_s = 0.0  # of the row before

    def entry(self, row: Mapping[Any, Any]) -> Entry:
        """The entry of a row."""
        unknown = [key for key in row if key not in _FIELDS]
        if unknown:
            why = row.get("") or f"no field {unknown[0]!r}; use {', '.join(_FIELDS)}"
            raise ValueError(why)
        time_s = _number(row, "t_s")
        if time_s is None or time_s < self._last_s:
            raise ValueError(f"t_s must rise; it is {time_s}, after {self._last_s:g}")
        a, b = sorted((self._robot(row, "a"), self._robot(row, "b")))
        if a == b:
            raise ValueError("a and b are the same robot")
        rate_bytes_s = _number(row, "rate_bytes_s")
        if rate_bytes_s is None:
            rate_bytes_s = self._rates.get((a, b), self._model.rate_bytes_s)
        if rate_bytes_s <= 0:
            raise ValueError(f"rate_bytes_s of {rate_bytes_s:g}; say up: 0 of a link that is down")
        up = self._up(row)
        self._last_s, self._rates[a, b] = time_s, rate_bytes_s
        return Entry(time_s, a, b, up, rate_bytes_s)

    def _robot(self, row: Mapping[Any, Any], key: str) -> int:
        name = row.get(key)
        if not isinstance(name, str) or name not in self._numbers:
            raise ValueError(f"{key}: no robot {name!r}; use {', '.join(self._numbers)}")
        return self._numbers[name]

    def _up(self, row: Mapping[Any, Any]) -> bool:
        said = row.get("up")
        if said is None or said == "":
            rssi_dbm = _number(row, "rssi_dbm")
            if rssi_dbm is None:
                raise ValueError("neither up nor rssi_dbm; say one of them")
            return rssi_dbm >= self._model.trigger_dbm
        answer = _YES_NO.get(str(said).lower())
        if answer is None:
            raise ValueError(f"up: {said!r}; write 1 or 0")
        return answer


def _number(row: Mapping[Any, Any], key: str) -> float | None:
    said = row.get(key)
    if said is None or said == "":
        return None
    try:
        value = float(said)
    except (TypeError, ValueError):
        value = math.nan
    if isinstance(said, bool) or not math.isfinite(value):
        raise ValueError(f"{key}: {said!r} is no number")
    return value
