"""Radios that other programs report for: by datagram, by line over TCP or stdin, by MAVLink.

A report is one line, JSON or plain text: ``{"peer": "io", "rssi_dbm": -61.5}`` or ``io -61.5 dBm``;
so any program can be a radio. `docs/embedding.md` has all forms.
"""

from __future__ import annotations

import asyncio
import functools
import importlib
import json
import os
import socket
import struct
import sys
from collections.abc import Callable
from typing import IO, Any

from mocha_link.errors import RadioError, needs_extra
from mocha_link.forks import closed_in_children
from mocha_link.hosts import family_of, socket_address
from mocha_link.links import Reading, Unit
from mocha_link.logs import Log, NodeLog
from mocha_link.radios.peers import the_peer
from mocha_link.radios.radio import LOG, BackgroundRadio, Report
from mocha_link.team import RadioUrl, Robot, Team

MAX_LINE_BYTES = 2048
MAX_PROGRAMS = 8  # connected to one port
READ_BYTES = 4096
ALIVE_S, PROBE_S, TRIES = 15, 5, 3  # a dead program is detected within 30 s
UNKNOWN = 255  # in a RADIO_STATUS
STATUS_NAMES = ("RADIO_STATUS", "RADIO")  # RADIO: the same fields, from old SiK firmware

KEYS = {"rssi_dbm": Unit.DBM, "snr_db": Unit.SNR_DB, "device": Unit.DEVICE}
UNITS = {"dbm": Unit.DBM, "db": Unit.SNR_DB, "device": Unit.DEVICE}


def parse_report(raw: bytes, source: str = "radio") -> tuple[str, Reading | None]:
    """The peer and its signal, from one line; None: no signal.

    `source` is the source of the reading if the line names none. Raises RadioError.
    """
    if len(raw) > MAX_LINE_BYTES:
        raise RadioError(f"a report of more than {MAX_LINE_BYTES} bytes")
    try:
        line = raw.decode().strip()
    except UnicodeDecodeError:
        raise RadioError("a report must be UTF-8 text") from None
    return _from_json(line, source) if line.startswith("{") else _from_text(line, source)


def _from_json(line: str, source: str) -> tuple[str, Reading | None]:
    try:
        report = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise RadioError(f"a report that is no JSON object: {error}") from None
    peer, source = report.get("peer"), report.get("source", source)
    if not isinstance(peer, str):
        raise RadioError('a report must name the "peer" as text')
    if not isinstance(source, str):
        raise RadioError('the "source" of a report must be text')
    found = [key for key in KEYS if key in report]
    if not found:
        raise RadioError(f"a report must have one of the keys {', '.join(KEYS)}")
    for key in found:
        if report[key] is not None:
            return peer, Reading(report[key], KEYS[key], source)
    return peer, None


def _from_text(line: str, source: str) -> tuple[str, Reading | None]:
    fields = line.split()
    if len(fields) == 2 and fields[1].lower() == "none":
        return fields[0], None
    if len(fields) not in (2, 3):
        raise RadioError("a report in words must be: PEER VALUE [dBm|dB|device], or PEER none")
    unit = UNITS.get(fields[2].lower()) if fields[2:] else Unit.DBM
    if unit is None:
        raise RadioError(f"'{fields[2][:20]}' is no unit; write dBm, dB (for SNR) or device")
    try:
        value = float(fields[1])
    except ValueError:
        raise RadioError(f"'{fields[1][:20]}' is no number") from None
    return fields[0], Reading(value, unit, source)


def accept(radio: BackgroundRadio, raw: bytes, source: str) -> None:
    """Pass one report of a program on to the node, or refuse it."""
    try:
        peer, reading = parse_report(raw, source)
    except RadioError as error:
        radio.refuse(error)
    else:
        radio.pass_on(peer, reading)


