"""Records a flight: every event, every action, and their context.

One MCAP file per flight (docs/records.md). It suffices to create the same controller again and to
give it the same events at the same times, as `air_router.record.replay` does.
"""

import base64
import dataclasses
import logging
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Final, Protocol

from air_router.controller import FlightStatus
from air_router.controller.model import FlightSetup, Motion
from air_router.gossip import Mapper
from air_router.record.channels import (
    ABOUT_MOTIONS,
    PATCHES,
    RECENT,
    TIME_KEY,
    RecordChannel,
    channel_of,
    link_channel,
    message_of,
    note_channel,
    status_channel,
    status_message_of,
)
from air_router.record.record_file import RecordFile, no_folder, open_record
from air_router.record.serialization import TYPE_KEY, json_of, plain_of
from air_router.vehicle import REBOOT_S
from mocha_link.errors import Guard
from mocha_link.lifetime import Closeable
from mocha_link.links import LinkMetrics

_log = logging.getLogger(__name__)

_LATEST_UNIX_S: Final = 1.8e10  # in the year 2540

CLOCK, STATUS, LINKS, MAP, GRID = "clock", "status", "links", "map", "grid"
EVERY_S: Final = {CLOCK: 10.0, STATUS: 1.0, LINKS: 1.0, MAP: 1.0, GRID: 30.0}
"""Seconds between two records of the vehicle's Unix time beside its own clock, of the flight's
status, of the links' metrics, of the size of the map, and of the whole map while it grows."""

PATCH_BYTES: Final = 200_000_000
"""Maximum of the map's patches before compression; later patches are only in the whole map."""

FILE_BYTES: Final = 20_000_000
"""A larger file of the mission is not attached to the record."""


class RecordViewer(Protocol):
    """Shows a record live; its faults do not affect the flight.

    Attributes:
        address: The address to open in the viewer.
    """

    address: str

    def send(self, channel: RecordChannel, time_ns: int, data: bytes) -> None:
        """Show a message; times are Unix nanoseconds."""


