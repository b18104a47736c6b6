"""Where the record of a flight goes, as given on the command line."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

import click

from air_router.errors import UsageError
from air_router.record.recorder import RecordViewer
from mocha_link.cli import PATH, Options, Parsed, option, optional, together
from mocha_link.errors import needs_extra


def default_folder() -> Path:
    """Where records go by default: below the user's state, as other programs' logs.

    Raises:
        UsageError: the user has no home.
    """
    state = os.environ.get("XDG_STATE_HOME", "")
    try:
        home = Path(state) if state.startswith("/") else Path.home() / ".local" / "state"
    except RuntimeError:
        raise UsageError("this user has no home folder; set HOME, or say --log-dir D") from None
    return home / "air-router" / "flights"


LOCAL_FOLDER = Path("logs")
"""Where `make sim` records, below the folder that a command is used in."""


record_argument = click.argument(
    "log",
    type=PATH,
    required=False,
    help="flight record, an MCAP file (default: the newest in logs/ and in "
    "~/.local/state/air-router/flights)",
)
"""`LOG`, the record of a flight."""


def record_of(arguments: Options) -> Path:
    """The record that `record_argument`'s argument names.

    Raises:
        UsageError: it is empty, and no flight was recorded where they usually are.
    """
    if arguments.log is not None:
        return Path(arguments.log)
    folders = (LOCAL_FOLDER, default_folder())
    found = (path for folder in folders for path in folder.rglob("*.mcap"))
    records = [path for path in found if path.is_file()]  # no link to a removed one
    if not records:
        raise UsageError(f"neither logs/ nor {default_folder()} has a record of a flight; name one")
    return max(records, key=lambda path: path.stat().st_mtime)


recording_options = together(
    option(
        "--log-dir",
        type=PATH,
        metavar="D",
        help="folder that the flight is recorded in (default: ~/.local/state/air-router/flights)",
    ),
    option("--no-record", is_flag=True, help="do not record the flight", not_with=["log_dir"]),
)
"""`--log-dir` and `--no-record`."""


class ViewerAddress(NamedTuple):
    """Where a viewer of records is served."""

    host: str = "127.0.0.1"
    port: int = 8765  # Foxglove's usual one

    def __str__(self) -> str:
        """As `--foxglove` takes it."""
        return f"{self.host}:{self.port}"

    @classmethod
    def of(cls, text: str) -> ViewerAddress:
        """PORT or HOST:PORT on the command line.

        Raises:
            ValueError: it is none.
        """
        host, _, port = text.rpartition(":")
        if not port.isdecimal() or int(port) > 65535:
            raise ValueError(f"{text} is not [HOST:]PORT; choose a port up to 65535")
        return cls(host or cls().host, int(port))


viewer_option = option(
    "--foxglove",
    type=Parsed(ViewerAddress.of),
    **optional(ViewerAddress()),
    metavar="[[HOST:]PORT]",
    help="serve the flight to Foxglove, which connects to this port (default 8765, on this "
    "machine only)",
)
"""Add `--foxglove`."""


@contextmanager
def viewing(address: ViewerAddress | None, name: str) -> Iterator[RecordViewer | None]:
    """A viewer at an address while in the context; None without one.

    Raises:
        MissingExtraError: the SDK is not installed.
        RefusedError: it cannot be served there.
    """
    if address is None:
        yield None
        return
    with needs_extra("--foxglove", "foxglove", "air-router"):
        from air_router.record.foxglove_sdk import FoxgloveSocket  # noqa: PLC0415 - an extra
    with closing(FoxgloveSocket(*address, name)) as viewer:
        yield viewer


def folder_of(arguments: Options) -> Path | None:
    """Where a flight is recorded, as `recording_options`'s options say; None: nowhere."""
    if arguments.no_record:
        return None
    return default_folder() if arguments.log_dir is None else Path(arguments.log_dir)
