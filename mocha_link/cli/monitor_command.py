"""The command `mocha-link monitor`: a running node's links, live in the terminal."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Iterator
from types import FrameType

import click

from mocha_link.cli.links_view import UNREADABLE, NodeView, Style
from mocha_link.cli.program import EXAMPLE, Options, Parsed, coloured, command, endpoint, examples
from mocha_link.lifetime import until_terminated
from mocha_link.service import Subscription

DONE = 0
REDRAW_S = 1.0  # ages grow also when nothing comes
POLL_S = 0.2
FIRST_S = 5.0  # a running node has sent a snapshot by then

_ENTER = "\x1b[?1049h\x1b[?25l"  # another screen, no cursor
_LEAVE = "\x1b[?25h\x1b[?1049l"
_HOME, _END_OF_LINE, _BELOW = "\x1b[H", "\x1b[K", "\x1b[J"


@command(
    "Watch the links of a running node live; q ends it.", examples(f"mocha-link monitor {EXAMPLE}")
)
@click.argument("endpoint", type=Parsed(endpoint), help="endpoint of the node's --metrics")
def run(options: Options) -> int:
    """Show the links until q or Ctrl-C; once, if the output is no terminal.

    Raises MetricsError if no node sends anything within 5 s.
    """
    with Subscription(options.endpoint) as subscription:
        picture = NodeView(options.endpoint)
        deadline_s = time.monotonic() + FIRST_S
        while not picture.ready:
            if not _receive(subscription, picture) and time.monotonic() > deadline_s:
                raise subscription.silent(FIRST_S)
        style = Style(colour=coloured(sys.stdout), unicode=_shows_blocks())
        if not (sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb"):
            _write(picture.printed(style) + "\n")
            return DONE
        with until_terminated(), _screen() as resized:
            _follow(subscription, picture, style, resized)
    return DONE


def _follow(
    subscription: Subscription, picture: NodeView, style: Style, resized: list[bool]
) -> None:
    due_s = 0.0
    while True:
        now_s = time.monotonic()
        if now_s >= due_s or resized:
            resized.clear()
            _draw(picture, style)
            due_s = now_s + REDRAW_S
        if _is_over():
            return
        while _receive(subscription, picture) and time.monotonic() < now_s + POLL_S:
            due_s = 0.0  # all that is there, then one picture of it


def _is_over() -> bool:
    """Whether the user has pressed q."""
    while sys.stdin.isatty() and select.select([sys.stdin], [], [], 0)[0]:
        pressed = os.read(sys.stdin.fileno(), 64)
        if b"q" in pressed or not pressed:
            return True
    return False


def _receive(subscription: Subscription, picture: NodeView, timeout_s: float = POLL_S) -> bool:
    """Take in the next message; False if none has come."""
    message = subscription.next(timeout_s)
    if message is None:
        return False
    try:
        picture.take(*message, time.monotonic())
    except UNREADABLE:
        raise subscription.malformed() from None
    return True


def _draw(picture: NodeView, style: Style) -> None:
    """Overwrite the screen line by line, so that it does not flicker."""
    size = os.get_terminal_size(sys.stdout.fileno())
    lines = picture.lines(size, style, time.monotonic())
    _write(_HOME + "".join(f"{line}{_END_OF_LINE}\r\n" for line in lines) + _BELOW)


@contextlib.contextmanager
def _screen() -> Iterator[list[bool]]:
    """Another screen of the terminal, given back whatever ends us; fills up when it is resized."""
    resized: list[bool] = []

    def note(_number: int, _frame: FrameType | None) -> None:
        resized.append(True)

    with contextlib.ExitStack() as stack:
        stack.callback(signal.signal, signal.SIGWINCH, signal.signal(signal.SIGWINCH, note))
        if sys.stdin.isatty():  # keys come at once, and are not shown
            usual = termios.tcgetattr(sys.stdin)
            stack.callback(termios.tcsetattr, sys.stdin, termios.TCSADRAIN, usual)
            tty.setcbreak(sys.stdin)
        stack.callback(_write, _LEAVE)
        _write(_ENTER)
        yield resized


def _shows_blocks() -> bool:
    try:
        "█▏".encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def _write(text: str) -> None:
    encoding = sys.stdout.encoding or "ascii"
    sys.stdout.write(text.encode(encoding, "replace").decode(encoding))
    sys.stdout.flush()
