"""Figures of runs: goals over time, bandwidth over time, and where robots were.

Needs matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from geo.grid import Terrain
from sitl.experiment.engine.result import BIN_S
from sitl.experiment.figures.sheet import (
    COLOURS,
    DASHES,
    FAINT,
    INK,
    Runs,
    example_panels,
    legend_below,
    rows_with_runs,
    runs_of,
    sheet,
)
from sitl.experiment.plan import Experiment, Record, Row, words
from sitl.experiment.plan_file import files_of
from sitl.experiment.settings import value_of
from sitl.world.towns.town_file import load_town

Numbers = npt.NDArray[np.float64]

_MOST_LINES: Final = 9
_STEP_S: Final = 15.0
_KINDS: Final = {
    "base": ("base station", COLOURS[4], "^"),
    "uav": ("UAV", COLOURS[1], "o"),
    "ugv": ("ground robot", COLOURS[0], "o"),
}
"""What a robot is called, its colour, and the mark at the end of its way."""

_GROUND: Final = {
    Terrain.ROAD: "#ffffff",
    Terrain.BUILDING: "#d5cfc4",
    Terrain.VEGETATION: "#d3e3cd",
}
_TOWN: Final = ListedColormap([_GROUND.get(terrain, "#efede7") for terrain in Terrain])


def draw_goals(experiment: Experiment, records: Sequence[Record]) -> Figure:
    """Goals over time: a line for each row, in panels by the first settings."""
    rows = rows_with_runs(experiment, records)
    inner, outer = list(experiment.varied), list[str]()

    def panels() -> dict[str, list[Row]]:
        found: dict[str, list[Row]] = {}
        for row in rows:
            found.setdefault(words(row.settings, outer), []).append(row)
        return found

    while inner[:-1] and max(map(len, panels().values())) > _MOST_LINES:
        outer.append(inner.pop(0))
    note = f"{experiment.title}; mean of the runs of each team, band: one standard error"
    figure, axes = sheet(len(panels()), "Goals reached over time", note)
    for one, (shared, own) in zip(axes, panels().items(), strict=True):
        for row, colour, dash in zip(own, cycle(COLOURS), cycle(DASHES), strict=False):
            label = words(row.settings, inner) or row.label
            _plot_goals(one, runs_of(row, records), {"color": colour, "ls": dash, "label": label})
        one.set(xlabel="time (min)", ylabel="goals reached (%)", ylim=(0, 100))
        one.set_title(shared or experiment.title, loc="left")
        one.legend(fontsize=7.5, labelcolor=INK, handlelength=2.4)
    return figure


def _plot_goals(one: Axes, runs: Runs, style: dict[str, Any]) -> None:
    longest_s = max(value_of(run["settings"], "duration_s") for run in runs)
    times_s = np.arange(0, longest_s + _STEP_S, _STEP_S)
    curves = np.array([_reached(run, times_s) for run in runs])
    mean = curves.mean(axis=0)
    one.plot(times_s / 60, mean, lw=1.7, **style)
    if len(curves) > 1:
        error = curves.std(axis=0, ddof=1) / np.sqrt(len(curves))
        band = {"color": style["color"], "alpha": 0.13, "linewidth": 0}
        one.fill_between(times_s / 60, mean - error, mean + error, **band)
    one.set_xlim(0, float(times_s[-1]) / 60)


def _reached(run: Record, times_s: Numbers) -> Numbers:
    total = run["measures"]["goals_total"] or 1
    found = np.sort([visit[1] for visit in run["curves"]["goals"]])
    share: Numbers = 100 * np.searchsorted(found, times_s, side="right") / total
    return share


def draw_bandwidth(experiment: Experiment, records: Sequence[Record]) -> Figure:
    """Bandwidth over time of single runs, as the paper's figure of the field."""
    title = "Bandwidth over time, all robots together"
    note = f"the first run of some teams, in bins of {BIN_S:.0f} s"
    return example_panels(title, note, _plot_bandwidth, experiment, records)


def _plot_bandwidth(one: Axes, runs: Runs) -> None:
    rate = np.array(runs[0]["curves"]["bin_bytes"], dtype=np.float64) / BIN_S / 1e3
    times_min = (np.arange(len(rate)) + 0.5) * BIN_S / 60
    one.bar(times_min, rate, width=BIN_S / 60, color=COLOURS[0], linewidth=0)
    silent = 100 * float(np.mean(rate == 0)) if len(rate) else 0.0
    said = f"mean {rate.mean():.1f} kB/s, silent {silent:.0f} % of the time"
    style: dict[str, Any] = {"ha": "right", "va": "bottom", "color": FAINT, "fontsize": 8}
    one.text(0.995, 1.02, said, transform=one.transAxes, **style)
    one.set(xlabel="time (min)", ylabel="kB/s", xlim=(0, len(rate) * BIN_S / 60))


def draw_places(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """Where robots were in the first runs of some rows, over their town."""
    placed = [record for record in records if "places_m" in record["curves"]]
    if not placed:
        return None
    note = "the first run of some teams. Goals: filled where reached"
    plot = partial(_plot_places, Path(experiment.folder))
    figure = example_panels("Where the robots were", note, plot, experiment, placed)
    legend_below(figure)
    return figure


def _plot_places(folder: Path, one: Axes, runs: Runs) -> None:
    run = runs[0]
    town = load_town(files_of(run["settings"], folder)["town"])
    west_m, south_m, east_m, north_m = town.bounds
    edges_m = (west_m, east_m, south_m, north_m)
    ground: dict[str, Any] = {"cmap": _TOWN, "vmin": 0, "vmax": len(Terrain) - 1}
    one.imshow(town.raster.cells, origin="lower", extent=edges_m, **ground)
    places_m = np.array(run["curves"]["places_m"], dtype=np.float64)
    for index, kind in enumerate(run["curves"]["kinds"]):
        what, colour, mark = _KINDS[kind]
        way_m, thin = places_m[:, index], 0.7 if kind == "uav" else 1.1
        one.plot(*way_m.T, color=colour, lw=thin, alpha=0.75, zorder=4, label=what)
        one.plot(*way_m[-1], mark, color=colour, ms=4.5, mec="white", mew=0.5, zorder=5)
    reached = {visit[0] for visit in run["curves"]["goals"]}
    for found, colour, what in (
        (True, COLOURS[2], "goal, reached"),
        (False, "white", "goal, not reached"),
    ):
        goals = run["curves"]["goal_places_m"]
        places = [place for goal, *place in goals if (goal in reached) is found]
        if places:
            style: dict[str, Any] = {"marker": "s", "s": 26, "edgecolor": INK, "linewidth": 0.8}
            one.scatter(*zip(*places, strict=True), color=colour, zorder=7, label=what, **style)
    one.set(xlabel="metres east", ylabel="metres north")
    one.grid(visible=False)
