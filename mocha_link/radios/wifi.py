"""A Linux Wi-Fi interface: how it hears the stations that it is linked with, by the tool `iw`."""

from __future__ import annotations

import asyncio
import contextlib
import re
import shutil
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import Mapping
from dataclasses import dataclass

from mocha_link.errors import RadioError
from mocha_link.links.reading import Reading, Unit
from mocha_link.radios.radio import LOG, BackgroundRadio, Report
from mocha_link.team.team_file import RadioUrl

POLL_S = 1.0
TIMEOUT_S = 5.0
INACTIVE_S = 10.0  # a station that has been silent for longer is not heard
MAX_OUTPUT_LETTERS = 1024 * 1024

_STATION = re.compile(r"Station ((?:[0-9a-f]{2}:){5}[0-9a-f]{2})\b", re.IGNORECASE)
_SIGNAL = re.compile(r"\s*(signal(?: avg)?):\s*(-?\d{1,4}) (?:\[[-\d, ]{0,80}\] )?dBm\b")
_INACTIVE = re.compile(r"\s*inactive time:\s*(\d{1,15}) ms\b")


@dataclass(slots=True)
class _Station:
    signal: float | None = None  # dBm of the last frame
    signal_avg: float | None = None  # dBm, smoothed
    inactive_s: float | None = None  # since its last frame

    def take(self, line: str) -> None:
        """Take a line in; only the first of a kind: those of single links come behind it."""
        if match := _SIGNAL.match(line):
            if match[1] == "signal" and self.signal is None:
                self.signal = float(match[2])
            elif match[1] == "signal avg" and self.signal_avg is None:
                self.signal_avg = float(match[2])
        elif (match := _INACTIVE.match(line)) and self.inactive_s is None:
            self.inactive_s = int(match[1]) / 1000

    def reading(self) -> Reading | None:
        """How the station is heard."""
        value = self.signal if self.signal_avg is None else self.signal_avg
        if value is None or (self.inactive_s or 0) > INACTIVE_S:
            return None
        try:
            return Reading(value, Unit.DBM, "wifi")
        except RadioError:  # no power that a radio can receive
            return None


def parse_station_dump(text: str) -> dict[str, Reading]:
    """The stations that are heard, by MAC address, from ``iw dev INTERFACE station dump``.

    The average signal where the driver has one, else that of the last frame. Lines that are not
    about that are left out, and so are stations that have been silent for 10 s.
    """
    stations: dict[str, _Station] = {}
    station = _Station()
    for line in text[:MAX_OUTPUT_LETTERS].splitlines():
        if match := _STATION.match(line):
            station = stations.setdefault(match[1].lower(), _Station())
        else:
            station.take(line)
    readings = {mac: station.reading() for mac, station in stations.items()}
    return {mac: reading for mac, reading in readings.items() if reading}


class WifiRadio(BackgroundRadio):
    """Asks `iw` about an interface (``wifi://wlan0``) once a second.

    Args:
        url: Which interface; it may come up later.
        peers: The robots by the MAC addresses of their radios, in lower case.
        poll_s: How often, in real seconds.
        command: What to run in place of `iw`.
    """

    def __init__(
        self,
        url: RadioUrl,
        peers: Mapping[str, str],
        *,
        poll_s: float = POLL_S,
        command: tuple[str, ...] = ("iw",),
    ) -> None:
        super().__init__()
        self._command = (*command, "dev", url.host, "station", "dump")
        self._peers = peers
        self._poll_s = poll_s
        self._complaint = ""  # warned of last, once

    def start(self, report: Report) -> None:
        """Begin to ask. Raises RadioError if `iw` is not installed."""
        if shutil.which(self._command[0]) is None:
            raise RadioError(f"no program {self._command[0]}; install it (Debian/Ubuntu: iw)")
        self._begin(report, self._watch())

    async def _watch(self) -> None:
        heard: set[str] = set()
        while True:
            readings = await self._readings()
            for peer in sorted(readings.keys() | heard):
                self.pass_on(peer, readings.get(peer))
            heard = set(readings)
            await asyncio.sleep(self._poll_s)

    async def _readings(self) -> dict[str, Reading]:
        """How each peer is heard: the better one of a robot with several radios."""
        try:
            stations = parse_station_dump(await self._ask())
        except OSError as error:
            complaint = f"cannot run {self._command[0]}: {error.strerror}"
            if complaint != self._complaint:  # once, not every second
                LOG.warning("%s", complaint)
            self._complaint = complaint
            return {}
        self._complaint = ""
        readings: dict[str, Reading] = {}
        for mac, reading in stations.items():
            peer = self._peers.get(mac)
            if peer and (peer not in readings or reading.value > readings[peer].value):
                readings[peer] = reading
        return readings

    async def _ask(self) -> str:
        """What `iw` says; nothing if it has no answer now. Raises OSError if it cannot run."""
        iw = await asyncio.create_subprocess_exec(
            *self._command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE
        )
        try:
            async with asyncio.timeout(TIMEOUT_S):
                output, complaint = await iw.communicate()
        except TimeoutError:
            return ""
        finally:
            with contextlib.suppress(ProcessLookupError):
                iw.kill()
            await iw.wait()
        if iw.returncode:
            text = complaint.decode(errors="replace").strip()
            LOG.debug("%s: %s", " ".join(self._command), text)
        return output.decode(errors="replace")
