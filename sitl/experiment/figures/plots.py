"""Figures of runs: numbers over time and how they are spread, links, places, meetings.

Needs matplotlib.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from air_router.counted import counted
from sitl.experiment.analysis.links import comparison, counts_of, halves
from sitl.experiment.engine.result import BIN_S, BUILDINGS_M, DISTANCES_M, WAIT_EDGES_S
from sitl.experiment.figures.sheet import COLOURS, DASHES, FAINT, INK, Chart, example_chart, sheet
from sitl.experiment.plan import Experiment, Record
from sitl.experiment.plan_file import town_file
from sitl.experiment.settings import value_of
from sitl.world.towns.town import Town
from sitl.world.towns.town_file import load_town

Numbers = npt.NDArray[np.float64]

_STEP_S = 15.0
_SHOWN = (0, 3, 5, 7)
_KINDS = {"base": COLOURS[4], "uav": COLOURS[1], "ugv": COLOURS[0]}
_WORDS = {"base": "base station", "uav": "UAV", "ugv": "ground robot"}
_BUILDING, _GREEN, _STREET, _GROUND = "#d5cfc4", "#d3e3cd", "#ffffff", "#efede7"


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
    if not all(halves(own)):
        return None
    figure, axes = sheet(
        2,
        "Which links the map foretells",
        f"{experiment.title}; dots: runs that were not learned from, lines: the prediction",
        high=3.3,
    )
    counts = counts_of(halves(own)[1])
    middle_m = (DISTANCES_M[:-1] + DISTANCES_M[1:]) / 2
    style: dict[str, Any]
    for one, (name, found) in zip(axes, comparison(own).items(), strict=True):
        for place, index in enumerate(_SHOWN):
            cases, linked = counts[:, index, 0], counts[:, index, 1]
            enough, colour = cases >= 20, COLOURS[place]
            seen = 100 * linked[enough] / cases[enough]
            one.plot(middle_m[enough], seen, "o", ms=3.5, color=colour, mew=0)
            style = {"color": INK, "ls": "-"}
            if name != "distance":
                style = {"color": colour, "ls": DASHES[place], "label": _words(index)}
            one.plot(middle_m, 100 * found.chance[:, index], lw=1.5, **style)
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


def draw_places(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """Where robots were in the first runs of some rows, over their town."""
    placed = [record for record in records if "places_m" in record["curves"]]
    if not placed:
        return None
    chart = Chart(
        "Where the robots were",
        "the first run of some teams. Goals: filled where reached",
        "metres east",
        "metres north",
        high=3.4,
    )
    figure = example_chart(chart, partial(_draw_run, experiment), experiment, placed)
    handles: dict[str, Any] = {}
    for one in figure.axes:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=5, fontsize=8
    )
    return figure


def _draw_run(experiment: Experiment, one: Axes, runs: Sequence[Record]) -> None:
    town = load_town(town_file(runs[0]["settings"]["town"], Path(experiment.folder)))
    _draw_town(one, town)
    _draw_ways(one, runs[0])
    _draw_goals(one, runs[0])
    one.set_aspect("equal")
    one.grid(visible=False)
    one.set_xlim(town.bounds.west_m, town.bounds.east_m)
    one.set_ylim(town.bounds.south_m, town.bounds.north_m)


def _draw_town(one: Axes, town: Town) -> None:
    one.set_facecolor(_GROUND)
    for road in town.roads:
        one.plot(
            *zip(*road.points, strict=True), color=_STREET, lw=3.2, zorder=1, solid_capstyle="round"
        )
    for rings, colour in ((town.vegetation, _GREEN), (town.buildings, _BUILDING)):
        for ring in rings:
            one.add_patch(Polygon(ring, facecolor=colour, edgecolor="none", zorder=2))


def _draw_ways(one: Axes, run: Record) -> None:
    places_m = np.array(run["curves"]["places_m"], dtype=np.float64)
    told: set[str] = set()
    for index, kind in enumerate(run["curves"]["kinds"]):
        way = places_m[:, index]
        label = "_" if kind in told else _WORDS[kind]
        told.add(kind)
        if kind == "base":
            one.plot(*way[0], "^", color=_KINDS[kind], ms=7, mec="white", zorder=6, label=label)
            continue
        thin = {"uav": 0.7, "ugv": 1.1}[kind]
        one.plot(
            way[:, 0], way[:, 1], color=_KINDS[kind], lw=thin, alpha=0.75, zorder=4, label=label
        )
        one.plot(*way[-1], "o", color=_KINDS[kind], ms=3.5, mec="white", mew=0.5, zorder=5)


def _draw_goals(one: Axes, run: Record) -> None:
    reached = {visit[0] for visit in run["curves"]["goals"]}
    for found, colour, label in (
        (True, COLOURS[2], "goal, reached"),
        (False, "white", "goal, not reached"),
    ):
        goals = run["curves"].get("goal_places_m", [])  # none in runs of before
        places = [place for goal, *place in goals if (goal in reached) is found]
        if places:
            style: dict[str, Any] = {"marker": "s", "s": 26, "edgecolor": INK, "linewidth": 0.8}
            one.scatter(*zip(*places, strict=True), color=colour, zorder=7, label=label, **style)


def plot_contacts(one: Axes, runs: Sequence[Record]) -> None:
    """Who met whom for how long: the mean of the runs of a row."""
    names, kinds = runs[0]["curves"]["robots"], runs[0]["curves"]["kinds"]
    places = _around(kinds)
    total: dict[tuple[int, int], float] = {}
    for run in runs:
        for a, b, _, time_s in run["curves"]["contacts"]:
            total[int(a), int(b)] = total.get((int(a), int(b)), 0.0) + time_s / len(runs)
    widest = max(total.values(), default=1.0) or 1.0
    pairs = sorted(total, key=lambda pair: total[pair])
    air = [any(kinds[i] == "uav" for i in pair) for pair in pairs]
    one.add_collection(
        LineCollection(
            [[places[a], places[b]] for a, b in pairs],
            linewidths=[0.15 + 5.5 * total[pair] / widest for pair in pairs],
            colors=[_KINDS["uav"] if up else _KINDS["ugv"] for up in air],
            alpha=0.55,
            zorder=1,
        )
    )
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6.5, "zorder": 4}
    for name, kind, place in zip(names, kinds, places, strict=True):
        size = 19 if kind == "base" else 15
        one.plot(*place, "o", ms=size, color=_KINDS[kind], mec="white", mew=1.2, zorder=3)
        short = "base" if kind == "base" else name.removeprefix(kind).lstrip("0") or name
        one.text(*place, short, color="white", fontweight="bold", **style)
    said = f"{sum(total.values()) / 60:.0f} min of contact in all; widest {widest / 60:.1f} min"
    one.text(0, -1.42, said, ha="center", fontsize=8, color=FAINT)
    one.set_xlim(-1.7, 1.7)
    one.set_ylim(-1.6, 1.2)
    one.set_aspect("equal")
    one.set_axis_off()


def _around(kinds: Sequence[str]) -> list[tuple[float, float]]:
    """Ground robots on a circle; UAVs and the base station within."""
    ground = [index for index, kind in enumerate(kinds) if kind == "ugv"]
    inner = [index for index, kind in enumerate(kinds) if kind != "ugv"]
    places = {}
    for own, radius, turn in ((ground, 1.0, 0.0), (inner, 0.38 if len(inner) > 1 else 0.0, 0.9)):
        for place, index in enumerate(own):
            angle = turn + 2 * math.pi * place / max(len(own), 1)
            places[index] = (radius * math.sin(angle), radius * math.cos(angle))
    return [places[index] for index in range(len(kinds))]
