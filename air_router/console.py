"""The operator's word: what is typed at the terminal, and signals from elsewhere."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from types import MappingProxyType
from typing import Final, TextIO

from air_router.events import Request

WORDS: Final = MappingProxyType({"home": Request.COME_HOME, "resume": Request.RESUME})
"""What can be typed, followed by Enter."""

SIGNALS: Final = MappingProxyType(
    {signal.SIGUSR1: Request.COME_HOME, signal.SIGUSR2: Request.RESUME}
)
"""What another terminal or a service manager can send: `kill -USR1 PID`, `kill -USR2 PID`."""


@contextlib.contextmanager
def listening(
    deliver: Callable[[Request], None],
    complain: Callable[[str], None],
    keyboard: TextIO | None = None,
) -> Iterator[None]:
    """Hand requests to `deliver` on the running event loop while this lasts.

    Args:
        deliver: Takes a request.
        complain: Told about a word that means nothing.
        keyboard: A terminal to read; default: stdin. What is no terminal is left alone.
    """
    loop = asyncio.get_running_loop()
    keyboard = keyboard if keyboard is not None else sys.stdin

    def on_line() -> None:
        line = keyboard.readline()
        if not line:  # the terminal is gone
            loop.remove_reader(keyboard)
            return
        word = line.strip().lower()
        if word in WORDS:
            deliver(WORDS[word])
        elif word:
            complain(f"'{word}' means nothing here; type {' or '.join(WORDS)}, or press Ctrl-C")

    typed = keyboard.isatty()
    if typed:
        loop.add_reader(keyboard, on_line)
    for number, request in SIGNALS.items():
        loop.add_signal_handler(number, deliver, request)
    try:
        yield
    finally:
        for number in SIGNALS:
            loop.remove_signal_handler(number)
        if typed:
            loop.remove_reader(keyboard)
