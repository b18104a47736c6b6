"""What people read of a node: its links as a table, its events as lines; no terminal needed."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple

from mocha_link.sanitize import sanitize

MAX_EVENTS = 200
SILENT_S = 3.0  # snapshots come every second
BAR_CELLS = 8
DECADES = 3  # what a bar spans, down from the best link

BOLD, DIM, RED, GREEN, CYAN = "\x1b[1m", "\x1b[2m", "\x1b[31m", "\x1b[32m", "\x1b[36m"
PLAIN = "\x1b[0m"
_COLOURS = {"started": CYAN, "ended": GREEN, "timed_out": RED, "idle": DIM}
_EIGHTHS = " ▏▎▍▌▋▊▉"

Link = Mapping[str, Any]

UNREADABLE = (KeyError, TypeError, ValueError, AttributeError, OverflowError, OSError)
"""What comes of a message that is not a node's metrics."""


def event_line(fields: dict[str, Any], *, date: bool = True) -> str:
    """One event, given as `server.as_fields` has it and `event`, its type."""
    hidden = {"event", "peer", "at_s"}
    if "signal" in fields:
        hidden.add("rssi_dbm")  # the same
    if fields.get("complete") is True:
        hidden.add("complete")
    parts = [f"{key}={_shown(value)}" for key, value in fields.items() if key not in hidden]
    at = datetime.fromtimestamp(fields["at_s"], UTC).isoformat(timespec="milliseconds")
    at = at[:-6] if date else at[11:-6]
    return " ".join([f"{at}Z", str(fields["event"]), str(fields["peer"]), *parts])


def _shown(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, dict):  # a reading of a radio
        return " ".join(
            f"{part:g}" if isinstance(part, float) else str(part) for part in value.values()
        )
    return f"{value:.3f}" if isinstance(value, float) else str(value)


class EventFilter:
    """Selects the events that deserve a line for a person who watches a node.

    Left out is what only repeats: that a sync begins, that one found nothing new after another
    that came to its end, and that one breaks off for the same reason as the one before.
    """

    def __init__(self) -> None:
        self._outcomes: dict[tuple[str, str], str | None] = {}  # of the last sync, by link

    def is_new(self, fields: dict[str, Any]) -> bool:
        """Whether to show an event, given as for `event_line`."""
        kind = fields["event"]
        if kind == "SyncStarted":
            return False
        if kind not in ("SyncEnded", "SyncTimedOut"):
            return True
        link = (fields["peer"], fields["direction"])
        known, before = link in self._outcomes, self._outcomes.get(link)
        self._outcomes[link] = fields.get("reason")
        brought = bool(fields.get("messages")) or fields.get("complete") is False
        return brought or not known or before != fields.get("reason")


PRINTED = os.terminal_size((200, 100))  # columns and rows, without a terminal


@dataclass(frozen=True, slots=True)
class Style:
    """What the terminal can show."""

    colour: bool = True
    unicode: bool = True  # beyond ASCII

    def paint(self, text: str, colour: str) -> str:
        """The text in a colour, if there are colours."""
        return f"{colour}{text}{PLAIN}" if self.colour and colour else text


class _CellContext(NamedTuple):
    """What a cell needs to know beside its link."""

    now_s: float  # Unix time of the node
    later_s: float  # since the snapshot
    best_bytes_s: float  # a full bar
    unicode: bool


class _Column(NamedTuple):
    """One column; the one with the highest rank goes first when the terminal is too narrow."""

    head: str  # heading
    rank: int  # least important: highest
    cell: Callable[[Link, _CellContext], str]
    right: bool = False  # aligned


class NodeView:
    """The metrics and events received from a node."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._links: dict[str, Any] = {}  # the newest snapshot
        self._received_s = 0.0  # when it came, monotonic
        self._filter = EventFilter()
        self._events: deque[str] = deque(maxlen=MAX_EVENTS)  # lines; the newest are last

    @property
    def ready(self) -> bool:
        """Whether there is anything to show."""
        return bool(self._links)

    def printed(self, style: Style) -> str:
        """The newest snapshot, for an output that is no terminal."""
        return "\n".join(self.lines(PRINTED, style, self._received_s))

    def take(self, kind: str, fields: dict[str, Any], steady_s: float) -> None:
        """Take in a message of the metrics stream, which came at a steady time.

        Raises one of `UNREADABLE` if it is none.
        """
        if kind == "links":
            _table(fields, 0.0, unicode=True)  # malformed fields raise here
            self._links = fields
        else:
            line = sanitize(event_line(fields, date=False))  # malformed fields raise here
            if self._filter.is_new(fields):
                self._events.append(line)
        self._received_s = steady_s

    def lines(self, size: os.terminal_size, style: Style, steady_s: float) -> list[str]:
        """The screen at a steady time.

        Title, table, and the latest events in the remaining rows.
        """
        silent_s = steady_s - self._received_s
        title = f"links of {sanitize(str(self._links['robot']))}, {self._endpoint}"
        colour = BOLD
        fault = self._links.get("storage_fault")
        if fault:
            title, colour = f"NOT ON DISK: {sanitize(str(fault))}  {title}", RED
        if silent_s > SILENT_S:
            title, colour = f"NO DATA FOR {silent_s:.0f} s  {title}", RED
        colours = ["", *(str(link["state"]) for link in self._links["links"].values())]
        table = _table(self._links, silent_s, unicode=style.unicode)
        rows = zip(_fitted(table, size.columns), colours, strict=True)
        lines = [
            style.paint(title[: size.columns], colour),
            *(style.paint(row, _COLOURS.get(state, "")) for row, state in rows),
        ]
        room = size.lines - len(lines) - 2
        if room > 0 and self._events:
            events = list(self._events)[-room:]
            lines += ["", *(style.paint(line[: size.columns], DIM) for line in events)]
        return lines[: max(1, size.lines - 1)]


def _table(fields: Mapping[str, Any], later_s: float, *, unicode: bool) -> list[list[str]]:
    """The cells of the table, with its head."""
    str(fields["robot"])
    links: Mapping[str, Link] = fields["links"]
    best = max((link["bandwidth_bytes_s"] or 0 for link in links.values()), default=0)
    context = _CellContext(fields["at_s"] + later_s, later_s, best, unicode)
    return [
        ["peer", *(column.head for column in _COLUMNS)],
        *(
            [sanitize(peer), *(sanitize(column.cell(link, context)) for column in _COLUMNS)]
            for peer, link in links.items()
        ),
    ]


def _fitted(table: Sequence[Sequence[str]], width: int) -> list[str]:
    """The rows with as many columns as there is room for; the peer always."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    shown = list(range(len(widths)))
    for index in sorted(shown[1:], key=lambda index: -_COLUMNS[index - 1].rank):
        if sum(widths[each] + 2 for each in shown) - 2 <= width:
            break
        shown.remove(index)
    rows = [[row[index] for index in shown] for row in table]
    right = {place for place, index in enumerate(shown) if index and _COLUMNS[index - 1].right}
    return [line[:width] for line in aligned(rows, right)]


