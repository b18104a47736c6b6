"""Listens to the monitor of a Rajant BreadCrumb, which is started here or runs elsewhere."""

from __future__ import annotations

import errno
import os
import select
import socket
import subprocess
import time
from collections.abc import Mapping

from mocha_link.errors import RadioError
from mocha_link.links.reading import Reading
from mocha_link.radios.port import Report
from mocha_link.radios.rajant_monitor import Monitor
from mocha_link.radios.reports import Lines
from mocha_link.radios.thread_radio import LOG, ThreadRadio, pause, pump
from mocha_link.team.url import RadioUrl

MAX_LINE_BYTES = 64 * 1024  # a published dictionary is one line
RETRY_S = 2.0
CONNECT_S = 5.0


class RajantRadio(ThreadRadio):
    """Reports what a monitor prints.

    ``rajant://10.229.221.1?jar=/usr/lib/monitor.jar`` runs ``java -jar JAR ADDRESS``, as MOCHA
    does; ``rajant://host:port`` reads the same output over TCP. Either begins anew when it ends.

    Args:
        url: One of these.
        peers: The robots by what the radios call theirs: MAC or IP addresses, in lower case.
        retry_s: Real seconds before it begins anew.
        command: What to run in place of ``java -jar``.
    """

    def __init__(
        self,
        url: RadioUrl,
        peers: Mapping[str, str],
        *,
        retry_s: float = RETRY_S,
        command: tuple[str, ...] = ("java", "-jar"),
    ) -> None:
        super().__init__()
        self._url = url
        self._peers = peers
        self._retry_s = retry_s
        self._command = (*command, url.options.get("jar", ""), url.host)

    def start(self, report: Report) -> None:
        """Begin to listen; the monitor may come up later.

        Raises RadioError if its program is not there.
        """
        jar = self._url.options.get("jar")
        if jar is not None and not os.access(jar, os.R_OK):
            raise RadioError(f"no Rajant monitor at {jar}; correct 'radio' in the team file")
        self._begin(lambda stopped: self._listen(stopped, report))

    def _listen(self, stopped: socket.socket, report: Report) -> None:
        complaint = ""
        while True:
            session = _Session(self._peers, self, report)
            try:
                run = self._run if "jar" in self._url.options else self._read
                if run(stopped, session):
                    return
                why = "it ended"
            except (OSError, RadioError) as error:
                why = str(error)
            if why != complaint:  # once, not every two seconds
                LOG.warning("%s: %s; trying again", self._url, why)
            complaint = "" if session.lines_seen else why
            if pause(stopped, self._retry_s):
                return

    def _run(self, stopped: socket.socket, session: _Session) -> bool:
        process = subprocess.Popen(  # noqa: S603 - what the team file of this robot names
            self._command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is ours to handle
        )
        with process:
            try:
                return pump(process.stdout.fileno(), stopped, session.take)  # type: ignore[union-attr]
            finally:
                process.kill()

    def _read(self, stopped: socket.socket, session: _Session) -> bool:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as connection:
            connection.setblocking(False)
            code = connection.connect_ex((self._url.host, self._url.port or 0))
            if code == errno.EINPROGRESS:
                ready = select.select([stopped], [connection], [], CONNECT_S)
                if ready[0]:
                    return True
                code = connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
                code = code if ready[1] else errno.ETIMEDOUT
            if code:
                raise OSError(code, os.strerror(code))
            return pump(connection.fileno(), stopped, session.take)


class _Session:
    """One run of the monitor, from its first line to its last."""

    def __init__(self, peers: Mapping[str, str], radio: ThreadRadio, report: Report) -> None:
        self.lines_seen = False  # the monitor has printed something
        self._peers = peers
        self._radio = radio
        self._report = report
        self._lines = Lines(MAX_LINE_BYTES)
        self._monitor = Monitor()

    def take(self, data: bytes) -> None:
        for raw in self._lines.feed(data):
            self.lines_seen = True
            found = self._monitor.feed(raw.decode("utf-8", "replace"), time.monotonic())
            for peer, reading in self._by_peer(found).items():
                self._radio.pass_on(self._report, peer, reading)

    def _by_peer(self, found: Mapping[str, Reading | None]) -> dict[str, Reading | None]:
        peers: dict[str, Reading | None] = {}
        for radio_id, reading in found.items():
            peer = self._peers.get(radio_id)
            if peer is None:
                continue
            best = peers.setdefault(peer, reading)
            if reading and (best is None or reading.value > best.value):
                peers[peer] = reading
        return peers
