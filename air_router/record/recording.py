"""Command-line options for the place of a flight's record."""

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
    """The default folder of records: in the user's state folder, like other programs' logs.

    Raises:
        UsageError: The user has no home folder.
    """
    state = os.environ.get("XDG_STATE_HOME", "")
    try:
        home = Path(state) if state.startswith("/") else Path.home() / ".local" / "state"
    except RuntimeError:
        raise UsageError("this user has no home folder; set HOME, or pass --log-dir D") from None
    return home / "air-router" / "flights"


LOCAL_FOLDER = Path("logs")
"""The folder of `make sim`'s records, below the current folder."""


record_argument = click.argument(
    "log",
    type=PATH,
    required=False,
    help="flight record, an MCAP file (default: the newest in logs/ and in "
    "~/.local/state/air-router/flights)",
)
"""The argument `LOG`: the record of a flight."""


def record_of(arguments: Options) -> Path:
    """The record given by `record_argument`.

    Raises:
        UsageError: No record is given, and the default folders have none.
    """
    if arguments.log is not None:
        return Path(arguments.log)
    folders = (LOCAL_FOLDER, default_folder())
    found = (path for folder in folders for path in folder.rglob("*.mcap"))
    records = [path for path in found if path.is_file()]  # no dangling link
    if not records:
        raise UsageError(f"neither logs/ nor {default_folder()} has a record of a flight; name one")
    return max(records, key=lambda path: path.stat().st_mtime)


recording_options = together(
    option(
        "--log-dir",
        type=PATH,
        metavar="D",
        help="folder for the record of the flight (default: ~/.local/state/air-router/flights)",
    ),
    option("--no-record", is_flag=True, help="do not record the flight", not_with=["log_dir"]),
)
"""`--log-dir` and `--no-record`."""


class ViewerAddress(NamedTuple):
    """The address on which records are served to a viewer."""

    host: str = "127.0.0.1"
    port: int = 8765  # Foxglove's usual one

    def __str__(self) -> str:
        """The address in the format of `--foxglove`."""
        return f"{self.host}:{self.port}"

    @classmethod
    def of(cls, text: str) -> ViewerAddress:
        """Parse PORT or HOST:PORT.

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
    help="serve the flight to Foxglove at this port (default 8765, on this machine only)",
)
"""Add `--foxglove`."""


@contextmanager
def viewing(address: ViewerAddress | None, name: str) -> Iterator[RecordViewer | None]:
    """Serve a viewer at an address while in the context; yields None without an address.

    Raises:
        MissingExtraError: The SDK is not installed.
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
    """The folder given by `recording_options`; None: no record."""
    if arguments.no_record:
        return None
    return default_folder() if arguments.log_dir is None else Path(arguments.log_dir)
