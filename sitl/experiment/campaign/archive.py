"""The finished runs of an experiment in one small file: all that its tables are made of.

XZ-compressed lines of JSON: the text of the experiment's file as it was, then a run each, without
the curves that only figures need. So a table can be remade when rows, towns or claims are others.
"""

from __future__ import annotations

import hashlib
import json
import lzma
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from mocha_link.team.document import Document
from sitl.experiment.campaign.plan import Experiment, Record
from sitl.experiment.campaign.plan_file import experiment_of
from sitl.experiment.campaign.run_log import RunLogError, read_line

ENDING: Final = ".jsonl.xz"
_KEPT_CURVES: Final = ("links",)


def write_archive(path: Path, plan: Path, records: Sequence[Record]) -> None:
    """Write runs and the file of their experiment."""
    lines: list[Record] = [{"file": plan.name, "plan": plan.read_text(encoding="utf-8")}]
    for record in records:
        curves = {key: record["curves"][key] for key in _KEPT_CURVES if key in record["curves"]}
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
    records = [read_line(line, path, number) for number, line in enumerate(lines, start=2)]
    return experiment_of(document), records


def checksum(path: Path) -> str:
    """SHA-256 of a file, in hex."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