class Recorder(Closeable):
    """Writes one flight's record. Without a folder nothing is written.

    Times are seconds on the vehicle's clock. A fault of the record is no error of the flight:
    `trouble` is called once, perhaps on another thread.

    Args:
        folder: The folder of the file; created if needed.
        mission: The mission's path, as given by the operator.
        unix_s: The vehicle's Unix time.
        trouble: Called when nothing more can be recorded; see `report_to`.
        stem: Beginning of the file name; `name`: the UAV's name at its end.
        must: A folder that is not writable is an error.
        viewer: Shows the flight live, also if nothing is written.

    Attributes:
        folder: The folder of records, also if this one cannot be written; None: nothing is
            recorded.
        path: The record's path; None: there is none.

    Raises:
        OSError: `must` is set and the file cannot be created.
    """

    PREFLIGHT: ClassVar = "Preflight"
    """The first note of a flight; a flight without it leaves no record."""

    def __init__(  # noqa: PLR0913 - each has its default
        self,
        folder: Path | None,
        mission: str,
        *,
        unix_s: Callable[[], float] = time.time,
        trouble: Callable[[str], object] = _log.error,
        stem: str = "flight",
        name: str = "",
        must: bool = True,
        viewer: RecordViewer | None = None,
    ) -> None:
        self._trouble, self.folder = trouble, folder
        self._unix_s, self._viewer = unix_s, viewer
        self._epoch_s: float | None = None  # Unix time of the vehicle's clock at 0
        self._last_ns = 0  # time of the newest message; never decreases
        self._event_s = -math.inf  # newest event, vehicle's clock
        self._done_s: dict[str, float] = {}  # last time of each of `EVERY_S`, vehicle's clock
        self._maps = self._grid_cells = self._motions = 0  # versions, cells and motions recorded
        self._recent: deque[tuple[object, int]] = deque(maxlen=RECENT)  # motions and their numbers
        self._links: dict[str, LinkMetrics] = {}  # last recorded, by peer
        self._held: dict[str, dict[tuple[str, str], float]] = {}  # newest stamps, by peer
        self._patch_bytes = 0  # received; recorded up to a limit
        self._unwritable: set[str] = set()  # unrecordable types already logged
        self._flown = False  # else the file is removed
        self._drawing: Any = None  # a `FlightDrawing` since `begin`, if the SDK is installed
        self._harmless = Guard("something of the flight is not drawn")
        self._file: RecordFile | None = None  # None: nothing is written
        if folder is not None:
            try:
                self._file = open_record(folder, (stem, name), mission, self._on_trouble)
            except OSError as error:
                if must:
                    raise no_folder(error) from None
                trouble(f"{folder}: {error.strerror}; the flight is not recorded")
        self.path = None if self._file is None else self._file.path

    def report_to(self, trouble: Callable[[str], object]) -> None:
        """Set the callback for a record that cannot continue; it may run on another thread."""
        self._trouble = trouble

    # Recording.

    def begin(self, setup: FlightSetup, **facts: object) -> None:
        """Record the setup of the controller and facts about the flight."""
        if self._idle:
            return
        status_channel()
        link_channel()  # makes all schemas: on the ground, and not at the first event of a kind
        self.note("Setup", 0.0, {"setup": self._encoded(plain_of, setup)})
        self.note("Options", 0.0, facts)
        unix_s = self._unix_s()
        with self._harmless:
            self._drawing = _drawing_of(setup)
        if self._drawing is not None:
            self._draw(self._drawing.begin, unix_s)

    def event(self, event: object, now_s: float) -> None:
        """Record an event."""
        if self._idle:
            return
        self._flown = True
        if now_s < self._event_s - REBOOT_S:  # Unix times continue
            self._epoch_s = None
            self._done_s.clear()
        self._event_s = now_s
        self._write("event", event, now_s)
        if self._due(CLOCK, now_s):
            self.note("Clock", now_s, {"unix_s": self._unix_s()})
        self._show(event, now_s)

    def actions(self, actions: Iterable[object], now_s: float) -> None:
        """Record actions."""
        if self._idle:
            return
        for action in actions:
            self._write("action", action, now_s)
            self._show(action, now_s)

    def note(self, name: str, now_s: float, fields: Mapping[str, Any]) -> None:
        """Record a note about the flight, as plain data."""
        self._flown = self._flown or name == self.PREFLIGHT
        message = json_of({TIME_KEY: now_s, TYPE_KEY: name, **fields})
        self._add(note_channel(name), now_s, message.encode())

    def links(
        self,
        links: Callable[[], Mapping[str, LinkMetrics]],
        held: Callable[[], Mapping[str, Mapping[tuple[str, str], float]]],
        now_s: float,
    ) -> None:
        """Record changed links, and the messages that peers are known to hold.

        Args:
            links: Called at intervals; returns metrics by peer.
            held: Called with it; returns the newest stamp by peer, robot and topic.
            now_s: The vehicle's clock.
        """
        if self._idle or not self._due(LINKS, now_s):
            return
        for peer, link in links().items():
            # Ages change all the time; contacts are recorded as events.
            steady = dataclasses.replace(link, newest_age_s=None, topic_ages_s={}, contacts=())
            if self._links.get(peer) != steady:
                self._links[peer] = steady
                message = message_of(dataclasses.replace(link, contacts=()), now_s)
                self._add(link_channel(), now_s, message)
                self._show(link, now_s)
        for peer, holdings in held().items():
            known = self._held.setdefault(peer, {})
            changed = [[*key, s] for key, s in sorted(holdings.items()) if known.get(key) != s]
            if changed:
                known.update(holdings)
                self.note("Held", now_s, {"peer": peer, "held": changed})

    def status(self, status: Callable[[], FlightStatus], now_s: float) -> None:
        """Record the flight's status, once a second.

        Args:
            status: Called when the next one is due.
            now_s: As everywhere.
        """
        if self._idle or not self._due(STATUS, now_s):
            return
        message = self._encoded(lambda value: status_message_of(value, now_s), status())
        if message is not None:
            self._add(status_channel(), now_s, message)

    def patch(self, patch: bytes, now_s: float) -> None:
        """Record a patch that was painted into the map."""
        self._patch_bytes += len(patch)
        if self._patch_bytes <= PATCH_BYTES:
            data = base64.b64encode(patch).decode("ascii")
            self._add(PATCHES, now_s, json_of({TIME_KEY: now_s, "patch": data}).encode())

    def map(self, mapper: Mapper, now_s: float) -> None:
        """Record the growth of the map, and at intervals the whole map."""
        if self._idle or not mapper.known_cells:
            return
        for version in mapper.published[self._maps :]:
            self.note("MapPublished", version.time_s, {"known_cells": version.known_cells})
        self._maps = len(mapper.published)
        if self._due(MAP, now_s):
            self.note("Map", now_s, {"known_cells": mapper.known_cells})
        if mapper.known_cells != self._grid_cells and self._due(GRID, now_s):
            self._grid_cells = mapper.known_cells
            self._show(mapper.grid, now_s)

    def file(self, path: Path) -> None:
        """Attach a file of the mission to the record."""
        if self._file is None:
            return
        try:
            if path.stat().st_size <= FILE_BYTES:
                data, kind = path.read_bytes(), _MEDIA_TYPES.get(path.suffix, "text/plain")
                self._file.attach(path.name, kind, _ns(self._unix_s()), data)
        except OSError as error:
            _log.warning("%s is not in the record: %s", path, error)

    # The end.

    def close(self) -> None:
        """End the file; a flight that never began leaves no file."""
        if self._file is not None:
            file, self._file = self._file, None
            file.close()
            if not self._flown:
                file.path.unlink(missing_ok=True)
                self.path = None

    @property
    def _idle(self) -> bool:
        return self._file is None and self._viewer is None

    def _due(self, what: str, now_s: float) -> bool:
        """Whether something is due; it then counts as done."""
        due = now_s - self._done_s.get(what, -math.inf) >= EVERY_S[what]
        if due:
            self._done_s[what] = now_s
        return due

    def _on_trouble(self, text: str) -> None:
        """Notify the flight; called on the writing thread."""
        try:
            self._trouble(text)
        except RuntimeError:  # the listener has ended
            _log.error(text)

    def _write(self, kind: str, value: object, now_s: float) -> None:
        order = self._order(value)
        message = self._encoded(lambda value: message_of(value, now_s, order), value)
        if message is None:
            self.note("Unwritable", now_s, {"kind": kind, "value": repr(value)[:1000]})
        else:
            of: Any = type(value)
            self._add(channel_of(kind, of), now_s, message)

    def _order(self, value: object) -> int | None:
        """The number of a motion, from 1: several motions may be equal."""
        if isinstance(value, Motion):
            self._motions += 1
            self._recent.append((value, self._motions))
            return self._motions
        if isinstance(value, ABOUT_MOTIONS):
            return next((n for motion, n in self._recent if motion is value.action), None)
        return None

    def _encoded(self, encode: Callable[[Any], Any], value: object) -> Any:
        try:
            return encode(value)
        except Exception:  # noqa: BLE001 - no fault of a record may end a flight
            name = type(value).__name__
            if name not in self._unwritable:
                self._unwritable.add(name)
                _log.exception("%s cannot be recorded: the record cannot be replayed", name)
            return None

    def _show(self, value: object, now_s: float) -> None:
        """Record the drawing of a value."""
        if self._drawing is not None:
            self._draw(partial(self._drawing.draw, value), self._time_s(now_s))

    def _draw(self, draw: Callable[[float], Iterable[Any]], unix_s: float) -> None:
        with self._harmless:
            for channel, data in draw(unix_s):
                self._send(channel, _ns(unix_s), data)

    def _add(self, channel: RecordChannel, now_s: float, data: bytes) -> None:
        self._send(channel, _ns(self._time_s(now_s)), data)

    def _send(self, channel: RecordChannel, time_ns: int, data: bytes) -> None:
        if self._idle:
            return
        self._last_ns = max(self._last_ns, time_ns)
        if self._file is not None:
            self._file.add(channel, self._last_ns, data)
        if self._viewer is not None:
            self._viewer.send(channel, self._last_ns, data)

    def _time_s(self, now_s: float) -> float:
        """Unix seconds for displays, which run with the vehicle's clock whatever GPS reports later.

        They never fall behind the computer's time at the start of the record.
        """
        if self._epoch_s is None:
            if now_s <= 0:
                return self._unix_s()
            self._epoch_s = max(self._unix_s(), self._last_ns / 1e9) - now_s
        return self._epoch_s + now_s


def _drawing_of(setup: FlightSetup) -> Any:
    """The drawing of the flight for Foxglove; None: its SDK, an extra, is not installed."""
    try:
        from air_router.record.drawing import FlightDrawing  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "foxglove":
            raise
        return None
    return FlightDrawing(setup.mission)


def _ns(unix_s: float) -> int:
    """Nanoseconds limited to MCAP's 64 bits: a vehicle may report any date."""
    return int(min(max(unix_s, 0.0), _LATEST_UNIX_S) * 1e9)


_MEDIA_TYPES: Final = {".yaml": "application/yaml", ".plan": "application/json"}
