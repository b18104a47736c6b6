"""Rajant BreadCrumb radios, through the output of the monitor that MOCHA runs beside them.

The monitor is a Java program that queries the radio by Rajant's API and prints its links; it
is started here or runs elsewhere. Three forms of its output are read: the lines of MOCHA's ROS 2
branch (``Ts:..,Iface:..,Peer:..,RSSI:..;`` up to ``END,..;``), the protobuf text of its ROS 1
branch, and the dictionary that the ROS 1 branch publishes from it.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import time
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import AsyncIterator, Iterator, Mapping

from mocha_link.errors import RadioError
from mocha_link.links import Reading, Unit
from mocha_link.logs import Log, NodeLog
from mocha_link.radios.peers import peers_by_radio
from mocha_link.radios.radio import LOG, BackgroundRadio, Report
from mocha_link.team import RadioUrl, Robot, Team

MAX_LINE_BYTES = 64 * 1024  # a published dictionary is one line
RETRY_S = 2.0
CONNECT_S = 5.0
MAX_DEPTH = 32
MAX_FIELDS = 64
MAX_VALUE = 256
MAX_PEERS = 256
HOLD_S = 20.0  # so long a value stands that the radio does not repeat, as MOCHA has it
SILENT_S = 30.0  # a monitor that prints nothing for so long hangs, or its connection is dead

_PEER_LINE = re.compile(r"Ts:\d{1,20},Iface:[^,]{0,64},Peer:([^,\s]{1,64}),RSSI:(-?\d{1,9});")
_END_LINE = re.compile(r"END,\d{1,20};")
_TOKEN = re.compile(
    r"""(?P<open>[{])|(?P<close>[}])|(?P<mark>[:,])"""
    r"""|"(?P<double>(?:[^"\\]|\\.){0,256})"|'(?P<single>(?:[^'\\]|\\.){0,256})'|(?P<word>[^\s{}:,"']+)"""
)
_ESCAPE = re.compile(r"\\([0-7]{1,3}|x[0-9A-Fa-f]{1,2}|.)")
_ESCAPED = {"a": 7, "b": 8, "f": 12, "n": 10, "r": 13, "t": 9, "v": 11}
_MAC = re.compile(r"(?:[0-9a-f]{2}:){5}[0-9a-f]{2}", re.IGNORECASE)
_MAC_BYTES = 6


class RajantRadio(BackgroundRadio):
    """Reports what a monitor prints.

    ``rajant://10.229.221.1?jar=/usr/lib/monitor.jar`` runs ``java -jar JAR ADDRESS``, as MOCHA
    does; ``rajant://host:port`` reads the same output over TCP. Either begins anew when it ends.

    Args:
        url: One of these.
        peers: The robots by what the radios call theirs: MAC or IP addresses, in lower case.
        retry_s: Real seconds before it begins anew.
        silent_s: After so many without a line, too.
        command: What to run in place of ``java -jar``.
        log: where it logs.
    """

    def __init__(  # noqa: PLR0913 - how the monitor is run
        self,
        url: RadioUrl,
        peers: Mapping[str, str],
        *,
        retry_s: float = RETRY_S,
        silent_s: float = SILENT_S,
        command: tuple[str, ...] = ("java", "-jar"),
        log: Log = LOG,
    ) -> None:
        super().__init__(log)
        self._url = url
        self._peers = peers
        self._retry_s = retry_s
        self._silent_s = silent_s
        self._command = (*command, url.options.get("jar", ""), url.host)

    def start(self, report: Report) -> None:
        """Begin to listen; the monitor may come up later.

        Raises RadioError if its program is not there.
        """
        jar = self._url.options.get("jar")
        if jar is not None and not os.access(jar, os.R_OK):
            raise RadioError(f"no Rajant monitor at {jar}; correct 'radio' in the team file")
        self._begin(report, self._listen())

    async def _listen(self) -> None:
        complaint = ""
        while True:
            monitor, printed, why = Monitor(), False, "it ended"
            try:
                async with self._output() as stream, asyncio.timeout(self._silent_s) as silence:
                    async for line in self.lines(stream):
                        printed = True
                        silence.reschedule(asyncio.get_running_loop().time() + self._silent_s)
                        readings = monitor.feed(line.decode(errors="replace"), time.monotonic())
                        self.pass_on_best(readings, self._peers)
            except (OSError, RadioError) as error:
                why = str(error) or "no answer"
            if why != complaint:  # once, not every two seconds
                self.log.warning("%s: %s; trying again", self._url, why)
            complaint = "" if printed else why
            await asyncio.sleep(self._retry_s)

    @contextlib.asynccontextmanager
    async def _output(self) -> AsyncIterator[asyncio.StreamReader]:
        """What the monitor prints. Raises OSError if it cannot be run or reached."""
        if "jar" not in self._url.options:
            async with asyncio.timeout(CONNECT_S):
                stream, connection = await asyncio.open_connection(
                    self._url.host, self._url.port, limit=MAX_LINE_BYTES
                )
            with contextlib.closing(connection):
                yield stream
            return
        monitor = await asyncio.create_subprocess_exec(
            *self._command,
            stdin=DEVNULL,
            stdout=PIPE,
            stderr=DEVNULL,
            start_new_session=True,  # Ctrl-C is ours to handle
            limit=MAX_LINE_BYTES,
        )
        try:
            if monitor.stdout:
                yield monitor.stdout
        finally:
            with contextlib.suppress(ProcessLookupError):
                monitor.kill()
            await monitor.wait()