class _ListeningRadio(BackgroundRadio):
    """Listens on a port of its own."""

    def __init__(self, url: RadioUrl, log: Log = LOG) -> None:
        super().__init__(log)
        self._url = url  # where it listens
        self._socket: socket.socket | None = None  # while it listens

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return int(self._socket.getsockname()[1]) if self._socket else self._url.port or 0

    def close(self) -> None:
        """Stop listening, and hang up on connected programs."""
        super().close()
        if self._socket:
            self._socket.close()  # also if the thread has not come to it
            self._socket = None

    def _bound(self, kind: socket.SocketKind) -> socket.socket:
        """A socket at the address that the URL names. Raises RadioError."""
        found = self._socket = closed_in_children(socket.socket(family_of(self._url.host), kind))
        try:
            if kind is socket.SOCK_STREAM:
                found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            found.bind(socket_address(self._url.host, self._url.port or 0))
        except OSError as error:
            found.close()
            self._socket = None
            raise RadioError(
                f"cannot listen for radio reports on {self._url}: {error.strerror}; end the "
                "process that uses the port, or change 'radio' in the team file"
            ) from None
        return found

    async def _datagrams(self, receiver: socket.socket, take: Callable[[bytes], None]) -> None:
        """Hand every datagram on until it is cancelled; closes the socket."""
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(lambda: _Receiver(take), sock=receiver)
        try:
            await loop.create_future()
        finally:
            transport.close()


class _Receiver(asyncio.DatagramProtocol):
    """Hands datagrams on; errors of the network are nothing to a receiver."""

    def __init__(self, take: Callable[[bytes], None]) -> None:
        self._take = take

    def datagram_received(self, data: bytes, _address: object) -> None:
        self._take(data)


class UdpRadio(_ListeningRadio):
    """Receives reports as datagrams, each a JSON object ``{"peer": "io", "rssi_dbm": -61.5}``.

    ``null`` for `rssi_dbm`: no signal of the peer; `docs/embedding.md` has the other forms. `url`
    is ``udp://host:port``, where to listen; port 0 takes a free one. Datagrams that are no reports
    are counted in `refused`.
    """

    def __init__(self, url: str, log: Log = LOG) -> None:
        super().__init__(RadioUrl.parse(url, scheme="udp"), log)

    def start(self, report: Report) -> None:
        """Begin to listen. Raises RadioError if the port is taken or the host is not ours."""
        receiver = self._bound(socket.SOCK_DGRAM)
        self._begin(
            report, self._datagrams(receiver, functools.partial(accept, self, source="udp"))
        )


class TcpRadio(_ListeningRadio):
    """Receives reports as lines from programs that connect to ``tcp://host:port``.

    A line is a JSON object as a datagram of `UdpRadio`, or ``io -61.5 dBm``. Lines that are no
    reports are counted in `refused`, and so is a program beyond the first 8. One whose computer is
    dead is disconnected after 30 s; a silent one may stay.
    """

    def __init__(self, url: str, log: Log = LOG) -> None:
        super().__init__(RadioUrl.parse(url, scheme="tcp"), log)
        self._programs = 0  # connected now

    def start(self, report: Report) -> None:
        """Begin to listen. Raises RadioError if the port is taken or the host is not ours."""
        listener = self._bound(socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)  # connections inherit it
        if sys.platform == "linux":
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, ALIVE_S)
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, PROBE_S)
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, TRIES)
        listener.listen(MAX_PROGRAMS)
        self._begin(report, self._serve(listener))

    async def _serve(self, listener: socket.socket) -> None:
        server = await asyncio.start_server(self._receive, sock=listener, limit=MAX_LINE_BYTES)
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            server.close()

    async def _receive(self, stream: asyncio.StreamReader, program: asyncio.StreamWriter) -> None:
        """Receive reports of a program until it disconnects."""
        if self._programs >= MAX_PROGRAMS:
            self.refuse(RadioError(f"more than {MAX_PROGRAMS} programs connected"))
            program.close()
            return
        self._programs += 1
        try:
            async for line in self.lines(stream):
                accept(self, line, "tcp")
        except asyncio.CancelledError:
            return  # the radio ends, which asyncio would log
        finally:
            self._programs -= 1
            program.close()


