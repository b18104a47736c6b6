"""Radios that other programs speak for: one report per datagram, or per line over TCP or stdin."""

from __future__ import annotations

import contextlib
import selectors
import socket
import sys
from collections.abc import Callable, Iterable
from typing import ClassVar, Protocol

from mocha_link.errors import RadioError
from mocha_link.radios.port import Report
from mocha_link.radios.reports import MAX_LINE_BYTES, Lines
from mocha_link.radios.thread_radio import LOG, READ_BYTES, ThreadRadio, pause, pump
from mocha_link.team.url import RadioUrl

MAX_PROGRAMS = 8
RETRY_S = 0.1


class _Listening(ThreadRadio):
    """What radios that listen on a port of their own have in common."""

    SCHEME: ClassVar[str]  # of its URLs

    def __init__(self, url: str) -> None:
        super().__init__()
        self._url = RadioUrl.parse(url, scheme=self.SCHEME)  # where it listens
        self._socket: socket.socket | None = None  # while it listens

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return int(self._socket.getsockname()[1]) if self._socket else self._url.port or 0

    def close(self) -> None:
        """Stop listening, and hang up on connected programs."""
        super().close()
        self._socket = None


class UdpRadio(_Listening):
    """Receives reports as datagrams, each a JSON object ``{"peer": "io", "rssi_dbm": -61.5}``.

    ``null`` for `rssi_dbm`: the peer is not heard; `docs/radios.md` has the other forms. `url` is
    ``udp://host:port``, where to listen; port 0 takes a free one. Datagrams that are no reports
    are counted in `refused`.
    """

    SCHEME = "udp"

    def start(self, report: Report) -> None:
        """Begin to listen. Raises RadioError if the port is taken or the host is not ours."""
        receiver = self._socket = bound(self._url, socket.SOCK_DGRAM)

        def take(raw: bytes) -> None:
            self.accept(report, raw, "udp")

        self._begin(lambda stopped: datagrams(receiver, stopped, take))


class TcpRadio(_Listening):
    """Receives reports as lines from programs that connect to ``tcp://host:port``.

    A line is a JSON object as a datagram of `UdpRadio`, or ``io -61.5 dBm``. Lines that are no
    reports are counted in `refused`, and so is a program beyond the first 8.
    """

    SCHEME = "tcp"

    def start(self, report: Report) -> None:
        """Begin to listen. Raises RadioError if the port is taken or the host is not ours."""
        listener = self._socket = bound(self._url, socket.SOCK_STREAM)
        listener.listen(MAX_PROGRAMS)
        self._begin(lambda stopped: self._serve(listener, stopped, report))

    def _serve(self, listener: socket.socket, stopped: socket.socket, report: Report) -> None:
        programs: dict[socket.socket, Lines] = {}
        with listener, contextlib.ExitStack() as stack, selectors.DefaultSelector() as selector:
            stack.callback(_close_all, programs)
            selector.register(listener, selectors.EVENT_READ)
            selector.register(stopped, selectors.EVENT_READ)
            while True:
                ready = [key.fileobj for key, _ in selector.select()]
                if stopped in ready:
                    return
                for each in ready:
                    if each is listener:
                        if not self._welcome(listener, programs, selector):
                            pause(stopped, RETRY_S)
                    elif isinstance(each, socket.socket) and not self._read(
                        each, programs[each], report
                    ):
                        selector.unregister(each)
                        del programs[each]
                        each.close()

    def _welcome(
        self,
        listener: socket.socket,
        programs: dict[socket.socket, Lines],
        selector: selectors.BaseSelector,
    ) -> bool:
        try:
            program, _ = listener.accept()
        except OSError:  # gone again, or we have no socket left
            return False
        if len(programs) >= MAX_PROGRAMS:
            self.refuse(RadioError(f"more than {MAX_PROGRAMS} programs connected"))
            program.close()
            return True
        program.setblocking(False)
        programs[program] = Lines()
        selector.register(program, selectors.EVENT_READ)
        return True

    def _read(self, program: socket.socket, lines: Lines, report: Report) -> bool:
        try:
            data = program.recv(READ_BYTES)
        except BlockingIOError:
            return True
        except OSError:
            return False
        for line in lines.feed(data):
            self.accept(report, line, "tcp")
        return bool(data)


class _Readable(Protocol):
    def fileno(self) -> int:
        """The file descriptor."""


class StdinRadio(ThreadRadio):
    """Receives reports as lines on standard input (``stdin:``), as `TcpRadio` does."""

    def __init__(self, file: _Readable | None = None) -> None:
        super().__init__()
        self._file = file

    def start(self, report: Report) -> None:
        """Begin to read. Raises RadioError if there is no standard input."""
        try:
            fd = (self._file or sys.stdin).fileno()
        except (AttributeError, OSError, ValueError):
            raise RadioError("there is no standard input to read radio reports from") from None
        self._begin(lambda stopped: self._listen(fd, stopped, report))

    def _listen(self, fd: int, stopped: socket.socket, report: Report) -> None:
        lines = Lines()

        def take(data: bytes) -> None:
            for line in lines.feed(data):
                self.accept(report, line, "stdin")

        if not pump(fd, stopped, take):
            take(b"\n")  # the last line may lack its end
            LOG.warning("standard input has ended: no more radio reports, no peer is heard")


def bound(url: RadioUrl, kind: socket.SocketKind) -> socket.socket:
    """A socket at the address that a URL names. Raises RadioError."""
    found = socket.socket(socket.AF_INET, kind)
    try:
        if kind is socket.SOCK_STREAM:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((url.host, url.port or 0))
    except OSError as error:
        found.close()
        raise RadioError(
            f"cannot listen for radio reports on {url}: {error.strerror}; end the "
            "process that uses the port, or change 'radio' in the team file"
        ) from None
    return found


def datagrams(
    receiver: socket.socket, stopped: socket.socket, take: Callable[[bytes], None]
) -> None:
    """Hand every datagram on until `stopped`; closes the socket."""
    with receiver, selectors.DefaultSelector() as selector:
        selector.register(receiver, selectors.EVENT_READ)
        selector.register(stopped, selectors.EVENT_READ)
        while True:
            ready = [key.fileobj for key, _ in selector.select()]
            if stopped in ready:
                return
            with contextlib.suppress(OSError):  # e.g. an ICMP error of an earlier packet
                take(receiver.recv(MAX_LINE_BYTES))


def _close_all(programs: Iterable[socket.socket]) -> None:
    for program in programs:
        program.close()
