"""A live picture of a node's links, as lines of text; no terminal needed."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from mocha_link.cli.display import EventFilter, event_line, path_text, signal_text
from mocha_link.sanitize import sanitize

MAX_NEWS = 200
SILENT_S = 3.0  # snapshots come every second
BAR_CELLS = 8
DECADES = 3  # what a bar spans, down from the best link

BOLD, DIM, RED, GREEN, CYAN = "\x1b[1m", "\x1b[2m", "\x1b[31m", "\x1b[32m", "\x1b[36m"
PLAIN = "\x1b[0m"
_COLOURS = {"started": CYAN, "ended": GREEN, "timed_out": RED, "idle": DIM}
_EIGHTHS = " ▏▎▍▌▋▊▉"

Link = Mapping[str, Any]


class Size(NamedTuple):
    """A terminal's."""

    columns: int
    rows: int


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
    """What has been heard of a node."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._links: dict[str, Any] = {}  # the newest answer
        self._heard_s = 0.0  # when it came, monotonic
        self._told = EventFilter()
        self._news: deque[str] = deque(maxlen=MAX_NEWS)  # lines; the newest are last

    @property
    def ready(self) -> bool:
        """Whether there is anything to show."""
        return bool(self._links)

    def take(self, kind: str, fields: dict[str, Any], steady_s: float) -> None:
        """Take in a message of the metrics stream, which came at a steady time.

        Raises KeyError, TypeError, ValueError, AttributeError, OverflowError or OSError if it is
        none.
        """
        if kind == "links":
            _table(fields, 0.0, unicode=True)  # what is strange is found out here
            self._links = fields
        else:
            line = sanitize(event_line(fields, date=False))  # what is strange is found out here
            if self._told.is_new(fields):
                self._news.append(line)
        self._heard_s = steady_s

    def lines(self, size: Size, style: Style, steady_s: float) -> list[str]:
        """The screen at a steady time: title, table, and the latest news in what room is left."""
        silent_s = steady_s - self._heard_s
        title = f"links of {sanitize(str(self._links['robot']))}, {self._endpoint}"
        colour = BOLD
        fault = self._links.get("storage_fault")
        if fault:
            title, colour = f"NOT ON DISK: {sanitize(str(fault))}  {title}", RED
        if silent_s > SILENT_S:
            title, colour = f"NO NEWS FOR {silent_s:.0f} s  {title}", RED
        colours = ["", *(str(link["state"]) for link in self._links["links"].values())]
        table = _table(self._links, silent_s, unicode=style.unicode)
        rows = zip(_fitted(table, size.columns), colours, strict=True)
        lines = [
            style.paint(title[: size.columns], colour),
            *(style.paint(row, _COLOURS.get(state, "")) for row, state in rows),
        ]
        room = size.rows - len(lines) - 2
        if room > 0 and self._news:
            news = list(self._news)[-room:]
            lines += ["", *(style.paint(line[: size.columns], DIM) for line in news)]
        return lines[: max(1, size.rows - 1)]


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
    return [
        "  ".join(
            row[index].rjust(widths[index])
            if index and _COLUMNS[index - 1].right
            else row[index].ljust(widths[index])
            for index in shown
        ).rstrip()[:width]
        for row in table
    ]


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


_COLUMNS = (
    _Column("state", 1, lambda link, _: str(link["state"])),
    _Column("path", 9, lambda link, _: path_text(link)),
    _Column("signal", 2, lambda link, _: signal_text(link), right=True),
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
