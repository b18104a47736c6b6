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


@dataclass(frozen=True, slots=True)
class Panel:
    """Some rows of an experiment that are drawn into the same axes."""

    title: str
    rows: tuple[Row, ...]
    labels: tuple[str, ...]


def panels(experiment: Experiment, records: Sequence[Record]) -> list[Panel]:
    """The rows that have runs, put into panels by their first settings, at most nine lines each."""
    labels = {record["row"] for record in records}
    rows = [row for row in experiment.rows if row.label in labels]
    keys = list(experiment.varied)
    outer: list[str] = []
    while keys[:-1] and _largest(rows, outer) > _MOST_LINES:
        outer.append(keys.pop(0))
    if not outer and len(keys) > 2 and len(rows) > 4:
        outer.append(keys.pop(0))
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(words(row.settings, outer), []).append(row)
    return [
        Panel(
            title or experiment.title,
            tuple(group),
            tuple(words(row.settings, keys) or row.label for row in group),
        )
        for title, group in groups.items()
    ]


def _largest(rows: Sequence[Row], keys: Sequence[str]) -> int:
    counts: dict[str, int] = {}
    for row in rows:
        key = words(row.settings, keys)
        counts[key] = counts.get(key, 0) + 1
    return max(counts.values(), default=0)


def styles(rows: Sequence[Row], keys: Sequence[str]) -> list[dict[str, Any]]:
    """A colour and a dash for each line: the last setting chooses the colour, others the dash."""
    last = keys[-1] if keys else ""
    colours = list(dict.fromkeys(str(row.settings.get(last)) for row in rows))
    dashes = list(dict.fromkeys(words(row.settings, keys[:-1]) for row in rows))
    if len(rows) != len(set(rows)) or len(colours) == 1:
        return [{"color": COLOURS[i % len(COLOURS)], "linestyle": "-"} for i in range(len(rows))]
    return [
        {
            "color": COLOURS[colours.index(str(row.settings.get(last))) % len(COLOURS)],
            "linestyle": DASHES[dashes.index(words(row.settings, keys[:-1])) % len(DASHES)],
        }
        for row in rows
    ]


def examples(experiment: Experiment, records: Sequence[Record]) -> list[Record]:
    """The first runs of a few rows that are spread over the experiment."""
    first: dict[str, Record] = {}
    for record in records:
        first.setdefault(record["row"], record)
    found = [first[row.label] for row in experiment.rows if row.label in first]
    if len(found) <= _MOST_EXAMPLES:
        return found
    last, steps = len(found) - 1, _MOST_EXAMPLES - 1
    return [found[round(i * last / steps)] for i in range(_MOST_EXAMPLES)]


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


PlotRow = Callable[[Axes, Sequence[Record], dict[str, Any]], None]
"""Draws the runs of a row into a panel, as one line."""

PlotExample = Callable[[Axes, Sequence[Record]], None]
"""Draws the runs of a row, or the first of them, into a panel of its own."""


def panel_chart(
    chart: Chart, plot: PlotRow, experiment: Experiment, records: Sequence[Record]
) -> Figure:
    """A figure in which each panel has some rows, and each row a line."""
    shown = panels(experiment, records)
    subtitle = f"{experiment.title}; {chart.subtitle}"
    figure, axes = sheet(len(shown), chart.title, subtitle, high=chart.high)
    for one, panel in zip(axes, shown, strict=True):
        settings = [row.settings for row in panel.rows]
        keys = [k for k in experiment.varied if len({str(own.get(k)) for own in settings}) > 1]
        for row, label, style in zip(
            panel.rows, panel.labels, styles(panel.rows, keys), strict=True
        ):
            plot(one, runs_of(row.label, records), {**style, "label": label})
        one.set_title(panel.title, loc="left")
        chart.dress(one, legend=panel is shown[0] or panel.labels != shown[0].labels)
    return figure


def example_chart(
    chart: Chart, plot: PlotExample, experiment: Experiment, records: Sequence[Record]
) -> Figure:
    """A figure with a panel for each of a few rows."""
    chosen = examples(experiment, records)
    subtitle = f"{experiment.title}; {chart.subtitle}"
    figure, axes = sheet(len(chosen), chart.title, subtitle, high=chart.high)
    for one, example in zip(axes, chosen, strict=True):
        one.set_title(example["row"], loc="left")
        plot(one, runs_of(example["row"], records))
        chart.dress(one, legend=one is axes[0])
    return figure


def styled() -> AbstractContextManager[None]:
    """Everything that is drawn within looks alike."""
    return mpl.rc_context(fname=_STYLE)


def sheet(count: int, title: str, subtitle: str, *, high: float = 2.7) -> tuple[Figure, list[Axes]]:
    """A figure with panels in up to two columns, under one title."""
    columns = 1 if count == 1 else 2
    figure, grid = panel_sheet(-(-count // columns), columns, title, subtitle, high=high)
    axes = [one for row in grid for one in row]
    for empty in axes[count:]:
        empty.set_visible(False)
    return figure, axes[:count]


def panel_sheet(
    rows: int, columns: int, title: str, subtitle: str, *, high: float = 2.4
) -> tuple[Figure, list[list[Axes]]]:
    """A figure with panels in rows and columns, under one title."""
    tall = high * rows + 0.75
    layout = ConstrainedLayoutEngine(rect=(0, 0, 1, 1 - 0.55 / tall))
    figure = Figure(figsize=({1: 6.4, 2: 9.6}.get(columns, 10.8), tall), layout=layout)
    figure.text(0.012, 1 - 0.08 / tall, title, va="top", fontsize=12, fontweight="bold")
    figure.text(0.012, 1 - 0.32 / tall, subtitle, va="top", fontsize=8.5, color=FAINT)
    grid = figure.subplots(rows, columns, squeeze=False)
    return figure, [list(row) for row in grid]


def runs_of(label: str, records: Sequence[Record]) -> list[Record]:
    """The runs of a row."""
    return [record for record in records if record["row"] == label]


def save(figure: Figure, *paths: Path) -> None:
    """Write a figure; the names' endings choose the formats. Raises PictureError."""
    figure.draw_without_rendering()  # lays it out, once for all formats
    figure.set_layout_engine("none")
    for path in paths:
        try:
            figure.savefig(path, dpi=_DPI, facecolor="white")
        except (OSError, ValueError) as error:
            raise PictureError(f"cannot write the figure {path}: {error}") from None
