"""Several flights at once, each a process of its own, as several companions would be.

What they print is put together on one terminal, each line with the name of its UAV; what is typed
there, and Ctrl-C, goes to all of them. None of them depends on another.
"""

import contextlib
import json
import os
import pty
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import termios
import tty
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import FrameType
from typing import IO, Any, Final, TextIO

from air_router.errors import ExitCode
from air_router.flight import line_of

AIR_ROUTER: Final = (sys.executable, "-m", "air_router.cli.cli")

_CHUNK: Final = 65_536
_LOOK_S: Final = 0.5
_ALL: Final = "all"

_GRAVITY: Final = (
    ExitCode.INTERRUPTED,
    ExitCode.PILOT_TOOK_OVER,
    ExitCode.REFUSED,
    ExitCode.NO_VEHICLE,
    ExitCode.INVALID_FILE,
    ExitCode.USAGE,
    ExitCode.MISSING_EXTRA,
    ExitCode.ENDED_OTHERWISE,
    ExitCode.DONE,
)
"""The exit codes from the worst to the best, for one that stands for all."""


@dataclass(slots=True)
class FlightProcess:
    """One `air-router fly` that is under way, or was.

    Attributes:
        uav: Whose flight.
        process: The process.
        screen: Where it prints to and reads from: our end of its terminal, or a pipe.
        out: The file that its stdout goes to.
        pending: The bytes of a line that has not ended yet.
        report: What it reported on stdout, known at its end; empty if it did not fly.
    """

    uav: str
    process: subprocess.Popen[bytes]
    screen: int
    out: IO[bytes]
    pending: bytes = b""
    report: dict[str, Any] = field(default_factory=dict)

    def close(self) -> None:
        """It has ended: listen no more, and read its report."""
        os.close(self.screen)
        with self.out, contextlib.suppress(ValueError):
            self.out.seek(0)
            self.report = json.load(self.out)

    def abandon(self) -> None:
        """End it at once: another one could not be started beside it."""
        self.process.kill()
        self.process.wait()
        self.close()

    @property
    def exit_code(self) -> ExitCode:
        """How it ended; one that was killed ended otherwise."""
        try:
            return ExitCode(self.process.wait())
        except ValueError:
            return ExitCode.ENDED_OTHERWISE


class StatusBlock:
    """Draws a block of lines on a terminal, one for each name; elsewhere it prints line by line.

    Args:
        names: Whose lines, from top to bottom.
        out: The terminal; default: stderr.
    """

    def __init__(self, names: Sequence[str], out: TextIO | None = None) -> None:
        self._out = out if out is not None else sys.stderr
        self._lines = dict.fromkeys(names, "")  # the newest of each
        self._width = max(map(len, names), default=0)  # of the names
        self._drawn = 0  # lines to be overwritten
        self.live = self._out.isatty()  # redrawn in place

    @property
    def columns(self) -> int:
        """How much of a line is left beside a name."""
        return max(20, shutil.get_terminal_size().columns - self._width - 2)

    def show(self, name: str, text: str) -> None:
        """Draw a name's status anew; only where the block is live."""
        self._lines[name] = text
        if self.live:
            self._write(self._erased() + self._block())

    def print_line(self, name: str, text: str) -> None:
        """Print a line that stays."""
        line = f"{self._prefix(name)}{text}\n"
        self._write(self._erased() + line + self._block() if self.live else line)

    def end(self) -> None:
        """Leave the block standing and go on below it."""
        if self._drawn:
            self._write("\n")
            self._drawn = 0

    def _prefix(self, name: str) -> str:
        return f"{name:<{self._width}}  "

    def _erased(self) -> str:
        """What takes the block away and puts the cursor where it began."""
        up = f"\x1b[{self._drawn - 1}A" if self._drawn > 1 else ""
        erased = f"\r{up}\x1b[J" if self._drawn else ""
        self._drawn = 0
        return erased

    def _block(self) -> str:
        shown = {name: text for name, text in self._lines.items() if text}
        self._drawn = len(shown)
        room = self.columns - 1  # one line must stay one line
        return "\n".join(f"{self._prefix(name)}{text[:room]}" for name, text in shown.items())

    def _write(self, text: str) -> None:
        self._out.write(text)
        self._out.flush()


