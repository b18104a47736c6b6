"""A live line for each of several flights, and their news above."""

import shutil
import sys
from collections.abc import Sequence
from typing import TextIO


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

    def say(self, name: str, text: str) -> None:
        """Print a line of news that stays."""
        news = f"{self._prefix(name)}{text}\n"
        self._write(self._erased() + news + self._block() if self.live else news)

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
