"""Reads records of `air_router.record.recorder`, also if the end is missing.

for entry in Log(Path("flight.mcap")):
    print(entry.t, entry.kind, entry.value)
"""

import base64
import dataclasses
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import MAGIC_SIZE, StreamReader, breakup_chunk
from pydantic_core import from_json

from air_router.controller.model import FlightSetup, Motion
from air_router.errors import AirRouterError, ExitCode
from air_router.record.channels import (
    ABOUT_MOTIONS,
    NOTES,
    ORDER_KEY,
    RECENT,
    TIME_KEY,
    RecordChannel,
)
from air_router.record.record_file import FORMAT, LIBRARY
from air_router.record.serialization import TYPE_KEY, CodecError, decode, read, shown
from mocha_link.links import LinkMetrics

RECORD_BYTES: Final = 256 << 20
"""A longer MCAP record, or a chunk that would unpack to more, counts as damage."""

LATEST_S: Final = 1e9
"""Latest valid time: no vehicle has been up for thirty years."""


class LogError(AirRouterError):
    """A file is no record of a flight, or this version cannot read it."""

    exit_code = ExitCode.INVALID_FILE


class Note(NamedTuple):
    """A note of the flight loop; its fields are plain data."""

    name: str  # kind of note
    fields: dict[str, Any]


class RecordEntry(NamedTuple):
    """One entry of a record.

    Attributes:
        t: Seconds on the vehicle's clock.
        kind: "about" (texts on the whole record), "setup" (`FlightSetup`), "event", "action",
            "note" (`Note`), "link" (`LinkMetrics`), "patch" (bytes of a `GridPatch`) or "file"
            (name and bytes of an attached file).
        value: The content.
    """

    t: float
    kind: str
    value: Any


class RecordMessage(NamedTuple):
    """A raw message of a record."""

    channel: RecordChannel
    time_ns: int  # Unix time on the vehicle's clock
    data: bytes  # in the channel's encoding
    entry: RecordEntry  # its content


class Log:
    """One record. After reading, `ending` describes its end.

    Attributes:
        path: Path of the file.
        ending: The fault at its end; None: complete. Everything before it is valid.
        damaged: The file contains wrong bytes; False if it only ends early, as after a power cut.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ending: str | None = None
        self.damaged = False
        # by their number
        self._motions: deque[tuple[int | None, Motion]] = deque(maxlen=RECENT)

    def __iter__(self) -> Iterator[RecordEntry]:
        """All entries in order.

        Raises:
            LogError: It is no record of a flight, has another version, or cannot be read.
        """
        for part in self._readable():
            yield part.entry if isinstance(part, RecordMessage) else part

    def messages(self) -> Iterator[RecordMessage]:
        """All raw messages with their content, without drawings for viewers.

        Raises:
            LogError: As on iteration.
        """
        for part in self._readable():
            if isinstance(part, RecordMessage):
                yield part

    def _readable(self) -> Iterator[RecordEntry | RecordMessage]:
        """All parts, with every fault of the file as one error."""
        try:
            yield from self._parts()
        except (TypeError, ValueError) as error:
            why = str(error)
        except KeyError as error:
            why = f"a message without {error}"
        else:
            return
        raise LogError(f"{self.path}: not written by this version of air_router: {why}")

    def _parts(self) -> Iterator[RecordEntry | RecordMessage]:
        schemas: dict[int, Schema] = {}  # by their numbers, as channels are
        channels: dict[int, RecordChannel] = {}
        ours, count = False, [0, 0]
        for record in self._records():
            match record:
                case Metadata(name=name) if name == LIBRARY:
                    self._check_format(record.metadata)
                    ours = True
                    yield RecordEntry(0.0, "about", record.metadata)
                case Message() | Attachment() if not ours:
                    break
                case Schema():
                    schemas[record.id] = record
                case Channel():
                    channels[record.id] = _channel(record, schemas)
                case Message():
                    count[0] += 1
                    yield from self._message(record, channels)
                case Attachment():
                    count[1] += 1
                    yield RecordEntry(0.0, "file", (record.name, record.data))
                case Statistics():
                    self._check_count(record, count)
        if not ours:
            raise LogError(f"{self.path}: {self.ending or _FOREIGN}")

    def _message(
        self, record: Message, channels: dict[int, RecordChannel]
    ) -> Iterator[RecordMessage]:
        channel = channels.get(record.channel_id, _NO_CHANNEL)
        if channel.root in _READERS:
            entry = self._entry(channel.root, _object(record.data))
            yield RecordMessage(channel, record.log_time, record.data, entry)

    def _check_count(self, expected: Statistics, count: list[int]) -> None:
        if count != [expected.message_count, expected.attachment_count]:
            self.damaged = True
            self.ending = "it is damaged: something of it cannot be found"

    def _check_format(self, facts: dict[str, str]) -> None:
        found = facts.get("format")
        if found != FORMAT:
            writer = facts.get("air-router", "another")
            raise LogError(
                f"{self.path}: a record of version {found}, and this program reads version "
                f"{FORMAT}; open it with the air-router that wrote it, {writer}"
            )

    def _records(self) -> Iterator[McapRecord]:
        """The file's MCAP records, up to its end or to the damage."""
        try:
            file = self.path.open("rb")
        except OSError as error:
            raise LogError(f"{self.path}: {error.strerror}") from None
        with file:
            reader = StreamReader(file, emit_chunks=True, record_size_limit=RECORD_BYTES).records
            while True:
                try:
                    record = next(reader)
                    inner = _unpacked(record) if isinstance(record, Chunk) else [record]
                except StopIteration:
                    return
                except Exception as error:  # noqa: BLE001 - bytes of any kind
                    if file.tell() <= MAGIC_SIZE:
                        raise LogError(f"{self.path}: not an MCAP file") from None
                    self.ending = self._end(file, error)
                    return
                yield from inner

    def _end(self, file: IO[bytes], error: Exception) -> str:
        self.damaged = True
        if isinstance(error, InvalidMagic):
            return "its last bytes are not those of an MCAP file"
        if isinstance(error, EndOfFile) or not file.read(1):
            self.damaged = False
            return "it was cut off: the program was ended from outside, or the disk failed"
        return f"it is damaged at byte {file.tell()}: {str(error) or type(error).__name__}"

    def _entry(self, kind: str, data: dict[str, Any]) -> RecordEntry:
        t, order = _time_s(data.pop(TIME_KEY)), data.pop(ORDER_KEY, None)
        entry = _READERS[kind](t, data)
        if isinstance(entry.value, Motion):
            self._motions.append((order, entry.value))
        elif isinstance(entry.value, ABOUT_MOTIONS):
            motion = self._motion(order, entry.value.action)
            return entry._replace(value=dataclasses.replace(entry.value, action=motion))
        return entry

    def _motion(self, order: int | None, like: Motion) -> Motion:
        """The same motion object: several motions may be equal."""
        for known, motion in reversed(self._motions):
            if motion == like and order in {None, known}:
                return motion
        return like


