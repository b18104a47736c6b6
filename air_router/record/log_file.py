"""One MCAP file that is written beside a flight: whole up to the last second, whatever happens.

A thread of its own writes, so that a slow disk never holds up a decision. Each second the chunk
that is being filled is closed, handed to the system and pushed to the disk: `kill -9` and a power
cut lose the last second and no more. While the disk is full the file ends where it was whole, and
what happens waits in memory.
"""

import contextlib
import logging
import os
import queue
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from mcap.writer import Writer

from air_router.files.whole_file import sync_folder

_log = logging.getLogger(__name__)

FLUSH_S: Final = 1.0
"""Wall time after which what was recorded is on the disk."""

MOST_BYTES: Final = 2 << 30
"""A file grows to this size and no further."""

MOST_WAITING: Final = 64 << 20
"""Bytes that wait for a disk that stands still or is full; then the file is given up."""

CLOSE_S: Final = 10.0

LIBRARY: Final = "air_router"

ORDER_KEY: Final = "of"
"""Which motion a motion is, or a confirmation of one: there may be several alike."""

RECENT: Final = 64
"""A motion is confirmed, or fails, before so many others have been decided."""

FORMAT: Final = "1"
"""Of the record; it changes when older programs cannot read it any more."""


class RecordChannel(NamedTuple):
    """A channel of messages in JSON: its topic, and the name and text of their JSON schema."""

    topic: str
    schema_name: str
    schema: str  # JSON schema


class _Message(NamedTuple):
    channel: RecordChannel
    time_ns: int
    data: bytes  # JSON


class _File(NamedTuple):
    name: str
    media_type: str
    time_ns: int
    data: bytes


class _FullError(OSError):
    """The file has grown to its limit."""


class _Sink:
    """Where the MCAP writer writes to: into memory, and what is whole from there to the disk.

    What a disk refuses waits in memory, and the file ends where it was whole; so a disk on which
    there is room again gets everything that happened meanwhile.
    """

    def __init__(self, path: Path, most_bytes: int) -> None:
        self._file = path.open("xb", buffering=0)  # written without a buffer of Python's
        self._most_bytes = most_bytes
        self._position = 0  # bytes the writer has written
        self._whole = 0  # up to here chunks are complete
        self._on_disk = 0  # bytes written and synced
        self._waiting = bytearray()  # from `_on_disk` on

    @property
    def waiting(self) -> int:
        """Bytes that are not on the disk yet."""
        return len(self._waiting)

    def write(self, data: bytes) -> int:
        if self._position + len(data) > self._most_bytes:
            raise _FullError(f"it has reached its limit of {self._most_bytes / 1e6:.0f} MB")
        self._waiting += data
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """All that was written is whole."""
        self._whole = self._position

    def sync(self) -> None:
        """Put what is whole on the disk. Raises OSError: it does not take it now."""
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


class LogFile:
    """Takes messages from one thread and puts them into a file.

    Args:
        path: The new file.
        trouble: Told, on the thread that writes, when the disk takes nothing, when it does again,
            and when the file is given up.
        metadata: What is known of the whole file, as texts.
        most_bytes: How large it may grow.

    Raises:
        OSError: the file cannot be made.
    """

    def __init__(
        self,
        path: Path,
        trouble: Callable[[str], None],
        metadata: Mapping[str, str],
        most_bytes: int = MOST_BYTES,
    ) -> None:
        self.path = path
        self._trouble = trouble
        self._sink = _Sink(path, most_bytes)
        self._writer = Writer(self._sink)  # type: ignore[arg-type]
        self._channels: dict[str, int] = {}  # MCAP ids, by topic
        self._numbers: dict[int, int] = {}  # messages so far, by channel id
        self._schemas: dict[str, int] = {}  # MCAP ids, by name
        # None: the end
        self._queue: queue.SimpleQueue[_Message | _File | None] = queue.SimpleQueue()
        self._given = self._taken = 0  # bytes: each is counted on one thread only
        self._failed = False  # the disk does not take it
        self._refused = False  # something did not fit
        self._thread = threading.Thread(
            target=self._run, args=(dict(metadata),), name="flight record", daemon=True
        )
        self._thread.start()

    @property
    def failed(self) -> bool:
        """Whether the file is not written any more."""
        return self._failed

    def add(self, channel: RecordChannel, time_ns: int, data: bytes) -> None:
        """Write a message; times are Unix nanoseconds of the vehicle's clock."""
        self._put(_Message(channel, time_ns, data))

    def attach(self, name: str, media_type: str, time_ns: int, data: bytes) -> None:
        """Put a whole file into the file."""
        self._put(_File(name, media_type, time_ns, data))

    def close(self) -> None:
        """End the file; waits for the disk, but not for ever."""
        self._queue.put(None)
        self._thread.join(CLOSE_S)
        if self._thread.is_alive():
            _log.error("%s: the disk does not answer; the record is not whole", self.path)

    def _put(self, item: _Message | _File) -> None:
        if self._failed:
            return
        if self._given - self._taken > MOST_WAITING:
            self._fail("the disk is too slow")
            return
        self._given += len(item.data)
        self._queue.put(item)

    # On the thread.

    def _run(self, metadata: dict[str, str]) -> None:
        try:
            self._write(lambda: self._begin(metadata))
            self._serve()
            self._write(self._end)
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
                self._write(self._flush)
                continue
            if item is None:
                return
            self._taken += len(item.data)
            if due_s is None:
                due_s = time.monotonic() + FLUSH_S
            elif time.monotonic() >= due_s:  # it never gets empty when much happens
                due_s = time.monotonic() + FLUSH_S
                self._write(self._flush)
            self._write(lambda item=item: self._enter(item))  # type: ignore[misc]

    def _write(self, work: Callable[[], None]) -> None:
        if self._failed:
            return
        try:
            work()
        except Exception as error:  # noqa: BLE001 - no fault of a record may end a flight
            self._fail(_reason(error))
            self._sync()  # what is whole

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

    def _begin(self, metadata: dict[str, str]) -> None:
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata(LIBRARY, metadata)
        self._flush()
        sync_folder(self.path.parent)  # so that a power cut does not take its name

    def _end(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._sink.flush()
        self._sync()
        if self._refused:
            self._fail("the disk takes nothing")

    def _flush(self) -> None:
        self._close_chunk()
        self._sync()

    def _close_chunk(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]

    def _enter(self, item: _Message | _File) -> None:
        if isinstance(item, _File):
            self._close_chunk()  # in the order in which things happened
            self._writer.add_attachment(
                item.time_ns, item.time_ns, item.name, item.media_type, item.data
            )
            return
        number = self._channel(item.channel)
        self._numbers[number] += 1
        self._writer.add_message(
            number, item.time_ns, item.data, item.time_ns, self._numbers[number] & 0xFFFFFFFF
        )

    def _channel(self, channel: RecordChannel) -> int:
        known = self._channels.get(channel.topic)
        if known is not None:
            return known
        schema = self._schemas.get(channel.schema_name)
        if schema is None:
            schema = self._writer.register_schema(
                channel.schema_name, "jsonschema", channel.schema.encode()
            )
            self._schemas[channel.schema_name] = schema
        number = self._writer.register_channel(channel.topic, "json", schema)
        self._channels[channel.topic] = number
        self._numbers[number] = 0
        return number


def _reason(error: Exception) -> str:
    reason = error.strerror if isinstance(error, OSError) else None
    return reason or str(error) or type(error).__name__
