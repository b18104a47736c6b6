"""The figures of an experiment, drawn from its finished runs; those that compare rows.

Ours and the paper's, with 95 % confidence intervals. Needs matplotlib.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from air_router.counted import counted
from sitl.experiment.analysis.statistics import Interval
from sitl.experiment.analysis.tables import Line, lines, of_the_paper
from sitl.experiment.engine.result import BIN_S
from sitl.experiment.figures.plots import (
    draw_links,
    draw_places,
    plot_ages,
    plot_bandwidth,
    plot_contacts,
    plot_goals,
    plot_waits,
)
from sitl.experiment.figures.sheet import (
    COLOURS,
    FAINT,
    INK,
    Chart,
    example_chart,
    panel_chart,
    save,
    sheet,
    styled,
)
from sitl.experiment.plan import Experiment, Record, words

_MEASURES: Final = (
    ("goals_percent", "goals_percent", "goals reached (%)", False),
    ("time_min", "mean_time_min", "time to a goal (min)", False),
    ("wait_mean_s", "wait_mean_s", "message wait, mean (s)", True),
)
_COMPARED: Final = (
    ("goals_percent", "goals reached (%)"),
    ("goal_area_percent", "goals reached, mean over time (%)"),
    ("pose_age_s", "age of poses at UAVs (s)"),
    ("map_age_s", "age of maps at ground robots (s)"),
    ("wait_mean_s", "message wait, mean (s)"),
    ("sent_mb", "sent (MB)"),
)
_MOST_ROWS: Final = 16


def draw_table(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """The paper's table as curves over the radius, ours beside the paper's."""
    found = lines(experiment, records)
    if not of_the_paper(experiment):
        return None
    sizes = sorted({line.settings["ugvs"] for line in found})
    figure, axes = sheet(
        len(_MEASURES) * len(sizes),
        "Our runs beside the paper's table",
        "Filled, with 95 % confidence intervals: ours. Hollow and dashed: the paper's",
        high=2.4,
        columns=len(sizes),
    )
    for place, (ours, theirs, label, logarithmic) in enumerate(_MEASURES):
        row = axes[place * len(sizes) : (place + 1) * len(sizes)]
        for size, one in zip(sizes, row, strict=True):
            team = [line for line in found if line.settings["ugvs"] == size]
            _draw_team(one, team, ours, theirs)
            one.set_title(counted(size, "ground robots"), loc="left")
            one.set_xlabel("radius (m)")
            one.set_ylabel(label)
            if logarithmic:
                _logarithmic(one)
        low = min(one.get_ylim()[0] for one in row)
        high = max(one.get_ylim()[1] for one in row)
        for one in row:
            one.set_ylim(low, high)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, labelcolor=INK)
    return figure


def _logarithmic(one: Axes) -> None:
    """A logarithmic axis with numbers that people read: 0.2, 0.5, 1, 2."""
    one.set_yscale("log")
    one.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    one.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    one.yaxis.set_minor_locator(NullLocator())


def _draw_team(one: Axes, team: Sequence[Line], ours: str, theirs: str) -> None:
    for uavs, colour, marker, shift in ((1, COLOURS[0], "o", -0.35), (2, COLOURS[1], "s", 0.35)):
        own = sorted(
            (line for line in team if line.settings["uavs"] == uavs),
            key=lambda line: line.settings["radius_m"],
        )
        if not own:
            continue
        radii_m = np.array([line.settings["radius_m"] for line in own]) + shift
        style: dict[str, Any] = {"color": colour, "marker": marker, "ms": 5}
        values = [line.values[ours] for line in own]
        _bars(one, radii_m, values, {**style, "label": f"{counted(uavs, 'UAVs')}, ours"})
        paper = [getattr(line.paper, theirs) if line.paper else np.nan for line in own]
        hollow: dict[str, Any] = {"linestyle": (0, (3, 2)), "mfc": "white", "lw": 1, "zorder": 2}
        one.plot(radii_m, paper, label=f"{counted(uavs, 'UAVs')}, paper", **style, **hollow)


def _bars(one: Axes, across: Any, found: Sequence[Interval], style: dict[str, Any]) -> None:
    value, low, high = np.array(found, dtype=np.float64).T
    reach = np.maximum(np.nan_to_num([value - low, high - value]), 0)
    one.errorbar(across, value, yerr=reach, lw=1.6, elinewidth=1.1, capsize=2.5, zorder=3, **style)


def draw_comparison(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """Every row's goals, times, ages and waits, one dot each."""
    found = lines(experiment, records)
    if not 1 < len(found) <= _MOST_ROWS:
        return None
    first = experiment.varied[:1]
    groups = [words(line.settings, first) for line in found]
    order = list(dict.fromkeys(groups))
    figure, axes = sheet(
        len(_COMPARED),
        "The rows compared",
        f"{experiment.title}; means with 95 % confidence intervals",
        high=0.9 + 0.19 * len(found),
    )
    height = np.arange(len(found))[::-1]
    for one, (measure, label) in zip(axes, _COMPARED, strict=True):
        for line, group, up in zip(found, groups, height, strict=True):
            estimate = line.values[measure]
            colour = COLOURS[order.index(group) % len(COLOURS)]
            if not np.isnan(estimate.low):
                one.plot([estimate.low, estimate.high], [up, up], color=colour, lw=1.6)
            one.plot(estimate.value, up, "o", color=colour, ms=5)
        one.set_yticks(height, [line.label for line in found], fontsize=7.5)
        one.set_xlabel(label)
        one.set_ylim(-0.7, len(found) - 0.3)
        one.grid(visible=True, axis="x")
        one.margins(x=0.08)
        one.tick_params(axis="y", length=0, labelcolor=INK, color=FAINT)
    return figure


