"""Where the record of a flight goes, as the command line says."""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

from air_router.errors import UsageError


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """Where a flight is recorded.

    Attributes:
        folder: Where its file goes; None: nowhere.
        stem: How the file's name begins.
        must: The operator has named the folder: the flight does not start if it cannot be used.
    """

    folder: Path | None = None
    stem: str = "flight"
    must: bool = False


def default_folder() -> Path:
    """Where records go by default: below the user's state, as other programs' logs."""
    state = os.environ.get("XDG_STATE_HOME", "")
    home = Path(state) if state.startswith("/") else Path.home() / ".local" / "state"
    return home / "air-router" / "flights"


LOCAL_FOLDER = Path("logs")
"""Where `make sim` records, below the folder that a command is used in."""


def add_record(parser: argparse.ArgumentParser) -> None:
    """Add `LOG`, the record of a flight."""
    parser.add_argument(
        "log",
        type=Path,
        nargs="?",
        metavar="LOG",
        help="the record, an MCAP file (default: the newest in logs/ and in "
        "~/.local/state/air-router/flights)",
    )


def record_of(arguments: argparse.Namespace) -> Path:
    """What `add_record`'s argument says.

    Raises:
        UsageError: it says nothing, and no flight was recorded where they usually are.
    """
    if arguments.log is not None:
        return Path(arguments.log)
    folders = (LOCAL_FOLDER, default_folder())
    records = [path for folder in folders for path in folder.rglob("*.mcap")]
    if not records:
        raise UsageError(f"neither logs/ nor {default_folder()} has a record of a flight; name one")
    return max(records, key=lambda path: path.stat().st_mtime)


def add_recording(parser: argparse.ArgumentParser) -> None:
    """Add `--log-dir` and `--no-record`."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--log-dir",
        type=Path,
        metavar="D",
        help="record the flight there (default: ~/.local/state/air-router/flights)",
    )
    where.add_argument("--no-record", action="store_true", help="do not record the flight")


def recording_of(arguments: argparse.Namespace, stem: str = "flight") -> RecordingOptions:
    """What `add_recording`'s options say."""
    if arguments.no_record:
        return RecordingOptions(None, stem)
    if arguments.log_dir is not None:
        return RecordingOptions(arguments.log_dir, stem, must=True)
    return RecordingOptions(default_folder(), stem)
