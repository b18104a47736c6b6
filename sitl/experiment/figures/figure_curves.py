"""Figures of numbers over time, over distance, and of how they are spread. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

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
from sitl.experiment.campaign.plan import Experiment, Record, Row
from sitl.experiment.engine.result import BIN_S, WAIT_EDGES_S
from sitl.experiment.figures.figure_sheet import (
    COLOURS,
    DASHES,
    FAINT,
    INK,
    Panel,
    example_sheet,
    panels,
    runs_of,
    sheet,
    styles,
)
from sitl.experiment.settings import value_of

Numbers = npt.NDArray[np.float64]

_STEP_S = 15.0
_Corner = Literal["upper left", "lower left", "lower right"]


def draw_goals(experiment: Experiment, records: Sequence[Record]) -> Figure:
    """Goals over time: the mean of all runs, with a band of one standard error."""
    shown = panels(experiment, records)
    figure, axes = sheet(
        len(shown),
        "Goals reached over time",
        f"{experiment.title}; mean of the runs of each team, band: one standard error",
    )
    for one, panel in zip(axes, shown, strict=True):
        for row, label, style in _lines(experiment, panel):
            found = runs_of(row, records)
            longest_s = max(value_of(run["settings"], "duration_s") for run in found)
            times_s = np.arange(0, longest_s + _STEP_S, _STEP_S)
            curves = np.array([_reached(run, times_s) for run in found])
            mean = curves.mean(axis=0)
            one.plot(times_s / 60, mean, lw=1.7, label=label, **style)
            if len(curves) > 1:
                error = curves.std(axis=0, ddof=1) / np.sqrt(len(curves))
                band = {"color": style["color"], "alpha": 0.13, "linewidth": 0}
                one.fill_between(times_s / 60, mean - error, mean + error, **band)
        _dress(one, panel, "time (min)", "goals reached (%)")
        one.set_ylim(0, 100)
        one.set_xlim(0, float(times_s[-1]) / 60)
        if panel.labels != shown[0].labels or panel is shown[0]:
            _legend(one, loc="lower right")
    return figure


def _reached(run: Record, times_s: Numbers) -> Numbers:
    total = run["measures"]["goals_total"] or 1
    found = np.sort([visit[1] for visit in run["curves"]["goals"]])
    share: Numbers = 100 * np.searchsorted(found, times_s, side="right") / total
    return share


def draw_waits(experiment: Experiment, records: Sequence[Record]) -> Figure:
    """How long messages wait: the share of them that waited longer than a time."""
    shown = panels(experiment, records)
    figure, axes = sheet(
        len(shown),
        "How long messages wait for the channel",
        f"{experiment.title}; all messages of all runs. Dots: the means",
    )
    middle_s = WAIT_EDGES_S[1:]
    for one, panel in zip(axes, shown, strict=True):
        least = 1e-4
        for row, label, style in _lines(experiment, panel):
            counts = np.zeros(len(WAIT_EDGES_S) - 1)
            for run in runs_of(row, records):
                own = run["curves"]["wait_counts"]
                counts[: len(own)] += own
            if not counts.sum():
                continue
            longer = 1 - np.cumsum(counts) / counts.sum()
            seen = longer > 1e-9
            one.plot(middle_s[seen], longer[seen], lw=1.5, label=label, **style)
            least = min(least, longer[seen][-1]) if seen.any() else least
            mean_s = _mean_wait_s(runs_of(row, records))
            height = float(np.interp(np.log(mean_s), np.log(middle_s), longer))
            one.plot(mean_s, height, "o", ms=4, color=style["color"], mec="white", mew=0.7)
        _dress(one, panel, "wait longer than (s)", "share of messages")
        one.set_xscale("log")
        one.set_yscale("log")
        one.set_xlim(1e-2, 2e3)
        one.set_ylim(max(least / 2, 1e-6), 1)
        if panel.labels != shown[0].labels or panel is shown[0]:
            _legend(one, loc="lower left")
    return figure


def _mean_wait_s(runs: Sequence[Record]) -> float:
    own = [run["measures"] for run in runs if run["measures"]["waits"]]
    total = sum(run["wait_mean_s"] * run["waits"] for run in own)
    return max(float(total / max(sum(run["waits"] for run in own), 1)), 1e-3)


def draw_bandwidth(experiment: Experiment, records: Sequence[Record]) -> Figure:
    """Bandwidth over time of single runs, as the paper's figure of the field."""
    figure, shown = example_sheet(
        experiment,
        records,
        "Bandwidth over time, all robots together",
        f"the first run of some teams, in bins of {BIN_S:.0f} s",
        high=2.1,
    )
    for one, run in shown:
        rate = np.array(run["curves"]["bin_bytes"], dtype=np.float64) / BIN_S / 1e3
        times_min = (np.arange(len(rate)) + 0.5) * BIN_S / 60
        one.bar(times_min, rate, width=BIN_S / 60, color=COLOURS[0], linewidth=0)
        silent = 100 * float(np.mean(rate == 0)) if len(rate) else 0.0
        one.text(
            0.995,
            1.02,
            f"mean {rate.mean():.1f} kB/s, silent {silent:.0f} % of the time",
            transform=one.transAxes,
            ha="right",
            va="bottom",
            color=FAINT,
            fontsize=8,
        )
        one.set_xlabel("time (min)")
        one.set_ylabel("kB/s")
        one.set_xlim(0, len(rate) * BIN_S / 60)
    return figure