FOLDER: Final = "figures"


_GOALS: Final = Chart(
    "Goals reached over time",
    "mean of the runs of each team, band: one standard error",
    "time (min)",
    "goals reached (%)",
    legend="lower right",
)
_WAITS: Final = Chart(
    "How long messages wait for the channel",
    "all messages of all runs. Dots: the means",
    "wait longer than (s)",
    "share of messages",
    legend="lower left",
)
_BANDWIDTH: Final = Chart(
    "Bandwidth over time, all robots together",
    f"the first run of some teams, in bins of {BIN_S:.0f} s",
    "time (min)",
    "kB/s",
    high=2.1,
)
_CONTACTS: Final = Chart(
    "Who met whom",
    "the wider a line, the longer the contact, mean of the runs. Orange: UAVs, blue: ground robots",
    high=3.2,
)
_AGES: Final = Chart(
    "Age of information",
    "thin: of each ground robot, thick: their mean; mean of the runs",
    "time (min)",
    "age (min)",
    legend="upper left",
)
_FIGURES: Final[Mapping[str, Callable[[Experiment, Sequence[Record]], Figure | None]]] = {
    "table": draw_table,
    "compare": draw_comparison,
    "goals": partial(panel_chart, _GOALS, plot_goals),
    "waits": partial(panel_chart, _WAITS, plot_waits),
    "bandwidth": partial(example_chart, _BANDWIDTH, plot_bandwidth),
    "places": draw_places,
    "contacts": partial(example_chart, _CONTACTS, plot_contacts),
    "ages": partial(example_chart, _AGES, plot_ages),
    "links": draw_links,
}
"""In the order in which to look at them."""


def draw_all(experiment: Experiment, records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw every figure into DIR/figures, as PNG and for papers as PDF.

    Returns the PNG files, in the order in which to look at them.

    Raises:
        PictureError: a file cannot be written.
    """
    into = folder / FOLDER
    into.mkdir(exist_ok=True)
    drawn = []
    for name, draw in _FIGURES.items():
        path = into / f"{name}.png"
        with styled():
            figure = draw(experiment, records)
            if figure is not None:
                save(figure, path, path.with_suffix(".pdf"))
                drawn.append(path)
    return drawn