def _age(seconds: float | None) -> str:
    """An age in at most five letters."""
    if seconds is None:
        return "-"
    seconds = max(0.0, seconds)
    for limit_s, unit, length_s in ((100, "s", 1), (6000, "m", 60), (360_000, "h", 3600)):
        if seconds < limit_s:
            value = seconds / length_s
            return f"{value:.1f}{unit}" if value < 10 else f"{value:.0f}{unit}"
    return f"{min(seconds / 86_400, 9999):.0f}d"


def _since(then_s: float | None, context: _CellContext) -> str:
    return _age(None if then_s is None else context.now_s - then_s)


def _bytes(count: float | None) -> str:
    """A number of bytes in at most five letters."""
    if count is None:
        return "-"
    value, unit = float(count), "B"
    for larger in ("k", "M", "G", "T"):
        if value < 1000:
            break
        value, unit = value / 1000, larger
    return f"{value:.0f}{unit}" if unit == "B" or value >= 100 else f"{value:.1f}{unit}"


def _bandwidth(link: Link, context: _CellContext) -> str:
    """A figure and a bar, whose scale is of decades down from the best link."""
    value = link["bandwidth_bytes_s"] or 0
    if value <= 0:
        return "-".rjust(5)
    share = max(0.0, 1 + math.log10(value / context.best_bytes_s) / DECADES)
    eighths = max(1, round(share * BAR_CELLS * 8))
    if context.unicode:
        bar = "█" * (eighths // 8) + _EIGHTHS[eighths % 8].strip()
    else:
        bar = "#" * max(1, eighths // 8)
    return f"{_bytes(value).rjust(5)} {bar}"


def _rtt(link: Link, _: _CellContext) -> str:
    rtt_s = link["rtt_smoothed_s"]
    if rtt_s is None:
        return "-"
    return f"{rtt_s * 1000:.0f} ms" if rtt_s >= 0.01 else f"{rtt_s * 1000:.1f} ms"


def _grown(age_s: float | None, context: _CellContext) -> str:
    return _age(None if age_s is None else age_s + context.later_s)


def _topics(link: Link, context: _CellContext) -> str:
    ages_s = sorted((link.get("topic_ages_s") or {}).items(), key=lambda item: float(item[1]))
    return " ".join(f"{topic} {_grown(age_s, context)}" for topic, age_s in ages_s[:4]) or "-"


def _path(link: Link) -> str:
    """What the last exchange with a peer went over, and whether it is encrypted."""
    path = str(link.get("path") or "-")
    return f"{path} key" if link.get("protected") else path


def _signal(link: Link) -> str:
    """The signal of a peer with unit and source, from the fields of its metrics."""
    signal = link.get("signal")
    if signal is None:
        return "-" if link["rssi_dbm"] is None else f"{link['rssi_dbm']:.1f} dBm"
    unit = "dB SNR" if signal["unit"] == "dB" else str(signal["unit"])
    return f"{signal['value']:.0f} {unit} {signal['source']}"


_COLUMNS = (
    _Column("state", 1, lambda link, _: str(link["state"])),
    _Column("path", 9, lambda link, _: _path(link)),
    _Column("signal", 2, lambda link, _: _signal(link), right=True),
    _Column("in", 3, lambda link, context: _since(link["last_sync_in_s"], context), right=True),
    _Column("out", 4, lambda link, context: _since(link["last_sync_out_s"], context), right=True),
    _Column("RTT", 7, _rtt, right=True),
    _Column("bandwidth/s", 6, _bandwidth),
    _Column("got", 8, lambda link, _: _bytes(link["bytes_in"]), right=True),
    _Column("gave", 10, lambda link, _: _bytes(link["bytes_out"]), right=True),
    _Column("broken", 11, lambda link, _: str(link["timeouts"]), right=True),
    _Column("refused", 12, lambda link, _: str(link.get("refused", "-")), right=True),
    _Column("newest", 5, lambda link, context: _grown(link["newest_age_s"], context), right=True),
    _Column("by topic", 13, _topics),
)


def aligned(rows: Sequence[Sequence[str]], right: Collection[int] = ()) -> list[str]:
    """Rows as lines of text, their columns one below the other, those in `right` at its right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if place in right else cell.ljust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
