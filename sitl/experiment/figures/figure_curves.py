"""Figures of numbers over time, over distance, and of how they are spread. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from air_router.counted import counted
from sitl.experiment.campaign.links import (
    BUILDINGS_M,
    DISTANCES_M,
    comparison,
    counts_of,
    fitted,
    halves,
    predicted,
)
from sitl.experiment.campaign.plan import Experiment, Record
from sitl.experiment.engine.result import BIN_S, WAIT_EDGES_S
from sitl.experiment.figures.figure_sheet import COLOURS, DASHES, FAINT, INK, sheet
from sitl.experiment.settings import value_of

Numbers = npt.NDArray[np.float64]

_STEP_S = 15.0
_SHOWN = (0, 3, 5, 7)


def plot_goals(one: Axes, runs: Sequence[Record], style: dict[str, Any]) -> None:
    """Goals over time: the mean of all runs, with a band of one standard error."""
    longest_s = max(value_of(run["settings"], "duration_s") for run in runs)
    times_s = np.arange(0, longest_s + _STEP_S, _STEP_S)
    curves = np.array([_reached(run, times_s) for run in runs])
    mean = curves.mean(axis=0)
    one.plot(times_s / 60, mean, lw=1.7, **style)
    if len(curves) > 1:
        error = curves.std(axis=0, ddof=1) / np.sqrt(len(curves))
        band = {"color": style["color"], "alpha": 0.13, "linewidth": 0}
        one.fill_between(times_s / 60, mean - error, mean + error, **band)
    one.set_ylim(0, 100)
    one.set_xlim(0, float(times_s[-1]) / 60)


def _reached(run: Record, times_s: Numbers) -> Numbers:
    total = run["measures"]["goals_total"] or 1
    found = np.sort([visit[1] for visit in run["curves"]["goals"]])
    share: Numbers = 100 * np.searchsorted(found, times_s, side="right") / total
    return share


def plot_waits(one: Axes, runs: Sequence[Record], style: dict[str, Any]) -> None:
    """How long messages wait: the share of them that waited longer than a time."""
    middle_s = WAIT_EDGES_S[1:]
    one.set_xscale("log")
    one.set_yscale("log")
    one.set_xlim(1e-2, 2e3)
    counts = np.zeros(len(WAIT_EDGES_S) - 1)
    for run in runs:
        own = run["curves"]["wait_counts"]
        counts[: len(own)] += own
    if not counts.sum():
        return
    longer = 1 - np.cumsum(counts) / counts.sum()
    seen = longer > 1e-9
    one.plot(middle_s[seen], longer[seen], lw=1.5, **style)
    mean_s = _mean_wait_s(runs)
    height = float(np.interp(np.log(mean_s), np.log(middle_s), longer))
    one.plot(mean_s, height, "o", ms=4, color=style["color"], mec="white", mew=0.7)
    lowest = min((float(np.min(line.get_ydata())) for line in one.get_lines()), default=1.0)
    one.set_ylim(min(max(lowest / 2, 1e-6), 5e-5), 1)


def _mean_wait_s(runs: Sequence[Record]) -> float:
    own = [run["measures"] for run in runs if run["measures"]["waits"]]
    total = sum(run["wait_mean_s"] * run["waits"] for run in own)
    return max(float(total / max(sum(run["waits"] for run in own), 1)), 1e-3)


def plot_bandwidth(one: Axes, runs: Sequence[Record]) -> None:
    """Bandwidth over time of a single run, as the paper's figure of the field."""
    rate = np.array(runs[0]["curves"]["bin_bytes"], dtype=np.float64) / BIN_S / 1e3
    times_min = (np.arange(len(rate)) + 0.5) * BIN_S / 60
    one.bar(times_min, rate, width=BIN_S / 60, color=COLOURS[0], linewidth=0)
    silent = 100 * float(np.mean(rate == 0)) if len(rate) else 0.0
    said = f"mean {rate.mean():.1f} kB/s, silent {silent:.0f} % of the time"
    style: dict[str, Any] = {"ha": "right", "va": "bottom", "color": FAINT, "fontsize": 8}
    one.text(0.995, 1.02, said, transform=one.transAxes, **style)
    one.set_xlim(0, len(rate) * BIN_S / 60)


def plot_ages(one: Axes, runs: Sequence[Record]) -> None:
    """Age of information over time: thin, each ground robot's; thick, their mean."""
    curves = runs[0]["curves"]
    times_min = np.array(curves["curve_times_s"]) / 60
    top_min = 1.0
    for key, colour, dash, what in (
        ("pose_age_s", COLOURS[0], DASHES[0], "ground robots' poses at UAVs"),
        ("map_age_s", COLOURS[2], DASHES[1], "UAVs' maps at ground robots"),
    ):
        ages_min = np.mean([run["curves"][key] for run in runs], axis=0).T / 60
        if ages_min.size:
            one.plot(times_min, ages_min, color=colour, lw=0.7, alpha=0.35)
            mean_min = ages_min.mean(axis=1)
            one.plot(times_min, mean_min, color=colour, linestyle=dash, lw=2, label=what)
            top_min = max(top_min, float(np.max(ages_min)))
    one.plot(times_min, times_min, color=FAINT, lw=0.8, ls=":", label="never heard")
    one.set_title(f"{runs[0]['row']} ({counted(len(runs), 'runs')})", loc="left")
    end_min = max(float(times_min[-1]), 1.0)
    one.set_xlim(0, end_min)
    one.set_ylim(0, min(top_min * 1.25, end_min))


def draw_links(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """How often robots on the ground were in contact, by distance and by what stood between."""
    own = [record for record in records if "links" in record["curves"]]
    learn, test = halves(own)
    if not learn or not test:
        return None
    figure, axes = sheet(
        2,
        "Which links the map foretells",
        f"{experiment.title}; dots: runs that were not learned from, lines: the prediction",
        high=3.3,
    )
    counts = counts_of(test)
    middle_m = (DISTANCES_M[:-1] + DISTANCES_M[1:]) / 2
    style: dict[str, Any]
    for one, (name, found) in zip(axes, comparison(own).items(), strict=True):
        flag = name != "distance"
        chances = predicted(fitted(counts_of(learn), buildings=flag), buildings=flag)
        for place, index in enumerate(_SHOWN):
            cases, linked = counts[:, index, 0], counts[:, index, 1]
            enough, colour = cases >= 20, COLOURS[place]
            seen = 100 * linked[enough] / cases[enough]
            one.plot(middle_m[enough], seen, "o", ms=3.5, color=colour, mew=0)
            style = {"color": INK, "ls": "-"}
            if flag:
                style = {"color": colour, "ls": DASHES[place], "label": _words(index)}
            one.plot(middle_m, 100 * chances[:, index], lw=1.5, **style)
        one.set_title(f"from {name}", loc="left")
        said = f"Brier {found.brier:.4f}, AUC {found.area:.3f}"
        style = {"transform": one.transAxes, "ha": "right", "va": "top", "fontsize": 8}
        one.text(0.98, 0.96, said, **style)
        one.set_xlabel("distance (m)")
        one.set_ylabel("in contact (%)")
        one.set_ylim(-2, 102)
        one.set_xlim(0, float(np.max(middle_m[counts[..., 1].sum(axis=1) > 0], initial=40)) * 1.3)
    axes[1].legend(title="between them", fontsize=7.5, loc="center right", labelcolor=INK)
    return figure


def _words(index: int) -> str:
    low, high = BUILDINGS_M[index : index + 2]
    return "no building" if index == 0 else f"{low:g} to {high:g} m of building"