class Flights:
    """Runs flights until all have ended.

    Args:
        commands: For each UAV the arguments of `air-router`.
        out: The terminal, stderr by default.
        keyboard: Where requests are typed, stdin by default; anything but a terminal is left alone.
        program: What takes the arguments.
        take_line: Called with the UAV and each line that its flight prints; a line for which it
            returns True is not printed.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        out: TextIO | None = None,
        keyboard: TextIO | None = None,
        *,
        program: Sequence[str] = AIR_ROUTER,
        take_line: Callable[[str, str], bool] = lambda _uav, _line: False,
    ) -> None:
        self._block = StatusBlock(tuple(commands), out)
        self._keyboard = keyboard if keyboard is not None else sys.stdin
        self._interrupted = False  # by a signal
        self._take_line = take_line
        self.flights: list[FlightProcess] = []  # one for each vehicle
        with contextlib.ExitStack() as undo:
            self._selector = undo.enter_context(selectors.DefaultSelector())
            for uav, arguments in commands.items():
                flight = _start(uav, (*program, *arguments), self._block)
                undo.callback(flight.abandon)
                self.flights.append(flight)
            undo.pop_all()

    def run(self) -> ExitCode:
        """Follow all of them to their ends; returns the worst exit code."""
        with contextlib.ExitStack() as stack:
            stack.callback(self._selector.close)
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2):
                stack.callback(signal.signal, number, signal.signal(number, self._on_signal))
            for flight in self.flights:
                self._listen(flight.screen, partial(self._take_output, flight))
            if self._block.live and self._keyboard.isatty():
                self._listen(self._keyboard, self._take_typed)
            while self._more():
                ready = self._selector.select(_LOOK_S)
                for key, _ in ready:
                    if not key.data():
                        self._selector.unregister(key.fileobj)
                if not ready and all(flight.process.poll() is not None for flight in self.flights):
                    break  # a process that one of them has left behind holds its terminal open
            self._block.end()
            codes = {flight.exit_code for flight in self.flights}
            for flight in self.flights:
                flight.close()
        return next(code for code in _GRAVITY if code in codes)

    def _more(self) -> bool:
        """Whether output may still come."""
        keys = self._selector.get_map().values()
        return any(key.fileobj is not self._keyboard for key in keys)

    def _listen(self, source: Any, take: Callable[[], bool]) -> None:
        """Call `take` whenever there is something to read; it answers whether there is more."""
        self._selector.register(source, selectors.EVENT_READ, take)

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        """Hand it on. At the second Ctrl-C they leave at once, and so do we."""
        for flight in self.flights:
            if flight.process.poll() is None:
                flight.process.send_signal(number)
        if number in {signal.SIGINT, signal.SIGTERM}:
            if self._interrupted:
                with contextlib.suppress(RuntimeError):  # we were just writing
                    self._block.end()
                os._exit(ExitCode.INTERRUPTED)
            self._interrupted = True

    def _take_output(self, flight: FlightProcess) -> bool:
        try:
            chunk = os.read(flight.screen, _CHUNK)
        except OSError:  # a terminal whose other end is closed
            chunk = b""
        *whole, flight.pending = (flight.pending + chunk).split(b"\n")
        for line in whole:
            # What stands before the last carriage return was drawn over.
            text = line.rstrip(b"\r").rpartition(b"\r")[2].decode(errors="replace").rstrip()
            if text and not self._take_line(flight.uav, text):
                self._block.print_line(flight.uav, text)
        _, drawn, status = flight.pending.rpartition(b"\r")
        if drawn and status.strip():
            self._block.show(flight.uav, status.decode(errors="replace").rstrip())
        if not chunk:
            self._block.show(flight.uav, "ended")
        return bool(chunk)

    def _take_typed(self) -> bool:
        """`home` goes to all, `titan home` to one."""
        line = line_of(self._keyboard)
        name, _, rest = line.strip().partition(" ")
        names = [flight.uav for flight in self.flights]
        request = rest if name in {*names, _ALL} else line.strip()
        for flight in self.flights if request else ():
            if name in {flight.uav, _ALL} or name not in names:
                with contextlib.suppress(OSError):
                    os.write(flight.screen, f"{request}\n".encode())
        return bool(line) or self._keyboard.isatty()  # Ctrl-D ends nothing


def _start(uav: str, command: Sequence[str], block: StatusBlock) -> FlightProcess:
    """Start one: with a terminal of its own if ours is one, so that it shows its status live.

    Raises:
        OSError: it cannot be started; nothing of it is left.
    """
    with contextlib.ExitStack() as undo:
        out = undo.enter_context(tempfile.TemporaryFile())
        ours, theirs = pty.openpty() if block.live else os.pipe()
        undo.callback(os.close, ours)
        with os.fdopen(theirs, "wb", buffering=0) as screen:
            if block.live:
                _read_by_line(theirs)
            process = subprocess.Popen(  # noqa: S603 - our own program and arguments
                # It ends with us, also if we are killed; the vehicle then holds where its leg ends.
                [sys.executable, "-m", "sitl.process.end_with_parent", str(os.getpid()), *command],
                stdin=screen if block.live else subprocess.DEVNULL,
                stdout=out,
                stderr=screen,
                env={**os.environ, "COLUMNS": str(block.columns)},
                start_new_session=True,  # Ctrl-C comes through us
            )
        undo.pop_all()
    return FlightProcess(uav, process, ours, out)


def _read_by_line(terminal: int) -> None:
    """A terminal that echoes and changes nothing, and yet is read line by line: each a request."""
    tty.setraw(terminal)
    mode = termios.tcgetattr(terminal)
    mode[tty.LFLAG] |= termios.ICANON
    termios.tcsetattr(terminal, termios.TCSANOW, mode)
