"""Writes one MCAP file during a flight, complete up to the last second whatever happens.

A separate thread writes, so a slow disk never delays a decision. Each second the current chunk is
closed, written and synced to disk: `kill -9` or a power cut loses at most the last second. While
the disk is full, the file ends at its last complete chunk, and new data wait in memory.
"""

import contextlib
import logging
import os
import platform
import queue
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Final

from mcap.writer import Writer

from air_router.errors import RefusedError
from air_router.files import sync_folder
from air_router.record.channels import RecordChannel
from air_router.record.serialization import SCHEMA_VERSION
from mocha_link.errors import error_text
from mocha_link.path_safety import made_folder

_log = logging.getLogger(__name__)

FLUSH_S: Final = 1.0
"""Wall time after which recorded data are on disk."""

MOST_BYTES: Final = 2 << 30
"""Maximum file size."""

MOST_WAITING: Final = 64 << 20
"""Maximum of data that wait for a slow or full disk; beyond it the file is given up."""

CLOSE_S: Final = 10.0

LIBRARY: Final = "air_router"

FORMAT: Final = str(SCHEMA_VERSION)

_VERSIONS_OF: Final = ("air-router", "mavsdk", "networkx", "numpy", "pyproj", "pyzmq", "shapely")


def open_record(
    folder: Path, names: tuple[str, str], mission: str, trouble: Callable[[str], None]
) -> "RecordFile":
    """Create a file in a folder; the folder is created if needed.

    Args:
        folder: The folder.
        names: Beginning and end (the UAV's name) of the file name.
        mission: The mission's path, as given by the operator.
        trouble: Called when nothing more can be recorded.

    Raises:
        OSError: The file cannot be created.
    """
    made_folder(folder)
    facts = {
        "format": FORMAT,
        "mission": mission,
        "unix_s": repr(time.time()),
        "python": platform.python_version(),
        "system": platform.platform(),
        **{name: _version(name) for name in _VERSIONS_OF},
    }
    uav = "".join(c if c.isalnum() else "_" for c in names[1])[:40]
    parts = [names[0], time.strftime("%Y%m%dT%H%M%SZ", time.gmtime()), uav]
    stem = "-".join(part for part in parts if part)
    number = 1
    while True:
        name = f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap"
        try:
            return RecordFile(folder / name, trouble, facts)
        except FileExistsError:
            number += 1


def no_folder(error: OSError) -> RefusedError:
    """The error for a folder given by the operator in which nothing can be recorded."""
    advice = "name a folder that can be written to, --log-dir D, or pass --no-record"
    return RefusedError(f"{error_text(error)}; {advice}")


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


