"""The operator's terminal: a live status line with log lines above it, and typed requests.

It is independent of flights: experiments also show their progress with it.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import math
import os
import shutil
import signal
import stat
import sys
import time
from collections.abc import Callable, Iterator
from types import MappingProxyType
from typing import Final, TextIO

from air_router.control import CommandRequest, parse_command
from air_router.flight.limits import (
    TERMINAL_PLAIN_REFRESH_S,
    TERMINAL_READ_AGAIN_S,
    TERMINAL_REFRESH_S,
)
from air_router.vehicle import Severity
from mocha_link.errors import RequestError

_STYLE: Final = MappingProxyType({Severity.WARNING: "\x1b[33m", Severity.ALARM: "\a\x1b[1;31m"})
_PLAIN: Final = "\x1b[0m"
"""ANSI: yellow; bold red, and a bell. The line itself has "WARNING" or "ALARM"."""


class StatusLine:
    """Draws the line on a terminal, or prints it at intervals elsewhere; always on stderr."""

    def __init__(
        self,
        out: TextIO | None = None,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        out = out if out is not None else sys.stderr
        self._live = out.isatty()  # on a terminal: one line, redrawn in place
        self._out = _patient(out)
        self._monotonic = monotonic
        self._shown_s = -math.inf  # last write
        self._width = 0  # of the line to overwrite

    def show(self, line: Callable[[], str]) -> None:
        """Draw the line if the last one is old enough; `line` is called only then."""
        now_s = self._monotonic()
        if now_s - self._shown_s < (TERMINAL_REFRESH_S if self._live else TERMINAL_PLAIN_REFRESH_S):
            return
        self._shown_s = now_s
        text = line()
        if self._live:
            width = max(shutil.get_terminal_size().columns - 1, 1)  # one line must stay one line
            text = text if len(text) <= width else f"{text[: width - 1]}…"
            self._write("\r" + text.ljust(self._width))
            self._width = len(text)
        else:
            self._write(text + "\n")

    def print_line(self, text: str, severity: Severity = Severity.INFO) -> None:
        """Print a permanent line; on a terminal warnings in color, and alarms with a bell."""
        if self._live and severity in _STYLE:
            text = f"{_STYLE[severity]}{text}{_PLAIN}"
        if self._live:
            text = "\r" + " " * self._width + "\r" + text
            self._width = 0
            self._shown_s = -math.inf
        self._write(text + "\n")

    def end(self) -> None:
        """Keep the last status line and continue below it."""
        if self._live and self._width:
            self._write("\n")
            self._width = 0

    def _write(self, text: str) -> None:
        with contextlib.suppress(OSError):  # the terminal is closed
            self._out.write(text)
            self._out.flush()


class _Screen(io.TextIOBase):
    """An output that drops text if the terminal does not accept it (Ctrl-S, stalled SSH).

    Args:
        path: Path of the terminal or pipe; opened again, so its mode does not change for other
            programs.
    """

    def __init__(self, path: str) -> None:
        descriptor = os.open(path, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        self._raw = io.FileIO(descriptor, "w")

    def write(self, text: str) -> int:
        """Write as much as possible."""
        self._raw.write(text.encode(errors="replace"))
        return len(text)

    def close(self) -> None:
        """Free the descriptor."""
        self._raw.close()
        super().close()


def _patient(out: TextIO) -> TextIO | _Screen:
    """Wrap a terminal or pipe so that it never blocks; return other outputs unchanged."""
    try:
        descriptor = out.fileno()
        if stat.S_ISFIFO(os.fstat(descriptor).st_mode):  # `| less`, and `| tee` while SSH stalls
            return _Screen(f"/proc/self/fd/{descriptor}")
        return _Screen(os.ttyname(descriptor))
    except OSError:
        return out


# The operator's requests: what is typed at the terminal, and signals from elsewhere.


SIGNALS: Final = MappingProxyType({signal.SIGUSR1: "home", signal.SIGUSR2: "resume"})
"""Signals for another terminal or a service manager: `kill -USR1 PID`, `kill -USR2 PID`."""

_STOPS: Final = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
"""Signals by which a terminal stops a program: zones and battery would no longer be monitored."""

_CLOSED: Final = "the terminal is gone; the flight goes on without it"


@contextlib.contextmanager
def listening(
    deliver: Callable[[CommandRequest], None],
    complain: Callable[[str], None],
    keyboard: TextIO | None = None,
) -> Iterator[None]:
    """Pass typed requests and signals to `deliver` on the running event loop.

    Meanwhile nothing at the terminal stops the program: not Ctrl-Z, not input while in the
    background, not a blocked output.

    Args:
        deliver: Called with each request.
        complain: Called with an error for invalid input.
        keyboard: The terminal to read; default: stdin. Not read if it is no terminal.
    """
    loop = asyncio.get_running_loop()
    keyboard = keyboard if keyboard is not None else sys.stdin

    def on_line(line: str) -> None:
        if not line.strip():
            return
        try:
            command = parse_command(line)
        except RequestError as error:
            complain(f"{error}; or press Ctrl-C")
        else:
            deliver(command)

    loop.add_signal_handler(signal.SIGHUP, complain, _CLOSED)
    for number, name in SIGNALS.items():
        loop.add_signal_handler(number, deliver, parse_command(name))
    try:
        with _lines_typed(keyboard, on_line), _unstopped():
            yield
    finally:
        for number in (signal.SIGHUP, *SIGNALS):
            loop.remove_signal_handler(number)


@contextlib.contextmanager
def _lines_typed(keyboard: TextIO, take: Callable[[str], None]) -> Iterator[None]:
    """Pass each line typed at a terminal to `take`."""
    if not keyboard.isatty():
        yield
        return
    loop = asyncio.get_running_loop()
    again: asyncio.TimerHandle | None = None

    def read() -> None:
        nonlocal again
        line = line_of(keyboard)
        if line:
            take(line)
            return
        loop.remove_reader(keyboard)
        if keyboard.isatty():  # it still exists
            again = loop.call_later(TERMINAL_READ_AGAIN_S, loop.add_reader, keyboard, read)

    loop.add_reader(keyboard, read)
    try:
        yield
    finally:
        if again is not None:
            again.cancel()
        loop.remove_reader(keyboard)


@contextlib.contextmanager
def _unstopped() -> Iterator[None]:
    """Keep the terminal from stopping the program or blocking its log."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in _STOPS}
    logs = [log for log in logging.getLogger().handlers if isinstance(log, logging.StreamHandler)]
    streams = [log.stream for log in logs]
    for log in logs:
        log.setStream(_patient(log.stream))
    try:
        yield
    finally:
        for log, stream in zip(logs, streams, strict=True):
            if (patient := log.setStream(stream)) is not None:
                patient.close()
        for number, handler in before.items():
            signal.signal(number, handler)


def line_of(keyboard: TextIO) -> str:
    """The typed line; empty at Ctrl-D, in the background, and after the terminal is closed."""
    try:
        return keyboard.readline()
    except OSError:
        return ""
    except UnicodeDecodeError as error:  # invalid bytes: an unknown request
        return error.object.decode(error.encoding, "replace")