class _Blocks:
    """Reads ``name { key: value ... }``, nested: protobuf text, or a dictionary made from it."""

    def __init__(self) -> None:
        self._open: list[tuple[str, dict[str, str]]] = []  # name and values, outermost first

    @property
    def depth(self) -> int:
        """How many blocks are open."""
        return len(self._open)

    def feed(self, line: str) -> Iterator[tuple[str, dict[str, str]]]:
        """The name and the fields of every block that ends in a line."""
        if line.startswith("watchResponse {"):
            self._open.clear()  # whatever was cut off before
        key = ""
        for token in _TOKEN.finditer(_unquoted(line)):
            kind = token.lastgroup or ""
            text = token[kind]
            if kind == "open":
                if self.depth == MAX_DEPTH:
                    self._open.clear()
                self._open.append((key, {}))
                key = ""
            elif kind == "close":
                if self._open:
                    yield self._open.pop()
                key = ""
            elif kind == "mark":
                key = "" if text == "," else key
            elif key and self._open:
                self._set(key, text if kind == "word" else _bytes(text))
                key = ""
            else:
                key = text[:64]

    def _set(self, key: str, value: str) -> None:
        fields = self._open[-1][1]
        if key in fields or len(fields) < MAX_FIELDS:
            fields[key] = value[:MAX_VALUE]


class Monitor:
    """Reads the monitor's output line by line.

    The reading of a radio is stored under each of its ids: MAC address and IP address.
    """

    def __init__(self) -> None:
        self._found: dict[str, Reading | None] = {}  # in the report under way, by radio
        self._known: dict[str, tuple[Reading, float]] = {}  # newest, and when
        self._blocks = _Blocks()

    def feed(self, line: str, now_s: float) -> dict[str, Reading | None]:
        """Process a line; at the end of a report returns the reading of each radio, by id.

        None: not any more. `now_s` are steady seconds. Raises RadioError if the monitor has lost
        its radio.
        """
        line = line.strip()
        if match := _PEER_LINE.fullmatch(line):
            self._best(match[1].lower(), _reading(match[2]))
            return {}
        if _END_LINE.fullmatch(line):
            return self._report()
        if line == "ERR":
            raise RadioError("the Rajant monitor has lost its radio")
        ended = False
        for name, fields in self._blocks.feed(line):
            ended = True
            if name.partition("-")[0] == "peer":
                self._peer(fields, now_s)
        return self._report() if ended and self._blocks.depth == 0 else {}

    def _peer(self, fields: Mapping[str, str], now_s: float) -> None:
        ids = {mac for mac in (_mac(fields.get("mac", "")),) if mac}
        address = fields.get("ipv4Address", "").lower()
        if address:
            ids.add(address[:64])
        deleted = fields.get("action", "").startswith("DELETE")
        for radio_id in ids:
            if deleted:
                self._known.pop(radio_id, None)
                self._best(radio_id, None)
            elif "rssi" in fields:
                reading = _reading(fields["rssi"])
                self._best(radio_id, reading)
                if reading and (radio_id in self._known or len(self._known) < MAX_PEERS):
                    self._known[radio_id] = reading, now_s
            elif (
                radio_id in self._known
            ):  # in a report of changes: it is there, as strong as before
                reading, since_s = self._known[radio_id]
                if now_s - since_s > HOLD_S:
                    del self._known[radio_id]
                self._best(radio_id, reading if radio_id in self._known else None)

    def _best(self, radio_id: str, reading: Reading | None) -> None:
        """Store a value; the better one of a radio with several interfaces."""
        known = self._found.get(radio_id)
        if known and (reading is None or reading.value <= known.value):
            return
        if radio_id in self._found or len(self._found) < MAX_PEERS:
            self._found[radio_id] = reading

    def _report(self) -> dict[str, Reading | None]:
        found, self._found = self._found, {}
        return found


def _unquoted(line: str) -> str:
    """A published dictionary without what `rostopic echo` puts around it."""
    line = line.removeprefix("data:").strip()
    if line.startswith('"{') and line.endswith('}"'):
        line = line[1:-1]
    return line


def _reading(text: str) -> Reading | None:
    with contextlib.suppress(ValueError, RadioError):
        return Reading(float(int(text)), Unit.DEVICE, "rajant")
    return None


def _bytes(text: str) -> str:
    """A quoted text with its escapes resolved; every letter is one byte."""

    def letter(match: re.Match[str]) -> str:
        code = match[1]
        if code[0] in "01234567":
            return chr(int(code, 8) & 0xFF)
        if code[0] == "x" and len(code) > 1:
            return chr(int(code[1:], 16))
        return chr(_ESCAPED[code]) if code in _ESCAPED else code

    return _ESCAPE.sub(letter, text)


def _mac(text: str) -> str:
    if _MAC.fullmatch(text):
        return text.lower()
    raw = [ord(letter) for letter in text]
    if len(raw) != _MAC_BYTES or max(raw) > 0xFF:
        return ""
    return ":".join(f"{byte:02x}" for byte in raw)


def open_rajant(url: RadioUrl, team: Team, robot: Robot) -> RajantRadio:
    """The radio ``rajant:``. Raises RadioError."""
    return RajantRadio(url, peers_by_radio(team, robot), log=NodeLog(robot.name))
