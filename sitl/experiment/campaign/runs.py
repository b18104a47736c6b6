"""The finished runs of an experiment: the log that is written as they are made, and its archive.

The log is one JSON object per line, written whole and synced to disk before the next run counts. A
line that was cut by a power loss is the last one; it is taken off, and that run is made again.

The archive is one small file, all that tables are made of: XZ-compressed lines of JSON, first the
text of the experiment's file as it was, then a run each, without the curves that only figures need.
So a table can be remade when rows, towns or claims are others.
"""

from __future__ import annotations

import fcntl
import functools
import hashlib
import json
import lzma
import os
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from air_router.errors import AirRouterError, ExitCode, UsageError
from mocha_link.team.document import Document
from sitl.experiment.plan import Experiment, Phase, Record
from sitl.experiment.plan_file import experiment_of

FILE_NAME: Final = "runs.jsonl"
ARCHIVE_ENDING: Final = ".jsonl.xz"
_ROOT: Final = Path(__file__).parents[3]
_PACKAGES: Final = ("air_router", "geo", "mocha_link", "sitl")
_KEYS: Final = frozenset(
    {"experiment", "row", "number", "phase", "rules", "seed", "fingerprint", "measures"}
)
_ARCHIVED_CURVES: Final = ("links",)


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

    Attributes:
        records: The runs that were there.

    Raises:
        RunLogError: the file has lines that no run wrote.
        InUseError: another program has it open.
    """

    def __init__(self, folder: Path, *, fresh: bool = False) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / FILE_NAME
        self._file = path.open("ab+")  # locked: one program at a time
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.records: list[Record] = [] if fresh else self._read(path)
        except BlockingIOError:
            self._file.close()
            raise InUseError(
                f"{folder} is in use by another `sitl experiment`; wait, or give another --out"
            ) from None
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

    def _read(self, path: Path) -> list[Record]:
        self._file.seek(0)
        content = self._file.read()
        whole = content[: content.rfind(b"\n") + 1]
        self._file.truncate(len(whole))
        return [_run(line, path, number) for number, line in enumerate(whole.splitlines(), 1)]


def write_archive(path: Path, plan: Path, records: Sequence[Record]) -> None:
    """Write runs and the file of their experiment."""
    lines: list[Record] = [{"file": plan.name, "plan": plan.read_text(encoding="utf-8")}]
    for record in records:
        curves = {key: record["curves"][key] for key in _ARCHIVED_CURVES if key in record["curves"]}
        lines.append({**record, "curves": curves})
    text = "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines)
    path.write_bytes(lzma.compress(text.encode(), preset=9))


def read_archive(path: Path) -> tuple[Experiment, list[Record]]:
    """The experiment as it was, and its runs.

    Raises:
        RunLogError: the file is no archive.
        OSError: it cannot be read.
    """
    try:
        head, *lines = lzma.decompress(path.read_bytes()).splitlines()
        said = json.loads(head)
        document = Document.from_text(said["plan"], path.with_name(said["file"]))
    except (lzma.LZMAError, ValueError, KeyError, TypeError):
        raise RunLogError(f"{path} is no archive of runs; write one with --archive") from None
    records = [_run(line, path, number) for number, line in enumerate(lines, start=2)]
    return experiment_of(document), records


def _run(line: bytes, path: Path, number: int) -> Record:
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


def usable(
    records: list[Record], experiment: Experiment, phase: Phase, folder: Path
) -> dict[Any, Record]:
    """The finished runs of this very experiment, by row's label and seed's number.

    Raises:
        MixedRunsError: there are runs of the other phase; or rows of the same name were run with
            other settings, or with other seeds: what the file's rows differ in, what is paired, or
            where confirmation begins has changed.
    """
    rows = {row.label: row for row in experiment.rows}
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
