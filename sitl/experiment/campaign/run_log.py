"""The finished runs of an experiment in a file that survives whatever ends the program.

One JSON object per line, written whole and synced to disk before the next run counts. A line that
was cut by a power loss is the last one; it is taken off, and that run is made again.
"""

from __future__ import annotations

import fcntl
import functools
import hashlib
import json
import os
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from air_router.errors import AirRouterError, ExitCode, UsageError
from sitl.experiment.campaign.plan import Experiment, Phase, Record, Row

FILE_NAME = "runs.jsonl"
_ROOT: Final = Path(__file__).parents[3]
_PACKAGES: Final = ("air_router", "geo", "mocha_link", "sitl")
_KEYS: Final = frozenset(
    {"experiment", "row", "number", "phase", "rules", "seed", "fingerprint", "measures"}
)


class RunLogError(AirRouterError):
    """The file of finished runs cannot be used."""


class MixedRunsError(UsageError):
    """The finished runs belong to other settings, seeds or a phase other than what is asked for."""


class InUseError(AirRouterError):
    """Another program is running the experiment in the same folder."""

    exit_code = ExitCode.REFUSED


class RunLog:
    """The finished runs in a folder; one program at a time may add to it.

    With `fresh` it does not look at what is there, and `clear` forgets it.

    Raises:
        RunLogError: the file has lines that no run wrote.
        InUseError: another program has it open.
    """

    def __init__(self, folder: Path, *, fresh: bool = False) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / FILE_NAME  # locked while this is open
        self._file = self.path.open("ab+")  # locked: one program at a time
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise InUseError(
                f"{folder} is in use by another `sitl experiment`; wait, or give another --out"
            ) from None
        try:
            self.records: list[Record] = [] if fresh else self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()

    def clear(self) -> None:
        """Forget what is in the file."""
        self._file.truncate(0)

    def add(self, record: Record) -> None:
        """Keep a run."""
        line = json.dumps(record, separators=(",", ":"), allow_nan=False) + "\n"
        self._file.write(line.encode())
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self) -> list[Record]:
        self._file.seek(0)
        content = self._file.read()
        self._file.truncate(content.rfind(b"\n") + 1)
        return _whole_lines(content, self.path)


def read_line(line: bytes, path: Path, number: int) -> Record:
    """One line as a run. Raises RunLogError."""
    try:
        record = json.loads(line)
    except ValueError:
        record = None
    if not isinstance(record, Mapping) or not record.keys() >= _KEYS:
        raise RunLogError(
            f"{path}:{number}: not a run; remove the line, or begin anew with --fresh"
        )
    return record


def read_runs(folder: Path) -> list[Record]:
    """The finished runs of a folder, without holding it; none is none. Raises RunLogError."""
    path = folder / FILE_NAME
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        content = b""
    return _whole_lines(content, path)


def _whole_lines(content: bytes, path: Path) -> list[Record]:
    lines = content[: content.rfind(b"\n") + 1].splitlines()
    return [read_line(line, path, number) for number, line in enumerate(lines, start=1)]


def usable(
    records: list[Record], experiment: Experiment, phase: Phase, folder: Path
) -> dict[Any, Record]:
    """The finished runs of this very experiment, by row's label and seed's number.

    Raises:
        MixedRunsError: there are runs of the other phase; or rows of the same name were run with
            other settings, or with other seeds: what the file's rows differ in, what is paired, or
            where confirmation begins has changed.
    """
    rows: dict[str, Row] = {row.label: row for row in experiment.rows}
    found: dict[Any, Record] = {}
    for record in records:
        if record["phase"] != phase:
            raise MixedRunsError(
                f"{folder} holds {record['phase']} runs, and {phase} runs are asked for; give "
                "another --out"
            )
        row = rows.get(record["row"])
        if row is None:
            continue
        number = record["number"]
        same = (
            record["experiment"] == experiment.name
            and record["fingerprint"] == row.fingerprint
            and record["phase"] == experiment.phase(number)
            and record["seed"] == experiment.seed(row, number)
        )
        if not same:
            raise MixedRunsError(
                f"{folder} holds runs of row '{row.label}' with other settings or seeds; give "
                "another --out, or begin anew with --fresh"
            )
        found[row.label, number] = record
    return found


@functools.cache
def program() -> str:
    """The version and a hash of the program's own sources: other code may make other runs."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(path.relative_to(_ROOT).as_posix().encode())
            digest.update(path.read_bytes())
    try:
        number = version("air-router")
    except PackageNotFoundError:
        number = "unknown"
    return f"{number} {digest.hexdigest()[:12]}"
