"""One MCAP file that is written beside a flight: whole up to the last second, whatever happens.

A thread of its own writes, so that a slow disk never holds up a decision. Each second the chunk
that is being filled is closed, handed to the system and pushed to the disk: `kill -9` and a power
cut lose the last second and no more. While the disk is full the file ends where it was whole, and
what happens waits in memory.
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
"""Wall time after which what was recorded is on the disk."""

MOST_BYTES: Final = 2 << 30
"""A file grows to this size and no further."""

MOST_WAITING: Final = 64 << 20
"""Bytes that wait for a disk that stands still or is full; then the file is given up."""

CLOSE_S: Final = 10.0

LIBRARY: Final = "air_router"

FORMAT: Final = str(SCHEMA_VERSION)

_VERSIONS_OF: Final = ("air-router", "mavsdk", "networkx", "numpy", "pyproj", "pyzmq", "shapely")


def open_record(
    folder: Path, names: tuple[str, str], mission: str, trouble: Callable[[str], None]
) -> "RecordFile":
    """A new file in a folder, which is made when it is not there.

    Args:
        folder: Where the file goes.
        names: How its name begins, and ends: the UAV's.
        mission: The path of the mission, as the operator wrote it.
        trouble: Called when nothing more can be recorded.

    Raises:
        OSError: it cannot be made.
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
    """Why nothing can be recorded in the folder that the operator named, and what to do."""
    advice = "name a folder that can be written to, --log-dir D, or say --no-record"
    return RefusedError(f"{error_text(error)}; {advice}")


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


class _Sink:
    """Where the MCAP writer writes to: into memory, and whole chunks from there to the disk.

    What a disk refuses waits in memory, and the file ends where it was whole; so a disk on which
    there is room again gets everything that happened meanwhile.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)  # written without a buffer of Python's
        self._position = 0  # bytes the writer has written
        self._whole = 0  # up to here chunks are complete
        self._on_disk = 0  # bytes written and synced
        self._waiting = bytearray()  # from `_on_disk` on

    @property
    def waiting(self) -> int:
        """Bytes that are not on the disk yet."""
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
        """All that was written is whole."""
        self._whole = self._position

    def sync(self) -> None:
        """Write the whole chunks. Raises OSError: the disk does not take them now."""
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
    """Takes messages from one thread and puts them into a file on another.

    Args:
        path: The new file.
        trouble: Called, on the writing thread, when the disk takes nothing, when it does again,
            and when the file is given up.
        facts: Facts about the whole file, as texts.

    Raises:
        OSError: the file cannot be made.
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
        # what to write, and its bytes; None: the end
        self._queue: queue.SimpleQueue[tuple[Callable[[], None], int] | None] = queue.SimpleQueue()
        self._given = self._taken = 0  # bytes: each is counted on one thread only
        self._failed = False  # the disk does not take it: it is not written any more
        self._refused = False  # something did not fit
        self._thread = threading.Thread(
            target=self._run, args=(dict(facts),), name="flight record", daemon=True
        )
        self._thread.start()

    def add(self, channel: RecordChannel, time_ns: int, data: bytes) -> None:
        """Write a message; times are Unix nanoseconds of the vehicle's clock."""
        self._put(partial(self._write_message, channel, time_ns, data), len(data))

    def attach(self, name: str, media_type: str, time_ns: int, data: bytes) -> None:
        """Put a whole file into the file."""
        self._put(partial(self._write_attachment, name, media_type, time_ns, data), len(data))

    def close(self) -> None:
        """End the file; waits for the disk, but not for ever."""
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
        """Write until the end; what waits is on the disk after a second."""
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
            elif time.monotonic() >= due_s:  # it never gets empty when much happens
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
            self._sync()  # the whole chunks

    def _sync(self) -> None:
        """Put it on the disk; what that does not take is kept, up to a limit, for the next time."""
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
        sync_folder(self.path.parent)  # so that a power cut does not take its name

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
        self._flush()  # in the order in which things happened
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