class _Sink:
    """The output of the MCAP writer: a memory buffer, from which complete chunks go to disk.

    Data that the disk refuses wait in memory, and the file ends at a complete chunk. Once the disk
    has space again, everything is written.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)  # unbuffered
        self._position = 0  # bytes written by the writer
        self._whole = 0  # end of the last complete chunk
        self._on_disk = 0  # bytes written and synced
        self._waiting = bytearray()  # data after `_on_disk`

    @property
    def waiting(self) -> int:
        """Bytes not on disk yet."""
        return len(self._waiting)

    def write(self, data: bytes) -> int:
        if self._position + len(data) > MOST_BYTES:
            raise OSError(f"it has reached its limit of {MOST_BYTES / 1e6:.0f} MB")
        self._waiting += data
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """Mark everything written as complete."""
        self._whole = self._position

    def sync(self) -> None:
        """Write the complete chunks. Raises OSError if the disk refuses them."""
        data = bytes(self._waiting[: self._whole - self._on_disk])
        try:
            self._append(data)
            os.fdatasync(self._file.fileno())
        except OSError:
            with contextlib.suppress(OSError):
                self._file.truncate(self._on_disk)
            self._file.seek(self._on_disk)
            raise
        del self._waiting[: len(data)]
        self._on_disk += len(data)

    def close(self) -> None:
        self._file.close()

    def _append(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) or 0 :]


class RecordFile:
    """Accepts messages on one thread and writes them to a file on another.

    Args:
        path: The new file.
        trouble: Called on the writing thread when the disk refuses data, when it accepts them
            again, and when the file is given up.
        facts: Facts about the whole file, as texts.

    Raises:
        OSError: The file cannot be created.
    """

    def __init__(
        self, path: Path, trouble: Callable[[str], None], facts: Mapping[str, str]
    ) -> None:
        self.path = path
        self._trouble = trouble
        self._sink = _Sink(path)
        self._writer = Writer(self._sink)  # type: ignore[arg-type]
        self._channels: dict[str, int] = {}  # MCAP ids, by topic
        self._schemas: dict[str, int] = {}  # MCAP ids, by name
        # write functions with their bytes; None: the end
        self._queue: queue.SimpleQueue[tuple[Callable[[], None], int] | None] = queue.SimpleQueue()
        self._given = self._taken = 0  # bytes, each counted on one thread
        self._failed = False  # given up
        self._refused = False  # the disk refused data
        self._thread = threading.Thread(
            target=self._run, args=(dict(facts),), name="flight record", daemon=True
        )
        self._thread.start()

    def add(self, channel: RecordChannel, time_ns: int, data: bytes) -> None:
        """Write a message; times are Unix nanoseconds of the vehicle's clock."""
        self._put(partial(self._write_message, channel, time_ns, data), len(data))

    def attach(self, name: str, media_type: str, time_ns: int, data: bytes) -> None:
        """Attach a file."""
        self._put(partial(self._write_attachment, name, media_type, time_ns, data), len(data))

    def close(self) -> None:
        """End the file; waits for the disk for a limited time."""
        self._queue.put(None)
        self._thread.join(CLOSE_S)
        if self._thread.is_alive():
            _log.error("%s: the disk does not answer; the record is not whole", self.path)

    def _put(self, write: Callable[[], None], size: int) -> None:
        if self._failed:
            return
        if self._given - self._taken > MOST_WAITING:
            self._fail("the disk is too slow")
            return
        self._given += size
        self._queue.put((write, size))

    # On the thread.

    def _run(self, facts: dict[str, str]) -> None:
        try:
            self._unless_failed(partial(self._begin, facts))
            self._serve()
            self._unless_failed(self._end)
        finally:
            self._sink.close()

    def _serve(self) -> None:
        """Write until the end; data are on disk after a second."""
        due_s: float | None = None
        while True:
            try:
                left_s = None if due_s is None else max(0.0, due_s - time.monotonic())
                item = self._queue.get(timeout=left_s)
            except queue.Empty:
                due_s = None
                self._unless_failed(self._flush)
                continue
            if item is None:
                return
            write, size = item
            self._taken += size
            if due_s is None:
                due_s = time.monotonic() + FLUSH_S
            elif time.monotonic() >= due_s:  # the queue may never be empty
                due_s = time.monotonic() + FLUSH_S
                self._unless_failed(self._flush)
            self._unless_failed(write)

    def _unless_failed(self, work: Callable[[], None]) -> None:
        if self._failed:
            return
        try:
            work()
        except Exception as error:  # noqa: BLE001 - no fault of a record may end a flight
            self._fail(_reason(error))
            self._sync()  # the complete chunks

    def _sync(self) -> None:
        """Write to disk; refused data are kept, up to a limit, for the next attempt."""
        try:
            self._sink.sync()
        except OSError as error:
            if self._sink.waiting > MOST_WAITING:
                self._fail(_reason(error))
            elif not self._refused:
                self._refused = True
                advice = "the record waits in memory: make room on the disk"
                self._trouble(f"{self.path}: {_reason(error)}; {advice}")
            return
        if self._refused and not self._failed:
            self._refused = False
            self._trouble(f"{self.path}: the disk takes it again; nothing of the record is lost")

    def _fail(self, reason: str) -> None:
        if not self._failed:
            self._failed = True
            self._trouble(f"{self.path}: {reason}; nothing more is recorded, the flight goes on")

    def _begin(self, facts: dict[str, str]) -> None:
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata(LIBRARY, facts)
        self._flush()
        sync_folder(self.path.parent)  # so a power cut does not lose its name

    def _end(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._sink.flush()
        self._sync()
        if self._refused:
            self._fail("the disk takes nothing")

    def _flush(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._sync()

    def _write_attachment(self, name: str, media_type: str, time_ns: int, data: bytes) -> None:
        self._flush()  # keeps the order
        self._writer.add_attachment(time_ns, time_ns, name, media_type, data)

    def _write_message(self, channel: RecordChannel, time_ns: int, data: bytes) -> None:
        self._writer.add_message(self._channel(channel), time_ns, data, time_ns)

    def _channel(self, channel: RecordChannel) -> int:
        topic, name = channel.topic, channel.schema_name
        if topic not in self._channels:
            if name not in self._schemas:
                self._schemas[name] = self._writer.register_schema(
                    name, channel.schema_encoding, channel.schema
                )
            self._channels[topic] = self._writer.register_channel(
                topic, channel.encoding, self._schemas[name]
            )
        return self._channels[topic]


def _reason(error: Exception) -> str:
    reason = error.strerror if isinstance(error, OSError) else None
    return reason or str(error) or type(error).__name__
