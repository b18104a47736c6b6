"""The finished runs of an experiment: the log that is written as they are made, and its archive.

The log is one JSON object per line, written whole and synced to disk before the next run counts. A
line that was cut by a power loss is the last one; it is taken off, and that run is made again.

The archive is one small file, all that tables are made of: XZ-compressed lines of JSON, first the
text of the experiment's file as it was, then a run each, without the curves that only figures need.
So a table can be remade when rows, towns or claims are others.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import lzma
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from air_router.errors import AirRouterError, ExitCode
from air_router.files import write_whole
from mocha_link.path_safety import check_links, made_folder
from mocha_link.team import Document
from sitl.experiment import Experiment, Record, experiment_of

FILE_NAME: Final = "runs.jsonl"
ARCHIVE_ENDING: Final = ".jsonl.xz"
_KEYS: Final = frozenset(
    {"experiment", "row", "number", "phase", "rules", "seed", "fingerprint", "measures"}
)


class RunLogError(AirRouterError):
    """The file of finished runs cannot be used."""


class InUseError(AirRouterError):
    """Another program is running the experiment in the same folder."""

    exit_code = ExitCode.REFUSED


@dataclass(slots=True)
class RunLog:
    """The finished runs in a folder.

    Attributes:
        records: The runs that were there when it was opened.
    """

    records: list[Record]
    _file: BinaryIO

    def clear(self) -> None:
        """Forget what is in the file."""
        self._file.truncate(0)

    def add(self, record: Record) -> None:
        """Keep a run."""
        line = json.dumps(record, separators=(",", ":"), allow_nan=False) + "\n"
        self._file.write(line.encode())
        self._file.flush()
        os.fsync(self._file.fileno())


@contextlib.contextmanager
def run_log(folder: Path, *, fresh: bool = False) -> Iterator[RunLog]:
    """The log in a folder, locked: one program at a time may add to it.

    With `fresh` it does not look at what is there, and `RunLog.clear` forgets it.

    Raises:
        RunLogError: the file has lines that no run wrote.
        InUseError: another program has it open.
    """
    made_folder(folder)
    path = folder / FILE_NAME
    check_links(path)
    with path.open("ab+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InUseError(
                f"{folder} is in use by another `sitl experiment`; wait, or give another --out"
            ) from None
        file.seek(0)
        content = b"" if fresh else file.read()
        whole = content[: content.rfind(b"\n") + 1]
        if not fresh:
            file.truncate(len(whole))
        yield RunLog([_run(line, path, n) for n, line in enumerate(whole.splitlines(), 1)], file)


def write_archive(path: Path, plan: Path, records: Sequence[Record]) -> None:
    """Write runs and the file of their experiment; an earlier archive stays until then."""
    lines: list[Record] = [{"file": plan.name, "plan": plan.read_text(encoding="utf-8")}]
    lines += [{**record, "curves": {}} for record in records]
    text = "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines)
    write_whole(path, lzma.compress(text.encode(), preset=9), replace=True)


def read_archive(path: Path) -> tuple[Experiment, list[Record]]:
    """The experiment as it was, and its runs.

    Raises:
        RunLogError: the file is no archive.
        OSError: it cannot be read.
    """
    try:
        head, *lines = lzma.decompress(path.read_bytes()).splitlines()
        header = json.loads(head)
        document = Document.from_text(header["plan"], path.with_name(header["file"]))
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
