"""What the figures share: colours that colour-blind readers can tell apart, panels, legends.

The colours are those of M. Okabe and K. Ito; lines that differ in one setting more differ in their
dashes too, so the figures can be read in black and white.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from air_router.errors import PictureError
from mocha_link.errors import needs_extra
from sitl.experiment.plan import Experiment, Record, Row, words

with needs_extra("a figure", "experiments", "air-router"):
    import matplotlib as mpl
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

INK, FAINT = "#30363d", "#7b838b"
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
DASHES: Final[tuple[Any, ...]] = ("-", (0, (4, 1.6)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)))
_DPI: Final = 140
_MOST_LINES: Final = 9
_MOST_EXAMPLES: Final = 4

_STYLE: Final = Path(__file__).with_name("figures.mplstyle")

PlotRow = Callable[[Axes, Sequence[Record], dict[str, Any]], None]
"""Draws the runs of a row into a panel, as one line."""

PlotExample = Callable[[Axes, Sequence[Record]], None]
"""Draws the runs of a row, or the first of them, into a panel of its own."""


@dataclass(frozen=True, slots=True)
class Chart:
    """How the panels of a figure look.

    Attributes:
        title: Above all of them.
        subtitle: Below it, after the experiment's.
        across, up: What the axes show.
        high: Inches of a panel.
        legend: Where in a panel; panels with the same lines have one together; None: none.
    """

    title: str
    subtitle: str
    across: str = ""
    up: str = ""
    high: float = 2.7
    legend: Literal["upper left", "lower left", "lower right"] | None = None

    def dress(self, one: Axes, *, legend: bool) -> None:
        """Name the axes of a panel, and its lines."""
        one.set_xlabel(self.across)
        one.set_ylabel(self.up)
        if self.legend and legend and one.get_legend_handles_labels()[1]:
            one.legend(loc=self.legend, fontsize=7.5, labelcolor=INK, handlelength=2.4)


def panel_chart(
    chart: Chart, plot: PlotRow, experiment: Experiment, records: Sequence[Record]
) -> Figure:
    """A figure in which each panel has some rows, and each row a line."""
    shown, keys = _panels(experiment, records)
    subtitle = f"{experiment.title}; {chart.subtitle}"
    figure, axes = sheet(len(shown), chart.title, subtitle, high=chart.high)
    before: list[str] = []
    for one, (title, rows) in zip(axes, shown.items(), strict=True):
        labels = [words(row.settings, keys) or row.label for row in rows]
        for row, label, style in zip(rows, labels, _styles(rows, experiment), strict=True):
            plot(one, runs_of(row.label, records), {**style, "label": label})
        one.set_title(title or experiment.title, loc="left")
        chart.dress(one, legend=labels != before)
        before = before or labels
    return figure


def _panels(
    experiment: Experiment, records: Sequence[Record]
) -> tuple[dict[str, list[Row]], list[str]]:
    """The rows that have runs by the panels that they share, and what tells them apart in one.

    Panels go by the first settings, with at most nine lines each.
    """
    labels = {record["row"] for record in records}
    rows = [row for row in experiment.rows if row.label in labels]
    inner, outer = list(experiment.varied), list[str]()

    def groups() -> dict[str, list[Row]]:
        found: dict[str, list[Row]] = {}
        for row in rows:
            found.setdefault(words(row.settings, outer), []).append(row)
        return found

    while inner[:-1] and max(map(len, groups().values()), default=0) > _MOST_LINES:
        outer.append(inner.pop(0))
    if not outer and len(inner) > 2 and len(rows) > 4:
        outer.append(inner.pop(0))
    return groups(), inner


def _styles(rows: Sequence[Row], experiment: Experiment) -> list[dict[str, Any]]:
    """A colour and a dash for each line: the last setting chooses the colour, others the dash."""
    keys = [k for k in experiment.varied if len({str(row.settings.get(k)) for row in rows}) > 1]
    colours = [str(row.settings.get(keys[-1])) if keys else "" for row in rows]
    dashes = [words(row.settings, keys[:-1]) for row in rows]
    if len(set(colours)) == 1:
        colours, dashes = [row.label for row in rows], [""] * len(rows)
    order, kinds = (list(dict.fromkeys(own)) for own in (colours, dashes))
    return [
        {
            "color": COLOURS[order.index(colour) % len(COLOURS)],
            "linestyle": DASHES[kinds.index(dash) % len(DASHES)],
        }
        for colour, dash in zip(colours, dashes, strict=True)
    ]


def example_chart(
    chart: Chart, plot: PlotExample, experiment: Experiment, records: Sequence[Record]
) -> Figure:
    """A figure with a panel for each of a few rows, which are spread over the experiment."""
    labels = {record["row"] for record in records}
    chosen = [row.label for row in experiment.rows if row.label in labels]
    if len(chosen) > _MOST_EXAMPLES:
        steps = _MOST_EXAMPLES - 1
        chosen = [chosen[round(i * (len(chosen) - 1) / steps)] for i in range(_MOST_EXAMPLES)]
    subtitle = f"{experiment.title}; {chart.subtitle}"
    figure, axes = sheet(len(chosen), chart.title, subtitle, high=chart.high)
    for one, label in zip(axes, chosen, strict=True):
        one.set_title(label, loc="left")
        plot(one, runs_of(label, records))
        chart.dress(one, legend=one is axes[0])
    return figure


def styled() -> AbstractContextManager[None]:
    """Everything that is drawn within looks alike."""
    return mpl.rc_context(fname=_STYLE)


def sheet(
    count: int, title: str, subtitle: str, *, high: float = 2.7, columns: int = 2
) -> tuple[Figure, list[Axes]]:
    """A figure with panels, row by row, under one title; each so many inches high."""
    columns = min(columns, count)
    rows = -(-count // columns)
    tall = high * rows + 0.75
    layout = ConstrainedLayoutEngine(rect=(0, 0, 1, 1 - 0.55 / tall))
    figure = Figure(figsize=({1: 6.4, 2: 9.6}.get(columns, 10.8), tall), layout=layout)
    figure.text(0.012, 1 - 0.08 / tall, title, va="top", fontsize=12, fontweight="bold")
    figure.text(0.012, 1 - 0.32 / tall, subtitle, va="top", fontsize=8.5, color=FAINT)
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for empty in axes[count:]:
        empty.set_visible(False)
    return figure, axes[:count]


def runs_of(label: str, records: Sequence[Record]) -> list[Record]:
    """The runs of a row."""
    return [record for record in records if record["row"] == label]


def save(figure: Figure, *paths: Path) -> None:
    """Write a figure; the names' endings choose the formats. Raises PictureError."""
    figure.set_dpi(_DPI)
    figure.draw_without_rendering()  # lays it out, once for all formats
    figure.set_layout_engine("none")
    for path in paths:
        try:
            figure.savefig(path, dpi=_DPI, facecolor="white")
        except (OSError, ValueError) as error:
            raise PictureError(f"cannot write the figure {path}: {error}") from None