def draw_ages(experiment: Experiment, records: Sequence[Record]) -> Figure:
    """Age of information: how old the others' newest word of each robot is."""
    figure, shown = example_sheet(
        experiment,
        records,
        "Age of information",
        "age of the others' newest word of each robot, mean of the runs",
    )
    for one, example in shown:
        runs = [record for record in records if record["row"] == example["row"]]
        times_min = np.array(example["curves"]["curve_times_s"]) / 60
        ages_s = np.mean([run["curves"]["pose_age_s"] for run in runs], axis=0)
        maps_s = np.mean([run["curves"]["map_age_s"] for run in runs], axis=0)
        kinds = example["curves"]["kinds"]
        for kind, colour, what in (
            ("ugv", COLOURS[0], "ground robots' poses"),
            ("uav", COLOURS[1], "UAVs' poses"),
        ):
            own = ages_s[:, [k == kind for k in kinds]] / 60
            if own.size:
                one.plot(times_min, own, color=colour, lw=0.7, alpha=0.35)
                one.plot(times_min, own.mean(axis=1), color=colour, lw=2, label=what)
        own = maps_s[:, [k == "ugv" for k in kinds]] / 60
        if own.size:
            style: dict[str, Any] = {"color": COLOURS[2], "linestyle": (0, (4, 1.6))}
            one.plot(
                times_min, own.mean(axis=1), lw=2, label="the UAV's map at ground robots", **style
            )
        one.plot(times_min, times_min, color=FAINT, lw=0.8, ls=":", label="never heard")
        one.set_title(f"{example['row']} ({counted(len(runs), 'runs')})", loc="left")
        one.set_xlabel("time (min)")
        one.set_ylabel("age (min)")
        end_min = max(float(times_min[-1]), 1.0)
        one.set_xlim(0, end_min)
        top = max(float(np.max(ages_s)), float(np.max(maps_s))) / 60
        one.set_ylim(0, min(max(top, 1) * 1.25, end_min))
    shown[0][0].legend(loc="upper left", fontsize=7.5, labelcolor=INK)
    return figure


def _lines(experiment: Experiment, panel: Panel) -> list[tuple[Row, str, dict[str, Any]]]:
    """Each row of a panel, what it is called there, and how it is drawn."""
    keys = [
        key for key in experiment.varied if len({str(r.settings.get(key)) for r in panel.rows}) > 1
    ]
    return list(zip(panel.rows, panel.labels, styles(panel.rows, keys), strict=True))


def _dress(one: Axes, panel: Panel, across: str, up: str) -> None:
    one.set_title(panel.title, loc="left")
    one.set_xlabel(across)
    one.set_ylabel(up)


def _legend(one: Axes, loc: _Corner) -> None:
    if one.get_legend_handles_labels()[1]:
        one.legend(loc=loc, fontsize=7.5, labelcolor=INK, handlelength=2.4)


_SHOWN = (0, 3, 5, 7)


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
    chances = {
        flag: predicted(fitted(counts_of(learn), buildings=flag), buildings=flag)
        for flag in (False, True)
    }
    for one, flag, title in (
        (axes[0], False, "from the distance alone"),
        (axes[1], True, "from the distance and the map"),
    ):
        for place, index in enumerate(_SHOWN):
            cases, linked = counts[:, index, 0], counts[:, index, 1]
            enough = cases >= 20
            colour = COLOURS[place]
            one.plot(
                middle_m[enough],
                100 * linked[enough] / cases[enough],
                "o",
                ms=3.5,
                color=colour,
                mew=0,
            )
            line = chances[flag][:, index]
            label = _words(index) if flag else None
            one.plot(
                middle_m,
                100 * line,
                color=colour if flag else INK,
                lw=1.5,
                ls=DASHES[place] if flag else "-",
                label=label,
            )
        found = comparison(own)["distance and map" if flag else "distance"]
        one.set_title(title, loc="left")
        one.text(
            0.98,
            0.96,
            f"Brier {found.brier:.4f}, AUC {found.area:.3f}",
            transform=one.transAxes,
            ha="right",
            va="top",
            fontsize=8,
        )
        one.set_xlabel("distance (m)")
        one.set_ylabel("in contact (%)")
        one.set_ylim(-2, 102)
        one.set_xlim(0, float(np.max(middle_m[counts[..., 1].sum(axis=1) > 0], initial=40)) * 1.3)
    axes[1].legend(title="between them", fontsize=7.5, loc="center right", labelcolor=INK)
    return figure


def _words(index: int) -> str:
    low, high = BUILDINGS_M[index : index + 2]
    return "no building" if index == 0 else f"{low:g} to {high:g} m of building"