def _unpacked(chunk: Chunk) -> list[McapRecord]:
    if chunk.uncompressed_size > RECORD_BYTES:
        raise LogError(f"a chunk of {chunk.uncompressed_size} bytes")
    return breakup_chunk(chunk, validate_crc=True)


def _channel(record: Channel, schemas: dict[int, Schema]) -> RecordChannel:
    schema = schemas.get(record.schema_id, _NO_SCHEMA)
    return RecordChannel(record.topic, schema.name, schema.data, record.message_encoding)


def _object(data: bytes) -> dict[str, Any]:
    plain = from_json(data, allow_inf_nan=False)
    if not isinstance(plain, dict):
        raise CodecError(f"{shown(plain)} is not an object")
    return plain


def _time_s(plain: Any) -> float:
    if type(plain) not in {int, float} or not abs(plain) <= LATEST_S:
        raise CodecError(f"{shown(plain)} is not a time of the vehicle's clock")
    return float(plain)


def _note(t: float, data: dict[str, Any]) -> RecordEntry:
    name = str(data.pop(TYPE_KEY))
    if name == "Setup":
        return RecordEntry(t, "setup", _only(FlightSetup, data["setup"]))
    for field, of in NOTES.get(name, {}).items():
        data[field] = read(of, data[field])
    return RecordEntry(t, "note", Note(name, data))


def _only(kind: type, plain: Any) -> Any:
    """A value of a channel for one class. Raises CodecError if it is of another class."""
    value = decode(plain)
    if not isinstance(value, kind):
        raise CodecError(f"{shown(plain)} is no {kind.__name__}")
    return value


_NO_SCHEMA: Final = Schema(id=0, name="", encoding="", data=b"")
_NO_CHANNEL: Final = RecordChannel("", "", b"")
_FOREIGN: Final = "an MCAP file, but not a flight's record"
_READERS: Final[dict[str, Callable[[float, dict[str, Any]], RecordEntry]]] = {
    "event": lambda t, data: RecordEntry(t, "event", decode(data)),
    "action": lambda t, data: RecordEntry(t, "action", decode(data)),
    "flight": _note,
    "links": lambda t, data: RecordEntry(t, "link", _only(LinkMetrics, data)),
    "patches": lambda t, data: RecordEntry(t, "patch", base64.b64decode(data["patch"])),
}
"""By the first part of a topic; drawings for viewers are redundant."""
