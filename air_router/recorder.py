"""Every event in and every decision out, as JSON lines: one file per flight."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from enum import Enum
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TextIO


class Recorder:
    """Writes one flight's log.

    Each line is an object with `t` (seconds on the vehicle's clock), `kind` ("flight", "event"
    or "action"), `type` (the class) and that class's fields. Without a folder nothing is kept.
    """

    def __init__(self, folder: Path | None, mission: str) -> None:
        self.path: Path | None = None
        self._file: TextIO | None = None
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
            self.path = _unused(folder, f"flight-{stamp}")
            # Line by line to the system: a crash of ours loses nothing that was decided.
            self._file = self.path.open("w", encoding="utf-8", buffering=1)
        self.write("flight", 0.0, {"type": "Flight", "mission": mission, "unix_s": time.time()})

    def event(self, event: object, now_s: float) -> None:
        """Record what happened."""
        self.write("event", now_s, fields_of(event))

    def action(self, action: object, now_s: float) -> None:
        """Record what was decided."""
        self.write("action", now_s, fields_of(action))

    def write(self, kind: str, now_s: float, fields: dict[str, Any]) -> None:
        """Record a line of any kind."""
        if self._file is not None:
            line = {"t": round(now_s, 3), "kind": kind, **fields}
            self._file.write(json.dumps(line, separators=(",", ":"), default=_plain) + "\n")

    def close(self) -> None:
        """End the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _type: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        self.close()


def fields_of(value: object) -> dict[str, Any]:
    """A frozen dataclass (or an enum member) as the fields of a log line."""
    if isinstance(value, Enum):
        return {"type": type(value).__name__, "name": value.name}
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        raise TypeError(f"{value!r} cannot be recorded: not a dataclass")
    fields = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    return {"type": type(value).__name__, **fields}


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    if isinstance(value, bytes):
        return value.hex()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return fields_of(value)
    return value if isinstance(value, str | int | bool | None | list | dict) else str(value)


def _unused(folder: Path, stem: str) -> Path:
    path = folder / f"{stem}.jsonl"
    number = 1
    while path.exists():
        number += 1
        path = folder / f"{stem}-{number}.jsonl"
    return path