class StdinRadio(BackgroundRadio):
    """Receives reports as lines on standard input (``stdin:``), as `TcpRadio` does."""

    def __init__(self, file: IO[Any] | None = None, log: Log = LOG) -> None:
        super().__init__(log)
        self._file = file  # None: standard input

    def start(self, report: Report) -> None:
        """Begin to read. Raises RadioError if there is no standard input."""
        try:
            fd = (self._file or sys.stdin).fileno()
        except (AttributeError, OSError, ValueError):
            raise RadioError("there is no standard input to read radio reports from") from None
        self._begin(report, self._listen(fd))

    async def _listen(self, fd: int) -> None:
        loop, stream = asyncio.get_running_loop(), asyncio.StreamReader(MAX_LINE_BYTES)

        def read() -> None:
            try:
                data = os.read(fd, READ_BYTES)
            except OSError:  # e.g. its terminal is closed
                data = b""
            if data:
                stream.feed_data(data)
            else:
                loop.remove_reader(fd)
                stream.feed_eof()

        loop.add_reader(fd, read)
        async for line in self.lines(stream):
            accept(self, line, "stdin")
        self.log.warning("standard input has ended: no more radio reports, no peer is received")


class MavlinkRadio(_ListeningRadio):
    """A telemetry radio that reports its state by MAVLink RADIO_STATUS, as SiK radios do.

    Listens at ``mavlink://host:port?peer=io``; the radio links to one peer. A MAVLink router or a
    ground station can forward the radio's messages there.
    """

    def __init__(self, url: RadioUrl, peer: str, log: Log = LOG) -> None:
        super().__init__(url, log)
        self._peer = peer  # at the other end

    def start(self, report: Report) -> None:
        """Begin to listen. Raises RadioError if the port is taken or the host is not ours."""
        _dialect()  # the import takes a moment; not on the thread
        self._begin(report, self._datagrams(self._bound(socket.SOCK_DGRAM), self._take))

    def _take(self, raw: bytes) -> None:
        try:
            readings = parse_radio_status(raw[:MAX_LINE_BYTES])
        except RadioError as error:
            self.refuse(error)
            return
        for reading in readings:
            self.pass_on(self._peer, reading)


def parse_radio_status(datagram: bytes) -> list[Reading | None]:
    """The readings of the RADIO_STATUS messages in a datagram; None: unknown to the radio.

    A reading is the weaker of the strengths at both ends, since an exchange needs both. Other
    messages and junk are left out. Raises RadioError.
    """
    parser = _dialect().MAVLink(None)
    parser.robust_parsing = True
    try:
        messages = parser.parse_buffer(datagram) or []
    except (ValueError, IndexError, KeyError, TypeError, struct.error) as error:
        raise RadioError(f"no MAVLink: {error}") from None
    return [_reading(each) for each in messages if each.get_type() in STATUS_NAMES]


def _reading(status: Any) -> Reading | None:
    known = [end for end in (status.rssi, status.remrssi) if end != UNKNOWN]
    return Reading(float(min(known)), Unit.DEVICE, "mavlink") if known else None


@functools.cache
def _dialect() -> Any:
    with needs_extra("a radio that reports its state by MAVLink", "mavlink"):
        return importlib.import_module("pymavlink.dialects.v20.ardupilotmega")


def open_udp(url: RadioUrl, _team: Team, robot: Robot) -> UdpRadio:
    """The radio ``udp:``."""
    return UdpRadio(url.text, NodeLog(robot.name))


def open_tcp(url: RadioUrl, _team: Team, robot: Robot) -> TcpRadio:
    """The radio ``tcp:``."""
    return TcpRadio(url.text, NodeLog(robot.name))


def open_stdin(_url: RadioUrl, _team: Team, robot: Robot) -> StdinRadio:
    """The radio ``stdin:``."""
    return StdinRadio(log=NodeLog(robot.name))


def open_mavlink(url: RadioUrl, _team: Team, robot: Robot) -> MavlinkRadio:
    """The radio ``mavlink:``. Raises RadioError."""
    return MavlinkRadio(url, the_peer(url, robot), NodeLog(robot.name))
