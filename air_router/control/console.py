"""The operator's requests: what is typed at the terminal, and signals from elsewhere."""

import asyncio
import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from types import MappingProxyType
from typing import Final, TextIO

from air_router.control.command_request import CommandRequest, CommandRequestError, parse_command

SIGNALS: Final = MappingProxyType({signal.SIGUSR1: "home", signal.SIGUSR2: "resume"})
"""What another terminal or a service manager can send: `kill -USR1 PID`, `kill -USR2 PID`."""

_GONE: Final = "the terminal is gone; the flight goes on without it"


@contextlib.contextmanager
def listening(
    deliver: Callable[[CommandRequest], None],
    complain: Callable[[str], None],
    keyboard: TextIO | None = None,
) -> Iterator[None]:
    """Hand what is asked for to `deliver` on the running event loop while this lasts.

    Args:
        deliver: Takes a request.
        complain: Told about words that mean nothing.
        keyboard: A terminal to read; default: stdin. What is no terminal is left alone.
    """
    loop = asyncio.get_running_loop()
    keyboard = keyboard if keyboard is not None else sys.stdin

    def on_line() -> None:
        line = _line_of(keyboard)
        if not line:
            loop.remove_reader(keyboard)
            return
        if not line.strip():
            return
        try:
            command = parse_command(line)
        except CommandRequestError as error:
            complain(f"{error}; or press Ctrl-C")
        else:
            deliver(command)

    typed = keyboard.isatty()
    if typed:
        loop.add_reader(keyboard, on_line)
    loop.add_signal_handler(signal.SIGHUP, complain, _GONE)
    for number, word in SIGNALS.items():
        loop.add_signal_handler(number, deliver, parse_command(word))
    try:
        yield
    finally:
        for number in (signal.SIGHUP, *SIGNALS):
            loop.remove_signal_handler(number)
        if typed:
            loop.remove_reader(keyboard)


def _line_of(keyboard: TextIO) -> str:
    """What was typed; empty once the terminal is gone."""
    try:
        return keyboard.readline()
    except OSError:
        return ""
