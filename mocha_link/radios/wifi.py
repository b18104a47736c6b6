"""A Linux Wi-Fi interface: signals of its associated stations, by the tool `iw`."""

from __future__ import annotations

import asyncio
import contextlib
import re
import shutil
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import Mapping

from mocha_link.errors import RadioError
from mocha_link.links import Reading, Unit
from mocha_link.logs import Log, NodeLog
from mocha_link.radios.peers import peers_by_radio
from mocha_link.radios.radio import LOG, BackgroundRadio, Report
from mocha_link.team import RadioUrl, Robot, Team

POLL_S = 1.0
TIMEOUT_S = 5.0
INACTIVE_S = 10.0  # after a longer silence a station has no signal
MAX_OUTPUT_LETTERS = 1024 * 1024

_STATION = re.compile(r"^Station ((?:[0-9a-f]{2}:){5}[0-9a-f]{2})\b", re.IGNORECASE | re.MULTILINE)
_SIGNAL = re.compile(
    r"^[ \t]*(signal(?: avg)?):[ \t]*(-?\d{1,4}) (?:\[[-\d, ]{0,80}\] )?dBm\b", re.MULTILINE
)
_INACTIVE = re.compile(r"^[ \t]*inactive time:[ \t]*(\d{1,15}) ms\b", re.MULTILINE)


def parse_station_dump(text: str) -> dict[str, Reading]:
    """The signals of stations, by MAC address, from ``iw dev INTERFACE station dump``.

    The average signal where the driver has one, else that of the last frame. Lines that are not
    about that are left out, and so are stations that have been silent for 10 s.
    """
    _, *parts = _STATION.split(text[:MAX_OUTPUT_LETTERS])
    readings = {
        mac.lower(): _reading(lines) for mac, lines in zip(parts[::2], parts[1::2], strict=True)
    }
    return {mac: reading for mac, reading in readings.items() if reading}


def _reading(lines: str) -> Reading | None:
    """The signal of a station; only the first of a kind: those of single links follow it."""
    signals = dict(reversed(_SIGNAL.findall(lines)))
    inactive = _INACTIVE.search(lines)
    if not signals or (inactive and int(inactive[1]) > INACTIVE_S * 1000):
        return None
    value = float(signals["signal avg" if "signal avg" in signals else "signal"])
    with contextlib.suppress(RadioError):  # no power that a radio can receive
        return Reading(value, Unit.DBM, "wifi")
    return None


class WifiRadio(BackgroundRadio):
    """Queries `iw` about an interface (``wifi://wlan0``) once a second.

    Args:
        url: Which interface; it may come up later.
        peers: The robots by the MAC addresses of their radios, in lower case.
        poll_s: How often, in real seconds.
        command: What to run in place of `iw`.
        log: where it logs.
    """

    def __init__(
        self,
        url: RadioUrl,
        peers: Mapping[str, str],
        *,
        poll_s: float = POLL_S,
        command: tuple[str, ...] = ("iw",),
        log: Log = LOG,
    ) -> None:
        super().__init__(log)
        self._command = (*command, "dev", url.host, "station", "dump")
        self._peers = peers
        self._poll_s = poll_s
        self._complaint = ""  # warned of last, once

    def start(self, report: Report) -> None:
        """Begin to poll. Raises RadioError if `iw` is not installed."""
        if shutil.which(self._command[0]) is None:
            raise RadioError(f"no program {self._command[0]}; install it (Debian/Ubuntu: iw)")
        self._begin(report, self._watch())

    async def _watch(self) -> None:
        before: dict[str, Reading] = {}
        while True:
            stations = await self._stations()
            self.pass_on_best({**dict.fromkeys(before), **stations}, self._peers)
            before = stations
            await asyncio.sleep(self._poll_s)

    async def _stations(self) -> dict[str, Reading]:
        """The signal of each station, by MAC address."""
        stations, complaint = {}, ""
        try:
            stations = parse_station_dump(await self._station_dump())
        except OSError as error:
            complaint = f"cannot run {self._command[0]}: {error.strerror}"
        if complaint and complaint != self._complaint:  # once, not every second
            self.log.warning("%s", complaint)
        self._complaint = complaint
        return stations

    async def _station_dump(self) -> str:
        """The output of `iw`; empty if it fails now. Raises OSError if it cannot run."""
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
            self.log.debug("%s: %s", " ".join(self._command), text)
        return output.decode(errors="replace")


def open_wifi(url: RadioUrl, team: Team, robot: Robot) -> WifiRadio:
    """The radio ``wifi:``. Raises RadioError."""
    return WifiRadio(url, peers_by_radio(team, robot), log=NodeLog(robot.name))
